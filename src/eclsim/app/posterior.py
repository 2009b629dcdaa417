"""Posterior draws: parameters of one patient that are consistent with the measurements, read or sampled."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from eclsim.app.fitting import PAGE_SEARCH, prepared_for_fit
from eclsim.app.texts import in_page_words, text
from eclsim.cases.case import Case
from eclsim.cases.quantities import quantity, with_values
from eclsim.cases.reading import read_mapping
from eclsim.cases.resolve import circuit_of, resolve_parameters
from eclsim.identification.density import PosteriorDensity, Prior, gaussian_approximation
from eclsim.identification.draws import several_solutions
from eclsim.identification.importance import importance_sample
from eclsim.identification.multi_start import MultiStart, sobol
from eclsim.identification.objective import Box, Explored
from eclsim.identification.quantities import Scale
from eclsim.identification.settings import checked_fit
from eclsim.inputs.mistakes import CaseError, Mistake
from eclsim.orbit.model import VolumePolicy, model_of
from eclsim.outputs.signals import parameters_read
from eclsim.outputs.uncertainty import measurement_errors

BAND_MEMBERS = 128
"""Number of draws used for bands."""
MOST_VALUES = 2_000_000
LONGEST_DOUBT = 300
METHODS = {
    "importance": "posterior_importance", "nuts": "posterior_nuts", "gaussian": "posterior_gaussian",
}  # fmt: skip
"""Methods of sampling a posterior, with the text key of each."""


@dataclass(frozen=True)
class PosteriorDraws:
    """Draws of a patient's fitted parameters, equally weighted.

    Args:
        names: names of the parameters.
        draws: draws in the parameters' units, shape (members, parameters), in random order.
        base: parameter values of the displayed patient before any knob is turned.
        method: method of sampling: "importance", "nuts" or "gaussian".
        doubts: reasons not to trust the draws; empty if there are none.
    """

    names: tuple[str, ...]
    draws: np.ndarray
    base: Mapping[str, float]
    method: str
    doubts: tuple[str, ...]

    def values(self, values: Mapping[str, Any], count: int) -> dict[str, Any]:
        """Return parameter values of the first members; a knob changes a fitted parameter in all of them.

        Parameters fitted on a logarithmic scale are multiplied by the ratio of displayed to base value. The
        others are shifted by the difference, within the range allowed in a case file.

        Args:
            values: parameter values of the displayed patient.
            count: number of members.
        """
        shown, base = (np.array([by[name] for name in self.names]) for by in (values, self.base))
        draws, linear = self.draws[:count], Scale.of(self.names).linear
        lowest, highest = _ranges(self.names)
        moved = np.clip(draws + shown - base, lowest, highest)
        draws_of = np.where(linear, moved, shown * draws / np.where(linear, 1.0, base))
        return {**values, **dict(zip(self.names, draws_of.T, strict=True))}

    def of(self, case: Case) -> PosteriorDraws:
        """Return the same members with the parameter values of a case as base."""
        values = resolve_parameters(case)
        return replace(self, base={name: values[name] for name in self.names})

    def centred(self, case: Case) -> Case:
        """Return the case with the base values, around which the members lie.

        Raises:
            CaseError: The case lacks such parameters, or its other values contradict them.
        """
        read = parameters_read(circuit_of(case))
        if missing := [name for name in self.names if name not in read]:
            reason = text("posterior_foreign", name=case.patient.id)
            raise CaseError([Mistake(", ".join(missing)[:80], reason, allowed=text("posterior_own"))])
        return read_mapping(with_values(case, self.base).as_mapping()).case

    def as_object(self) -> dict[str, Any]:
        """Return plain data for the page."""
        return {
            "method": text(METHODS[self.method]) if self.method in METHODS else self.method,
            "trusted": not self.doubts, "doubts": list(self.doubts), "checked": self.method != "gaussian",
            "count": len(self.draws),
        }  # fmt: skip

    def central(self) -> dict[str, float]:
        """Return the member nearest to the medians: a member is consistent, which the medians need not be."""
        at = Scale.of(self.names).coordinates(self.draws)
        spread = np.maximum(at.std(axis=0), 1e-12)
        away = np.sum(((at - np.median(at, axis=0)) / spread) ** 2, axis=1)
        return dict(zip(self.names, map(float, self.draws[int(np.argmin(away))]), strict=True))


def _ranges(names: tuple[str, ...]) -> np.ndarray:
    """Return smallest and largest values allowed in a case file, shape (2, parameters)."""
    known = [parameter for name in names if (parameter := quantity(name)) is not None]
    return np.array([(parameter.minimum, parameter.maximum) for parameter in known]).T


def read_posterior(name: str, content: bytes) -> PosteriorDraws:
    """Read the draws of a `posterior.nc` written by `eclsim identify --posterior`.

    Raises:
        CaseError: It is not such a file, or has a variable that is not a parameter.
    """
    with tempfile.TemporaryDirectory(prefix="eclsim-") as folder:
        path = Path(folder) / "posterior.nc"
        path.write_bytes(content)
        try:
            with xr.open_dataset(path, group="posterior", engine="h5netcdf") as data:
                return _read(name, data)
        except CaseError:
            raise
        except Exception:  # any error that the reader raises on a damaged file
            raise _refused(name, text("posterior_damaged")) from None


def _read(name: str, data: xr.Dataset) -> PosteriorDraws:
    names = tuple(str(n) for n in data.data_vars)
    if not names or {"chain", "draw"} != set(data.dims):
        raise _refused(name, text("posterior_damaged"))
    if unknown := [n for n in names if quantity(n) is None]:
        raise _refused(name, text("posterior_unknown"), ", ".join(unknown)[:80])
    if data.sizes["chain"] * data.sizes["draw"] * len(names) > MOST_VALUES:
        raise _refused(name, text("posterior_long"))
    draws = np.stack([np.asarray(data[n].values, dtype=float).ravel() for n in names], axis=1)
    lowest, highest = _ranges(names)
    right = (draws >= lowest) & (draws <= highest) & ((draws > 0.0) | Scale.of(names).linear)
    if wrong := [n for n, column in zip(names, right.T, strict=True) if not column.all()]:
        raise _refused(name, text("posterior_range", parameter=wrong[0]))
    doubts = str(data.attrs.get("doubts", ""))[:LONGEST_DOUBT]
    if not int(data.attrs.get("trusted", 0)) and not doubts:
        doubts = text("posterior_unchecked")
    chosen = np.random.default_rng(0).permutation(len(draws))[:BAND_MEMBERS]
    result = PosteriorDraws(
        names, draws[chosen], {}, str(data.attrs.get("sampler", ""))[:40], (doubts,) if doubts else ()
    )
    return replace(result, base=result.central())


def _refused(name: str, reason: str, value: str = "") -> CaseError:
    return CaseError([Mistake("", reason, value, file=name)])


# --- weighted draws around a fit, the quick way to a posterior --------------------------------------


SHOWN_DRAWS = 4000
SEED = 0


@dataclass(frozen=True)
class _ReportingDensity(PosteriorDensity):
    """A density that reports how many beats it has computed; the report may raise an exception to stop it."""

    report: Callable[[str], None] = print
    done: list[int] = field(default_factory=list)

    def simulate(self, z: np.ndarray, centre: np.ndarray | None = None) -> np.ndarray:
        """Return outputs as `PosteriorDensity.simulate` does."""
        self.report(text("posterior_draws", count=sum(self.done)))
        result = super().simulate(z, centre)
        self.done.append(len(z))
        return result


def plain_posterior(
    raw: Mapping[str, Any], policy: VolumePolicy, report: Callable[[str], None], free: Sequence[str] = ()
) -> dict[str, Any]:
    """Return members, parameter intervals and doubts for a fitted case.

    Args:
        raw: case with measurements and the fitted parameters, as in a case file.
        policy: blood volume policy.
        report: called with a description of the current step; may raise an exception to stop.
        free: the fitted parameters; empty to choose those worth fitting.

    Returns:
        Plain data: names and members, intervals of the parameters, notes on several solutions, and
        diagnostics of the weights.
    """
    report(text("posterior_preparing"))
    posterior, start = _density(raw, policy, report, free)
    explored = sobol(posterior.prior, MultiStart(PAGE_SEARCH["points_per_parameter"]))
    outputs = PosteriorDensity.simulate(posterior, posterior.prior.z_of(explored))
    gaussian = gaussian_approximation(posterior, start[None], Explored(explored, outputs))
    weighted = importance_sample(posterior, gaussian, seed=SEED)
    names, drawn = posterior.prior.names, weighted.z[weighted.resample(SHOWN_DRAWS, SEED)]
    shown = posterior.prior.values_of(drawn)
    notes = [in_page_words(n) for n in several_solutions(posterior.prior, drawn, gaussian)]
    chosen = np.random.default_rng(SEED).permutation(weighted.resample(BAND_MEMBERS, SEED))
    members = posterior.prior.values_of(weighted.z[chosen])
    quantiles = np.quantile(shown, (0.05, 0.5, 0.95), axis=0).T.tolist()
    return {
        "names": list(names), "members": members.tolist(), "method": "importance",
        "doubts": list(weighted.doubts), "shape": float(weighted.shape), "effective": weighted.effective,
        "draws": len(weighted.z), "notes": notes,
        "parameters": {
            n: {"lower": low, "median": middle, "upper": high}
            for n, (low, middle, high) in zip(names, quantiles, strict=True)
        },
    }  # fmt: skip


def _density(
    raw: Mapping[str, Any], policy: VolumePolicy, report: Callable[[str], None], free: Sequence[str]
) -> tuple[_ReportingDensity, np.ndarray]:
    """Return the density of a fitted case's parameters, and the coordinates of their fitted values."""
    case, settings = prepared_for_fit(raw, policy, free)
    checked = checked_fit(case, settings)
    prior = Prior.within(Box.of(checked.free))
    model = model_of(case).with_values(dict(checked.fixed))
    errors = measurement_errors(checked.targets)
    return _ReportingDensity(model, dict(checked.targets), errors, prior, policy, report), prior.start
