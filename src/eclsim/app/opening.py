"""Opening a case file or a cohort that somebody chose in the browser."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from eclsim.app.texts import text
from eclsim.cases.reading import read_case
from eclsim.inputs.mistakes import CaseError, Mistake

if TYPE_CHECKING:
    from eclsim.app.members import Members
    from eclsim.cases.case import Case

LARGEST_FILE = 5_000_000
SIZE = "5 MB"
MOST_SAID = 12
MOST_ROWS = 2000


@dataclass(frozen=True)
class Opened:
    """What a file held.

    Args:
        name: of the file.
        cases: name and case of each data point; one of a case file.
        said: doubts and refused rows.
    """

    name: str
    cases: tuple[tuple[str, Case], ...]
    said: tuple[str, ...]


def open_file(name: str, content: bytes) -> Opened:
    """Read a case file or a cohort, and solve for the speed where a case gives a flow.

    Raises:
        CaseError: With everything that is wrong, the place called by the file's own name.
    """
    return with_speeds(parse_file(name, content))


def parse_file(name: str, content: bytes) -> Opened:
    """A case file or a cohort as it stands, without computing anything.

    Raises:
        CaseError: With everything that is wrong, the place called by the file's own name.
    """
    shown, suffix = _checked_name(name, content, (".toml", ".csv"))
    with tempfile.TemporaryDirectory(prefix="eclsim-") as folder:
        path = Path(folder) / f"upload{suffix}"
        path.write_bytes(content)
        try:
            return _case(path, shown) if suffix == ".toml" else _cohort(path, shown)
        except CaseError as error:
            raise CaseError([replace(m, file=shown) for m in error.mistakes]) from None


def open_posterior(name: str, content: bytes) -> Members:
    """Read a `posterior.nc`.

    Raises:
        CaseError: If it is none.
    """
    from eclsim.app.members import read_members

    shown, _ = _checked_name(name, content, (".nc",))
    return read_members(shown, content)


def shown_name(name: str) -> str:
    """What a file is called on the page: its name without folders."""
    return Path(name.replace("\\", "/")).name[:80] or "file"


def _checked_name(name: str, content: bytes, suffixes: tuple[str, ...]) -> tuple[str, str]:
    """The file's own name and suffix."""
    shown = shown_name(name)
    suffix = Path(shown).suffix.lower()
    if suffix not in suffixes:
        raise _refused(text("wrong_type", name=shown))
    if not content:
        raise _refused(text("empty_file", name=shown))
    if len(content) > LARGEST_FILE:
        raise _refused(text("too_large", name=shown, size=SIZE))
    return shown, suffix


def with_speeds(opened: Opened) -> Opened:
    """The same with the speed of the pump where the one case gives a flow.

    Raises:
        CaseError: The flow cannot be reached.
    """
    from eclsim.simulation.target_flow import FlowNotReachedError, with_speed

    if len(opened.cases) != 1:
        return opened
    ((name, case),) = opened.cases
    try:
        case, found = with_speed(case)
    except FlowNotReachedError as error:
        raise _refused(f"{opened.name}: {error}") from None
    said = [f"{opened.name}: {found}"] if found is not None else []
    return replace(opened, cases=((name, case),), said=(*opened.said, *said))


def _case(path: Path, shown: str) -> Opened:
    reading = read_case(path)
    said = [str(replace(m, file=shown)) for m in reading.warnings]
    return Opened(shown, ((reading.case.patient.id, reading.case),), tuple(said))


def _cohort(path: Path, shown: str) -> Opened:
    from eclsim.cases.cohort import read_cohort

    reading = read_cohort(path)
    said = [str(replace(m, file=shown)) for m in (*reading.refused, *reading.warnings)]
    if not reading.points:
        raise CaseError(reading.refused or [Mistake("", "no data points")])
    points = tuple((point.name, point.case) for point in reading.points[:MOST_ROWS])
    return Opened(shown, points, tuple(said))


def _refused(why: str) -> CaseError:
    return CaseError([Mistake("", why)])


def brief(lines: tuple[str, ...] | list[str]) -> list[str]:
    """The first lines, and how many more there are."""
    if len(lines) <= MOST_SAID:
        return list(lines)
    return [*lines[:MOST_SAID], f"… {len(lines) - MOST_SAID} more"]
