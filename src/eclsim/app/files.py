"""Opening and exporting of files. Opened files are read in a separate process.

A file of some kilobytes can expand to gigabytes (compressed arrays, deep nesting). A failure then ends that
process and not the page.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.app.provenance import marked_id, measured_values, provenance
from eclsim.app.texts import text, with_minus
from eclsim.cases.case import Case
from eclsim.cases.fit_mark import FitMark
from eclsim.cases.reading import MAXIMUM_BYTES, case_text, read_case
from eclsim.files import file_stems, write_json
from eclsim.inputs.files import size_in_words
from eclsim.inputs.mistakes import CaseError, Mistake
from eclsim.inputs.sections import NOT_FITTED
from eclsim.orbit.model import values_of

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.app.beat import Beat
    from eclsim.app.posterior import PosteriorDraws
    from eclsim.app.state import PageState

LARGEST_FILE = 5_000_000
LARGEST_FILE_TEXT = size_in_words(LARGEST_FILE)
LARGEST_CASE_TEXT = size_in_words(MAXIMUM_BYTES)
MOST_LINES = 12
MOST_ROWS = 2000
MEMORY_BYTES = 1_500_000_000
"""Largest address space of the reading process [bytes], including the HDF5 libraries."""
SECONDS = 30.0
KINDS = ("case", "outputs", "waveforms", "svg", "png", "study", "course")


@dataclass(frozen=True)
class OpenedFile:
    """Content of an opened file.

    Args:
        name: name of the file.
        cases: name and case of each data point; a single one for a case file.
        remarks: warnings and refused rows.
        fit: verdict in a case file on the fit that gave its parameters.
    """

    name: str
    cases: tuple[tuple[str, Case], ...]
    remarks: tuple[str, ...]
    fit: FitMark | None = None


class ExportError(ValueError):
    """Reason why a file cannot be exported for this patient."""


# --- in the process of the page ------------------------------------------------------------------


def read_file(name: str, content: bytes) -> OpenedFile:
    """Run `parse_file` in a separate process.

    Raises:
        CaseError: The file has errors, all of which are listed, or reading takes too much memory or time.
    """
    plain = _read_in_own_process("file", name, content)
    cases = tuple((label, Case.model_validate(case)) for label, case in plain["cases"])
    fit = FitMark(**plain["fit"]) if plain["fit"] else None
    return OpenedFile(plain["name"], cases, tuple(plain["remarks"]), fit)


def read_posterior_file(name: str, content: bytes) -> PosteriorDraws:
    """Run `parse_posterior` in a separate process.

    Raises:
        CaseError: As for `read_file`.
    """
    from eclsim.app.posterior import PosteriorDraws

    plain = _read_in_own_process("posterior", name, content)
    draws = np.array(plain["draws"], dtype=float)
    return PosteriorDraws(
        tuple(plain["names"]), draws, plain["base"], plain["method"], tuple(plain["doubts"])
    )


def _read_in_own_process(kind: str, name: str, content: bytes) -> dict[str, Any]:
    command = [sys.executable, "-m", "eclsim.app.files", kind, name.replace("\0", "")]
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    too_much = CaseError([Mistake("", text("takes_too_much"), file=shown_name(name))])
    try:
        done = subprocess.run(
            command, input=content, capture_output=True, timeout=SECONDS, env=os.environ | threads,
            check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise too_much from None
    if done.returncode != 0:
        raise too_much
    reply = json.loads(done.stdout)
    if "mistakes" in reply:
        raise CaseError([Mistake(**mistake) for mistake in reply["mistakes"]])
    return reply


def with_speeds(opened: OpenedFile) -> OpenedFile:
    """Replace the target flow of a single case by the pump speed that gives it.

    Raises:
        CaseError: The flow cannot be reached.
    """
    from eclsim.simulation.target_flow import FlowNotReachedError, with_speed

    if len(opened.cases) != 1:
        return opened
    ((name, case),) = opened.cases
    try:
        case, speed = with_speed(case)
    except FlowNotReachedError as error:
        raise _refused(f"{opened.name}: {error}") from None
    remarks = [f"{opened.name}: {speed}"] if speed is not None else []
    return replace(opened, cases=((name, case),), remarks=(*opened.remarks, *remarks))


def shown_name(name: str) -> str:
    """Return the displayed name of a file: without folders, with unprintable characters replaced by "?"."""
    printed = "".join(letter if letter.isprintable() else "?" for letter in name)
    return Path(printed.replace("\\", "/")).name[:80] or "file"


def shortened(lines: Sequence[str], most: int = MOST_LINES) -> list[str]:
    """Return the first lines, followed by the number of further ones."""
    more = [f"… {len(lines) - most} more"] if len(lines) > most else []
    return [*map(with_minus, lines[:most]), *more]


# --- in the process that reads -------------------------------------------------------------------


def parse_file(name: str, content: bytes) -> OpenedFile:
    """Read a case file or a cohort without computing anything.

    Raises:
        CaseError: The file has errors; all are listed, with the file's own name as place.
    """
    shown, suffix = _checked_name(name, content, (".toml", ".csv"))
    with tempfile.TemporaryDirectory(prefix="eclsim-") as folder:
        path = Path(folder) / f"upload{suffix}"
        path.write_bytes(content)
        try:
            cases, remarks, fit = _case(path) if suffix == ".toml" else _cohort(path)
        except CaseError as error:
            raise CaseError([replace(m, file=shown) for m in error.mistakes]) from None
    return OpenedFile(shown, cases, tuple(str(replace(m, file=shown)) for m in remarks), fit)


def parse_posterior(name: str, content: bytes) -> PosteriorDraws:
    """Read a `posterior.nc`.

    Raises:
        CaseError: The file is not a valid posterior.
    """
    from eclsim.app.posterior import read_posterior

    shown, _ = _checked_name(name, content, (".nc",))
    return read_posterior(shown, content)


_Contents = tuple[tuple[tuple[str, "Case"], ...], Sequence[Mistake], FitMark | None]


def _case(path: Path) -> _Contents:
    """Read a case file; a doubt about its fit is shown with the origin of its numbers, not as a remark."""
    reading = read_case(path)
    remarks = [mistake for mistake in reading.warnings if mistake.message not in reading.case.doubts]
    remarks += [note for note in reading.notes if note.message == NOT_FITTED]
    return ((reading.case.patient.id, reading.case),), remarks, reading.case.fit_mark


def _cohort(path: Path) -> _Contents:
    from eclsim.cases.cohort import read_cohort

    reading = read_cohort(path)
    if not reading.points:
        raise CaseError(reading.refused or [Mistake("", "no data points")])
    points = tuple((point.name, point.case) for point in reading.points[:MOST_ROWS])
    return points, (*reading.refused, *reading.warnings), None


def _checked_name(name: str, content: bytes, suffixes: tuple[str, ...]) -> tuple[str, str]:
    """Check name, suffix and size of a file, and return its displayed name and its suffix."""
    shown = shown_name(name)
    suffix = Path(shown).suffix.lower()
    if suffix not in suffixes:
        raise _refused(text("wrong_type", name=shown))
    if not content:
        raise _refused(text("empty_file", name=shown))
    if len(content) > LARGEST_FILE:
        raise _refused(text("too_large", name=shown, size=LARGEST_FILE_TEXT))
    return shown, suffix


def _refused(reason: str) -> CaseError:
    return CaseError([Mistake("", reason)])


def _limit_memory() -> None:
    """Limit the memory of this process, except on Windows, which does not support it."""
    if sys.platform == "win32":
        return
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))


def _plain(kind: str, name: str, content: bytes) -> Mapping[str, Any]:
    try:
        if kind == "file":
            opened = parse_file(name, content)
            cases = [(label, case.as_mapping()) for label, case in opened.cases]
            fit = asdict(opened.fit) if opened.fit else None
            return {"name": opened.name, "cases": cases, "remarks": opened.remarks, "fit": fit}
        posterior = parse_posterior(name, content)
        return asdict(posterior) | {"draws": posterior.draws.tolist()}
    except CaseError as error:
        return {"mistakes": [asdict(mistake) for mistake in error.mistakes]}


# --- to take away --------------------------------------------------------------------------------


def export(state: PageState, kind: str, minutes: int = 0, shown: Beat | None = None) -> tuple[str, bytes]:
    """Return name and content of an exported file.

    Args:
        state: state of the page.
        kind: one of `KINDS`.
        minutes: duration of the course [min]; 0 for that of `usual_length`.
        shown: beat of the page at the start, with which that of the exported case is compared.

    Raises:
        ExportError: There is no such file for the state.
    """
    about = " ".join(provenance(state)["text"].split())
    state = replace(state, case=_as_shown(state))
    (stem,) = file_stems([state.case.patient.id])
    if kind == "case":
        return f"{stem}.toml", _case_with_origin(state, about, stem, minutes, shown).encode()
    if kind in ("outputs", "waveforms"):
        return _table(state, kind, stem)
    if kind in ("svg", "png"):
        return _figures(state, kind, stem)
    if kind == "study":
        return _study(state, stem)
    if kind == "course":
        return _course(state, about, stem, minutes, shown)
    raise ExportError(f"no such file: {kind[:20]}")


def _case_with_origin(state: PageState, about: str, stem: str, minutes: int, shown: Beat | None) -> str:
    """Return a case file that begins with the origin of its numbers and how to get the page's from it."""
    from eclsim.app.beat import compute_beat

    outputs: Mapping[str, float] = {}
    if shown is not None:
        anew = compute_beat(state)
        outputs = anew.outputs if anew.converged else {}
    has_course = bool(state.case.events)
    return _case_file(state, about, _replay(state, stem, minutes) if has_course else "", shown, outputs)


