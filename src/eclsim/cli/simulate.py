"""`eclsim simulate`: case files in, the steady beat of each out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray as xr

    from eclsim.cases import Case, CaseReading
    from eclsim.cli.destinations import Destinations, Request

Solver = Literal["semi-implicit", "adaptive"]
VolumePolicy = Literal["as_published", "patient_held"]
_FILES = "Files"
_MODEL = "Model"


@dataclass(frozen=True, slots=True)
class Options:
    """How to compute: solver, seconds of the course in time (0: none), grid check."""

    solver: Solver
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
    sweep: Annotated[
        list[str] | None,
        typer.Option(
            "--sweep",
            metavar="KEY=FIRST:LAST:STEP",
            help="Vary one key that --set takes, a steady beat for each value: ecmo.speed_rpm=2000:4500:250 "
            "[rpm], ecmo.flow_l_min=2:5:0.5 [L/min], or a list, Rmc=0.6,0.8,1.0; one case file.",
        ),
    ] = None,
    compare: Annotated[
        bool,
        typer.Option(
            "--compare",
            help="Show the case as its file has it beside the case with --set, or two case files, and the "
            "change.",
        ),
    ] = False,
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
        VolumePolicy | None,
        typer.Option(
            help="as_published: the patient's blood fills the circuits; patient_held: the circuits are "
            "primed and the patient keeps the stressed volume. Left out, what the case file says, "
            "else as_published.",
        ),
    ] = None,
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
    from eclsim.cli.messages import fail

    options = Options(solver, transient, check_grid)
    _check_modes(case_files, sweep or [], compare, options, save)
    request = destinations.Request(json_file, out, figures, csv, force, transient)
    if sweep:
        _sweep(case_files[0], settings or [], sweep[0], request, volume_policy)
        return
    labels = None
    if compare:
        from eclsim.cli.compare import read as read_both

        readings, labels = read_both(case_files, settings or [], volume_policy)
    else:
        readings = cases.read_all(case_files, settings or [], volume_policy)
    read = [reading.case for reading in readings]
    names = cases.waveforms_to_save(save, read)
    if save is not None and out is None and csv is None:
        fail("--save: without --out or --csv no waveform is written; give one of them")
    planned = destinations.plan(request, case_files, [case.patient.id for case in read])
    results = _compute_all(read, options)
    courses = [
        _compute_course(case, options, names) if "phase" in result.dims else None
        for case, result in zip(read, results, strict=True)
        if transient
    ]
    _write(planned, read, results, courses, names, labels)
    _say_doubts(readings, results)
    _leave(results)


def _leave(results: Sequence[xr.Dataset]) -> None:
    if any(not bool(result.attrs["converged"]) for result in results):
        from eclsim.cli.messages import SOME_DID_NOT_CONVERGE

        raise typer.Exit(SOME_DID_NOT_CONVERGE)


def _check_modes(
    files: list[str], sweeps: list[str], compare: bool, options: Options, save: str | None
) -> None:
    """A sweep is of one key of one case, and has a beat for each value and nothing else."""
    from eclsim.cli.messages import fail

    wrong = []
    if sweeps and compare:
        wrong.append("--sweep and --compare: one of them")
    if len(sweeps) > 1:
        wrong.append(f"--sweep: given {len(sweeps)} times; one key is varied at a time")
    if sweeps and len(files) > 1:
        wrong.append(f"--sweep: {len(files)} case files; one case is swept at a time")
    if sweeps and (options.solver != "semi-implicit" or options.transient_s or options.check_grid or save):
        wrong.append("--sweep: without --solver, --transient, --check-grid and --save, which are of one beat")
    if wrong:
        fail(*wrong)


def _sweep(file: str, settings: list[str], text: str, request: Request, policy: VolumePolicy | None) -> None:
    from eclsim.cli import destinations, sweep

    readings = sweep.read(file, settings, text, policy)
    name = next(iter(readings.cases.values())).patient.id
    planned = destinations.plan(request, [file], [f"{name}_sweep"], tables=())
    found = sweep.run_sweep(readings)
    sweep.write(found, planned)
    if planned.json != "-":
        sweep.show(found)
    sweep.say_doubts(found, file)
    _leave(found.results)


def _compute(case: Case, options: Options) -> xr.Dataset:
    from eclsim.simulation.single import simulate_case

    return simulate_case(case, solver=options.solver, check_grid=options.check_grid)


def _compute_course(case: Case, options: Options, names: list[str] | None) -> xr.Dataset:
    from eclsim.simulation.single import simulate_transient

    return simulate_transient(case, options.transient_s, solver=options.solver, names=names)


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
    courses: list[xr.Dataset | None],
    names: list[str] | None,
    labels: list[str] | None,
) -> None:
    from eclsim.cli import compare
    from eclsim.cli.messages import fail
    from eclsim.simulation import files, summary

    try:
        if planned.out is not None:
            files.write_netcdf(results, courses, planned.out, names)
        if planned.csv is not None:
            files.write_csv(results, courses, planned.csv, planned.stems, names)
        if planned.figures is not None:
            files.write_figures(cases, results, planned.figures, planned.stems)
        if labels is not None:
            compare.write(results, labels, planned)
        elif planned.json is not None:
            files.write_json(results, planned.json)
    except BrokenPipeError:
        raise
    except OSError as error:
        fail(f"{error.filename or 'output'}: cannot be written: {error.strerror or error}")
    if planned.json != "-" and labels is None:
        summary.show(results)


def _say_speed(reading: CaseReading, result: xr.Dataset) -> None:
    from eclsim.cli.messages import warn
    from eclsim.simulation.single import FLOW_WANTED, SPEED_FOUND
    from eclsim.simulation.target_flow import SpeedFound

    if SPEED_FOUND in result.attrs:
        found = SpeedFound(result.attrs[FLOW_WANTED], result.attrs[SPEED_FOUND])
        warn([f"{reading.file}: {found}"], "note")


def _say_doubts(readings: list[CaseReading], results: list[xr.Dataset]) -> None:
    """What did not converge, limits that a beat breaks, and flows outside the oxygenator's label."""
    from eclsim.cli.messages import warn
    from eclsim.devices.ecmo import OXYGENATORS
    from eclsim.simulation.single import NOT_REACHED

    for reading, result in zip(readings, results, strict=True):
        _say_speed(reading, result)
        said = [*result.attrs.get("warnings", ())]
        if not result.attrs["converged"]:
            unsettled = "" if result.attrs.get("status") == NOT_REACHED else "not converged: "
            said.insert(0, f"{unsettled}{result.attrs.get('message', '')}")
        if reading.case.ecmo is not None and "PF" in result:
            label = OXYGENATORS[reading.case.ecmo.oxygenator].label_warning(float(result["PF"]))
            said += [f"ECMO flow of {label}"] if label else []
        warn(f"{reading.file}: {sentence}" for sentence in said)
