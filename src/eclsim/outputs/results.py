"""Labelled results: one steady beat, also by an independent method, many at once, and derivatives."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from eclsim.arguments import TRACED, is_traced, is_truth_value, written
from eclsim.beat.grid import RESOLUTIONS, PhaseGrid, refined_for_switching_times, switching_times
from eclsim.beat.heartbeat import HEART_RATE, beat_program
from eclsim.beat.recording import all_signals, with_rates
from eclsim.cases.case import Case
from eclsim.cases.fluid import remarks_on_viscosity
from eclsim.cases.quantities import quantity
from eclsim.circuit.assembly import assemble
from eclsim.files import ORIGIN
from eclsim.gas.network import STATUS, GasStatus
from eclsim.inputs.mistakes import as_names
from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.execution import Execution
from eclsim.orbit.independent import AdaptiveBeats, AdaptiveOptions, WaitingResult
from eclsim.orbit.inputs import allowed_values
from eclsim.orbit.model import Model, ModelSource, as_case, as_model, nominal_values
from eclsim.orbit.status import NoDerivativesError, Status
from eclsim.orbit.steady import ADAPTIVE, SEMI_IMPLICIT, Batch, SolvedOrbits, start_state
from eclsim.outputs.alarms import (
    Finding,
    doubted_outputs,
    findings,
    gravest_first,
    impossible,
    marks,
    sentences,
)
from eclsim.outputs.gas import LUNG_FLOW, OF_LUNG_FLOW, of_moving_blood, recirculation
from eclsim.outputs.measures import Measures
from eclsim.outputs.ranges import out_of_range, refuse_taken_from_patient, taken_from_patient
from eclsim.outputs.registry import computed, leading_outputs, output
from eclsim.outputs.regulation import REFLEX_USE, corner_at_set_point
from eclsim.outputs.second_beat import findings_of_second_beat
from eclsim.outputs.signals import (
    gas_dependent_outputs,
    needed_parameters,
    output_names,
    signal_labels,
    unstressed_volume,
    watched_waveforms,
)
from eclsim.outputs.steady_beat import SteadyBeat, Waveforms, statistics_of, steady_beat, with_status
from eclsim.outputs.uncertainty import cautions_on_misses

STEPS_AT_RESOLUTION_1 = 400
ALLOWED_GRID_ERROR_PERCENT = 0.5


def simulate(
    case: ModelSource,
    volume_policy: str | None = None,
    options: OrbitOptions | None = None,
    resolution: int | None = None,
) -> xr.Dataset:
    """The steady beat of a model as of `eclsim.simulate`; a case must have a pump speed."""
    model = as_model(case)
    batch = Batch.of(model, volume_policy)
    beat = steady_beat(batch, waveforms=None, keep=None, options=options, resolution=resolution)
    beyond = out_of_range(model.circuit, model.values, 1)[0] if isinstance(case, Model) else []
    return labelled(beat, 0, model.name, (*model.doubts, *beyond), findings_of_second_beat(beat))


def labelled(
    beat: SteadyBeat, member: int = 0, name: str = "model", doubts: Sequence[str] = (),
    further: Sequence[Finding] = (),
) -> xr.Dataset:  # fmt: skip
    """Return one member of a batch as `simulate` does; its waveforms must have been kept.

    Args:
        beat: solved and measured beats.
        member: index of the member.
        name: `id` of the result.
        doubts: doubts about the model, which are placed before the warnings of the beat.
        further: findings about the beat that are not computed from it alone.
    """
    values, circuit = beat.batch.member(member), beat.batch.circuit
    phases = beat.waveforms[member].phases
    rate = float(np.asarray(beat.values_in_effect(member)[HEART_RATE]))
    period = 60.0 / rate if rate > 0.0 else np.nan
    data: dict[str, xr.Variable] = {}
    for k, signal in enumerate(beat.signals):
        with np.errstate(invalid="ignore"):
            shift = unstressed_volume(circuit, signal, values)
        mean, lowest, highest = beat.statistics[:, k, member] + shift
        statistics = {"mean": float(mean), "minimum": float(lowest), "maximum": float(highest)}
        series = beat.waveforms[member].values[:, k] + shift
        data[signal] = variable("phase", series, **signal_labels(circuit, signal), **statistics)
    for place, blood in beat.gases[member].places.items() if member in beat.gases else ():
        if place in beat.gases[member].standing:
            continue
        gases = {"SO2": 100.0 * blood.saturation, "PO2": blood.po2, "PCO2": blood.pco2}
        data[f"P{place}"].attrs |= {name: float(value) for name, value in gases.items()}
    outputs, result = beat.outputs(member), gravest_first([*beat.findings(member), *further])
    data |= {n: variable((), v, **output_labels(n)) for n, v in of_moving_blood(outputs).items()}
    doubted = doubted_outputs(result)
    for concerned, kind in marks(result, outputs, beat.batch.all_values_of(member)).items():
        if concerned in data:
            data[concerned].attrs |= {"finding": kind, "read_with_care": int(concerned in doubted)}
    data |= _recirculation(beat, member)
    status, orbits = Status(int(beat.status[member])), beat.orbits
    attributes: dict[str, Any] = {
        **ORIGIN,
        "id": name,
        "converged": int(beat.converged[member]),
        "status": status.word,
        "message": beat.message(member),
        "beats": int(orbits.beats[member]),
        "residual": float(orbits.residual[member]),
        "drift_ml_per_beat": float(orbits.drift[member]),
        "blood_volume_policy": beat.batch.policy,
        **_solver(beat, member),
        "warnings": [*doubts, *sentences(result)],
        "impossible": int(impossible(result)),
        "one_of_many": int(status is Status.ONE_OF_MANY),
    }
    if beat.of_gases:
        attributes["gas_status"] = GasStatus(int(beat.gas_status[member])).word
    # As an index, xarray would import Dask to check whether it is one of its arrays: 0.1 s.
    labels = {"units": "1", "long_name": "phase of the beat"}
    phase = xr.IndexVariable("phase", pd.Index(phases), labels)
    time = variable("phase", phases * period, units="s", long_name="time")
    return xr.Dataset(data, coords={"phase": phase, "time": time}, attrs=attributes)


def simulate_many(
    case: ModelSource,
    changes: Mapping[str, npt.ArrayLike],
    outputs: Sequence[str] | None = None,
    volume_policy: str | None = None,
    options: OrbitOptions | None = None,
    execution: Execution | None = None,
) -> xr.Dataset:
    """Steady beats of variants of a model as of `eclsim.simulate_many`; a case must have a pump speed."""
    model, outputs = as_model(case), None if outputs is None else as_names(outputs, "outputs")
    changes = as_columns(changes)
    model.refuse_unknown(changes)
    count = member_count(changes)
    values = {**model.values, **changes}
    batch = Batch(model.circuit, values, count, volume_policy or model.policy)
    start = model.values if nominal_values(model.circuit) is None else None
    watched = watched_waveforms(model.circuit)
    computed = outputs
    if outputs is not None and {*OF_LUNG_FLOW} & {*outputs}:
        computed = list(dict.fromkeys([*outputs, LUNG_FLOW]))
    beat = steady_beat(batch, computed, waveforms=watched, options=options, start=start, execution=execution)
    member_findings = [beat.findings(k) for k in range(count)]
    notes = out_of_range(model.circuit, changes, count), taken_from_patient(changes, count)
    read = of_moving_blood({n: beat.output(n) for n in beat.names})
    data: dict[str, Any] = {n: ("member", read[n], output_labels(n)) for n in outputs or beat.names}
    texts = {
        "status": [Status(int(status)).word for status in beat.status],
        "message": [beat.message(k) for k in range(count)],
        "warnings": [
            "\n".join([*outside, *taken, *sentences(one)])
            for outside, taken, one in zip(*notes, member_findings, strict=True)
        ],
    }
    data |= {name: ("member", np.array(each, dtype=str)) for name, each in texts.items()}
    data["impossible"] = ("member", np.array([impossible(one) for one in member_findings], dtype=int))
    data["beats"] = ("member", beat.orbits.beats)
    if beat.of_gases:
        data["gas_status"] = ("member", [GasStatus(int(status)).word for status in beat.gas_status])
    residual = {"units": "1", "long_name": "largest relative change over a beat"}
    data["residual"] = ("member", beat.orbits.residual, residual)
    coordinates = {
        k: ("member", np.broadcast_to(values[k], (count,)), {"units": unit_of_value(k)}) for k in changes
    }
    attributes = {
        **ORIGIN,
        "id": model.name,
        "blood_volume_policy": batch.policy,
        "failed": int((~beat.converged).sum()),
        **({"without_gases": int(beat.without_gases.sum())} if beat.of_gases else {}),
        "warnings": [*model.doubts, *remarks_on_viscosity(changes)],
    }
    return xr.Dataset(data, coords=coordinates, attrs=attributes)


def beat_warnings(
    case: ModelSource,
    volume_policy: str | None = None,
    shown: Collection[str] | None = None,
    measured: Case | None = None,
) -> tuple[str, ...]:
    """Warnings about the steady beat behind an analysis, as of `simulate`.

    Args:
        case: case or model as in `simulate`.
        volume_policy: blood volume policy; None takes that of the case.
        shown: outputs of the analysis; cautions about other outputs are left out. None for all.
        measured: case with whose measurements the beat of a model is compared; a case is compared with its
            own.
    """
    if not isinstance(case, Model):
        case = measured = as_case(case, or_model=True)
    model = as_model(case)
    watched = watched_waveforms(model.circuit)
    beat = steady_beat(Batch.of(model, volume_policy), waveforms=watched)
    if not beat.converged[0]:
        return (*model.doubts, beat.message())
    every = gravest_first([*beat.findings(), *findings_of_second_beat(beat)])
    warnings = sentences(f for f in every if shown is None or f.is_about(shown))
    missed = [] if measured is None else cautions_on_misses(measured, beat.outputs())
    return (*model.doubts, *warnings, *missed)


def as_columns(changes: Mapping[str, npt.ArrayLike]) -> dict[str, np.ndarray]:
    """Convert changes by parameter to arrays: a number for all variants, or one for each.

    Masked entries of an array are missing and become NaN.

    Raises:
        TypeError: The argument does not map parameters to changes, or a change is no number.
        ValueError: A change is too large, or an array with more than one dimension.
    """
    if not isinstance(changes, Mapping):
        table = "; of a DataFrame: frame.to_dict('list')" if isinstance(changes, pd.DataFrame) else ""
        allowed = f'numbers by parameter, such as {{"Rmc": [0.8, 1.0]}}{table}'
        raise TypeError(f"changes: {written(changes)} names no parameter; allowed: {allowed}")
    return {name: _column(name, given) for name, given in changes.items()}


def _column(name: str, given: npt.ArrayLike) -> np.ndarray:
    """Convert one change for `as_columns`."""
    entries = given if isinstance(given, (list, tuple)) else [given]
    if any(map(is_traced, entries)):
        raise TypeError(f"{name}: {TRACED}")
    try:
        array = np.ma.asanyarray(given) if isinstance(given, np.ma.MaskedArray) else np.asarray(given)
        if array.dtype.kind not in "fiu" and array.size:
            mixed = array.dtype.kind == "O" and not any(isinstance(one, str) for one in array.flat)
            array = array.astype(float) if mixed else None
    except OverflowError:
        raise ValueError(f"{name}: a number is too large; allowed: up to 1.8e308") from None
    except (TypeError, ValueError):
        array = None
    if array is None or any(map(is_truth_value, entries)):
        no_number = (one for one in entries if is_truth_value(one) or not isinstance(one, Real))
        raise TypeError(f"{name}: {written(next(no_number, given))} is not a number or a list of numbers")
    if array.ndim > 1:
        shape = " x ".join(map(str, array.shape))
        raise ValueError(f"{name}: an array of {shape}; allowed: a number, or one for each variant")
    return np.ma.filled(array.astype(float), np.nan)


def member_count(columns: Mapping[str, np.ndarray]) -> int:
    """Number of variants given by columns of changes, or by numbers that hold for all.

    Raises:
        ValueError: Columns have different lengths.
    """
    lengths = {column.size for column in columns.values() if column.ndim > 0}
    if len(lengths) > 1:
        raise ValueError(f"arrays of {sorted(lengths)} members: all changes need the same length")
    return lengths.pop() if lengths else 1


def derivatives(
    case: ModelSource,
    outputs: Sequence[str],
    parameters: Sequence[str],
    volume_policy: str | None = None,
    resolution: int | None = None,
    throw: bool = True,
) -> xr.DataArray:
    """d output / d parameter of a model's steady beat, as of `eclsim.derivatives`.

    Raises:
        NoDerivativesError: No steady beat was found, or its equation is singular.
    """
    model = as_model(case)
    model.refuse_unknown(parameters)
    refuse_taken_from_patient(parameters, model.values)
    watched = watched_waveforms(model.circuit)
    batch = Batch.of(model, volume_policy)
    beat = steady_beat(batch, outputs, waveforms=watched, resolution=resolution)
    status, message = Status(int(beat.status[0])).word, beat.message()
    levels = _resolutions(beat, parameters, refine=resolution is None)
    try:
        values, slopes = _linearised(beat, outputs, parameters, levels)
    except NoDerivativesError as error:
        if throw:
            raise NoDerivativesError(error.status, error.reason, model.name, error.gases) from None
        status, message = error.word, error.reason
        values, slopes = np.full(len(outputs), np.nan), np.full((len(outputs), len(parameters)), np.nan)
    about = {
        "id": model.name,
        "status": status,
        "message": message,
        "warnings": [*model.doubts, *sentences(beat.findings()), *_corners(beat, outputs)],
    }
    steps = STEPS_AT_RESOLUTION_1 * levels
    return labelled_derivatives(slopes, outputs, values, parameters, model.values, steps, about)


def _resolutions(beat: SteadyBeat, parameters: Sequence[str], refine: bool) -> np.ndarray:
    """Resolution of the grid for each column of derivatives; with `refine`, finer for switching times."""
    own = int(beat.orbits.resolution[0])
    switching = switching_times(assemble(beat.batch.circuit)) if refine else ()
    finer = refined_for_switching_times(own)
    return np.array([finer if name in switching else own for name in parameters])


def _linearised(
    beat: SteadyBeat, outputs: Sequence[str], parameters: Sequence[str], levels: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Outputs of a beat and their slopes, each column on the grid of its resolution."""
    slopes = np.empty((len(outputs), len(parameters)))
    for level in np.unique(levels).tolist():
        own = level == beat.orbits.resolution[0]
        columns = np.flatnonzero(levels == level).tolist()
        on_grid = beat if own else steady_beat(beat.batch, outputs, resolution=level)
        slopes[:, columns] = on_grid.linearise(outputs, [parameters[k] for k in columns]).slopes
    return np.array([beat.output(name)[0] for name in outputs]), slopes


