"""Steady beats, variants, derivatives and courses of cases, with speeds solved for given pump flows."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from eclsim.arguments import OneOf, flag
from eclsim.cases.case import Case
from eclsim.files import ORIGIN, finite
from eclsim.inputs.mistakes import as_names
from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.execution import Execution
from eclsim.orbit.model import CASE, Model, ModelSource, UnknownValueError, as_case, case_json, model_of
from eclsim.orbit.steady import ADAPTIVE, SEMI_IMPLICIT
from eclsim.outputs import results
from eclsim.outputs.results import simulate_course
from eclsim.outputs.uncertainty import cautions_on_misses
from eclsim.simulation.target_flow import FlowNotReachedError, SolvedSpeeds, solve_speeds, with_speed

if TYPE_CHECKING:
    import numpy.typing as npt


VALUES = "values"
"""Attribute of variants of a model that holds the values of its parameters as JSON text."""
NOT_REACHED = "flow_not_reached"
"""Status of a case whose target pump flow no speed can reach."""


def simulate(
    case: ModelSource,
    volume_policy: str | None = None,
    options: OrbitOptions | None = None,
    resolution: int | None = None,
    *,
    solver: str = SEMI_IMPLICIT,
    check_grid: bool = False,
) -> xr.Dataset:
    """Compute the steady beat of a case or a model.

    Args:
        case: path of a case file, what `read_case` returned, a case or a model. If a case gives a pump flow
            (`ecmo.flow_l_min`), the speed is solved for; a model already has its speed.
        volume_policy: blood volume policy, "as_published" or "patient_held"; None takes that of the case.
        options: accuracy and effort of the search.
        resolution: resolution of the phase grid; None takes what the circuit's time constants need.
        solver: "semi-implicit" solves for the orbit; "adaptive" integrates with Dopri8 and tight tolerance
            until the orbit is reached (slow, for verification, without `options` and `resolution`).
        check_grid: whether to solve again with half the step and report the change of the outputs.

    Returns:
        Waveforms over `phase`, scalar outputs, and as attributes whether and how the search converged; NaN if
        it did not. The attribute `case` is the case as JSON text, for `Case.model_validate_json`, with the
        computed speed. With `ecmo.flow_l_min` also the target flow and the pump speed solved for it
        (`target_flow.solved_speed_of`). If no speed gives the flow, a Dataset without numbers whose status is
        "flow_not_reached" and whose message gives the reason.
    """
    OneOf((SEMI_IMPLICIT, ADAPTIVE))("solver", solver)
    check_grid = flag("check_grid", check_grid)
    if solver == ADAPTIVE and (options is not None or resolution is not None):
        raise ValueError("the adaptive solver takes no options and no resolution: leave them out")
    if isinstance(case, Model):
        return _beat(case, volume_policy, options, resolution, solver, check_grid)
    case = as_case(case, or_model=True)
    try:
        solved, speed = with_speed(case, volume_policy)
    except FlowNotReachedError as error:
        return result_without_flow(case, volume_policy or case.volume_policy, str(error))
    result = _beat(model_of(solved), volume_policy, options, resolution, solver, check_grid)
    if speed is not None:
        result.attrs |= speed.attributes()
    result.attrs[CASE] = case_json(solved, volume_policy)
    if result.attrs["converged"]:
        beat = {str(name): float(value) for name, value in result.data_vars.items() if not value.ndim}
        result.attrs["warnings"] = [*result.attrs["warnings"], *cautions_on_misses(case, beat)]
    return result


def simulate_many(
    case: ModelSource,
    changes: Mapping[str, npt.ArrayLike],
    outputs: Sequence[str] | None = None,
    volume_policy: str | None = None,
    options: OrbitOptions | None = None,
    execution: Execution | None = None,
) -> xr.Dataset:
    """Compute the steady beats of variants of a case or a model.

    Args:
        case: path of a case file, what `read_case` returned, a case or a model, shared by all variants. If a
            case gives a pump flow (`ecmo.flow_l_min`), the speed of each variant is solved for.
        changes: an array (members,) for each varied parameter, or a number for all members; for a case also
            the flow, "ecmo.flow_l_min".
        outputs: names of outputs, as in the registry; None for all that the circuit has.
        volume_policy: blood volume policy; None takes that of the case.
        options: accuracy and effort of the search.
        execution: how the batch is computed.

    Returns:
        Dataset over `member`: the changed parameters (and with a flow its key and the speed) as coordinates,
        outputs with units, `status` (see `Status`; "flow_not_reached" if no speed gives the flow), `message`,
        `beats` and `residual`, `warnings` about these outputs (one line each) and whether the beat is
        `impossible` in a patient. Outputs of a member that did not converge are NaN, and its message gives
        the reason. The attribute `case` is the case as JSON text, for `Case.model_validate_json`; with it and
        the coordinates the variants can be repeated. For a model, `values` are those of its parameters.

    Raises:
        ValueError: Arrays have different lengths.
        UnknownValueError: The circuit lacks a parameter, or a speed that follows from a flow is changed.
        TypeError: A change is no number.
    """
    source = case if isinstance(case, Model) else as_case(case, or_model=True)
    how, solved, changes = (volume_policy, options, execution), None, results.as_columns(changes)
    if not isinstance(source, Model):
        solved = solve_speeds(source, changes, volume_policy, options=options, execution=execution)
    if solved is None:
        result = results.simulate_many(source, changes, outputs, *how)
        return result.assign_attrs(_base(source, volume_policy))
    model, speeds = model_of(solved.case_at(0.0)), {solved.speed: solved.speeds}
    result = results.simulate_many(model, {**solved.changes, **speeds}, outputs, *how)
    unreachable = np.array(solved.reasons) != ""
    for name, texts in (("status", [NOT_REACHED] * len(unreachable)), ("message", solved.reasons)):
        result[name] = result[name].dims, np.where(unreachable, texts, result[name])
    flows = {solved.flow_key: ("member", solved.flows, {"units": "L/min"})}
    return result.assign_coords(flows).assign_attrs(_base(solved.case, volume_policy))


def _base(source: Case | Model, policy: str | None) -> dict[str, str]:
    """Attribute that states what variants were made of: the case, or the values of a model, as JSON text."""
    if isinstance(source, Model):
        return {VALUES: json.dumps(finite(dict(source.values)))}
    return {CASE: case_json(source, policy)}


def derivatives(
    case: ModelSource,
    outputs: Sequence[str],
    parameters: Sequence[str],
    volume_policy: str | None = None,
    resolution: int | None = None,
    throw: bool = True,
) -> xr.DataArray:
    """Compute d output / d parameter of a steady beat, exact for the grid.

    Args:
        case: path of a case file, what `read_case` returned, a case or a model. If a case gives a pump flow
            (`ecmo.flow_l_min`), derivatives are at constant flow: the speed changes with each parameter.
        outputs: names of outputs, as in the registry.
        parameters: names of parameters of the circuit, or `heart_rate_bpm`; at constant flow also its key,
            but not the speed.
        volume_policy: blood volume policy; None takes that of the case.
        resolution: resolution of the phase grid; None takes what the circuit's time constants need, and four
            times that for the column of a phase of the beat (`iabp.inflation_phase`). Half of the outputs
            have derivatives within 0.5 % of their largest elasticity, extremes within 1 to 7 %: if a small
            one matters, compare two resolutions (docs, Numerics).
        throw: if False, missing derivatives are NaN and the attributes give the reason.

    Returns:
        Array with dimensions (output, parameter), in `output_units` per `parameter_units`, which are
        coordinates like `value` and `parameter_value`, the point of the derivatives, and `steps_per_beat`,
        the grid of each column. The array's name is "derivative". The attributes `status`
        ("converged", else as `Status`, "singular" or "flow_not_reached"), `message` and `warnings` describe
        the beat. The attributes `case` and, for a model, `values` are those of `simulate_many`.

    Raises:
        NoDerivativesError: No steady beat was found, or its equation is singular.
        FlowNotReachedError: No speed gives the flow.
        UnknownValueError: The circuit has no such parameter, or the parameter has no number of its own: it is
            the speed at constant flow, solved with the beat, or selects the value of the patient's blood.
        UnknownOutputError: There is no such output.
    """
    throw = flag("throw", throw)
    source = case if isinstance(case, Model) else as_case(case, or_model=True)
    outputs, parameters = as_names(outputs, "outputs"), as_names(parameters, "parameters")
    if not (outputs and parameters):
        raise ValueError("no outputs or no parameters for derivatives; allowed: one or more of each")
    solved = None if isinstance(source, Model) else solve_speeds(source, {}, volume_policy)
    if solved is None:
        result = results.derivatives(source, outputs, parameters, volume_policy, resolution, throw)
        return result.assign_attrs(_base(source, volume_policy))
    if solved.speed in parameters:
        advice = f"ask for {solved.flow_key}, or give the case a speed"
        raise UnknownValueError(f"{solved.speed} is computed from the target flow: {advice}")
    if solved.reasons[0]:
        if throw:
            raise FlowNotReachedError(solved.reasons[0])
        return _no_derivatives(solved, outputs, parameters).assign_attrs(_base(source, volume_policy))
    model = model_of(solved.case_at(float(solved.speeds[0])))
    varied = [name for name in dict.fromkeys(parameters) if name != solved.flow_key]
    names = (*dict.fromkeys((*outputs, solved.output)),), (*varied, solved.speed)
    result = results.derivatives(model, *names, volume_policy, resolution, throw)
    held = _at_held_flow(result, solved, outputs, parameters)
    return held.assign_attrs(_base(solved.case, volume_policy))


def _at_held_flow(
    result: xr.DataArray, solved: SolvedSpeeds, outputs: Sequence[str], parameters: Sequence[str]
) -> xr.DataArray:
    """Derivatives at constant flow: d speed = (d flow - sum(flow by parameter)) / (flow by speed)."""
    by_speed, flow = result.sel(parameter=solved.speed), result.sel(output=solved.output)
    by_flow = by_speed / float(flow.sel(parameter=solved.speed))
    table = (result - by_flow * flow).drop_sel(parameter=solved.speed)
    at_flow = {
        "parameter": [solved.flow_key],
        "parameter_value": ("parameter", solved.flows),
        "parameter_units": ("parameter", ["L/min"]),
        "steps_per_beat": ("parameter", [int(by_speed["steps_per_beat"])]),
    }
    columns = by_flow.drop_vars(at_flow).expand_dims("parameter", 1)
    table = xr.concat([table, columns.assign_coords(at_flow)], "parameter")
    speed = solved.solved_speed(0).attributes()
    table = table.sel(output=list(outputs), parameter=list(parameters))
    return table.assign_coords(value=result["value"].sel(output=list(outputs))).assign_attrs(
        result.attrs | speed
    )


def _no_derivatives(solved: SolvedSpeeds, outputs: Sequence[str], parameters: Sequence[str]) -> xr.DataArray:
    model = model_of(solved.case_at(0.0))
    model.refuse_unknown([name for name in parameters if name != solved.flow_key])
    values = {**model.values, solved.flow_key: float(solved.flows[0])}
    about = {
        "id": solved.case.patient.id,
        "status": NOT_REACHED,
        "message": solved.reasons[0],
        "warnings": list(solved.case.doubts),
    }
    nothing, no_steps = np.full((len(outputs), len(parameters)), np.nan), np.zeros(len(parameters), dtype=int)
    return results.labelled_derivatives(nothing, outputs, nothing[:, 0], parameters, values, no_steps, about)


def _beat(
    model: Model, policy: str | None, options: OrbitOptions | None, resolution: int | None, solver: str,
    check_grid: bool,
) -> xr.Dataset:  # fmt: skip
    if solver == ADAPTIVE:
        return results.simulate_adaptive(model, policy)
    result = results.simulate(model, policy, options, resolution)
    return results.with_grid_check(model, result) if check_grid else result


def result_without_flow(case: Case, policy: str, sentence: str) -> xr.Dataset:
    """Return a result without numbers, with the reason, for a case whose target flow cannot be reached."""
    attributes = {
        **ORIGIN,
        "id": case.patient.id,
        "converged": 0,
        "status": NOT_REACHED,
        "message": sentence,
        "beats": 0,
        "residual": float("nan"),
        "blood_volume_policy": policy,
        "warnings": list(case.doubts),
        CASE: case_json(case, policy),
    }
    return xr.Dataset(attrs=attributes)


def simulate_transient(
    case: Case,
    seconds: float,
    *,
    volume_policy: str | None = None,
    solver: str = "semi-implicit",
    names: Sequence[str] | None = None,
) -> xr.Dataset:
    """Simulate a case from the published initial state over `seconds`.

    Args:
        case: patient, devices and parameters.
        seconds: duration [s].
        volume_policy: "as_published" or "patient_held" (the circuits start primed); None takes that of the
            case.
        solver: "semi-implicit" or "adaptive".
        names: names of the waveforms to keep; None for all.

    Raises:
        FlowNotReachedError: The case gives a pump flow that no speed can reach.
    """
    solved, _ = with_speed(case, volume_policy)
    return simulate_course(model_of(solved), seconds, policy=volume_policy, solver=solver, names=names)
