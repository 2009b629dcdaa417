"""`eclsim identify`: fit a patient's own model, or a cohort's, to what was measured."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

VolumePolicy = Literal["as_published", "patient_held"]
Weights = Literal["relative", "uncertainty"]
Method = Literal["nuts", "importance"]
PredictWith = Literal["importance", "gaussian"]
Prior = Literal["log-uniform", "log-normal"]


def identify(
    file: Annotated[
        str,
        typer.Argument(metavar="CASE.toml|COHORT.csv", help="A case with measurements, or a table of them."),
    ],
    out: Annotated[
        str,
        typer.Option("--out", metavar="DIR", help="Write fitted case files, tables, JSON and figures here."),
    ],
    parameters: Annotated[
        str | None,
        typer.Option(
            "--parameters",
            "--free",
            metavar="NAMES",
            help="Free parameters; left out, the paper's Csart,Edla,Emaxlv,Emaxrv,Rmc,Rpmc,Rsvn.",
        ),
    ] = None,
    bounds: Annotated[
        str | None,
        typer.Option(
            metavar="NAME=LOWER:UPPER,...",
            help="Bounds in the parameter's unit; equal ones fix it. Default: the start value / 10 to * 10.",
        ),
    ] = None,
    weights: Annotated[
        Weights,
        typer.Option(
            help="What a difference is divided by: the measured value (as in the paper), or its uncertainty."
        ),
    ] = "relative",
    uncertainty: Annotated[
        str | None,
        typer.Option(
            metavar="NAME=VALUE,...",
            help="Standard uncertainties: SP=4,CO=10% [mmHg, L/min or %]. They give the intervals and, "
            "if chosen, the weights. Defaults: SP=4,DP=4,MAP=3,MPAP=2,PCWP=2 mmHg, CO=10 %, PF=5 %.",
        ),
    ] = None,
    posterior: Annotated[
        bool,
        typer.Option(
            "--posterior",
            help="Sample the full posterior with NUTS as well (minutes; needs the extra `bayes`).",
        ),
    ] = False,
    posterior_method: Annotated[
        Method,
        typer.Option(
            help="nuts: chains on exact derivatives; importance: weighted draws, in seconds. For --posterior."
        ),
    ] = "nuts",
    predict: Annotated[
        list[str] | None,
        typer.Option(
            "--predict",
            metavar="KEY=VALUE,...",
            help="Predict the outputs at other settings with 90 % intervals, such as ecmo.speed_rpm=4000. "
            "Without --posterior by --predict-with. May be repeated.",
        ),
    ] = None,
    predict_with: Annotated[
        PredictWith,
        typer.Option(
            help="importance: draws weighted by the exact posterior, with a check of the weights (seconds); "
            "gaussian: the Gaussian approximation, unchecked. For --predict without --posterior."
        ),
    ] = "importance",
    prior: Annotated[
        Prior, typer.Option(help="Of --posterior and --predict: what is known before any measurement.")
    ] = "log-uniform",
    chains: Annotated[int, typer.Option(min=2, max=64, help="Chains of --posterior.")] = 4,
    warmup: Annotated[int, typer.Option(min=50, help="Draws of each chain that are thrown away.")] = 600,
    draws: Annotated[int, typer.Option(min=50, help="Draws of each chain that are kept.")] = 1500,
    shared: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="For cohorts: free parameters that all data points of a patient have in common, as Csvn.",
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Of the explored points; the same seed, the same result.")
    ] = 0,
    json_file: Annotated[
        str | None,
        typer.Option("--json", metavar="FILE", help="Write the JSON here too; - for standard output."),
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
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a cohort that was stopped.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that exist.")] = False,
) -> None:
    """Fit parameters to measurements: multi-start least squares with exact derivatives.

    Explores 1,000 sets of parameters for each free one, refines the best until the optimum has been found
    again ten times, says whether the fit is good, doubtful or poor, and how far each parameter can be relied
    on. A cohort has a row for each data point; a bad row stops no other. Exit status: 0 all fitted (look at
    the verdict: doubtful ones count as fitted), 1 some were not or are poor, 2 bad input.
    """  # fmt: skip
    from eclsim.cli.identify_run import Request, run
    from eclsim.cli.posterior_run import PosteriorRequest

    wanted = PosteriorRequest(
        posterior, posterior_method, tuple(predict or ()), predict_with, prior, chains, warmup, draws
    )
    run(
        Request(
            file, out, parameters, bounds, weights, uncertainty, seed, json_file, tuple(settings or ()),
            volume_policy, resume, force, wanted, shared,
        )
    )  # fmt: skip
