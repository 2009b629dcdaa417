"""Reading the case files of a command line, with everything there is to say about them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from eclsim.cli.messages import BAD_INPUT, fail, say, warn

if TYPE_CHECKING:
    from eclsim.patients import Case, CaseReading, Mistake


def read_all(files: Sequence[str], settings: Sequence[str]) -> list[CaseReading]:
    """Read every case; with any mistake in any of them say all and leave with exit status 2."""
    from eclsim.patients import CaseError, read_case

    readings: list[CaseReading] = []
    mistakes: list[Mistake] = []
    for file in files:
        try:
            readings.append(read_case(file, settings))
        except CaseError as error:
            mistakes += error.mistakes
    if mistakes:
        for mistake in dict.fromkeys(mistakes):
            say(mistake)
        raise SystemExit(BAD_INPUT)
    for reading in readings:
        warn(reading.warnings)
        warn(reading.notes, "note")
    warn(_id_collisions(readings))
    return readings


def _id_collisions(readings: Iterable[CaseReading]) -> list[str]:
    """Cases that a reader would take for the same: ids equal but for case and spaces."""
    import unicodedata

    first: dict[str, CaseReading] = {}
    said = []
    for reading in readings:
        name = reading.case.patient.id
        same = unicodedata.normalize("NFKC", "".join(name.split())).casefold()
        if same in first:
            said.append(f"{reading.file}: patient.id is the same as in {first[same].file}")
        first.setdefault(same, reading)
    return said


def waveforms_of(case: Case) -> list[str]:
    """Names of the waveforms that a case has: P, Q or V and compartment or connection."""
    from eclsim.patients.fields import ECMO_POSITIONS, PATIENT_SITES

    nodes, pumps = list(PATIENT_SITES), []
    if case.ecmo is not None:
        nodes += ECMO_POSITIONS.values()
        pumps.append("ecmopump")
    if case.crrt is not None:
        nodes += ["crrttuin", "crrttupf", "crrtfil", "crrttuout"]
        pumps.append("crrtpump")
    if case.lvad is not None:
        pumps.append("lvadpump")
    flows_and_pressures = [quantity + name for quantity in "PQ" for name in (*nodes, *pumps)]
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
