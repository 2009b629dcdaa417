"""Draws of a posterior: parameters of one patient that the measurements leave possible."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.app.texts import text
from eclsim.inputs.mistakes import CaseError, Mistake
from eclsim.parameters import thiel2025

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.cases.case import Case

MEMBERS = 128
"""Draws that bands are made of."""
MOST_VALUES = 2_000_000
LONGEST_DOUBT = 300
METHODS = {
    "importance": "posterior_importance", "nuts": "posterior_nuts", "gaussian": "posterior_gaussian",
}  # fmt: skip
"""How a posterior may have been found, and the key of its words."""


@dataclass(frozen=True)
class PosteriorDraws:
    """Draws of a patient's fitted parameters, all as likely as each other.

    Args:
        names: parameters.
        draws: in their units, shape (members, parameters), in no order.
        base: values of the patient that is shown when no knob is turned.
        method: how they were found: "importance", "nuts" or "gaussian".
        doubts: why they are not to be trusted; empty where they are.
    """

    names: tuple[str, ...]
    draws: np.ndarray
    base: Mapping[str, float]
    method: str
    doubts: tuple[str, ...]

    def values(self, values: Mapping[str, Any], count: int) -> dict[str, Any]:
        """Parameter values of the first members; a knob turns a fitted parameter in all of them.

        Args:
            values: of the patient that is shown.
            count: members.
        """
        own = {
            name: values[name] * self.draws[:count, k] / self.base[name] for k, name in enumerate(self.names)
        }
        return {**values, **own}

    def of(self, case: Case) -> PosteriorDraws:
        """The same members around the parameters of a case."""
        return replace(self, base={name: case.parameters[name] for name in self.names})

    def as_object(self) -> dict[str, Any]:
        """What the page says of them."""
        return {
            "method": text(METHODS[self.method]) if self.method in METHODS else self.method,
            "trusted": not self.doubts, "doubts": list(self.doubts), "checked": self.method != "gaussian",
            "count": len(self.draws),
        }  # fmt: skip

    def central(self) -> dict[str, float]:
        """The member nearest to the medians: one that fits, which the medians themselves need not."""
        logs = np.log(self.draws)
        spread = np.maximum(logs.std(axis=0), 1e-12)
        away = np.sum(((logs - np.median(logs, axis=0)) / spread) ** 2, axis=1)
        return dict(zip(self.names, map(float, self.draws[int(np.argmin(away))]), strict=True))


def read_posterior(name: str, content: bytes) -> PosteriorDraws:
    """PosteriorDraws of a `posterior.nc` that `eclsim identify --posterior` wrote.

    Raises:
        CaseError: If it is no such file, or holds what is no parameter.
    """
    import xarray as xr

    with tempfile.TemporaryDirectory(prefix="eclsim-") as folder:
        path = Path(folder) / "posterior.nc"
        path.write_bytes(content)
        try:
            with xr.open_dataset(path, group="posterior", engine="h5netcdf") as data:
                return _read(name, data)
        except CaseError:
            raise
        except Exception:  # whatever a damaged file makes the reader say
            raise _refused(name, text("posterior_damaged")) from None


def _read(name: str, data: xr.Dataset) -> PosteriorDraws:
    names = tuple(str(n) for n in data.data_vars)
    unknown = [n for n in names if n not in thiel2025.PARAMETERS]
    if not names or unknown or {"chain", "draw"} != set(data.dims):
        raise _refused(name, text("posterior_damaged"), ", ".join(unknown)[:80])
    if data.sizes["chain"] * data.sizes["draw"] * len(names) > MOST_VALUES:
        raise _refused(name, text("posterior_long"))
    draws = np.stack([np.asarray(data[n].values, dtype=float).ravel() for n in names], axis=1)
    for k, parameter in enumerate(names):
        known = thiel2025.PARAMETERS[parameter]
        column = draws[:, k]
        if not ((column > 0.0) & (column >= known.minimum) & (column <= known.maximum)).all():
            raise _refused(name, text("posterior_range", parameter=parameter))
    doubts = str(data.attrs.get("doubts", ""))[:LONGEST_DOUBT]
    if not int(data.attrs.get("trusted", 0)) and not doubts:
        doubts = text("posterior_unchecked")
    chosen = np.random.default_rng(0).permutation(len(draws))[:MEMBERS]
    result = PosteriorDraws(
        names, draws[chosen], {}, str(data.attrs.get("sampler", ""))[:40], (doubts,) if doubts else ()
    )
    return replace(result, base=result.central())


def _refused(name: str, why: str, value: str = "") -> CaseError:
    return CaseError([Mistake("", why, value, file=name)])
