"""Reading the case files and tables of a command line, with mistakes, warnings and notes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from eclsim.cli.console import BAD_INPUT, fail, note, refuse, say, warn

if TYPE_CHECKING:
    from eclsim.cases import CaseReading, Mistake
    from eclsim.cases.cohort import CohortReading

TABLES = (".csv", ".tsv")


def read_all(
    files: Sequence[str], settings: Sequence[str], volume_policy: str | None = None
) -> list[CaseReading]:
    """Read every case; report all mistakes and leave with exit status 2.

    `settings` and `volume_policy` win over the files, and a note says so.
    """
    readings = read_each([(file, settings, volume_policy) for file in files])
    for reading in readings:
        warn(reading.warnings)
        note(reading.notes)
    warn(_id_collisions(readings))
    return readings


def case_files_in(place: str) -> list[str]:
    """A file itself, or the case files of a folder; without any leave with exit status 2."""
    if not Path(place).is_dir():
        return [place]
    if files := sorted(str(path) for path in Path(place).glob("*.toml")):
        return files
    fitted = Path(place) / "cases"  # as `eclsim identify --out` leaves them
    hint = f"; {fitted} holds some" if any(fitted.glob("*.toml")) else ""
    fail(f"{place}: holds no case file (*.toml){hint}")


def read_each(
    sources: Iterable[tuple[str, Sequence[str], str | None]],
    renamed: Callable[[Mistake], Mistake] = lambda mistake: mistake,
) -> list[CaseReading]:
    """Read cases, each a file with settings and a policy; what warnings and notes say is left to the caller.

    Args:
        sources: files, settings and blood volume policies, as `read_case` takes them.
        renamed: names to use in mistakes.
    """
    from eclsim.cases import CaseError, read_case

    readings: list[CaseReading] = []
    mistakes: list[Mistake] = []
    for file, settings, policy in sources:
        try:
            readings.append(read_case(file, settings, policy))
        except CaseError as error:
            mistakes += [renamed(mistake) for mistake in error.mistakes]
    if mistakes:
        for mistake in dict.fromkeys(mistakes):
            say(mistake)
        raise SystemExit(BAD_INPUT)
    return readings


def read_table(file: str) -> CohortReading:
    """Read a cohort's table, saying which rows are refused; without any other leave with status 2."""
    from eclsim.cases.cohort import read_cohort
    from eclsim.inputs.mistakes import CaseError

    try:
        reading = read_cohort(file)
    except CaseError as error:
        fail(*error.mistakes)
    for mistake in reading.refused:
        say(f"refused: {mistake}")
    warn(reading.warnings)
    note(reading.notes)
    if not reading.points:
        fail(f"{file}: no row can be used")
    return reading


def with_speeds(readings: Sequence[CaseReading], policy: str | None = None) -> list[CaseReading]:
    """The cases with the pump speed that gives their target flow, where they name one; a note says it.

    The flow is that under `policy`, or else under the policy of each case. With a flow that cannot be reached
    leave with exit status 2.
    """
    if not any(reading.case.targets() for reading in readings):
        return list(readings)
    from dataclasses import replace

    from eclsim.simulation.target_flow import FlowNotReachedError, with_speed

    solved, wrong = [], []
    for reading in readings:
        try:
            case, speed = with_speed(reading.case, policy)
        except FlowNotReachedError as error:
            wrong.append(f"{reading.file}: {error}")
            continue
        solved.append(replace(reading, case=case))
        if speed is not None:
            note([f"{reading.file}: {speed} ({policy or case.volume_policy}); this speed is held"])
    refuse(wrong)
    return solved


def warn_of_new_findings(reading: CaseReading, lines: Iterable[object], at: str = "") -> None:
    """Show warnings of results, but for doubts that were shown when their case was read."""
    warn(f"{reading.file}{at}: {line}" for line in lines if line not in reading.case.doubts)


def names_of(text: str | None) -> tuple[str, ...] | None:
    """Names with commas between; None if there are none."""
    return tuple(name.strip() for name in (text or "").split(",") if name.strip()) or None


def _id_collisions(readings: Iterable[CaseReading]) -> list[str]:
    """Ids that differ, but that a reader would take for the same."""
    from eclsim.cases.cohort_rows import plain_id

    first: dict[str, CaseReading] = {}
    lines = []
    for reading in readings:
        name = reading.case.patient.id
        known = first.setdefault(plain_id(name), reading)
        if known.case.patient.id != name:
            lines.append(
                f"{reading.file}: patient.id '{name}' differs from '{known.case.patient.id}' in {known.file} "
                "in case, spaces or Unicode form alone"
            )
    return lines
