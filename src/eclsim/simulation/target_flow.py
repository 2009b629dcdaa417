"""Solve for the pump speed at which the steady beat has the flow that a case gives: PF(speed) = flow.

Devices declare which target can replace which setting (`eclsim.devices.description.Target`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from eclsim.cases.case import Case
from eclsim.devices.description import Target
from eclsim.devices.device import Instance
from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.execution import Execution
from eclsim.orbit.model import UnknownValueError, model_of
from eclsim.outputs.results import as_columns, member_count, simulate_many

if TYPE_CHECKING:
    import xarray as xr


TOLERANCE_L_MIN = 1e-6
SPEEDS_SCANNED = 9
"""Number of speeds over the pump's range tried first; the flow is then searched between two of them."""
MOST_TRIALS = 60

Flows = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, list[str]]]
"""Maps members and speeds [rpm] to flows [L/min], NaN without a steady beat, and messages."""


class FlowNotReachedError(ValueError):
    """Raised if no speed of the pump's range gives the flow; the message gives the possible flows."""


@dataclass(frozen=True)
class SolvedSpeed:
    """A target flow and the pump speed that reaches it.

    Args:
        flow_key: key of the target in a case file, such as "ecmo.flow_l_min".
        flow: target pump flow [L/min], reached within `TOLERANCE_L_MIN`.
        speed_key: key of the speed, such as "ecmo.speed_rpm".
        speed_rpm: pump speed [rpm].
    """

    flow_key: str
    flow: float
    speed_key: str
    speed_rpm: float

    def __str__(self) -> str:
        return f"{self.flow_key} = {self.flow:g} needs {self.speed_rpm:.0f} rpm"

    def attributes(self) -> dict[str, str | float]:
        """Attributes of a result, such as "target_ecmo_flow_l_min" and "solved_ecmo_speed_rpm"."""
        return {
            "target": self.flow_key, "target_" + self.flow_key.replace(".", "_"): self.flow,
            "solved": self.speed_key, "solved_" + self.speed_key.replace(".", "_"): self.speed_rpm,
        }  # fmt: skip


def solved_speed_of(result: xr.Dataset) -> SolvedSpeed | None:
    """The speed solved for a result; None if none was."""
    about = result.attrs
    if "solved" not in about:
        return None
    values = (about[f"{role}_{about[role].replace('.', '_')}"] for role in ("target", "solved"))
    flow, speed = map(float, values)
    return SolvedSpeed(about["target"], flow, about["solved"], speed)


def with_speed(case: Case, policy: str | None = None) -> tuple[Case, SolvedSpeed | None]:
    """Return the case with the pump speed that gives its target flow, and this speed.

    Args:
        case: case with a target such as `ecmo.flow_l_min`; any other is returned unchanged, with None.
        policy: blood volume policy; None takes that of the case.

    Raises:
        FlowNotReachedError: No speed in the pump's usual range gives the flow.
    """
    solved = solve_speeds(case, {}, policy)
    if solved is None:
        return _with_resting_speed(case, policy), None
    if solved.reasons[0]:
        raise FlowNotReachedError(solved.reasons[0])
    return solved.case_at(float(solved.speeds[0])), solved.solved_speed(0)


@dataclass(frozen=True)
class SolvedSpeeds:
    """Speeds of the variants of a case with a target flow.

    Args:
        case: case that all variants share, with known set points.
        instance: device with the target flow.
        target: target of this device.
        changes: further changes of the variants, an array (members,) or a number for each parameter.
        flows: target flows [L/min], shape (members,).
        speeds: speeds that give them [rpm], NaN if there is none, shape (members,).
        reasons: reasons why there is no speed; empty if there is one.
    """

    case: Case
    instance: Instance
    target: Target
    changes: Mapping[str, npt.ArrayLike]
    flows: np.ndarray
    speeds: np.ndarray
    reasons: tuple[str, ...]

    @property
    def speed(self) -> str:
        """Name of the speed parameter of the circuit."""
        return self.instance.parameter(f"{self.instance.device.key}.{self.target.setting}")

    @property
    def flow_key(self) -> str:
        """Key of the flow in a case file."""
        return f"{self.instance.key}.{self.target.key}"

    @property
    def output(self) -> str:
        """Name of the output that must reach the target."""
        return self.instance.output(self.target.output)

    def case_at(self, speed: float) -> Case:
        """Return the case with a speed instead of the target flow."""
        keys = {self.target.key: None, self.target.setting: speed}
        return self.case.with_section(self.instance.key, **keys)

    def solved_speed(self, member: int) -> SolvedSpeed:
        """Target and speed of a member."""
        speed_key = f"{self.instance.key}.{self.target.setting}"
        return SolvedSpeed(self.flow_key, float(self.flows[member]), speed_key, float(self.speeds[member]))


