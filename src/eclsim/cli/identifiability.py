"""`eclsim identifiability`: which parameters a set of measurements can tell apart."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

VolumePolicy = Literal["as_published", "patient_held"]


def identifiability(
    case_file: Annotated[str, typer.Argument(metavar="CASE.toml", help="Case file.")],
    parameters: Annotated[
        str | None, typer.Option(metavar="NAMES", help="Parameters in question; left out, the paper's 24.")
    ] = None,
    outputs: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES", help="What is measured; left out, the case's measurements, or all seven."
        ),
    ] = None,
    uncertainty: Annotated[
        str | None,
        typer.Option(
            metavar="NAME=VALUE,...",
            help="Standard uncertainties of measurements: SP=4,CO=10% [mmHg, L/min or %]. "
            "Defaults: SP=4,DP=4,MAP=3,MPAP=2,PCWP=2 mmHg, CO=10 %, PF=5 %.",
        ),
    ] = None,
    limit: Annotated[
        float, typer.Option(min=1.0, help="Largest collinearity index of a set that can be told apart.")
    ] = 10.0,
    threshold: Annotated[
        float,
        typer.Option(
            min=0.0,
            help="Smallest effect that counts: change of the measurements, in uncertainties, for 100 %.",
        ),
    ] = 1.0,
    json_file: Annotated[
        str | None,
        typer.Option("--json", metavar="FILE", help="Write everything as JSON; - for standard output."),
    ] = None,
    out: Annotated[
        str | None, typer.Option("--out", metavar="DIR", help="Write JSON and figures here.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Value that wins over the case file. May be repeated."
        ),
    ] = None,
    volume_policy: Annotated[
        VolumePolicy | None,
        typer.Option(help="Who fills the circuits, see `eclsim simulate --help`; left out, the case file's."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that exist.")] = False,
) -> None:
    """Which parameters the measurements of a case can tell apart, from exact derivatives of the steady beat.

    Proposes a set to fit and says of every other parameter why it is not in it.
    """
    from eclsim.cli.identifiability_run import Request, run

    run(
        Request(
            case_file, parameters, outputs, uncertainty, limit, threshold, json_file, out,
            tuple(settings or ()), volume_policy, force,
        )
    )  # fmt: skip
