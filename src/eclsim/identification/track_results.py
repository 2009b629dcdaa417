"""What following a patient gives, and how measurements are held against their forecast."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from eclsim.identification.filtering import Belief

SHARES = (0.05, 0.5, 0.95)
UNUSUAL_SERIES = 0.01
"""A measurement whose outputs together are less probable than this does not fit the patient so far."""
UNUSUAL_OUTPUT = 0.001
"""An output that alone is less probable than this does not fit the others."""


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
        deviation: (measured - forecast) / standard deviation of the difference.
        unusual: whether it does not fit.
        used: whether the parameters were updated with it.
    """

    measured: float
    deviation: float | None
    unusual: bool
    used: bool


@dataclass(frozen=True)
class TrackedPoint:
    """One time of a series.

    Args:
        name: of the point.
        forecast: what the model's outputs were expected to be; empty at the first point.
        expected: where 90 % of measurements were expected: the forecast with measurement noise.
        innovations: of each measurement.
        chi_square: of all innovations together; None at the first point.
        probability: of a larger one.
        unusual: whether the measurements together do not fit the patient so far.
        parameters: after the update.
        outputs: of the model, after the update.
        drift: standard deviation of the change of a hidden variable, as the measurements so far have it.
        seconds: wall time of forecast and update.
        message: what there is to say; empty where all is well.
        failed: whether the point could not be used.
        hours: since the measurement before, known or assumed; None at the first point.
    """

    name: str
    forecast: Mapping[str, Interval]
    expected: Mapping[str, Interval]
    innovations: Mapping[str, Innovation]
    chi_square: float | None
    probability: float | None
    unusual: bool
    parameters: Mapping[str, Interval]
    outputs: Mapping[str, Interval]
    drift: float
    seconds: float
    message: str = ""
    failed: bool = False
    hours: float | None = None


@dataclass(frozen=True)
class Fitting:
    """How well measurements fit their forecast.

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
    def of(cls, values: np.ndarray, scales: np.ndarray, outputs: Belief, given: np.ndarray) -> Fitting:
        """Hold measurements against the outputs expected.

        One output that alone does not fit, while the others do, is left out of the update: a clotted line is
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
            alone = chi2.sf(square - rest, 1) < UNUSUAL_OUTPUT
            if alone and chi2.sf(rest, given.sum() - 1) > UNUSUAL_SERIES:
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


def named(names: Sequence[str], values: np.ndarray) -> dict[str, float]:
    """Values by name."""
    return dict(zip(names, values.tolist(), strict=True))


def intervals(names: Sequence[str], outputs: Belief) -> dict[str, Interval]:
    """Median and 90 % of each output of a belief."""
    found = outputs.quantiles(SHARES)
    return {n: Interval(*map(float, found[:, k])) for k, n in enumerate(names)}


def expected_measurements(
    names: Sequence[str], outputs: Belief, errors: Mapping[str, float]
) -> dict[str, Interval]:
    """Likewise of measurements of these outputs, with their standard uncertainties."""
    noise = np.diag([errors[n] ** 2 for n in names])
    return intervals(names, Belief(outputs.weights, outputs.means, outputs.covariances + noise))