def _case_file(
    state: PageState, about: str, replay: str, shown: Beat | None, outputs: Mapping[str, float]
) -> str:
    """Return a case file with what must be known of its numbers in its first lines.

    Args:
        state: state of the page.
        about: origin of the numbers.
        replay: line on how to get the page's course; empty for none.
        shown: beat of the page.
        outputs: outputs of the beat computed anew, with which it is compared.
    """
    from eclsim.app.course import another_start

    known = measured_values(state)
    is_before = known["measured"] and known["measured_before"]
    lines = (
        about,
        *_device_line(state.case),
        text("export_measured_before") if is_before else "",
        replay,
        another_start(state.case, shown, outputs),
    )
    return "".join(f"# {line}\n" for line in lines if line) + case_text(state.case)


def _replay(state: PageState, stem: str, minutes: int) -> str:
    from eclsim.app.course import replay_command

    return f"{text('export_replay')} {replay_command(state.case, stem, minutes)}"


def _device_line(case: Case) -> list[str]:
    """Return a sentence on the files of the user's own devices without which the case cannot be read."""
    from eclsim.app.course import device_options

    options = device_options(case)
    return [text("export_devices", options=options)] if options else []


def _as_shown(state: PageState) -> Case:
    """Return the case with its beat's policy and an id that states the fit's verdict and changes by hand."""
    case = state.case
    if case.volume_policy != state.policy:
        case = case.with_volume_policy(state.policy)
    if state.changed:
        changed = {"blood_volume_policy": case.blood_volume_policy}
        case = _with_set_points(state.computed_case.model_copy(update=changed))
    person = case.patient.model_copy(update={"id": marked_id(state)})
    return case.model_copy(update={"patient": person})


