"""Tracking of latent variables over time: a bank of iterated unscented Kalman filters.

The tracked quantities are the latent variables z of a `Prior`, in the coordinates u of the `Transport` of the
first measurement, in which its curved posterior is nearly normal. Between measurements z drifts. Over one
day,

    z(k+1) = sqrt(1 - q^2) z(k) + q e(k),    e(k) standard normal,

and over t days with q^2 replaced by 1 - (1 - q^2)^t (an Ornstein-Uhlenbeck process): over short times the
variance grows in proportion to time, and without measurements z returns to its prior, N(0, 1). A measurement
is the model's output plus noise. The output is averaged over sigma points (the unscented transform, Julier
and Uhlmann 1997; cubature weights, Arasaratnam and Haykin 2009), first around the forecast, then again around
the estimate itself (García-Fernández et al. 2015, IEEE Trans. Signal Process. 63, 5561), because the model is
far from linear over the width of a forecast.

The rate at which a patient drifts is not known. Filters with different q therefore run side by side, each
weighted by the probability that it has assigned to the measurements so far (Magill 1965, IEEE Trans. Autom.
Control 10, 434).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import logsumexp, ndtr, ndtri
from scipy.stats import chi2

from eclsim.arguments import FiniteNumber
from eclsim.identification.density import NoSteadyBeatError
from eclsim.identification.transport import Transport

Simulate = Callable[[np.ndarray], np.ndarray]
"""Outputs (members, outputs) of latent variables (members, parameters); NaN without a steady beat."""
DRIFTS = (0.05, 0.12, 0.3)
"""Standard deviation q of the change of a latent variable over a day.
With bounds a factor of 100 apart, 0.1 is about 18 % of the parameter near the middle of the bounds."""
SMALLEST_SPREAD = 1e-12
MOST_STEPS = 100
"""Largest number of steps into which a time without measurement is divided."""
ITERATIONS = 3
SMALL_CHANGE = 0.3
"""The estimate is linearised again only if it has moved by more than this, in its standard deviations."""
LIKELY_FILTER = 0.05
"""Weight of a filter from which on it decides how far an update has moved."""
RETRACTED_SHARES = (0.5, 0.2, 0.05)
"""A sigma point without a steady beat is moved towards the mean, to these shares of its distance."""
UNUSUAL_SERIES = 0.01
"""A measurement does not fit the patient so far if its outputs together are less probable than this."""
UNUSUAL_OUTPUT = 0.001
"""An output does not fit the others if by itself it is less probable than this."""


def as_drifts(name: str, drifts: Any) -> tuple[float, ...]:
    """Check and return standard deviations of drifts: one or more numbers above 0."""
    listed = (drifts,) if isinstance(drifts, str) or not isinstance(drifts, Iterable) else tuple(drifts)
    numbers = tuple(FiniteNumber(above=0.0)(name, drift) for drift in listed)
    if not numbers:
        raise ValueError(f"{name}: none given; allowed: numbers above 0, such as {DRIFTS}")
    return numbers


@dataclass(frozen=True)
class GaussianMixture:
    """Distribution at one time: a mixture of normal distributions, one for each filter of the bank.

    Args:
        weights: weights of the filters, which sum to 1, shape (filters,).
        means: means of the filters, shape (filters, size).
        covariances: covariances of the filters, shape (filters, size, size).
    """

    weights: np.ndarray
    means: np.ndarray
    covariances: np.ndarray

    @property
    def mean(self) -> np.ndarray:
        """Mean of the mixture, shape (size,)."""
        return self.weights @ self.means

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the mixture, shape (size, size)."""
        deviations = self.means - self.mean
        return (
            np.einsum("f,fij->ij", self.weights, self.covariances)
            + (deviations.T * self.weights) @ deviations
        )

    def quantiles(self, shares: Sequence[float]) -> np.ndarray:
        """Marginal quantiles of each component, found by bisection, shape (shares, size)."""
        # What no parameter moves is known exactly.
        spreads = np.maximum(np.sqrt(np.einsum("fii->fi", self.covariances)), SMALLEST_SPREAD)
        rows = []
        for share in shares:
            each = self.means + spreads * ndtri(share)
            low, high = each.min(axis=0), each.max(axis=0)
            for _ in range(60):
                middle = 0.5 * (low + high)
                below = self.weights @ ndtr((middle - self.means) / spreads) < share * self.weights.sum()
                low, high = np.where(below, middle, low), np.where(below, high, middle)
            rows.append(0.5 * (low + high))
        return np.stack(rows)

    def forecast(self, drifts: np.ndarray, transport: Transport, days: float = 1.0) -> GaussianMixture:
        """Return the distribution after some days without measurement.

        Args:
            drifts: q of each filter for one day.
            transport: coordinates in which the means are given.
            days: elapsed time [days], divided into steps; the drift of z is converted to u again at each.
        """
        steps = min(max(1, int(np.ceil(days))), MOST_STEPS)
        each = np.sqrt(-np.expm1(days / steps * np.log1p(-(drifts**2))))
        state = self
        for _ in range(steps):
            state = state._drifted(each, transport)
        return state

    def _drifted(self, drifts: np.ndarray, transport: Transport) -> GaussianMixture:
        """Return the distribution after one step; the drift of z is converted to u at each mean."""
        shares = np.sqrt(1.0 - drifts**2)
        means, covariances = self.means.copy(), self.covariances.copy()
        for k, (share, drift) in enumerate(zip(shares, drifts, strict=True)):
            back = np.linalg.inv(transport.jacobian(self.means[k]))
            means[k] += back @ ((share - 1.0) * transport.z_of(self.means[k])[0])
            covariances[k] = share**2 * covariances[k] + drift**2 * back @ back.T
        return GaussianMixture(self.weights, means, covariances)

    def draws(self, count: int, seed: int) -> np.ndarray:
        """Random points of the mixture, shape (about count, size)."""
        random = np.random.default_rng(seed)
        roots = np.linalg.cholesky(self.covariances)
        each = [
            mean + random.standard_normal((round(count * weight), len(mean))) @ root.T
            for weight, mean, root in zip(self.weights, self.means, roots, strict=True)
        ]
        return np.concatenate(each)


