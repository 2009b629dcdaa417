"""Files that somebody chose in the browser, read in a process of their own with little memory and time.

A file of some kilobytes can unfold to gigabytes (compressed arrays, deep nesting). What goes wrong with one
then ends this process and nobody's page.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from eclsim.app.texts import text
from eclsim.inputs.mistakes import CaseError, Mistake

if TYPE_CHECKING:
    from eclsim.app.members import Members
    from eclsim.app.opening import Opened

MEMORY_BYTES = 1_500_000_000
"""Address space of the process, the libraries that read HDF5 included."""
SECONDS = 30.0
_POSTERIOR, _FILE = "posterior", "file"


def file_apart(name: str, content: bytes) -> Opened:
    """As `eclsim.app.opening.parse_file`.

    Raises:
        CaseError: With everything that is wrong, also where the file takes too much memory or time.
    """
    from eclsim.app.opening import Opened
    from eclsim.cases.case import Case

    found = _apart(_FILE, name, content)
    cases = tuple((label, Case.model_validate(case)) for label, case in found["cases"])
    return Opened(found["name"], cases, tuple(found["said"]))


def posterior_apart(name: str, content: bytes) -> Members:
    """As `eclsim.app.opening.open_posterior`.

    Raises:
        CaseError: As above.
    """
    import numpy as np

    from eclsim.app.members import Members

    found = _apart(_POSTERIOR, name, content)
    draws = np.array(found["draws"], dtype=float)
    return Members(tuple(found["names"]), draws, found["base"], found["method"], tuple(found["doubts"]))


def _apart(kind: str, name: str, content: bytes) -> dict[str, Any]:
    command = [sys.executable, "-m", "eclsim.app.uploads", kind, name.replace("\0", "")]
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    try:
        done = subprocess.run(
            command, input=content, capture_output=True, timeout=SECONDS, env=os.environ | threads,
            check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise _too_much(name) from None
    if done.returncode != 0:
        raise _too_much(name)
    found = json.loads(done.stdout)
    if "mistakes" in found:
        raise CaseError([Mistake(**mistake) for mistake in found["mistakes"]])
    return found


def _too_much(name: str) -> CaseError:
    from eclsim.app.opening import shown_name

    return CaseError([Mistake("", text("takes_too_much"), file=shown_name(name))])


def _limit_memory() -> None:
    """Where the operating system can; Windows cannot."""
    if sys.platform == "win32":
        return
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))


def _read(kind: str, name: str, content: bytes) -> Mapping[str, Any]:
    from eclsim.app.opening import open_posterior, parse_file

    try:
        if kind == _FILE:
            opened = parse_file(name, content)
            cases = [(label, case.as_mapping()) for label, case in opened.cases]
            return {"name": opened.name, "cases": cases, "said": opened.said}
        members = open_posterior(name, content)
        return asdict(members) | {"draws": members.draws.tolist()}
    except CaseError as error:
        return {"mistakes": [asdict(mistake) for mistake in error.mistakes]}


def _main() -> None:
    _limit_memory()
    kind, name = sys.argv[1:]
    print(json.dumps(_read(kind, name, sys.stdin.buffer.read())))


if __name__ == "__main__":
    _main()
