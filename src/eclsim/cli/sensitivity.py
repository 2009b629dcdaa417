"""`eclsim sensitivity`: Sobol indices of a case."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

VolumePolicy = Literal["as_published", "patient_held"]
MERGE = "merge"


def sensitivity(
    case_file: Annotated[
        str,
        typer.Argument(
            metavar="CASE.toml",
            help="Case file; or the word merge, to finish the shards in the folder --out.",
        ),
    ],
    out: Annotated[
        str | None, typer.Option("--out", metavar="DIR", help="Folder for samples, indices and figures.")
    ] = None,
    json_file: Annotated[
        str | None,
        typer.Option("--json", metavar="FILE", help="Write the indices as JSON; - for standard output."),
    ] = None,
    samples: Annotated[
        int, typer.Option(min=2, help="Rows N of Saltelli's design, a power of two: N (2 D + 2) runs.")
    ] = 2048,
    perturbation: Annotated[
        float, typer.Option(metavar="PERCENT", help="Half width of the range of each number [%].")
    ] = 25.0,
    parameters: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Parameters to vary: Rmc,Emaxlv ...; left out, the paper's 24."),
    ] = None,
    include: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Further inputs: ecmo.speed_rpm, ecmo.drainage_fr, ecmo.return_fr (the maker's sizes), "
            "crrt.flow_ml_min, crrt.scheme (the nine schemes) or crrt.access_site and crrt.return_site, "
            "heart_rate_bpm, any parameter.",
        ),
    ] = None,
    groups: Annotated[
        str | None,
        typer.Option(
            metavar="R,C,L,E", help="Treat the parameters that begin with these letters as one factor each."
        ),
    ] = None,
    outputs: Annotated[
        str | None, typer.Option(metavar="NAMES", help="Outputs; left out, SP,DP,MAP,MPAP,PCWP,CO,PF.")
    ] = None,
    second_order: Annotated[
        bool | None,
        typer.Option(
            "--second-order/--no-second-order",
            help="Report the indices of pairs; without the runs they need, N (D + 2). "
            "Left out: with these runs, pairs in the files only.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the design and of the intervals.")] = 1,
    states: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Analyse around these states in place of the case's values: normal,hypertensive,hypotensive "
            "(mean arterial pressure 79, 102, 60 mmHg, by Rmc), a folder each.",
        ),
    ] = None,
    until: Annotated[
        float | None,
        typer.Option(
            metavar="WIDTH",
            help="Stop at 64, 128, 256 ... rows once every total order is certain to +- this (95 %).",
        ),
    ] = None,
    volume_policy: Annotated[
        VolumePolicy | None,
        typer.Option(help="Who fills the circuits, see `eclsim simulate --help`; left out, the case file's."),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Value that wins over the case file. May be repeated."
        ),
    ] = None,
    shard: Annotated[
        str | None,
        typer.Option(
            metavar="i/n", help="Run part i of n (from 1) only; finish with `eclsim sensitivity merge`."
        ),
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Run on the workers of a Dask scheduler, or on local ones: local."
        ),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what --out holds already.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Throw away what --out and --json hold.")] = False,
    figures: Annotated[bool, typer.Option(help="Write figures to --out.")] = True,
) -> None:
    """Sobol sensitivity indices of a case: which parameters its outputs [mmHg, L/min] depend on.

    Ctrl-C keeps what is done; --resume goes on. Exit status: 0 done, 1 some runs failed (they are named in
    failed.csv and their rows left out), 2 bad input.
    """
    from eclsim.cli.sensitivity_run import Request, merge, run

    request = Request(
        case_file, out, json_file, samples, perturbation, _names(parameters), _names(include) or (),
        _names(groups) or (), _names(outputs), second_order, seed, _names(states) or (), until, volume_policy,
        tuple(settings or ()), shard, dask, resume, force, figures,
    )  # fmt: skip
    failed = merge(request) if case_file == MERGE else run(request)
    if failed:
        raise typer.Exit(1)


def _names(text: str | None) -> tuple[str, ...] | None:
    """Names between commas; None if there are none."""
    return tuple(n.strip() for n in text.split(",") if n.strip()) or None if text is not None else None
