"""Start values of a normal, a hypertensive and a hypotensive patient, solved for a mean pressure.

The paper names the three states and not their values. Here the systemic microcirculation is widened or
narrowed until the mean arterial pressure is in the middle of the paper's own class: hypotension below 65
mmHg, hypertension above 92 mmHg (section 3.2); everything else stays as the case has it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import MappingProxyType

from eclsim.orbit.model import AS_PUBLISHED, Model
from eclsim.orbit.status import Status

TARGETS: MappingProxyType[str, float] = MappingProxyType(
    {"normal": 79.0, "hypertensive": 102.0, "hypotensive": 60.0}
)
"""Mean arterial pressure of each state [mmHg]: the cohort's median (Table 1); the middle between 92 and the
cohort's 113; the middle between the cohort's 55 and 65."""

ADJUSTED = "Rmc"
_WIDEST = 32.0


class StateError(ValueError):
    """A state that the case cannot reach, or whose search met a patient without a steady beat."""


def state_values(model: Model, state: str, policy: str = AS_PUBLISHED) -> dict[str, float]:
    """The values that bring a model into a state: the systemic microcirculation's resistance [mmHg s/mL]."""
    if state not in TARGETS:
        raise StateError(f"state {state}: allowed: {', '.join(TARGETS)}")
    return {ADJUSTED: solve_for_pressure(model, TARGETS[state], policy=policy)}


def solve_for_pressure(
    model: Model, mean_pressure_mmhg: float, adjusted: str = ADJUSTED, policy: str = AS_PUBLISHED
) -> float:
    """Value of a parameter at which the mean arterial pressure is as wanted, to 0.001 mmHg.

    Raises:
        StateError: the pressure is not reached, or a beat on the way to it did not settle.
    """
    from scipy.optimize import brentq

    def excess(log_factor: float) -> float:
        value = model.values[adjusted] * math.exp(log_factor)
        tried = model.with_values({adjusted: value})
        return _mean_arterial_pressure(tried, policy, adjusted) - mean_pressure_mmhg

    low, high = _bracket(excess)
    if low is None or high is None:
        limits = f"{adjusted} / {_WIDEST:g} to {adjusted} x {_WIDEST:g}"
        raise StateError(
            f"a mean arterial pressure of {mean_pressure_mmhg:g} mmHg: not reached from {limits}"
        )
    root = brentq(excess, low, high, xtol=1e-6)
    return model.values[adjusted] * math.exp(float(root))  # pyright: ignore[reportArgumentType]  # a number


def _bracket(excess) -> tuple[float | None, float | None]:
    """Two neighbouring powers of two between which the pressure passes its target."""
    here, step = excess(0.0), math.log(2.0)
    direction = -1.0 if here > 0.0 else 1.0
    log_factor = 0.0
    while abs(log_factor) < math.log(_WIDEST):
        following = log_factor + direction * step
        there = excess(following)
        if here * there <= 0.0:
            return min(log_factor, following), max(log_factor, following)
        log_factor, here = following, there
    return None, None


def _mean_arterial_pressure(model: Model, policy: str, adjusted: str) -> float:
    """Of the steady beat; `StateError` where there is none."""
    from eclsim.orbit.steady import Batch
    from eclsim.outputs.steady_beat import steady_beat

    beat = steady_beat(Batch.of(model, policy), ("MAP",))
    if not beat.determined[0]:
        raise StateError(
            f"at {adjusted} = {model.values[adjusted]:.4g}, on the way to the mean arterial pressure wanted, "
            f"there is no steady beat ({Status(int(beat.status[0])).word}): {beat.message()}"
        )
    return float(beat.output("MAP")[0])


def union_over(unions: Sequence[Sequence[str]]) -> list[str]:
    """Names selected in any state, in order of appearance."""
    return list(dict.fromkeys(name for names in unions for name in names))
