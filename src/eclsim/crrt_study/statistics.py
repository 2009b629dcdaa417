"""Median and variation of the cycle means over the schemes, as in section 3.3 of Thiel et al.

Schemes whose beat was not found have no part in them; how many have is said beside them.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

SUMMARISED = (
    "Psart", "Psvn", "Ppart", "Pcrrttuin", "Pcrrttuout", "Pecmodrain", "PF", "MAP", "CO", "EDVRV", "ESVRV",
)  # fmt: skip
"""Quantities that are compared between the schemes: cycle means, and the right ventricle's volumes."""


def summarise(means: xr.Dataset) -> xr.Dataset:
    """Median, absolute and relative variation over the dimension `scheme`.

    Args:
        means: quantities with a dimension `scheme`; NaN where the beat was not found.

    Returns:
        For each quantity `<name>_median`, `<name>_variation` (largest less smallest),
        `<name>_variation_percent` (variation over the median's magnitude) and `<name>_highest`,
        `<name>_lowest` (letters of schemes; empty unless all are known); `schemes_known`, the number of
        schemes that these are computed from.
    """
    import xarray as xr

    found: dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, str]]] = {}
    letters = means["scheme"].values.astype(str)
    dims = tuple(str(d) for d in means[SUMMARISED[0]].dims if d != "scheme")
    for name in SUMMARISED:
        values = means[name].transpose("scheme", *dims).values
        units = {"units": means[name].attrs.get("units", "")}
        median, variation = _median(values), _variation(values)
        percent = 100.0 * variation / np.where(median == 0.0, np.nan, np.abs(median))
        about = units | {"long_name": f"median of {name} over the schemes"}
        found[f"{name}_median"] = (dims, median, about)
        about = units | {"long_name": f"largest less smallest {name}"}
        found[f"{name}_variation"] = (dims, variation, about)
        about = {"units": "%", "long_name": f"variation of {name} relative to the median"}
        found[f"{name}_variation_percent"] = (dims, percent, about)
        known = np.isfinite(values).all(axis=0)
        for word, choose in (("highest", np.argmax), ("lowest", np.argmin)):
            named = np.where(known, letters[choose(np.nan_to_num(values), axis=0)], "")
            found[f"{name}_{word}"] = (dims, named, {"long_name": f"scheme with the {word} {name}"})
    every = np.stack([means[name].transpose("scheme", *dims).values for name in SUMMARISED])
    about = {"units": "1", "long_name": "schemes whose beat was found, of which these are computed"}
    found["schemes_known"] = (dims, np.isfinite(every).all(axis=0).sum(axis=0), about)
    return xr.Dataset(found, {d: means[d] for d in dims})


def _median(values: np.ndarray) -> np.ndarray:
    """Median over the schemes that are known; NaN where none is."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="All-NaN")
        return np.nanmedian(values, axis=0)


def _variation(values: np.ndarray) -> np.ndarray:
    """Largest less smallest of the schemes that are known; NaN where none is."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="All-NaN")
        return np.nanmax(values, axis=0) - np.nanmin(values, axis=0)
