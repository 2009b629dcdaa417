"""Command `eclsim simulate`: the steady beat of each case, sweeps of one key, comparisons of two cases."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from eclsim.cli.cases import names_of, read_all, read_each, warn_of_new_findings
from eclsim.cli.console import INCOMPLETE, Progress, broken_rules, fail, note, refuse, warn
from eclsim.cli.destination import NETCDF, Destinations, Target, reporting_write_errors, write_json_output
from eclsim.cli.options import CaseChanges, Json, argument, option
from eclsim.files import file_stems
from eclsim.inputs.mistakes import CaseError
from eclsim.spelling import spelling_hint

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.cases import Case, CaseReading, Mistake
    from eclsim.simulation.sweep import Value

Solver = Literal["semi-implicit", "adaptive"]
_COMPARED = "one case file with --set or --volume-policy (compared with the file as it is), or two case files"


@dataclass(frozen=True, kw_only=True)
class SimulateOptions(CaseChanges, Json):
    """Options of `eclsim simulate`."""

    case_files: list[str] = argument(..., "CASE.toml...", "Case files, one patient each.")
    sweep: list[str] = option(
        [],
        "Vary one key of --set and compute the steady beat at each value: {setting}=2000:4500:250 [rpm], "
        "{target}=2:5:0.5 [L/min], or a list, Rmc=0.6,0.8,1.0. For one case file.",
        metavar="KEY=FIRST:LAST:STEP",
    )
    compare: bool = option(
        False,
        "Compare the case before and after --set, or two case files, and show the change.",
        "--compare",
    )
    out: str | None = option(None, "Write waveforms and outputs as NetCDF.", metavar="FILE.nc")
    figures: str | None = option(None, "Write figures (SVG and PNG) to this folder.", metavar="DIR")
    csv: str | None = option(
        None, "Write waveforms and a table of outputs as CSV to this folder.", metavar="DIR"
    )
    solver: Solver = option(
        "semi-implicit", "semi-implicit: solve for the steady beat; adaptive: check it with tight tolerances."
    )
    transient: float = option(
        0.0,
        "Also simulate this long from the start [s]; written to --out and --csv.",
        metavar="SECONDS",
        minimum=0.0,
        maximum=3600.0,
    )
    save: str | None = option(
        None, "Write only these waveforms to --out and --csv: Pao,Qlv,Vlv ...", metavar="NAMES"
    )
    check_grid: bool = option(
        False, "Solve again with half the time step and show how much outputs change [%].", "--check-grid"
    )


@dataclass(frozen=True)
class OutputPlaces:
    """Destinations of the results; `stems` are the beginnings of file names, one per case."""

    json: Target
    out: Path | None
    figures: Path | None
    csv: Path | None
    stems: tuple[str, ...]


def simulate(options: SimulateOptions) -> None:
    """Simulate the steady heartbeat of each case and show pressures [mmHg], flows [L/min] and volumes [mL].

    Exit status: 0 all converged, 1 some did not, 2 bad input (nothing computed).
    """
    _check_modes(options)
    if options.sweep:
        results = _sweep(options)
    elif options.compare:
        results = _simulate_each(options, *_compared_cases(options))
    else:
        places, _ = _destinations(options, ())
        readings = read_all(options.case_files, options.settings, options.volume_policy, places.mistakes)
        results = _simulate_each(options, readings)
    if not all(result.attrs["converged"] for result in results):
        raise typer.Exit(INCOMPLETE)


def _check_modes(o: SimulateOptions) -> None:
    """Check that a sweep varies one key of one case, without options that apply to a single beat."""
    of_one_beat = o.solver != "semi-implicit" or o.transient or o.check_grid or o.save
    refuse(broken_rules({
        "--sweep, --compare: give only one": o.sweep and o.compare,
        f"--sweep: given {len(o.sweep)} times; one key is varied at a time": len(o.sweep) > 1,
        f"--sweep: {len(o.case_files)} case files; one case is swept at a time":
            o.sweep and len(o.case_files) > 1,
        "--sweep: cannot be combined with --solver, --transient, --check-grid or --save, which apply to one "
        "beat": o.sweep and of_one_beat,
    }))  # fmt: skip


def _places(
    o: SimulateOptions, ids: Sequence[str], tables: Sequence[str] = ("outputs",), of_all: Sequence[str] = ()
) -> OutputPlaces:
    """Return the destinations for the results of cases with these ids; exit with status 2 on errors.

    Args:
        o: options of the command.
        ids: ids of the cases.
        tables: stems of the tables of all cases.
        of_all: stems of the figures of all cases.
    """
    places, result = _destinations(o, ids, tables, of_all)
    places.check()
    return result


def _destinations(
    o: SimulateOptions, ids: Sequence[str], tables: Sequence[str] = ("outputs",), of_all: Sequence[str] = ()
) -> tuple[Destinations, OutputPlaces]:
    """Return the destinations for the results of cases with these ids, and the errors in them."""
    stems = file_stems(ids)
    places = Destinations(force=o.force, inputs=o.case_files)
    result = OutputPlaces(
        json=places.target("--json", o.json),
        out=places.file("--out", o.out, NETCDF),
        figures=places.folder("--figures", o.figures, stems=[*stems, *of_all]),
        csv=places.folder("--csv", o.csv, stems=[*stems, *tables]),
        stems=stems,
    )
    if o.transient and not (o.out or o.csv):
        places.mistakes.append("--transient needs --out FILE.nc or --csv DIR to write the course to")
    return places, result


def _simulate_each(
    o: SimulateOptions, readings: Sequence[CaseReading], labels: Sequence[str] | None = None
) -> Sequence[xr.Dataset]:
    """Simulate each case, write and show the results; `labels` name the cases before and after a change."""
    from eclsim.reporting.beat_values import COMPARED, SIDES
    from eclsim.simulation.files import COMPARISON
    from eclsim.simulation.single import simulate as steady
    from eclsim.simulation.single import simulate_transient

    cases = [reading.case for reading in readings]
    names = _waveforms(o, cases)
    ids = [case.patient.id for case in cases]
    if labels:
        named = [f"{i}_{which}" for i, which in zip(ids, SIDES, strict=True)]
        places = _places(o, named, of_all=(COMPARISON,))
    else:
        places = _places(o, ids)
    results = []
    with Progress() as progress:
        for case in cases:
            progress(f"simulating {case.patient.id}")
            results.append(steady(case, solver=o.solver, check_grid=o.check_grid))
    if labels:
        pairs = zip(results, SIDES, strict=True)
        results = [result.assign_attrs({COMPARED: which}) for result, which in pairs]
    courses = [
        simulate_transient(case, o.transient, solver=o.solver, names=names)
        if "phase" in result.dims
        else None
        for case, result in zip(cases, results, strict=True)
        if o.transient
    ]
    _write(places, cases, results, courses, names, labels)
    _warn_of_doubts(readings, results)
    return results


def _waveforms(o: SimulateOptions, cases: Sequence[Case]) -> tuple[str, ...] | None:
    """Return the names given by --save, or None for all; a name that no case has is an error."""
    if o.save is None:
        return None
    from eclsim.beat.recording import all_signals
    from eclsim.circuit.assembly import assemble
    from eclsim.orbit.model import circuit_of

    known = list(dict.fromkeys(name for case in cases for name in all_signals(assemble(circuit_of(case)))))
    wanted = names_of(o.save) or ()
    wrong = [f"--save {n}: no such waveform{spelling_hint(n, known)}" for n in wanted if n not in known]
    if not wanted:
        wrong.append("--save: empty; allowed: waveforms such as Pao,Qlv,Vlv")
    if wrong:
        fail(*wrong, f"--save allowed: {', '.join(known)}")
    if o.out is None and o.csv is None:
        fail("--save: waveforms are written only with --out or --csv; give at least one")
    return wanted


def _write(
    places: OutputPlaces,
    cases: Sequence[Case],
    results: Sequence[xr.Dataset],
    courses: Sequence[xr.Dataset | None],
    names: Sequence[str] | None,
    labels: Sequence[str] | None,
) -> None:
    from eclsim.simulation import files, summary
    from eclsim.simulation.files import results_object

    change = _change(results) if labels else None
    with reporting_write_errors():
        if places.out is not None:
            files.write_netcdf(results, courses, places.out, names)
        if places.csv is not None:
            files.write_csv(results, courses, places.csv, places.stems, names)
        if places.figures is not None:
            files.write_figures(cases, results, places.figures, places.stems)
            if labels:
                files.write_comparison(results, labels, places.figures)
        content = {} if places.json is None else results_object(results)
        if labels:
            content["compare"] = {"before": labels[0], "after": labels[1], "change": change}
        shown = write_json_output(content, places.json)
    if shown and labels:
        typer.echo(f"before: {labels[0]}\nafter:  {labels[1]}")
    if shown:
        summary.show(results, change)


def _warn_of_doubts(readings: Sequence[CaseReading], results: Sequence[xr.Dataset]) -> None:
    """Warn of failed convergence and of the findings of each beat, and note solved pump speeds."""
    from eclsim.simulation.single import NOT_REACHED
    from eclsim.simulation.target_flow import solved_speed_of

    for reading, result in zip(readings, results, strict=True):
        if solved := solved_speed_of(result):
            note([f"{reading.file}: {solved}"])
        lines = list(result.attrs.get("warnings", ()))
        if not result.attrs["converged"]:
            kind = "" if result.attrs.get("status") == NOT_REACHED else "not converged: "
            lines.insert(0, f"{kind}{result.attrs.get('message', '')}")
        warn_of_new_findings(reading, lines)


# --- before and after a change --------------------------------------------------------------------


def _compared_cases(o: SimulateOptions) -> tuple[Sequence[CaseReading], Sequence[str]]:
    """Return the two cases to compare and their labels; exit with status 2 if there are not exactly two."""
    if len(o.case_files) == 2:
        return read_all(o.case_files, o.settings, o.volume_policy), o.case_files
    if len(o.case_files) != 1 or not (o.settings or o.volume_policy):
        without = "" if o.settings else " and no --set"
        fail(f"--compare: {len(o.case_files)} case file(s){without}; allowed: {_COMPARED}")
    (file,) = o.case_files
    readings = read_each([(file, (), None), (file, o.settings, o.volume_policy)])
    warn(dict.fromkeys(str(line) for reading in readings for line in reading.warnings))
    note(dict.fromkeys(str(line) for reading in readings for line in reading.notes))
    before, after = readings
    changed = [*o.settings, *([f"blood volume {o.volume_policy}"] if o.volume_policy else [])]
    named = [replace(before, file=f"{file}, before"), replace(after, file=f"{file}, after")]
    return named, ["as in the file", ", ".join(changed)]


def _change(results: Sequence[xr.Dataset]) -> dict[str, float]:
    """Return the changes of outputs from the first to the second beat; empty unless both converged."""
    before, after = results
    if not (before.attrs["converged"] and after.attrs["converged"]):
        return {}
    names = [str(name) for name, variable in before.data_vars.items() if variable.ndim == 0 and name in after]
    changes = {name: float(after[name]) - float(before[name]) for name in names}
    return {name: value for name, value in changes.items() if math.isfinite(value)}


# --- one key varied -------------------------------------------------------------------------------


def _sweep(o: SimulateOptions) -> Sequence[xr.Dataset]:
    """Simulate the case at each value of one key, write and show the results."""
    from eclsim.devices.description import placed_sentence
    from eclsim.simulation import sweep as sweeps
    from eclsim.simulation.summary import sweep_doubts, sweep_text

    readings = read_sweep(o.case_files[0], o.settings, o.sweep[0], o.volume_policy)
    name = next(iter(readings.cases.values())).patient.id
    places = _places(o, [f"{name}_sweep"], tables=())
    try:
        sweep = sweeps.sweep_cases(readings.key, readings.unit, readings.case_value, readings.cases)
    except sweeps.SweepError as error:
        fail(f"--sweep {error}")
    (stem,) = places.stems
    with reporting_write_errors():
        if places.out is not None:
            sweeps.write_netcdf(sweep, places.out)
        if places.csv is not None:
            sweeps.write_csv(sweep, places.csv / f"{stem}.csv")
        if places.figures is not None:
            sweeps.write_figure(sweep, places.figures / stem)
        if write_json_output(sweeps.sweep_object(sweep), places.json):
            typer.echo(sweep_text(sweep))
    warn(placed_sentence(o.case_files[0], line) for line in sweep_doubts(sweep))
    return sweep.results


# --- the cases of a sweep ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Readings:
    """Cases of a sweep by value of its key; the key as in a case file, its unit, the case's own value."""

    key: str
    unit: str
    case_value: Value | None
    cases: Mapping[Value, Case]


