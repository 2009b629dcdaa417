"""Checking what a parameter identification is asked for: targets, free parameters and their bounds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from eclsim.cases.sections import MEASURED
from eclsim.inputs.mistakes import CaseError, Mistake, shown
from eclsim.parameters import did_you_mean, thiel2025

if TYPE_CHECKING:
    from eclsim.cases.case import Case

TARGETS = MEASURED
"""Measurements that can be fitted."""


@dataclass(slots=True)
class CheckedFit:
    """What can be fitted, and everything there is to say about it.

    Attributes:
        targets: Measured values by name, in mmHg and L/min.
        free: Start value, lower and upper bound of each parameter that is free.
        fixed: Value of each parameter whose bounds are equal.
        mistakes: Errors; with any of them nothing can be fitted.
        warnings: Doubts.
        notes: What was left out or fixed.
    """

    targets: dict[str, float] = field(default_factory=dict)
    free: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    fixed: dict[str, float] = field(default_factory=dict)
    mistakes: list[Mistake] = field(default_factory=list)
    warnings: list[Mistake] = field(default_factory=list)
    notes: list[Mistake] = field(default_factory=list)


def common_policy(cases: Sequence[Case], wanted: str | None = None) -> str:
    """The blood volume policy that cases are fitted or studied with together.

    Args:
        cases: One at the least.
        wanted: Wins over what the cases say.

    Raises:
        CaseError: If the cases say different things.
    """
    if wanted is not None:
        return wanted
    found = {case.volume_policy: case.patient.id for case in cases}
    if len(found) > 1:
        said = ", ".join(f"{policy} in {name}" for policy, name in found.items())
        message = "cases that go together have the same policy; --volume-policy chooses one for all"
        raise CaseError([Mistake("blood_volume_policy", message, said)])
    return next(iter(found))


def check_fit(case: Case, bounds: Mapping[str, tuple[float, float, float]]) -> CheckedFit:
    """Check targets and bounds before anything is fitted; never raises.

    Args:
        case: Its measurements are the targets.
        bounds: Start value, lower and upper bound of each free parameter, in the parameter's unit,
            such as `eclsim.parameters.thiel2025.BOUNDS`.
    """
    checked = CheckedFit()
    if case.ecmo is not None and case.ecmo.flow_l_min is not None:
        message = "a target, while a fit needs the speed that the pump ran at"
        allowed = "ecmo.speed_rpm in its place; a measured pump flow is measurements.PF"
        checked.mistakes.append(Mistake("ecmo.flow_l_min", message, shown(case.ecmo.flow_l_min), allowed))
    measured = case.measurements
    for name in TARGETS:
        value = getattr(measured, name) if measured is not None else None
        if value is None or (name == "PF" and case.ecmo is None):
            checked.notes.append(Mistake(f"measurements.{name}", "not measured, so not fitted"))
        else:
            checked.targets[name] = value
    if not checked.targets:
        checked.mistakes.append(Mistake("measurements", "nothing to fit", allowed=", ".join(TARGETS)))
    for key, limits in bounds.items():
        _check_bounds(key, limits, checked)
    if 0 < len(checked.targets) < len(checked.free):
        counts = f"{len(checked.targets)} targets for {len(checked.free)} free parameters"
        checked.warnings.append(Mistake("measurements", f"under-determined: {counts}"))
    return checked


def _check_bounds(key: str, limits: tuple[float, float, float], checked: CheckedFit) -> None:
    start, lower, upper = limits
    written = f"{start:g}, {lower:g} to {upper:g}"
    parameter = thiel2025.PARAMETERS.get(key)
    if parameter is None:
        hint = did_you_mean(key, thiel2025.PARAMETERS) or ""
        allowed = "names of the parameter tables (eclsim parameters lists them)"
        checked.mistakes.append(Mistake(key, "unknown parameter", allowed=allowed, suggestion=hint))
        return
    allowed = parameter.allowed
    if not all(math.isfinite(number) for number in limits):
        checked.mistakes.append(Mistake(key, "start and bounds must be finite", written, allowed))
    elif lower > upper:
        hint = f"{upper:g} to {lower:g}"
        checked.mistakes.append(Mistake(key, "lower bound above upper bound", written, allowed, hint))
    elif not lower <= start <= upper:
        checked.mistakes.append(Mistake(key, "start value outside its bounds", written, allowed))
    elif not (parameter.accepts(lower) and parameter.accepts(upper)):
        checked.mistakes.append(Mistake(key, "bounds outside the allowed range", written, allowed))
    elif lower == upper:
        checked.fixed[key] = start
        checked.notes.append(Mistake(key, "bounds are equal: fixed, not fitted", shown(start)))
    else:
        checked.free[key] = (start, lower, upper)
