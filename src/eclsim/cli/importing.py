"""`eclsim import`: clinical data to the table of a cohort."""

from __future__ import annotations

from dataclasses import dataclass

from eclsim.cli.console import fail, note, say, warn
from eclsim.cli.destination import STANDARD_OUTPUT, Destinations
from eclsim.cli.options import Force, argument, option


@dataclass(frozen=True, kw_only=True)
class ImportOptions(Force):
    """Options of `eclsim import`."""

    file: str = argument(
        ...,
        "BUNDLE.json|LONG.csv",
        "A FHIR R4 bundle of Observations and Patients, or a table patient,time,code,value,unit.",
    )
    out: str = option(..., "The cohort to write.", "--out", metavar="COHORT.csv")
    base: str | None = option(
        None,
        "Gives the devices, and sex, age, size and heart rate where the file has none.",
        metavar="CASE.toml",
    )
    within: float = option(
        5.0, "Values up to so long after the first are one point.", metavar="MINUTES", minimum=0.0
    )


def import_data(options: ImportOptions) -> None:
    """Turn clinical data into a cohort that `eclsim identify` takes.

    Reads heart rate, SP, DP, MAP, MPAP, PCWP, CO, ECMO flow, height and weight by LOINC or SNOMED CT code or
    by column name. Every conversion of a unit is said. Exit status: 0 written, 2 bad input, all mistakes
    at once and nothing written.
    """
    from datetime import timedelta

    from eclsim.cases.importing import as_table, import_cohort
    from eclsim.cases.reading import read_case
    from eclsim.files import write_text
    from eclsim.inputs.mistakes import CaseError

    places = Destinations(force=options.force, inputs=[options.file, options.base])
    target = places.target("--out", options.out)
    places.check()
    try:
        case = read_case(options.base).case if options.base is not None else None
        cohort = import_cohort(options.file, case, timedelta(minutes=options.within))
    except CaseError as error:
        fail(*error.mistakes)
    warn(cohort.warnings)
    note(cohort.notes)
    write_text(as_table(cohort.rows), target or STANDARD_OUTPUT)
    if target != STANDARD_OUTPUT:
        patients = len({row["patient_id"] for row in cohort.rows})
        say(f"{target}: {len(cohort.rows)} data points of {patients} patients")
