"""`eclsim simulate`: case files in, the steady beat of each out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.cli.destinations import Destinations
    from eclsim.patients import Case, CaseReading

Solver = Literal["semi-implicit", "adaptive"]
VolumePolicy = Literal["as_published", "patient_held"]
_FILES = "Files"
_MODEL = "Model"


@dataclass(frozen=True, slots=True)
class Options:
    """How to compute: solver, blood volume policy, seconds of the course in time (0: none), grid check."""

    solver: Solver
    volume_policy: VolumePolicy
    transient_s: float
    check_grid: bool = False


def simulate(
    case_files: Annotated[
        list[str], typer.Argument(metavar="CASE.toml...", help="Case files, one patient each.")
    ],
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Value that wins over the case files, such as ecmo.speed_rpm=3000 [rpm], "
            "patient.heart_rate_bpm=90 or Rmc=0.8 [mmHg s/mL]. May be repeated.",
        ),
    ] = None,
    json_file: Annotated[
        str | None,
        typer.Option(
            "--json", metavar="FILE", help="Write results as JSON; - writes them to standard output."
        ),
    ] = None,
    out: Annotated[
        str | None, typer.Option("--out", metavar="FILE.nc", help="Write waveforms and outputs as NetCDF.")
    ] = None,
    figures: Annotated[
        str | None,
        typer.Option("--figures", metavar="DIR", help="Write figures (SVG and PNG) to this folder."),
    ] = None,
    csv: Annotated[
        str | None,
        typer.Option(
            "--csv", metavar="DIR", help="Write waveforms and a table of outputs as CSV to this folder."
        ),
    ] = None,
    solver: Annotated[
        Solver,
        typer.Option(
            help="semi-implicit solves for the steady beat; adaptive checks it with tight tolerances."
        ),
    ] = "semi-implicit",
    transient: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            min=0.0,
            max=3600.0,
            help="Also follow the course from the start for so long [s]; goes to --out and --csv.",
        ),
    ] = 0.0,
    save: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Only these waveforms in --out and --csv: Pao,Qlv,Vlv ...",
        ),
    ] = None,
    volume_policy: Annotated[
        VolumePolicy,
        typer.Option(
            help="as_published: the patient's blood fills the circuits; patient_held: the circuits are "
            "primed and the patient keeps the stressed volume."
        ),
    ] = "as_published",
    check_grid: Annotated[
        bool,
        typer.Option(
            "--check-grid", help="Solve again with half the step and say how much outputs change [%]."
        ),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that exist.")] = False,
) -> None:
    """Simulate the steady heartbeat of each case and show pressures [mmHg], flows [L/min] and volumes [mL].

    Exit status: 0 all converged, 1 some did not, 2 bad input (nothing computed).
    """
    from eclsim.cli import cases, destinations

    readings = cases.read_all(case_files, settings or [])
    read = [reading.case for reading in readings]
    names = cases.waveforms_to_save(save, read)
    wanted = destinations.Request(json_file, out, figures, csv, force, transient)
    planned = destinations.plan(wanted, case_files, [case.patient.id for case in read])
    options = Options(solver, volume_policy, transient, check_grid)
    results = _compute_all(read, options)
    courses = [_compute_course(case, options, names) for case in read] if transient else []
    _write(planned, read, results, courses, names)
    _say_doubts(readings, results)
    if any(not bool(result.attrs["converged"]) for result in results):
        from eclsim.cli.messages import SOME_DID_NOT_CONVERGE

        raise typer.Exit(SOME_DID_NOT_CONVERGE)


def _compute(case: Case, options: Options) -> xr.Dataset:
    from eclsim.studies.simulation import simulate_case

    return simulate_case(
        case, volume_policy=options.volume_policy, solver=options.solver, check_grid=options.check_grid
    )


def _compute_course(case: Case, options: Options, names: list[str] | None) -> xr.Dataset:
    from eclsim.studies.simulation import simulate_transient

    policy = options.volume_policy
    return simulate_transient(
        case, options.transient_s, volume_policy=policy, solver=options.solver, names=names
    )


def _compute_all(cases: list[Case], options: Options) -> list[xr.Dataset]:
    import sys

    if len(cases) == 1 or not sys.stderr.isatty():
        return [_compute(case, options) for case in cases]
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    return [_compute(case, options) for case in track(cases, "simulating", console=console, transient=True)]


def _write(
    planned: Destinations,
    cases: list[Case],
    results: list[xr.Dataset],
    courses: list[xr.Dataset],
    names: list[str] | None,
) -> None:
    from eclsim.cli.messages import fail
    from eclsim.report import files, summary

    try:
        if planned.out is not None:
            files.write_netcdf(results, courses, planned.out, names)
        if planned.csv is not None:
            files.write_csv(results, courses, planned.csv, planned.stems, names)
        if planned.figures is not None:
            files.write_figures(cases, results, planned.figures, planned.stems)
        if planned.json is not None:
            files.write_json(results, planned.json)
    except BrokenPipeError:
        raise
    except OSError as error:
        fail(f"{error.filename or 'output'}: cannot be written: {error.strerror or error}")
    if planned.json != "-":
        summary.show(results)


def _say_doubts(readings: list[CaseReading], results: list[xr.Dataset]) -> None:
    """What did not converge, limits that a beat breaks, and flows outside the oxygenator's label."""
    from eclsim.cli.messages import warn
    from eclsim.parameters.devices import OXYGENATORS

    for reading, result in zip(readings, results, strict=True):
        said = [*result.attrs.get("warnings", ())]
        if not result.attrs["converged"]:
            said.insert(0, f"not converged: {result.attrs.get('message', '')}")
        if reading.case.ecmo is not None and "PF" in result:
            label = OXYGENATORS[reading.case.ecmo.oxygenator].label_warning(float(result["PF"]))
            said += [f"ECMO flow of {label}"] if label else []
        warn(f"{reading.file}: {sentence}" for sentence in said)
