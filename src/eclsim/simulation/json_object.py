"""The JSON object of each simulated case, as other programs read it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.files import finite
from eclsim.simulation.single import FLOW_WANTED, SPEED_FOUND

if TYPE_CHECKING:
    import xarray as xr

OUTPUTS = (
    "SP", "DP", "MAP", "MPAP", "PCWP", "CO", "PF", "SPAP", "DPAP",
    "EDVLV", "ESVLV", "EDVRV", "ESVRV", "EDVLA", "ESVLA", "EDVRA", "ESVRA",
)  # fmt: skip
"""The outputs of the contract, in its order; PF is there with an ECMO circuit only."""


def results_object(results: Iterable[xr.Dataset]) -> dict[str, Any]:
    """All cases as one object, in order; holds finite numbers only, what is not finite is left out."""
    return {"cases": [case_object(result) for result in results]}


def case_object(result: xr.Dataset) -> dict[str, Any]:
    """One case: outputs in mmHg, L/min and mL, waveforms as mean, min and max over the beat."""
    scalars = {str(name): value for name, value in result.data_vars.items() if value.ndim == 0}
    others = [name for name in scalars if name not in OUTPUTS]
    return {
        "id": str(result.attrs["id"]),
        "converged": bool(result.attrs["converged"]),
        "beats": int(result.attrs["beats"]),
        "residual": finite(result.attrs["residual"]),
        "blood_volume_policy": str(result.attrs["blood_volume_policy"]),
        "status": _plain(result.attrs.get("status", "")),
        "message": str(result.attrs.get("message", "")),
        **(
            {"grid_error_percent": finite(result.attrs["grid_error_percent"])}
            if "grid_error_percent" in result.attrs
            else {}
        ),
        **_solved(result),
        "impossible": bool(result.attrs.get("impossible", 0)),
        "one_of_many": bool(result.attrs.get("one_of_many", 0)),
        "warnings": [str(sentence) for sentence in result.attrs.get("warnings", ())],
        "outputs": _numbers(result, [name for name in OUTPUTS if name in scalars]),
        "more_outputs": _numbers(result, others),
        "waveforms": {
            str(name): found for name in result.data_vars if (found := _statistics(result, str(name)))
        },
    }


def _solved(result: xr.Dataset) -> dict[str, Any]:
    """What was solved for, under the keys of a case file."""
    if SPEED_FOUND not in result.attrs:
        return {}
    return {
        "target": {"ecmo.flow_l_min": float(result.attrs[FLOW_WANTED])},
        "solved": {"ecmo.speed_rpm": float(result.attrs[SPEED_FOUND])},
    }


def _statistics(result: xr.Dataset, name: str) -> dict[str, float] | None:
    """Mean, smallest and largest value of a waveform; None for what is none or is not finite."""
    variable = result[name]
    if variable.dims != ("phase",):
        return None
    statistics = {"mean": "mean", "min": "minimum", "max": "maximum"}
    found = {key: float(variable.attrs[attribute]) for key, attribute in statistics.items()}
    return found if np.all(np.isfinite(list(found.values()))) else None


def _numbers(result: xr.Dataset, names: Sequence[str]) -> dict[str, float]:
    values = {name: result[name].item() for name in names}
    return {name: float(v) for name, v in values.items() if isinstance(v, int | float) and np.isfinite(v)}


def _plain(value: Any) -> str | int:
    return int(value) if isinstance(value, (int, np.integer)) else str(value)
