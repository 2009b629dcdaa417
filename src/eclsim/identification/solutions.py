"""Whether the measurements of a fit have further solutions, before any draw of its posterior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eclsim.identification.density import Gaussian, NoSteadyBeatError, PosteriorDensity
from eclsim.identification.fit import FitResult
from eclsim.identification.fitted_parameters import FittedParameter
from eclsim.identification.objective import RISE_90
from eclsim.identification.posterior import PosteriorSettings, density_of, maxima_of
from eclsim.identification.quantities import Scale
from eclsim.identification.verdict import Aspect, Level, Reason, intervals_differ

NOTABLE_SHARE = 0.05
"""Probability of the other solutions above which 90 % intervals around one solution are too narrow."""


def with_solutions_sought(fit: FitResult) -> FitResult:
    """Return the fit with what further solutions of the measurements mean for it; the same fit without any.

    Maxima of the posterior density are sought from the ends of the search and from sets of parameters that it
    explored; see `maxima_of`. A solution that meets the measurements as well as the fit belongs
    to the 90 % intervals, as an end of the search does.
    """
    if not fit.simulated or fit.optimum.shared is not None or fit.verdict.goodness is None:
        return fit
    density = density_of(fit, PosteriorSettings())
    try:
        maxima = maxima_of(fit, density)
    except NoSteadyBeatError:
        return fit
    if not maxima.others:
        return fit
    fitted = density.prior.z_of(fit.optimum.x)
    own = maxima.solutions[int(maxima.nearest(fitted))]
    others = [each for each in maxima.solutions if each is not own]
    least = fit.verdict.goodness.chi_square
    as_good = [each for each in others if chi_square(density, each) <= least + RISE_90]
    fit = replace(fit, parameters=_reaching(fit, density, as_good))
    share = 1.0 - 1.0 / sum(np.exp(each.log_probability - own.log_probability) for each in maxima.solutions)
    parts = "; or ".join(_difference(density, own, each, fit) for each in others)
    them = "the other has" if len(others) == 1 else "the others have"
    sentence = (
        f"the measurements fit another patient, too: {parts}, against {words_on_fit(density, own, least)}; "
        f"{them} about {100.0 * share:.2g} % of the probability. A posterior (--posterior) covers all of "
        "them, and a further measurement may exclude one"
    )
    level = Level.DOUBTFUL if as_good or share > NOTABLE_SHARE else Level.GOOD
    return fit.judged([Reason(Aspect.SEARCH, level, "", sentence)])


def chi_square(density: PosteriorDensity, solution: Gaussian) -> float:
    """Sum of squared differences from the measurements at a solution, in standard uncertainties."""
    return float(np.sum(((solution.outputs - density.target) / density.scale) ** 2))


def words_on_fit(density: PosteriorDensity, own: Gaussian, fitted: float) -> str:
    """How well a fit meets the measurements, and the likeliest patient near it if that one does it better.

    A fit that minimises relative differences may be far from the likeliest patient, to whom the probability
    belongs.

    Args:
        density: posterior density of the fit.
        own: solution nearest to the fit.
        fitted: chi-square of the fit.
    """
    likeliest = chi_square(density, own)
    if fitted - likeliest <= RISE_90:
        return f"{fitted:.1f} of this fit"
    return (
        f"{likeliest:.1f} of the likeliest patient near this fit ({fitted:.1f} of the fit itself, which does "
        "not weigh differences by uncertainty: --weights uncertainty does)"
    )


def _difference(density: PosteriorDensity, own: Gaussian, other: Gaussian, fit: FitResult) -> str:
    """Text of the parameter in which another solution differs most, and of how well it fits."""
    spread = np.maximum(np.diag(other.covariance), np.diag(own.covariance))
    k = int(np.argmax((other.centre - own.centre) ** 2 / spread))
    name, there = density.prior.names[k], density.prior.values_of(other.centre)[k]
    here = fit.parameters[name].value
    return f"{name} {there:.4g} instead of {here:.4g} (chi-square {chi_square(density, other):.1f})"


def _reaching(
    fit: FitResult, density: PosteriorDensity, solutions: Sequence[Gaussian]
) -> dict[str, FittedParameter]:
    """Return the parameters with intervals that reach to solutions that fit as well."""
    parameters = {}
    for k, (name, known) in enumerate(fit.parameters.items()):
        values = [float(density.prior.values_of(each.centre)[k]) for each in solutions]
        lower, upper = min([known.lower, *values]), max([known.upper, *values])
        wider = replace(known, lower=lower, upper=upper)
        scale = Scale.of([name])
        ends = [scale.coordinates(np.array([[p.lower], [p.upper]]))[:, 0] for p in (known, wider)]
        if known.identifiable and intervals_differ(*ends):
            reason = (
                f"another solution fits the measurements equally well (90 %), from {lower:.3g} to "
                f"{upper:.3g} in all, a far wider interval than the derivatives at the fit give"
            )
            wider = replace(wider, identifiable=False, reason=reason)
        parameters[name] = wider
    return parameters