def labelled_derivatives(
    slopes: np.ndarray,
    outputs: Sequence[str],
    output_values: np.ndarray,
    parameters: Sequence[str],
    values: Mapping[str, float],
    steps_per_beat: np.ndarray,
    about: Mapping[str, Any],
) -> xr.DataArray:
    """Label derivatives with names, values and units of what was derived and by what.

    Args:
        slopes: derivatives, shape (outputs, parameters); NaN where there are none.
        outputs: names of the outputs.
        output_values: their values, shape (outputs,).
        parameters: names of the parameters.
        values: values of the parameters by name.
        steps_per_beat: steps of the grid of each column, shape (parameters,); 0 where there was no beat.
        about: further attributes, such as the status.
    """
    coordinates = {
        "output": list(outputs),
        "parameter": list(parameters),
        "value": ("output", output_values),
        "output_units": ("output", [output(name).unit for name in outputs]),
        "parameter_value": ("parameter", [values[name] for name in parameters]),
        "parameter_units": ("parameter", [unit_of_value(name) for name in parameters]),
        "steps_per_beat": ("parameter", steps_per_beat),
    }
    long_name = "d output / d parameter, in output_units per parameter_units"
    attributes = {**ORIGIN, "long_name": long_name, **about}
    return xr.DataArray(slopes, coordinates, ("output", "parameter"), "derivative", attrs=attributes)


