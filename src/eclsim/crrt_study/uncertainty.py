"""How sure the study can be of a scheme: the limits, held against samples of the patient's parameters."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from eclsim.crrt_study.limits import CRRT_LIMITS, LIMITS
from eclsim.crrt_study.uptake import value

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.crrt_study.batches import Bench

QUANTITIES = ("Psart", "Pcrrttuin", "Pcrrttuout", "PF")
QUANTILES = (0.05, 0.5, 0.95)


def uncertainty(
    bench: Bench, speed: float, policy: str, samples: Mapping[str, Sequence[float]]
) -> xr.Dataset:
    """Probability that every scheme keeps each limit, and the spread of its pressures.

    Args:
        bench: of the study.
        speed: pump speed [rpm].
        policy: blood volume policy.
        samples: values by parameter, one per sample.

    Returns:
        Over `scheme`: `settled`, the share of the samples whose steady beat was found. Of these alone:
        `probability_kept` over `scheme` and `limit`, and `<quantity>_quantiles` over `scheme` and `quantile`;
        NaN where there is none. The share of all samples lies between `probability_at_least`, where those
        without a beat break the limit, and `probability_at_most`, where they keep it.
    """
    import xarray as xr

    patients = {name: np.asarray(values, dtype=float) for name, values in samples.items()}
    records = bench.run_patients(np.array([speed]), policy, patients)
    shape = (len(bench.schemes), -1)
    settled = records.converged.reshape(shape)
    margins = {limit.name: limit.margin(value(records, limit.quantity).reshape(shape)) for limit in LIMITS}
    margins[CRRT_LIMITS] = np.min([margins[limit.name] for limit in LIMITS if limit.of_crrt], axis=0)
    kept = np.stack([(m >= 0.0).sum(axis=1) for m in margins.values()], axis=1)
    found, every = settled.sum(axis=1)[:, None], settled.shape[1]
    dims = ("scheme", "limit")
    data = {
        "probability_kept": (dims, np.where(found > 0, kept / np.maximum(found, 1), np.nan), {"units": "1"}),
        "probability_at_least": (dims, kept / every, {"units": "1"}),
        "probability_at_most": (dims, (kept + every - found) / every, {"units": "1"}),
        "settled": ("scheme", settled.mean(axis=1), {"units": "1"}),
    }
    for name in QUANTITIES:
        quantiles = _quantiles(value(records, name).reshape(shape))
        data[f"{name}_quantiles"] = (("scheme", "quantile"), quantiles, {})
    coordinates = {
        "scheme": [s.letter for s in bench.schemes],
        "limit": list(margins),
        "quantile": list(QUANTILES),
    }
    attributes = {"blood_volume_policy": policy, "samples": settled.shape[1], "speed_rpm": speed}
    return xr.Dataset(data, coordinates, attributes)


def _quantiles(values: np.ndarray) -> np.ndarray:
    """Quantiles of the samples whose beat was found, shape (schemes, quantiles); NaN where none was."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="All-NaN")
        return np.nanquantile(values, QUANTILES, axis=1).T