def read_sweep(file: str, settings: Sequence[str], text: str, policy: str | None = None) -> Readings:
    """Read the cases of a sweep; report all errors and exit with status 2 if there are any."""
    from eclsim.cases.fluid import remarks_on_viscosity
    from eclsim.cases.settings import parse_settings
    from eclsim.simulation.sweep import SweepError, parse_sweep, remarks_on_last_values

    try:
        key, texts = parse_sweep(text)
        ((section, name),) = parse_settings([f"{key}={texts[0]}"])
    except SweepError as error:
        fail(f"--sweep {error}")
    except CaseError as error:
        fail(*(str(m.at("--sweep", None)) for m in error.mistakes))
    if (section, name) == ("patient", "id") or section == "measurements":
        fail(f"--sweep {key}: changes nothing that the simulation reads; sweep a setting or a parameter")
    if (section, name) in _set_keys(settings):
        fail(f"--sweep {key}: is also given by --set; remove one of the two")
    note([*remarks_on_last_values(text), *remarks_on_viscosity([f"{section}.{name}"])])
    wanted = [(file, [*settings, f"{key}={text}"], policy) for text in texts]
    readings = read_each(wanted, lambda mistake: _for_swept_key(mistake, key))
    warn(dict.fromkeys(str(_for_swept_key(m, key)) for r in readings for m in r.warnings))
    note(dict.fromkeys(str(m) for m in readings[0].notes if not _is_about(m, key)))
    cases = {_value(reading.case, section, name): reading.case for reading in readings}
    if all(isinstance(value, float) for value in cases):
        cases = dict(sorted(cases.items()))
    key = name if section == "parameters" else f"{section}.{name}"
    return Readings(key, _unit(section, name), _value_without_sweep(file, settings, section, name), cases)