def _corners(beat: SteadyBeat, outputs: Sequence[str]) -> list[str]:
    """Outputs that have other slopes on the other side of where the only member is."""
    if REFLEX_USE not in outputs:
        return []
    return corner_at_set_point(beat.batch.circuit, beat.batch.member(0), float(beat.output(REFLEX_USE)[0]))


def with_grid_check(model: Model, result: xr.Dataset) -> xr.Dataset:
    """Add to a result the largest change of its outputs on a grid with half the step.

    The attributes are `grid_error_percent` and `grid_error_output`, the output with the largest change. A
    change of more than 0.5 % gives a warning.

    Args:
        model: model that was simulated.
        result: its steady beat by the semi-implicit solver.
    """
    resolution = int(result.attrs["steps_per_beat"]) // STEPS_AT_RESOLUTION_1
    finer = min((r for r in RESOLUTIONS if r >= 2 * resolution), default=2 * resolution)
    fine = simulate(model, result.attrs["blood_volume_policy"], resolution=finer)
    errors = {
        o.name: 100.0 * abs(float(result[o.name]) / float(fine[o.name]) - 1.0)
        for o in leading_outputs()
        if o.name in result and float(fine[o.name]) != 0.0
    }
    worst = max(errors, key=lambda name: errors[name])
    checked = result.assign_attrs(grid_error_percent=errors[worst], grid_error_output=worst)
    if errors[worst] > ALLOWED_GRID_ERROR_PERCENT:
        sentence = f"{worst} changes by {errors[worst]:.2f} % on a grid of half the step"
        checked.attrs["warnings"] = [*result.attrs["warnings"], sentence]
    return checked