def _with_set_points(case: Case) -> Case:
    """Return the case with the set points used on the page, as a file has no record of the case as opened."""
    if case.as_written is None or case.regulation is None:
        return case

    return case.with_set_points(values_of(case))


def _table(state: PageState, kind: str, stem: str) -> tuple[str, bytes]:
    from eclsim.simulation.files import write_csv

    with tempfile.TemporaryDirectory(prefix="eclsim-") as folder:
        write_csv([_simulated(state)], [], Path(folder), [stem], None)
        name = f"{stem}_waveforms.csv" if kind == "waveforms" else "outputs.csv"
        return f"{stem}_{kind}.csv", (Path(folder) / name).read_bytes()


def _figures(state: PageState, kind: str, stem: str) -> tuple[str, bytes]:
    from eclsim.simulation.files import write_figures

    with tempfile.TemporaryDirectory(prefix="eclsim-") as folder:
        write_figures([state.case], [_simulated(state)], Path(folder), [stem])
        return f"{stem}_figures_{kind}.zip", _zipped(sorted(Path(folder).rglob(f"*.{kind}")))


def _study(state: PageState, stem: str) -> tuple[str, bytes]:
    from eclsim.crrt_study.report import PAGE, drawings, study_page
    from eclsim.crrt_study.schemes import StudyError
    from eclsim.crrt_study.study import crrt_study

    try:
        study = crrt_study(state.case, volume_policy=state.policy)
    except StudyError as error:
        raise ExportError(str(error)) from None
    return f"{stem}_{PAGE}", study_page(study, drawings(study)).encode()


def _course(state: PageState, about: str, stem: str, minutes: int, shown: Beat | None) -> tuple[str, bytes]:
    from eclsim.app.course import compute_course, first_outputs, usual_length
    from eclsim.course.files import course_object, write_figure, write_tables

    try:
        minutes = minutes or usual_length(state.case)
        result = compute_course(state, minutes).computed.result
    except CaseError as error:
        raise ExportError(str(error)) from None
    with tempfile.TemporaryDirectory(prefix="eclsim-") as place:
        folder = Path(place)
        case = _case_file(state, about, _replay(state, stem, minutes), shown, first_outputs(result))
        (folder / f"{stem}.toml").write_text(case, encoding="utf-8")
        write_json(course_object(result), folder / f"{stem}_course.json")
        write_tables(result, folder, f"{stem}_course")
        write_figure(result, folder, f"{stem}_course")
        return f"{stem}_course.zip", _zipped(sorted(folder.iterdir()))


def _zipped(paths: Sequence[Path]) -> bytes:
    packed = BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in paths:
            archive.write(path, path.name)
    return packed.getvalue()


def _simulated(state: PageState) -> xr.Dataset:
    from eclsim.simulation.single import simulate

    return simulate(state.case, volume_policy=state.policy)


if __name__ == "__main__":
    _limit_memory()
    print(json.dumps(_plain(sys.argv[1], sys.argv[2], sys.stdin.buffer.read())))