def solve_speeds(
    case: Case,
    changes: Mapping[str, npt.ArrayLike],
    policy: str | None = None,
    options: OrbitOptions | None = None,
    execution: Execution | None = None,
) -> SolvedSpeeds | None:
    """Solve for the speed of each variant of a case that gives its target flow; None without a target.

    Args:
        case: case that all variants share.
        changes: changes as for `eclsim.simulate_many`, which may include a target such as "ecmo.flow_l_min".
        policy: blood volume policy; None takes that of the case.
        options: accuracy and effort of the search.
        execution: how the batch is computed.

    Raises:
        FlowNotReachedError: Two target flows are given at once.
        UnknownValueError: A speed is changed that follows from a target flow.
        ValueError: Arrays have different lengths.
    """
    changes = as_columns(changes)
    count = member_count(changes)
    targets = {instance.key: (instance, target) for instance, target in case.targets()}
    for instance in case.instances():
        if instance.device.target is not None and f"{instance.key}.{instance.device.target.key}" in changes:
            targets[instance.key] = (instance, instance.device.target)
    if not targets:
        return None
    if len(targets) > 1:
        message = (
            f"{' and '.join(targets)} both name a flow: only one can be solved for, give the others a speed"
        )
        raise FlowNotReachedError(message)
    (instance, target), shared = next(iter(targets.values())), _with_resting_speed(case, policy)
    sweep = instance.device.sweep(instance.section)
    if sweep is None:
        raise UnknownValueError(f"{instance.key} has no pump speed that could be solved for")
    flow_key = f"{instance.key}.{target.key}"
    varied_keys = {name: value for name, value in changes.items() if name != flow_key}
    flows = np.broadcast_to(
        np.asarray(changes.get(flow_key, getattr(instance.section, target.key)), dtype=float), (count,)
    )
    blank = SolvedSpeeds(shared, instance, target, varied_keys, flows, np.full(count, np.nan), ())
    if blank.speed in varied_keys:
        message = f"{blank.speed} is computed from the target flow: vary {flow_key}, or give the case a speed"
        raise UnknownValueError(message)
    model = model_of(blank.case_at(sweep.low))
    columns = {
        name: np.broadcast_to(np.asarray(value, float), (count,)) for name, value in varied_keys.items()
    }

    def flow_at(members: np.ndarray, speeds: np.ndarray) -> tuple[np.ndarray, list[str]]:
        varied = {name: column[members] for name, column in columns.items()} | {blank.speed: speeds}
        beats = simulate_many(model, varied, (blank.output,), policy, options, execution)
        return beats[blank.output].to_numpy(), [str(text) for text in beats["message"].to_numpy()]

    def narrowed_at(member: int) -> str:
        own = {name: float(column[member]) for name, column in columns.items()}
        _, line = instance.device.narrowed(instance, {**model.values, **own})
        return f"; {line}" if line else ""

    speeds, reasons = speeds_for_flows(flow_at, flows, (sweep.low, sweep.high))
    messages = tuple(
        reason
        and f"{flow_key} = {flows[k]:g} "
        + (
            f"cannot be reached: {reason}{narrowed_at(k)}"
            if np.isfinite(flows[k])
            else "is not a finite number"
        )
        for k, reason in enumerate(reasons)
    )
    return SolvedSpeeds(shared, instance, target, varied_keys, flows, speeds, messages)


def _with_resting_speed(case: Case, policy: str | None) -> Case:
    """Return the case with its speed at rest solved for, to which its open set points refer."""
    if case.regulation is None or not case.regulation.open_set_points or not case.at_rest().targets():
        return case
    return case.model_copy(update={"as_written": with_speed(case.at_rest(), policy)[0]})


# --- the search, for any function of speeds -------------------------------------------------------