def unit_of_value(name: str) -> str:
    """Unit of a parameter of a circuit; empty for one of a user's own circuit."""
    known = quantity(name)
    return "" if known is None else known.unit


def scalars_of(result: xr.Dataset) -> list[str]:
    """Names of the outputs of a result, which unlike waveforms are single numbers."""
    return [str(name) for name, values in result.data_vars.items() if values.ndim == 0]


def output_labels(name: str) -> dict[str, str]:
    """Unit, long name and definition of an output, as attributes."""
    entry = output(name)
    return {"units": entry.unit, "long_name": entry.long_name, "definition": entry.definition}


def _solver(beat: SteadyBeat, member: int) -> dict[str, str | float]:
    """Attributes that describe how a member was solved."""
    if beat.orbits.adaptive_tolerance is not None:
        return {"tolerance": beat.orbits.adaptive_tolerance, "solver": ADAPTIVE}
    grid = PhaseGrid(int(beat.orbits.resolution[member]))
    return {"steps_per_beat": grid.n_steps, "solver": SEMI_IMPLICIT}


def _recirculation(beat: SteadyBeat, member: int) -> dict[str, xr.Variable]:
    if not beat.converged[member]:
        return {}
    circuit = beat.batch.circuit.with_chosen_sites(beat.batch.member(member))
    flows = {c.name: float(beat.mean("Q" + c.name)[member]) for c in circuit.connections}
    return {n: variable((), v, **about) for n, (v, about) in recirculation(circuit, flows).items()}