@dataclass(frozen=True)
class Regression:
    """Linear regression of outputs over a normal distribution: y = mean + slope (z - mean of z) + residual.

    Args:
        mean: mean outputs, shape (filters, outputs).
        slope: regression coefficients, shape (filters, outputs, parameters).
        rest: covariance of the residual, the nonlinear part, shape (filters, outputs, outputs).
    """

    mean: np.ndarray
    slope: np.ndarray
    rest: np.ndarray

    def outputs(self, state: GaussianMixture) -> GaussianMixture:
        """Return the distribution of the outputs for the state over which this regression was computed."""
        spread = self.slope @ state.covariances @ np.swapaxes(self.slope, 1, 2) + self.rest
        return GaussianMixture(state.weights, self.mean, spread)


def sigma_points(means: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Return the mean, and the mean +/- sqrt(size) times each column of the Cholesky factor.

    Returns:
        Points, shape (filters, 2 size + 1, size); the first is the mean.
    """
    size = means.shape[1]
    axes = np.sqrt(size) * np.swapaxes(np.linalg.cholesky(covariances), 1, 2)
    middle = means[:, None, :]
    return np.concatenate([middle, middle + axes, middle - axes], axis=1)


def regress(simulate: Simulate, means: np.ndarray, covariances: np.ndarray) -> Regression:
    """Regress the outputs on the latent variables over the normal distribution of each filter.

    Raises:
        NoSteadyBeatError: The model has no steady beat at a mean.
    """
    points = sigma_points(means, covariances)
    count, each, size = points.shape
    outputs = simulate(points.reshape(-1, size)).reshape(count, each, -1)
    if not np.isfinite(outputs[:, 0]).all():
        raise NoSteadyBeatError(
            "no steady heartbeat at the estimate so far: check heart rate and devices of this point"
        )
    for pull in RETRACTED_SHARES:
        missing = ~np.isfinite(outputs).all(axis=2)
        if not missing.any():
            break
        middle = np.repeat(points[:, :1], each, axis=1)[missing]
        centre = np.repeat(outputs[:, :1], each, axis=1)[missing]
        outputs[missing] = centre + (simulate(middle + pull * (points[missing] - middle)) - centre) / pull
    outputs = np.where(np.isfinite(outputs), outputs, outputs[:, :1])
    mean = outputs[:, 1:].mean(axis=1)
    deviations = outputs[:, 1:] - mean[:, None]
    shifts = points[:, 1:] - points[:, :1]
    cross = np.einsum("fno,fnp->fop", deviations, shifts) / (each - 1)
    slope = np.swapaxes(np.linalg.solve(covariances, np.swapaxes(cross, 1, 2)), 1, 2)
    spread = np.einsum("fno,fnq->foq", deviations, deviations) / (each - 1)
    return Regression(mean, slope, spread - slope @ covariances @ np.swapaxes(slope, 1, 2))


def updated(
    simulate: Simulate, forecast: GaussianMixture, first: Regression, measured: np.ndarray,
    errors: np.ndarray, used: np.ndarray,
) -> GaussianMixture:  # fmt: skip
    """Return the distribution after a measurement.

    Args:
        simulate: function that computes outputs from latent variables.
        forecast: forecast distribution of the latent variables.
        first: regression over the forecast.
        measured: measured values, shape (outputs,).
        errors: standard uncertainties of the measured values.
        used: whether each output is used for the update.
    """
    noise = np.diag(errors[used] ** 2)
    weights = _with_new_weights(forecast, first.outputs(forecast), measured, noise, used)
    means, covariances = _linear_update(forecast, forecast.means, first, measured, noise, used)
    for _ in range(ITERATIONS - 1):
        before = means
        try:
            again = regress(simulate, means, covariances)
        except NoSteadyBeatError:
            break
        means, covariances = _linear_update(forecast, before, again, measured, noise, used)
        moved = np.abs(means - before) / np.sqrt(np.einsum("fii->fi", covariances))
        if (moved.max(axis=1) * (weights > LIKELY_FILTER)).max() < SMALL_CHANGE:
            break
    return GaussianMixture(weights, means, covariances)


def outputs_after(simulate: Simulate, state: GaussianMixture) -> GaussianMixture:
    """Outputs after an update, by a regression over the filters that are likely.

    The regression over the forecast would add what is not linear over the width of the forecast, which the
    update has narrowed.

    Args:
        simulate: outputs of latent variables.
        state: of the latent variables after the update.

    Raises:
        NoSteadyBeatError: At a mean of the state.
    """
    likely = state.weights >= min(LIKELY_FILTER, state.weights.max())
    weights = state.weights[likely] / state.weights[likely].sum()
    chosen = GaussianMixture(weights, state.means[likely], state.covariances[likely])
    return regress(simulate, chosen.means, chosen.covariances).outputs(chosen)


def _linear_update(
    forecast: GaussianMixture, around: np.ndarray, regression: Regression, measured: np.ndarray,
    noise: np.ndarray, used: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Kalman update of the forecast with the model linearised around given points."""
    slope, residual = regression.slope[:, used], regression.rest[:, used][:, :, used]
    total = slope @ forecast.covariances @ np.swapaxes(slope, 1, 2) + residual + noise
    gain = np.swapaxes(np.linalg.solve(total, slope @ forecast.covariances), 1, 2)
    expected = regression.mean[:, used] + np.einsum("fop,fp->fo", slope, forecast.means - around)
    means = forecast.means + np.einsum("fpo,fo->fp", gain, measured[used] - expected)
    covariances = forecast.covariances - gain @ total @ np.swapaxes(gain, 1, 2)
    return means, 0.5 * (covariances + np.swapaxes(covariances, 1, 2))


def _with_new_weights(
    forecast: GaussianMixture, outputs: GaussianMixture, measured: np.ndarray, noise: np.ndarray,
    used: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Weights of the filters, multiplied by the likelihood of the measurement under each and normalised."""
    total = outputs.covariances[:, used][:, :, used] + noise
    deviations = measured[used] - outputs.means[:, used]
    square = np.einsum("fo,fo->f", deviations, np.linalg.solve(total, deviations[..., None])[..., 0])
    log = np.log(forecast.weights) - 0.5 * square - 0.5 * np.linalg.slogdet(total)[1]
    return np.exp(log - logsumexp(log)).clip(min=1e-12)


# --- measurements compared with their forecast -------------------------------------------------------


@dataclass(frozen=True)
class InnovationTest:
    """Test whether measurements fit their forecast.

    Args:
        deviations: deviation of each output in standard deviations; NaN where nothing was measured.
        unusual: whether each output is far from its forecast or does not fit the others.
        left_out: whether each output is unusual and not used for the update.
        persistent: whether each output is unusual but used, since it deviated in the same direction last
            time.
        chi_square: chi-square of all outputs together.
        probability: probability of a larger chi-square.
    """

    deviations: np.ndarray
    unusual: np.ndarray
    left_out: np.ndarray
    persistent: np.ndarray
    chi_square: float
    probability: float

    @classmethod
    def of(
        cls,
        values: np.ndarray,
        scales: np.ndarray,
        outputs: GaussianMixture,
        measured: np.ndarray,
        missed: np.ndarray | None = None,
    ) -> InnovationTest:
        """Compare measurements with the expected outputs.

        A single output that does not fit, while all others do, is left out of the update: an error such as a
        clotted line is more likely than such a change of the heart. If it does not fit the next time either,
        the change is lasting, and the output is used. Where several outputs do not fit, the patient has
        changed.

        Args:
            values: measured values.
            scales: standard uncertainties of the measured values.
            outputs: distribution of the expected outputs.
            measured: whether each output was measured.
            missed: deviations of the outputs that were left out the last time; NaN for others.
        """
        total = outputs.covariance + np.diag(np.where(measured, scales, 1.0) ** 2)
        differences = values - outputs.mean
        deviations = differences / np.sqrt(np.diag(total))
        square, probability = _chi_square(differences, total, measured)
        unusual = measured & (np.abs(np.nan_to_num(deviations)) > np.sqrt(chi2.isf(UNUSUAL_OUTPUT, 1)))
        left_out, persistent = np.zeros_like(measured), np.zeros_like(measured)
        if probability < UNUSUAL_SERIES and measured.sum() > 2:
            rests = []
            for k in np.flatnonzero(measured):
                others = measured.copy()
                others[k] = False
                rests.append((_chi_square(differences, total, others)[0], k))
            smallest, k = min(rests)
            by_itself = chi2.sf(square - smallest, 1) < UNUSUAL_OUTPUT
            if by_itself and chi2.sf(smallest, measured.sum() - 1) > UNUSUAL_SERIES:
                unusual[k] = True
                persistent[k] = missed is not None and missed[k] * deviations[k] > 0.0
                left_out[k] = not persistent[k]
        return cls(deviations, unusual, left_out, persistent, square, probability)

    def message(self, names: Sequence[str], changes: str = "") -> str:
        """State which outputs do not fit and whether they were used; empty if all fit.

        Args:
            names: names of the outputs.
            changes: how others moved with an output that does not fit; empty if they did not.
        """
        left_out, persistent, unusual = (
            ", ".join(itertools.compress(names, chosen))
            for chosen in (self.left_out, self.persistent, self.unusual)
        )
        if left_out and changes:
            return (
                f"{changes}: a sudden change of the patient is likelier than a wrong value: look at the "
                f"patient; {left_out} is not used, as the free parameters do not explain it with the others"
            )
        if left_out:
            return f"{left_out} does not fit the forecast and the other measurements: not used; check it"
        if persistent:
            return (
                f"{persistent} does not fit for the second time, while all others do: used now; a line, a "
                "device or the patient has changed"
            )
        if self.probability < UNUSUAL_SERIES:
            return "the measurements do not fit the patient so far: a sudden change, or a mistake in several"
        if unusual:
            text = f"{unusual} is far from the forecast, although all measurements together fit"
            return f"{text}: used; check it"
        return ""


def _chi_square(differences: np.ndarray, total: np.ndarray, chosen: np.ndarray) -> tuple[float, float]:
    a, t = differences[chosen], total[np.ix_(chosen, chosen)]
    square = float(a @ np.linalg.solve(t, a))
    return square, float(chi2.sf(square, len(a)))
