"""Reading the case files of a command line, with everything there is to say about them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from eclsim.cli.messages import BAD_INPUT, fail, say, warn

if TYPE_CHECKING:
    from eclsim.cases import Case, CaseReading, Mistake


def read_all(
    files: Sequence[str], settings: Sequence[str], volume_policy: str | None = None
) -> list[CaseReading]:
    """Read every case; with any mistake in any of them say all and leave with exit status 2.

    `settings` and `volume_policy` win over the files, and a note says so.
    """
    readings = read_each([(file, settings, volume_policy) for file in files])
    for reading in readings:
        warn(reading.warnings)
        warn(reading.notes, "note")
    warn(_id_collisions(readings))
    return readings


def read_each(
    wanted: Iterable[tuple[str, Sequence[str], str | None]],
    renamed: Callable[[Mistake], Mistake] = lambda mistake: mistake,
) -> list[CaseReading]:
    """Read cases, each a file with settings and a policy; what warnings and notes say is left to the caller.

    Args:
        wanted: files, settings and blood volume policies, as `read_case` takes them.
        renamed: what a mistake is said as.
    """
    from eclsim.cases import CaseError, read_case

    readings: list[CaseReading] = []
    mistakes: list[Mistake] = []
    for file, settings, policy in wanted:
        try:
            readings.append(read_case(file, settings, policy))
        except CaseError as error:
            mistakes += [renamed(mistake) for mistake in error.mistakes]
    if mistakes:
        for mistake in dict.fromkeys(mistakes):
            say(mistake)
        raise SystemExit(BAD_INPUT)
    return readings


def with_speeds(readings: Sequence[CaseReading], policy: str | None = None) -> list[CaseReading]:
    """The cases with the pump speed that gives their target flow, where they name one; a note says it.

    The flow is that under `policy`, or else under the policy of each case. With a flow that cannot be reached
    leave with exit status 2.
    """
    if not any(reading.case.ecmo and reading.case.ecmo.flow_l_min is not None for reading in readings):
        return list(readings)
    from dataclasses import replace

    from eclsim.simulation.target_flow import FlowNotReachedError, with_speed

    solved, wrong = [], []
    for reading in readings:
        try:
            case, found = with_speed(reading.case, policy)
        except FlowNotReachedError as error:
            wrong.append(f"{reading.file}: {error}")
            continue
        solved.append(replace(reading, case=case))
        if found is not None:
            warn([f"{reading.file}: {found} ({policy or case.volume_policy}); this speed is held"], "note")
    if wrong:
        fail(*wrong)
    return solved


def _id_collisions(readings: Iterable[CaseReading]) -> list[str]:
    """Ids that differ, but that a reader would take for the same."""
    from eclsim.cases.ids import plain_id

    first: dict[str, CaseReading] = {}
    said = []
    for reading in readings:
        name = reading.case.patient.id
        known = first.setdefault(plain_id(name), reading)
        if known.case.patient.id != name:
            said.append(
                f"{reading.file}: patient.id '{name}' differs from '{known.case.patient.id}' in {known.file} "
                "in case, spaces or Unicode form alone"
            )
    return said


def waveforms_of(case: Case) -> list[str]:
    """Names of the waveforms that a case has: P, Q or V and compartment or connection."""
    from eclsim.patient.sites import PATIENT_SITES

    nodes, others = list(PATIENT_SITES), []
    for one in case.instances():
        own = one.device.compartments
        nodes += [one.place(name) for name in own]
        others += [one.place(name) for name in one.device.connections if name not in own]
    flows_and_pressures = [quantity + name for quantity in "PQ" for name in (*nodes, *others)]
    return flows_and_pressures + ["V" + name for name in nodes]


def waveforms_to_save(names: str | None, cases: Sequence[Case]) -> list[str] | None:
    """The names of --save, or None for all; a name that no case has is an error."""
    if names is None:
        return None
    from eclsim.parameters import did_you_mean

    wanted = [name.strip() for name in names.split(",") if name.strip()]
    known = list(dict.fromkeys(name for case in cases for name in waveforms_of(case)))
    wrong = []
    for name in wanted:
        if name not in known:
            hint = did_you_mean(name, known)
            wrong.append(f"--save {name}: no such waveform" + (f"; did you mean {hint}?" if hint else ""))
    if not wanted:
        wrong.append("--save: no names; allowed: waveforms such as Pao,Qlv,Vlv")
    if wrong:
        fail(*wrong, f"--save allowed: {', '.join(known)}")
    return wanted