def variable(dims: str | tuple[str, ...], values: npt.ArrayLike, **labels: object) -> xr.Variable:
    """Return a labelled array without xarray's shorthand, which imports Dask and takes half a second."""
    return xr.Variable(dims, np.asarray(values), labels, fastpath=True)


# --- a course in time ---------------------------------------------------------------------------


def simulate_course(
    model: Model,
    seconds: float,
    *,
    policy: str | None = None,
    solver: str = SEMI_IMPLICIT,
    names: Sequence[str] | None = None,
) -> xr.Dataset:
    """Simulate a model in time from the published initial state.

    Args:
        model: circuit and values.
        seconds: duration [s].
        policy: blood volume policy; with "patient_held" the circuits start primed. None takes that of the
            model.
        solver: "semi-implicit" or "adaptive".
        names: names of the waveforms to keep; None for all.

    Returns:
        Waveforms over `time` [s]; the attributes describe the computation.
    """
    from eclsim.orbit.transient import follow

    known = all_signals(assemble(model.circuit))
    signals = known if names is None else tuple(name for name in known if name in set(names))
    policy = policy or model.policy
    course = follow(model, seconds, signals, policy=policy, solver=solver)
    data = {
        name: variable(
            "time", column + unstressed_volume(model.circuit, name, model.values),
            **signal_labels(model.circuit, name),
        )
        for name, column in zip(signals, course.signals.T, strict=True)
    }  # fmt: skip
    extremes = {n: (float(s.min()), float(s.max())) for n, s in zip(signals, course.signals.T, strict=True)}
    attributes = {
        **ORIGIN,
        "id": model.name,
        "seconds": float(seconds),
        "status": "finite" if np.isfinite(course.signals).all() else "not_finite",
        "blood_volume_policy": policy,
        "steps_per_beat": course.steps_per_beat,
        "solver": solver,
        "warnings": [*model.doubts, *sentences(findings({}, extremes))],
    }
    time = variable("time", course.time, units="s", long_name="time")
    return xr.Dataset(data, coords={"time": time}, attrs=attributes)


