"""How sure the study can be of a scheme: the limits, held against samples of the patient's parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from eclsim.studies.crrt_limits import CRRT_LIMITS, LIMITS
from eclsim.studies.crrt_uptake import value

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.studies.crrt_batches import Bench

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
        Over `scheme`, `limit` and `quantile`: `probability_kept`, `<quantity>_quantiles`; over `scheme`
        `settled`, the share of the samples whose steady beat was found, and the rest is counted without.
    """
    import xarray as xr

    patients = {name: np.asarray(values, dtype=float) for name, values in samples.items()}
    records = bench.run_patients(np.array([speed]), policy, patients)
    shape = (len(bench.schemes), -1)
    settled = records.converged.reshape(shape)
    margins = {
        limit.name: np.where(settled, limit.margin(value(records, limit.quantity).reshape(shape)), np.nan)
        for limit in LIMITS
    }
    margins[CRRT_LIMITS] = np.min([margins[limit.name] for limit in LIMITS if limit.of_crrt], axis=0)
    counted = np.maximum(settled.sum(axis=1), 1)
    kept = np.stack([(m >= 0.0).sum(axis=1) / counted for m in margins.values()], axis=1)
    data = {
        "probability_kept": (("scheme", "limit"), kept, {"units": "1"}),
        "settled": ("scheme", settled.mean(axis=1), {"units": "1"}),
    }
    for name in QUANTITIES:
        found = np.where(settled, value(records, name).reshape(shape), np.nan)
        quantiles = np.nanquantile(found, QUANTILES, axis=1).T
        data[f"{name}_quantiles"] = (("scheme", "quantile"), quantiles, {})
    coordinates = {
        "scheme": [s.letter for s in bench.schemes],
        "limit": list(margins),
        "quantile": list(QUANTILES),
    }
    attributes = {"blood_volume_policy": policy, "samples": settled.shape[1], "speed_rpm": speed}
    return xr.Dataset(data, coordinates, attributes)
