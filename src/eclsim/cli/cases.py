"""Reading of case files and tables for commands, with their errors, warnings and notes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from eclsim.cli.console import fail, note, refuse, say, warn
from eclsim.inputs.mistakes import CaseError

if TYPE_CHECKING:
    from eclsim.cases import CaseReading, Mistake
    from eclsim.cases.cohort import CohortReading


def is_table(file: str) -> bool:
    """Whether a file is a table of measurements, by its suffix."""
    return Path(file).suffix.lower() in (".csv", ".tsv")


def read_all(
    files: Sequence[str],
    settings: Sequence[str],
    volume_policy: str | None = None,
    mistakes: Collection[object] = (),
) -> list[CaseReading]:
    """Read all cases; if there are errors, report all of them and exit with status 2.

    Args:
        files: case files.
        settings: settings that override the files, with a note.
        volume_policy: blood volume policy that overrides the files, with a note.
        mistakes: errors in the options of the command, reported here only together with those of the cases.
    """
    readings = read_each([(file, settings, volume_policy) for file in files], mistakes=mistakes)
    for reading in readings:
        warn(reading.warnings)
        note(reading.notes)
    warn(_id_collisions(readings))
    return readings


def case_files_in(place: str) -> list[str]:
    """Return a file itself, or the case files of a folder; exit with status 2 if it has none."""
    if not Path(place).is_dir():
        return [place]
    if files := sorted(str(path) for path in Path(place).glob("*.toml")):
        return files
    fitted = Path(place) / "cases"  # as written by `eclsim identify --out`
    hint = f"; {fitted} holds some" if any(fitted.glob("*.toml")) else ""
    fail(f"{place}: holds no case file (*.toml){hint}")


def read_each(
    sources: Iterable[tuple[str, Sequence[str], str | None]],
    renamed: Callable[[Mistake], Mistake] = lambda mistake: mistake,
    mistakes: Collection[object] = (),
) -> list[CaseReading]:
    """Read cases, each from a file with settings and a policy; the caller reports warnings and notes.

    Args:
        sources: file, settings and blood volume policy of each case, as for `read_case`.
        renamed: converts an error before it is reported, such as its names.
        mistakes: errors in the options of the command, reported here only together with those of the cases.
    """
    from eclsim.cases import read_case

    readings: list[CaseReading] = []
    wrong: dict[Mistake, None] = {}
    for file, settings, policy in sources:
        try:
            readings.append(read_case(file, settings, policy))
        except CaseError as error:
            wrong |= dict.fromkeys(map(renamed, error.mistakes))
    if wrong:
        fail(*wrong, *mistakes)
    return readings


def read_usable_cohort(file: str, mistakes: Collection[object] = ()) -> CohortReading:
    """Read a cohort's table and report its refused rows; exit with status 2 if no row is usable.

    Errors in the options of the command are reported here only together with those of the table.
    """
    from eclsim.cases.cohort import read_cohort

    try:
        reading = read_cohort(file)
    except CaseError as error:
        fail(*error.mistakes, *mistakes)
    for mistake in reading.refused:
        say(f"refused: {mistake}")
    warn(reading.warnings)
    note(reading.notes)
    if not reading.points:
        fail(f"{file}: no row can be used", *mistakes)
    return reading


def with_speeds(readings: Sequence[CaseReading], policy: str | None = None) -> list[CaseReading]:
    """Replace target pump flows of cases by the speeds that give them, with a note.

    The flow is reached under `policy`, or else under the policy of each case. Exit with status 2 if a flow
    cannot be reached.
    """
    solved, reasons = with_reachable_speeds(readings, policy)
    refuse([f"{reading.file}: {reason}" for reading, reason in reasons])
    return solved


def with_reachable_speeds(
    readings: Sequence[CaseReading], policy: str | None = None
) -> tuple[list[CaseReading], list[tuple[CaseReading, str]]]:
    """As `with_speeds`, with the cases whose flow cannot be reached beside the others, and the reasons."""
    if not any(reading.case.targets() for reading in readings):
        return list(readings), []

    from eclsim.simulation.target_flow import FlowNotReachedError, with_speed

    solved, reasons = [], []
    for reading in readings:
        try:
            case, speed = with_speed(reading.case, policy)
        except FlowNotReachedError as error:
            reasons.append((reading, str(error)))
            continue
        solved.append(replace(reading, case=case))
        if speed is not None:
            note([f"{reading.file}: {speed} ({policy or case.volume_policy}); this speed is held"])
    return solved, reasons


def warn_of_new_findings(reading: CaseReading, lines: Iterable[object], at: str = "") -> None:
    """Show warnings of results, except those that were shown when their case was read."""
    from eclsim.devices.description import placed_sentence

    fresh = (str(line) for line in lines if line not in reading.case.doubts)
    warn(placed_sentence(f"{reading.file}{at}", line) for line in fresh)


def names_of(text: str | None) -> tuple[str, ...] | None:
    """Split names at commas; return None if there are none."""
    return tuple(name.strip() for name in (text or "").split(",") if name.strip()) or None


def _id_collisions(readings: Iterable[CaseReading]) -> list[str]:
    """Return warnings about different ids that a reader would take to be the same."""
    from eclsim.cases.cohort import plain_id

    first: dict[str, CaseReading] = {}
    lines = []
    for reading in readings:
        name = reading.case.patient.id
        known = first.setdefault(plain_id(name), reading)
        if known.case.patient.id != name:
            lines.append(
                f"{reading.file}: patient.id '{name}' differs from '{known.case.patient.id}' in "
                f"{known.file} only in case, spaces or Unicode form"
            )
    return lines