# --- adaptive steps -------------------------------------------------------------------------------

RECORDING_GRID = PhaseGrid(4)
"""Grid of the recorded beat, fine enough for extremes and means to add no error."""


def simulate_adaptive(
    model: Model, policy: str | None = None, options: AdaptiveOptions | None = None
) -> xr.Dataset:
    """Compute the steady beat of a model with adaptive steps of tight tolerance, without solving the orbit.

    Args:
        model: circuit and values.
        policy: blood volume policy, "as_published" or "patient_held"; None takes that of the model.
        options: tolerance and longest waiting time.

    Returns:
        Dataset as of `simulate`.
    """
    batch, beats = Batch.of(model, policy), AdaptiveBeats(model, options)
    batch.volume()  # raises an error for an unknown policy
    refused = bool(allowed_values(model.circuit).refused(batch.packed(beat_program(model.circuit))).any())
    nothing = WaitingResult(np.full(len(start_state(model)), np.nan), 0, np.inf, np.inf, False)
    waiting_result = nothing if refused else beats.wait(batch.policy)
    plain = all_signals(beats.program.explicit.assembly)
    _, recorded = beats.record(waiting_result.state, RECORDING_GRID.phases, with_rates(model.circuit, plain))
    names = with_rates(model.circuit, plain)
    known = output_names(model.circuit)
    parameters = batch.read_by_outputs(needed_parameters(model.circuit, known), np.array([0]))
    waves = {n: recorded[:, [k]] for k, n in enumerate(names)}
    measures = Measures(waves, RECORDING_GRID.phases, model.circuit, parameters)
    outputs = {n: computed(n, measures) for n in known}
    with_gas = bool(gas_dependent_outputs(model.circuit, known))
    gas_status = np.asarray(measures.gas(*STATUS) if with_gas else [0], dtype=int)
    series = recorded[:, [names.index(n) for n in plain]]
    beat = with_status(
        _orbits(batch, waiting_result, refused, beats.options.tolerance), tuple(outputs), outputs, plain,
        statistics_of(measures, plain, series[..., None]), {0: Waveforms(RECORDING_GRID.phases, series)},
        gas_status,
    )  # fmt: skip
    return labelled(beat, 0, model.name, model.doubts)


def _orbits(batch: Batch, waiting_result: WaitingResult, refused: bool, tolerance: float) -> SolvedOrbits:
    """Convert the state at the end of the waiting time to the result of a search."""
    finite = np.isfinite(waiting_result.change)
    status = (
        Status.CONVERGED if waiting_result.steady else Status.NOT_CONVERGED if finite else Status.NOT_FINITE
    )
    return SolvedOrbits(
        waiting_result.state[:, None], np.array([Status.INVALID_INPUT if refused else status]),
        np.array([waiting_result.beats]), np.array([waiting_result.change]), np.array([waiting_result.drift]),
        batch=batch, resolution=np.array([RECORDING_GRID.resolution]), width=1, adaptive_tolerance=tolerance,
    )  # fmt: skip
