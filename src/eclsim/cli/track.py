"""`eclsim track`: follow patients from measurement to measurement."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

VolumePolicy = Literal["as_published", "patient_held"]
Prior = Literal["log-uniform", "log-normal"]


def track(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="SERIES.csv|CASE.toml...",
            help="A table with a row for each time, or case files of one patient in order of time. Names "
            "such as 2024-03-01T08:00 (files: 2024-03-01T08-00.toml) say how much time lies between them.",
        ),
    ],
    out: Annotated[str, typer.Option("--out", metavar="DIR", help="Write JSON, tables and figures here.")],
    parameters: Annotated[
        str | None,
        typer.Option(
            "--parameters",
            "--free",
            metavar="NAMES",
            help="Parameters to follow; left out, the paper's Csart,Edla,Emaxlv,Emaxrv,Rmc,Rpmc,Rsvn.",
        ),
    ] = None,
    bounds: Annotated[
        str | None,
        typer.Option(
            metavar="NAME=LOWER:UPPER,...",
            help="Bounds in the parameter's unit. Default: the start value / 10 to * 10.",
        ),
    ] = None,
    uncertainty: Annotated[
        str | None,
        typer.Option(
            metavar="NAME=VALUE,...",
            help="Standard uncertainties of the measurements: SP=4,CO=10% [mmHg, L/min or %]. Defaults: "
            "SP=4,DP=4,MAP=3,MPAP=2,PCWP=2 mmHg, CO=10 %, PF=5 %.",
        ),
    ] = None,
    prior: Annotated[
        Prior, typer.Option(help="What is known of the parameters before the first measurement.")
    ] = "log-uniform",
    drift: Annotated[
        float | None,
        typer.Option(
            min=0.001,
            max=0.9,
            help="How far parameters drift in a day: 0.1 is about 18 %. Left out, the measurements decide "
            "among three rates.",
        ),
    ] = None,
    interval: Annotated[
        float,
        typer.Option(
            min=0.01,
            max=8760.0,
            metavar="HOURS",
            help="Time from one measurement to the next where their names are no times [h].",
        ),
    ] = 24.0,
    json_file: Annotated[
        str | None,
        typer.Option("--json", metavar="FILE", help="Write the JSON here too; - for standard output."),
    ] = None,
    volume_policy: Annotated[
        VolumePolicy | None,
        typer.Option(help="Who fills the circuits, see `eclsim simulate --help`; left out, the case file's."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that exist.")] = False,
) -> None:
    """Follow a patient's parameters through time, forecast the next outputs, flag what does not fit.

    Each measurement is first held against its forecast (normalised innovation), then updates the parameters:
    an iterated unscented Kalman filter on the steady heartbeat. All intervals are 90 %. Exit status: 0 all
    points followed, 1 some could not be, 2 bad input.
    """
    from eclsim.cli.track_run import Request, run

    run(
        Request(
            tuple(files),
            out,
            parameters,
            bounds,
            uncertainty,
            prior,
            drift,
            interval,
            json_file,
            volume_policy,
            force,
        )
    )