def _set_keys(settings: Sequence[str]) -> Collection[tuple[str, str]]:
    """Return section and name of each setting; errors in settings are reported when the case is read."""
    from eclsim.cases.settings import parse_settings

    try:
        return parse_settings(settings)
    except CaseError:
        return ()


def _is_about(mistake: Mistake, key: str) -> bool:
    return mistake.key.removeprefix("parameters.") == key.removeprefix("parameters.")


def _for_swept_key(mistake: Mistake, key: str) -> Mistake:
    return replace(mistake, file="--sweep") if _is_about(mistake, key) else mistake


def _value_without_sweep(file: str, settings: Sequence[str], section: str, name: str) -> Value | None:
    """Return the value of the case without the sweep; None if there is none or the case is invalid."""
    from eclsim.cases import read_case
    from eclsim.cases.resolve import resolve_parameters
    from eclsim.devices.device import UnsolvedFlowError

    try:
        case = read_case(file, settings).case
        if section == "parameters":
            return resolve_parameters(case)[name]
        return _value(case, section, name)
    except (CaseError, KeyError, UnsolvedFlowError):
        return None


def _value(case: Case, section: str, name: str) -> Value:
    value = case.setting(section, name)
    if value is None:
        raise KeyError(name)
    return float(value) if isinstance(value, (int, float)) else str(value)


def _unit(section: str, name: str) -> str:
    from eclsim.cases.sections import section_of
    from eclsim.devices.registry import parameter_of

    if section == "parameters":
        parameter = parameter_of(name)
        return "" if parameter is None else parameter.unit
    kind = section_of(section)
    return "" if kind is None else kind.fields()[name].unit
