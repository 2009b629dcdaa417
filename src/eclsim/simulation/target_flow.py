"""The pump speed at which the steady beat has the ECMO pump flow that a case names: PF(speed) = flow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from eclsim.devices.ecmo import PUMPS
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate_many

if TYPE_CHECKING:
    from eclsim.cases.case import Case

TOLERANCE_L_MIN = 1e-6
SCANNED = 9
"""Speeds over the pump's range that are tried first; the flow is sought between two of them."""
MOST_TRIALS = 60
SPEED = "ecmo.speed_rpm"

Flows = Callable[[np.ndarray], tuple[np.ndarray, list[str]]]
"""From speeds [rpm] to flows [L/min], NaN where no steady beat was found, and what was said of each."""


class FlowNotReachedError(ValueError):
    """No speed of the pump's range gives the flow; says which flows can be had."""


@dataclass(frozen=True)
class SpeedFound:
    """A target and the speed that reaches it.

    Args:
        flow_l_min: pump flow wanted [L/min]; met to `TOLERANCE_L_MIN`.
        speed_rpm: what the pump has to run at [rpm].
    """

    flow_l_min: float
    speed_rpm: float

    def __str__(self) -> str:
        return f"ecmo.flow_l_min = {self.flow_l_min:g} needs {self.speed_rpm:.0f} rpm"


def with_speed(case: Case, policy: str | None = None) -> tuple[Case, SpeedFound | None]:
    """The case with the pump speed that gives its target flow, and that speed.

    Args:
        case: with `ecmo.flow_l_min`; any other is handed back as it is, with None.
        policy: blood volume policy; left out, the case's.

    Raises:
        FlowNotReachedError: No speed in the pump's usual range gives the flow.
    """
    if case.regulation is not None and case.regulation.left_open:
        rest = case.at_rest()
        if rest.ecmo is not None and rest.ecmo.flow_l_min is not None:
            case = case.model_copy(update={"as_written": with_speed(rest, policy)[0]})
    if case.ecmo is None or case.ecmo.flow_l_min is None or not isinstance(case.ecmo.pump, str):
        return case, None
    flow, span = case.ecmo.flow_l_min, PUMPS[case.ecmo.pump].speed_range_rpm
    model = model_of(_at_speed(case, span[0]))

    def flows(speeds: np.ndarray) -> tuple[np.ndarray, list[str]]:
        found = simulate_many(model, {SPEED: speeds}, ("PF",), policy)
        return found["PF"].to_numpy(), [str(text) for text in found["message"].to_numpy()]

    speed = speed_for_flow(flows, flow, span)
    return _at_speed(case, speed), SpeedFound(flow, speed)


def speed_for_flow(flows: Flows, wanted: float, span: tuple[float, float]) -> float:
    """Speed [rpm] within a range that gives a flow [L/min]; the lowest, should there be several.

    The range is scanned, then the flow is closed in between two speeds by false position (Illinois) with
    bisection where that stalls.

    Args:
        flows: flow at each speed.
        wanted: flow to reach [L/min].
        span: lowest and highest speed [rpm].

    Raises:
        FlowNotReachedError: The flow is outside what the range gives, or no steady beat was found on the way.
    """
    speeds = np.linspace(*span, SCANNED)
    found, said = flows(speeds)
    known = np.flatnonzero(np.isfinite(found))
    if not len(known):
        raise FlowNotReachedError(_words(wanted, f"no steady beat was found at any speed: {said[-1]}"))
    for left, right in pairwise(known):
        if min(found[left], found[right]) <= wanted <= max(found[left], found[right]):
            return _close_in(flows, wanted, (speeds[left], speeds[right]), (found[left], found[right]))
    raise FlowNotReachedError(_words(wanted, _out_of_reach(wanted, speeds, found, known)))


def _close_in(flows: Flows, wanted: float, ends: tuple[float, float], values: tuple[float, float]) -> float:
    (low, high), (below, above) = ends, (values[0] - wanted, values[1] - wanted)
    for end, excess in ((low, below), (high, above)):
        if abs(excess) <= TOLERANCE_L_MIN:
            return float(end)
    last = 0
    for trial in range(MOST_TRIALS):
        secant = (low * above - high * below) / (above - below)
        speed = secant if trial % 8 != 7 else 0.5 * (low + high)
        (flow,), (said,) = flows(np.array([speed]))
        if not np.isfinite(flow):
            where = f"between {ends[0]:.0f} and {ends[1]:.0f} rpm"
            why = f"it lies {where}, but no steady beat was found at {speed:.0f} rpm: {said}"
            raise FlowNotReachedError(_words(wanted, why))
        excess = flow - wanted
        if abs(excess) <= TOLERANCE_L_MIN:
            return float(speed)
        # An end that stays twice counts half, so that the next trial falls on its side.
        if (excess > 0.0) == (above > 0.0):
            high, above, below = speed, excess, below * (0.5 if last == 1 else 1.0)
            last = 1
        else:
            low, below, above = speed, excess, above * (0.5 if last == -1 else 1.0)
            last = -1
    raise FlowNotReachedError(_words(wanted, f"the flow jumps over it between {low:.6g} and {high:.6g} rpm"))


def _out_of_reach(wanted: float, speeds: np.ndarray, found: np.ndarray, known: np.ndarray) -> str:
    most, least = known[np.argmax(found[known])], known[np.argmin(found[known])]
    if wanted > found[most]:
        text = f"the highest flow reached is {found[most]:.2f} L/min, at {speeds[most]:.0f} rpm"
    else:
        text = f"the lowest flow reached is {found[least]:.2f} L/min, at {speeds[least]:.0f} rpm"
    unknown = [f"{speed:.0f}" for k, speed in enumerate(speeds) if k not in known]
    text += f" (pump range {speeds[0]:.0f} to {speeds[-1]:.0f} rpm)"
    return text + (f"; no steady beat was found at {', '.join(unknown)} rpm" if unknown else "")


def _words(wanted: float, why: str) -> str:
    return f"ecmo.flow_l_min = {wanted:g} cannot be reached: {why}"


def _at_speed(case: Case, speed: float) -> Case:
    assert case.ecmo is not None
    ecmo = case.ecmo.model_copy(update={"flow_l_min": None, "speed_rpm": float(speed)})
    return case.model_copy(update={"ecmo": ecmo})
