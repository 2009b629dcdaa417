"""What a fit is asked for: free parameters with bounds, weights, how widely to look."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from eclsim.cases.fitting import CheckedFit, check_fit
from eclsim.identification.multi_start import MultiStart
from eclsim.inputs.mistakes import Mistake
from eclsim.orbit.model import VolumePolicy, circuit_of
from eclsim.parameters import did_you_mean, thiel2025
from eclsim.parameters.thiel2025 import BOUNDS
from eclsim.sensitivity.uncertainties import DEFAULTS, Uncertainty

if TYPE_CHECKING:
    from eclsim.cases.case import Case

WIDE = 10.0
"""Bounds of a parameter that has none of its own: its value divided and multiplied by this."""


@dataclass(frozen=True)
class FitSettings:
    """How data points are fitted.

    Args:
        parameters: free parameters.
        bounds: lower and upper bounds that differ from the usual ones.
        weights: "relative", (simulated - measured) / measured as in the paper, or "uncertainty",
            (simulated - measured) / standard uncertainty.
        uncertainties: standard uncertainties of measurements that differ from the defaults.
        multi_start: how widely to look.
        volume_policy: blood volume policy; None, that of the cases.
        shared: free parameters that all data points of a patient of a cohort have in common.
    """

    parameters: tuple[str, ...] = tuple(BOUNDS)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    weights: Literal["relative", "uncertainty"] = "relative"
    uncertainties: Mapping[str, Uncertainty] = field(default_factory=dict)
    multi_start: MultiStart = field(default_factory=MultiStart)
    volume_policy: VolumePolicy | None = None
    shared: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """All free parameters: what is shared is free as well."""
        return tuple(dict.fromkeys([*self.parameters, *self.shared]))

    def as_object(self) -> dict[str, Any]:
        """As plain data; two fits with the same object give the same numbers."""
        m = self.multi_start
        return {
            "parameters": list(self.parameters),
            "bounds": {k: list(v) for k, v in self.bounds.items()},
            "weights": self.weights,
            "uncertainties": {k: [u.absolute, u.relative] for k, u in self.uncertainties.items()},
            "points_per_parameter": m.points_per_parameter,
            "refined_share": m.refined_share,
            "round_size": m.round_size,
            "rediscoveries": m.rediscoveries,
            "seed": m.seed,
            "blood_volume_policy": self.volume_policy,
            "shared": list(self.shared),
        }


def checked_fit(case: Case, settings: FitSettings) -> CheckedFit:
    """Targets and bounds of a case, checked, with everything there is to say."""
    wanted = {name: _bounds(name, case, settings.bounds) for name in settings.names}
    checked = check_fit(case, wanted)
    read = ("heart_rate_bpm", *circuit_of(case).parameter_names())
    for name in [*checked.free, *checked.fixed]:
        if name not in read:
            checked.mistakes.append(
                Mistake(name, "not read by the circuit of this case, so it cannot be fitted")
            )
        elif wanted[name][1] <= 0.0:
            checked.mistakes.append(
                Mistake(name, "is sought on a logarithmic scale: its lower bound must be above 0")
            )
    for name in settings.bounds:
        if name not in settings.names:
            hint = did_you_mean(name, settings.names) or ""
            allowed = ", ".join(settings.names)
            checked.mistakes.append(
                Mistake(name, "bounds of a parameter that is not free", "", allowed, hint)
            )
    if not checked.mistakes and not checked.free:
        checked.mistakes.append(Mistake("parameters", "none is free"))
    return checked


def unmeasured_uncertainties(cases: Iterable[Case], settings: FitSettings) -> list[Mistake]:
    """Uncertainties that change nothing, because no case has such a measurement."""
    measured = {n for case in cases for n in checked_fit(case, settings).targets}
    return [
        Mistake("uncertainty", "not measured, so its uncertainty changes nothing", name,
                ", ".join(n for n in DEFAULTS if n in measured))
        for name in settings.uncertainties
        if measured and name not in measured
    ]  # fmt: skip


def _bounds(name: str, case: Case, given: Mapping[str, tuple[float, float]]) -> tuple[float, float, float]:
    """Start value, lower and upper bound; a case's own value is the start where it is inside the bounds."""
    known = thiel2025.PARAMETERS.get(name)
    if known is None:
        return (0.0, 0.0, 0.0)
    if name in BOUNDS:
        start, lower, upper = BOUNDS[name]
    else:
        start = float(known.value)
        lower, upper = max(start / WIDE, known.minimum), min(start * WIDE, known.maximum)
    own = case.parameters.get(name, start)
    if name in given:
        lower, upper = given[name]
        middle = (lower * upper) ** 0.5 if 0.0 < lower <= upper else lower
        start = start if lower <= start <= upper else middle
    if lower > upper:
        return (lower, lower, upper)
    return (own if lower <= own <= upper else start, lower, upper)


def read_bounds(text: str) -> dict[str, tuple[float, float]]:
    """Read "Rmc=0.1:2,Csart=0.5:5".

    Raises:
        ValueError: With one line for each part that is no pair of numbers.
    """
    found, wrong = {}, []
    for part in (p.strip() for p in text.split(",") if p.strip()):
        name, _, numbers = part.partition("=")
        lower, _, upper = numbers.partition(":")
        if name.strip() in found:
            wrong.append(f"--bounds {part}: {name.strip()} is given twice; leave one of them out")
            continue
        try:
            found[name.strip()] = float(lower), float(upper)
        except ValueError:
            wrong.append(f"--bounds {part}: allowed: NAME=LOWER:UPPER, such as Rmc=0.1:2")
    if wrong:
        raise ValueError("\n".join(wrong))
    return found


def parameter_names(text: str) -> Sequence[str]:
    """Read "Csart,Rmc"; each name once."""
    return list(dict.fromkeys(p.strip() for p in text.split(",") if p.strip()))
