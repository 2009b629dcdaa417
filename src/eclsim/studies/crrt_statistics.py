"""Median and variation of the cycle means over the schemes, as in section 3.3 of Thiel et al."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

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
        means: quantities with a dimension `scheme`.

    Returns:
        For each quantity `<name>_median`, `<name>_variation` (largest less smallest),
        `<name>_variation_percent` (variation over the median's magnitude) and `<name>_highest`,
        `<name>_lowest` (letters of schemes).
    """
    import xarray as xr

    found = {}
    for name in SUMMARISED:
        data = means[name]
        units = {"units": data.attrs.get("units", "")}
        median = data.median("scheme", skipna=True)
        variation = data.max("scheme") - data.min("scheme")
        percent = 100.0 * variation / abs(median).where(median != 0.0)
        found[f"{name}_median"] = median.assign_attrs(units, long_name=f"median of {name} over the schemes")
        found[f"{name}_variation"] = variation.assign_attrs(units, long_name=f"largest less smallest {name}")
        found[f"{name}_variation_percent"] = percent.assign_attrs(
            units="%", long_name=f"variation of {name} relative to the median"
        )
        for word, choose in (("highest", np.argmax), ("lowest", np.argmin)):
            found[f"{name}_{word}"] = _letters(data, choose).assign_attrs(
                long_name=f"scheme with the {word} {name}"
            )
    return xr.Dataset(found)


def _letters(data: xr.DataArray, choose: Callable[..., Any]) -> xr.DataArray:
    """Letter of the scheme where a quantity is highest or lowest; empty where it is not known for all."""
    import xarray as xr

    letters = data["scheme"].values.astype(str)
    known = data.notnull().all("scheme")
    filled = data.fillna(0.0)
    index = xr.apply_ufunc(choose, filled, input_core_dims=[["scheme"]], kwargs={"axis": -1})
    named = xr.apply_ufunc(lambda k: letters[k], index)
    return named.where(known, "")
