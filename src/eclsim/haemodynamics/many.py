"""Many variants of a model at once, as one labelled table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from eclsim.haemodynamics.evaluation import batch_outputs, output_names
from eclsim.haemodynamics.outputs import output
from eclsim.solver.model import AS_PUBLISHED, Model
from eclsim.solver.orbit import OrbitOptions
from eclsim.solver.status import Status
from eclsim.solver.steady import Batch, steady_beats


def simulate_many(
    model: Model,
    changes: Mapping[str, Any],
    outputs: Sequence[str] | None = None,
    policy: str = AS_PUBLISHED,
    options: OrbitOptions | None = None,
) -> xr.Dataset:
    """Steady beats of variants of a model.

    Args:
        model: circuit and values that all variants share.
        changes: an array (members,) for each parameter that varies, or a number that holds for all.
        outputs: names of the registry; left out, all that the circuit has.
        policy: blood volume policy.
        options: accuracy and effort of the orbit solver.

    Returns:
        Dataset over `member`: the changed parameters as coordinates, outputs with units, `status` (see
        `Status`), `message`, `beats` and `residual`. Outputs of a member that did not settle are NaN, and its
        message says why.

    Raises:
        ValueError: arrays of different lengths.
        UnknownValueError: a parameter that the circuit does not have.
    """
    model.with_values(dict.fromkeys(changes, 0.0))
    lengths = {np.size(v) for v in changes.values() if np.ndim(v) > 0}
    if len(lengths) > 1:
        raise ValueError(f"arrays of {sorted(lengths)} members: all changes need the same length")
    count = lengths.pop() if lengths else 1
    names = tuple(outputs) if outputs is not None else output_names(model.circuit)
    values = {**model.values, **{k: np.asarray(v, dtype=float) for k, v in changes.items()}}
    steady = steady_beats(Batch(model.circuit, values, count, policy), options)
    found = batch_outputs(steady, names)
    settled = steady.orbits.status == Status.CONVERGED
    found = np.where(settled, found, np.nan)
    data: dict[str, Any] = {}
    for name, row in zip(names, found, strict=True):
        entry = output(name)
        labels = {"units": entry.unit, "long_name": entry.long_name, "definition": entry.definition}
        data[name] = ("member", row, labels)
    data["status"] = ("member", [Status(int(s)).name.lower() for s in steady.orbits.status])
    data["message"] = ("member", [Status(int(s)).message for s in steady.orbits.status])
    data["beats"] = ("member", steady.orbits.beats)
    data["residual"] = (
        "member",
        steady.orbits.residual,
        {"long_name": "largest relative change over a beat"},
    )
    coords = {k: ("member", np.broadcast_to(values[k], (count,))) for k in changes}
    attributes = {"id": model.name, "blood_volume_policy": policy, "failed": int((~settled).sum())}
    return xr.Dataset(data, coords=coords, attrs=attributes)
