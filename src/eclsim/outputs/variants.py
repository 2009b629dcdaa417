"""Many variants of a model at once, as one labelled table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.model import Model
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch, steady_beats
from eclsim.outputs.dataset import outcome
from eclsim.outputs.evaluation import batch_outputs, output_names
from eclsim.outputs.registry import output
from eclsim.outputs.sealed import valve_flows


def simulate_many(
    model: Model,
    changes: Mapping[str, Any],
    outputs: Sequence[str] | None = None,
    policy: str | None = None,
    options: OrbitOptions | None = None,
) -> xr.Dataset:
    """Steady beats of variants of a model.

    Args:
        model: circuit and values that all variants share.
        changes: an array (members,) for each parameter that varies, or a number that holds for all.
        outputs: names of the registry; left out, all that the circuit has.
        policy: blood volume policy; left out, the model's.
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
    policy = policy or model.policy
    steady = steady_beats(Batch(model.circuit, values, count, policy), options)
    judged = tuple(dict.fromkeys((*names, *valve_flows(model.circuit))))
    found = batch_outputs(steady, judged)
    ends = [outcome(steady, dict(zip(judged, found[:, k], strict=True)), k) for k in range(count)]
    settled = np.array([status is Status.CONVERGED for status, _ in ends])
    found = np.where(settled, found[: len(names)], np.nan)
    data: dict[str, Any] = {}
    for name, row in zip(names, found, strict=True):
        entry = output(name)
        labels = {"units": entry.unit, "long_name": entry.long_name, "definition": entry.definition}
        data[name] = ("member", row, labels)
    data["status"] = ("member", [status.name.lower() for status, _ in ends])
    data["message"] = ("member", [message for _, message in ends])
    data["beats"] = ("member", steady.orbits.beats)
    data["residual"] = (
        "member",
        steady.orbits.residual,
        {"long_name": "largest relative change over a beat"},
    )
    coords = {k: ("member", np.broadcast_to(values[k], (count,))) for k in changes}
    attributes = {"id": model.name, "blood_volume_policy": policy, "failed": int((~settled).sum())}
    return xr.Dataset(data, coords=coords, attrs=attributes)
