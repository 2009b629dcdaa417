"""What following a patient gives, and how measurements are held against their forecast."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import chi2

from eclsim.identification.filtering import GaussianMixture
from eclsim.identification.observation import OUTPUTS, unit_of
from eclsim.identification.verdict import FitVerdict
from eclsim.parameters import thiel2025

if TYPE_CHECKING:
    import xarray as xr

SHARES = (0.05, 0.5, 0.95)
UNUSUAL_SERIES = 0.01
"""A measurement whose outputs together are less probable than this does not fit the patient so far."""
UNUSUAL_OUTPUT = 0.001
"""An output that by itself is less probable than this does not fit the others."""


@dataclass(frozen=True)
class Interval:
    """Median and central 90 %, in the unit of the quantity."""

    lower: float
    median: float
    upper: float

    def as_object(self) -> dict[str, float]:
        """As plain data."""
        return {"median": self.median, "lower": self.lower, "upper": self.upper}


@dataclass(frozen=True)
class Innovation:
    """A measurement held against its forecast.

    Args:
        measured: value [mmHg or L/min].
        deviation: (measured - forecast) / standard deviation of the difference; None without a forecast.
        unusual: whether it does not fit.
        used: whether the parameters were updated with it.
    """

    measured: float
    deviation: float | None = None
    unusual: bool = False
    used: bool = True


@dataclass(frozen=True)
class TrackedPoint:
    """One time of a series.

    Args:
        name: of the point.
        innovations: of each measurement.
        parameters: after the update.
        outputs: of the model, after the update.
        drift: standard deviation of the change of a latent variable, as the measurements so far have it.
        forecast: what the model's outputs were expected to be; empty at the first point.
        expected: where 90 % of measurements were expected: the forecast with measurement noise.
        chi_square: of all innovations together; None at the first point.
        probability: of a larger one.
        unusual: whether the measurements together do not fit the patient so far.
        verdict: on the first estimate: whether the model can give the measurements; None at later points.
        message: what there is to say; empty where all is well.
        failed: whether the point could not be used.
        hours: since the measurement before, known or assumed; None at the first point.
        seconds: wall time of forecast and update.
    """

    name: str
    innovations: Mapping[str, Innovation]
    parameters: Mapping[str, Interval]
    outputs: Mapping[str, Interval]
    drift: float
    forecast: Mapping[str, Interval] = field(default_factory=dict)
    expected: Mapping[str, Interval] = field(default_factory=dict)
    chi_square: float | None = None
    probability: float | None = None
    unusual: bool = False
    verdict: FitVerdict | None = None
    message: str = ""
    failed: bool = False
    hours: float | None = None
    seconds: float = 0.0

    def as_object(self) -> dict[str, Any]:
        """As plain data for JSON; null for what is not known."""

        def each(intervals: Mapping[str, Interval]) -> dict[str, dict[str, float]]:
            return {n: i.as_object() for n, i in intervals.items()}

        return {
            "id": self.name,
            "hours_since_last": self.hours,
            "forecast": each(self.forecast),
            "expected": each(self.expected),
            "measurements": {n: dict(vars(i)) for n, i in self.innovations.items()},
            "chi_square": self.chi_square,
            "probability": self.probability,
            "unusual": self.unusual,
            "parameters": each(self.parameters),
            "outputs": each(self.outputs),
            "drift": self.drift,
            "seconds": round(self.seconds, 3),
            "failed": self.failed,
            "verdict": None if self.verdict is None else self.verdict.as_object(),
            "message": self.message,
        }


@dataclass(frozen=True)
class TrackResult:
    """A patient followed through a series of measurements.

    Args:
        patient: id.
        points: in order of time.
        assumed_interval_hours: from one measurement to the next; None where their names are times.
    """

    patient: str
    points: tuple[TrackedPoint, ...]
    assumed_interval_hours: float | None

    @property
    def dataset(self) -> xr.Dataset:
        """Parameters, forecasts and measurements over the points, with units; NaN for what is not known."""
        import xarray as xr

        points = self.points
        parameters = list(dict.fromkeys(n for p in points for n in p.parameters))
        outputs = [n for n in OUTPUTS if any(n in p.outputs or n in p.innovations for p in points)]

        def intervals(each: Sequence[Mapping[str, Interval]], names: Sequence[str]) -> np.ndarray:
            nothing = Interval(np.nan, np.nan, np.nan)
            found = [[own.get(n, nothing) for n in names] for own in each]
            return np.array([[(i.lower, i.median, i.upper) for i in row] for row in found])

        def of_measured(attribute: str) -> np.ndarray:
            rows = [[getattr(p.innovations.get(n), attribute, None) for n in outputs] for p in points]
            return np.array(rows, dtype=float)

        of_parameters = ("point", "parameter", "quantile")
        of_points, of_outputs = ("point", "output"), ("point", "output", "quantile")
        data = {
            "parameters": (of_parameters, intervals([p.parameters for p in points], parameters)),
            "forecast": (of_outputs, intervals([p.forecast for p in points], outputs)),
            "expected": (of_outputs, intervals([p.expected for p in points], outputs)),
            "outputs": (of_outputs, intervals([p.outputs for p in points], outputs)),
            "measured": (of_points, of_measured("measured")),
            "deviation": (of_points, of_measured("deviation")),
        }  # fmt: skip
        for name, unit in (("chi_square", "1"), ("probability", "1"), ("drift", "1"), ("hours", "h")):
            values = np.array([getattr(p, name) for p in points], dtype=float)
            data[name] = ("point", values, {"units": unit})
        coordinates = {
            "point": [p.name for p in points], "parameter": parameters, "output": outputs,
            "quantile": list(SHARES),
            "parameter_units": ("parameter", [thiel2025.PARAMETERS[n].unit for n in parameters]),
            "output_units": ("output", [unit_of(n) for n in outputs]),
        }  # fmt: skip
        return xr.Dataset(data, coordinates, {"patient": self.patient})

    def as_object(self) -> dict[str, Any]:
        """As plain data for JSON; null for what is not known."""
        return {
            "id": self.patient,
            "assumed_interval_hours": self.assumed_interval_hours,
            "points": [p.as_object() for p in self.points],
        }


@dataclass(frozen=True)
class InnovationTest:
    """Whether measurements fit their forecast.

    Args:
        deviations: of each output in standard deviations; NaN where nothing was measured.
        unusual: outputs that do not fit the others.
        left_out: of these, those that the update goes without.
        chi_square: of all together.
        probability: of a larger one.
    """

    deviations: np.ndarray
    unusual: np.ndarray
    left_out: np.ndarray
    chi_square: float
    probability: float

    @classmethod
    def of(
        cls, values: np.ndarray, scales: np.ndarray, outputs: GaussianMixture, given: np.ndarray
    ) -> InnovationTest:
        """Hold measurements against the outputs expected.

        One output that does not fit, while all others do, is left out of the update: a clotted line is
        likelier than a heart that changed so. Where several do not fit, the patient has changed.
        """
        total = outputs.covariance + np.diag(np.where(given, scales, 1.0) ** 2)
        away = values - outputs.mean
        deviations = away / np.sqrt(np.diag(total))
        square, probability = _chi_square(away, total, given)
        unusual = given & (np.abs(np.nan_to_num(deviations)) > np.sqrt(chi2.isf(UNUSUAL_OUTPUT, 1)))
        left_out = np.zeros_like(given)
        if probability < UNUSUAL_SERIES and given.sum() > 2:
            rests = []
            for k in np.flatnonzero(given):
                others = given.copy()
                others[k] = False
                rests.append((_chi_square(away, total, others)[0], k))
            rest, k = min(rests)
            by_itself = chi2.sf(square - rest, 1) < UNUSUAL_OUTPUT
            if by_itself and chi2.sf(rest, given.sum() - 1) > UNUSUAL_SERIES:
                unusual[k] = left_out[k] = True
        return cls(deviations, unusual, left_out, square, probability)

    def message(self, names: Sequence[str]) -> str:
        """What does not fit, and what was done; empty where all does."""
        if self.left_out.any():
            which = ", ".join(n for n, out in zip(names, self.left_out, strict=True) if out)
            return f"{which} does not fit the forecast and the other measurements: not used; check it"
        if self.probability < UNUSUAL_SERIES:
            return "the measurements do not fit the patient so far: a sudden change, or a mistake in several"
        if self.unusual.any():
            which = ", ".join(n for n, odd in zip(names, self.unusual, strict=True) if odd)
            return f"{which} is far from the forecast, though all together fit: used; check it"
        return ""


def _chi_square(away: np.ndarray, total: np.ndarray, chosen: np.ndarray) -> tuple[float, float]:
    a, t = away[chosen], total[np.ix_(chosen, chosen)]
    square = float(a @ np.linalg.solve(t, a))
    return square, float(chi2.sf(square, len(a)))