def speeds_for_flows(
    flows: Flows, targets: np.ndarray, span: tuple[float, float]
) -> tuple[np.ndarray, list[str]]:
    """Speeds [rpm] within a range that give flows [L/min]; the lowest if there are several.

    The range is scanned. Each flow is then bracketed and found by false position (Illinois), with bisection
    where that stalls; all members are solved side by side.

    Args:
        flows: function that computes the flow of members at speeds.
        targets: target flows [L/min], shape (members,).
        span: smallest and largest speed [rpm].

    Returns:
        Speeds, NaN if there is none, and for each member the reason, empty if there is a speed.
    """
    count, tried = len(targets), np.linspace(*span, SPEEDS_SCANNED)
    result, messages = flows(np.repeat(np.arange(count), SPEEDS_SCANNED), np.tile(tried, count))
    searches = [
        _Search(targets[k], tried, result[scanned], messages[scanned][-1])
        for k in range(count)
        for scanned in [slice(k * SPEEDS_SCANNED, (k + 1) * SPEEDS_SCANNED)]
    ]
    while running := [k for k, search in enumerate(searches) if search.running]:
        trials = np.array([searches[k].trial() for k in running])
        result, messages = flows(np.array(running), trials)
        for k, speed, flow, message in zip(running, trials, result, messages, strict=True):
            searches[k].record(float(speed), float(flow), message)
    return np.array([search.speed for search in searches]), [search.reason for search in searches]


class _Search:
    """False position for one member, after a scan of the range.

    Args:
        target: target flow [L/min].
        speeds: increasing speeds of the scan.
        flows: flows at these speeds, NaN without a steady beat.
        message: message of the last speed.
    """

    def __init__(self, target: float, speeds: np.ndarray, flows: np.ndarray, message: str):
        self.target, self.speed, self.reason, self.trials, self.last = target, np.nan, "", 0, 0
        solved = np.flatnonzero(np.isfinite(flows))
        between = (
            (left, right)
            for left, right in pairwise(solved)
            if min(flows[left], flows[right]) <= target <= max(flows[left], flows[right])
        )
        ends = next(between, None)
        if not len(solved):
            self.reason = f"no steady beat was found at any speed: {message}"
        elif ends is None:
            self.reason = _unreachable_text(target, speeds, flows, solved)
        else:
            self.ends = (self.low, self.high) = tuple(float(speeds[k]) for k in ends)
            self.below, self.above = (float(flows[k] - target) for k in ends)
            for end, excess in ((self.low, self.below), (self.high, self.above)):
                if abs(excess) <= TOLERANCE_L_MIN and np.isnan(self.speed):
                    self.speed = end

    @property
    def running(self) -> bool:
        """Whether neither a speed nor a reason has been found yet."""
        return not self.reason and bool(np.isnan(self.speed))

    def trial(self) -> float:
        """Next speed to try."""
        secant = (self.low * self.above - self.high * self.below) / (self.above - self.below)
        return secant if self.trials % 8 != 7 else 0.5 * (self.low + self.high)

    def record(self, speed: float, flow: float, message: str) -> None:
        """Add the flow at the speed that was tried."""
        excess, self.trials = flow - self.target, self.trials + 1
        if not np.isfinite(flow):
            where = f"between {self.ends[0]:.0f} and {self.ends[1]:.0f} rpm"
            self.reason = f"it lies {where}, but no steady beat was found at {speed:.0f} rpm: {message}"
        elif abs(excess) <= TOLERANCE_L_MIN:
            self.speed = speed
        # The value at an end that is kept twice is halved, so that the next trial falls on its side.
        elif (excess > 0.0) == (self.above > 0.0):
            self.high, self.above = speed, excess
            self.below, self.last = self.below * (0.5 if self.last == 1 else 1.0), 1
        else:
            self.low, self.below = speed, excess
            self.above, self.last = self.above * (0.5 if self.last == -1 else 1.0), -1
        if self.running and self.trials == MOST_TRIALS:
            self.reason = f"the flow jumps over it between {self.low:.6g} and {self.high:.6g} rpm"


def _unreachable_text(target: float, speeds: np.ndarray, result: np.ndarray, solved: np.ndarray) -> str:
    most, least = solved[np.argmax(result[solved])], solved[np.argmin(result[solved])]
    if target > result[most]:
        text = f"the highest flow reached is {result[most]:.2f} L/min, at {speeds[most]:.0f} rpm"
    else:
        text = f"the lowest flow reached is {result[least]:.2f} L/min, at {speeds[least]:.0f} rpm"
    unknown = [f"{speed:.0f}" for k, speed in enumerate(speeds) if k not in solved]
    text += f" (pump range {speeds[0]:.0f} to {speeds[-1]:.0f} rpm)"
    return text + (f"; no steady beat was found at {', '.join(unknown)} rpm" if unknown else "")
