"""`eclsim import`: clinical data to the table of a cohort."""

from __future__ import annotations

from typing import Annotated

import typer


def import_data(
    file: Annotated[
        str,
        typer.Argument(
            metavar="BUNDLE.json|LONG.csv",
            help="A FHIR R4 bundle of Observations and Patients, or a table patient,time,code,value,unit.",
        ),
    ],
    out: Annotated[str, typer.Option("--out", metavar="COHORT.csv", help="The cohort to write.")],
    base: Annotated[
        str | None,
        typer.Option(
            metavar="CASE.toml",
            help="Gives the ECMO circuit, and sex, age, size and heart rate where the file has none.",
        ),
    ] = None,
    within: Annotated[
        float,
        typer.Option(min=0.0, metavar="MINUTES", help="Values up to so long after the first are one point."),
    ] = 5.0,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that exists.")] = False,
) -> None:
    """Turn clinical data into a cohort that `eclsim identify` takes.

    Reads heart rate, SP, DP, MAP, MPAP, PCWP, CO, ECMO flow, height and weight by LOINC or SNOMED CT code or
    by column name. Every conversion of a unit is said. Exit status: 0 written, 2 bad input, all mistakes
    at once and nothing written.
    """
    from datetime import timedelta

    from eclsim.cases.importing import as_table, import_cohort
    from eclsim.cases.reading import read_case
    from eclsim.cli.messages import fail, say, warn
    from eclsim.cli.output_option import destination
    from eclsim.files import write_text
    from eclsim.inputs.mistakes import CaseError

    destination("--out", out, force, (file, base))
    try:
        case = read_case(base).case if base is not None else None
        found = import_cohort(file, case, timedelta(minutes=within))
    except CaseError as error:
        fail(*error.mistakes)
    warn(found.warnings)
    warn(found.notes, "note")
    text = as_table(found.rows)
    write_text(text, out)
    if out == "-":
        return
    patients = len({row["patient_id"] for row in found.rows})
    say(f"{out}: {len(found.rows)} data points of {patients} patients")
