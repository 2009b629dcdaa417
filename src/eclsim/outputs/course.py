"""The course in time as a labelled result."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from eclsim.beat.recording import all_signals
from eclsim.circuit.assembly import assemble
from eclsim.orbit.model import Model
from eclsim.orbit.steady import SEMI_IMPLICIT
from eclsim.orbit.transient import follow
from eclsim.outputs.alarms import findings
from eclsim.outputs.results import variable
from eclsim.outputs.signals import signal_labels, unstressed_volume


def simulate_course(
    model: Model,
    seconds: float,
    *,
    policy: str | None = None,
    solver: str = SEMI_IMPLICIT,
    names: Sequence[str] | None = None,
) -> xr.Dataset:
    """A model's course from the published initial state.

    Args:
        model: circuit and values.
        seconds: how long [s].
        policy: blood volume policy; with "patient_held" the circuits start primed. Left out, the model's.
        solver: "semi-implicit" or "adaptive".
        names: waveforms to keep; left out, all.

    Returns:
        Waveforms over `time` [s]; the attributes say how they were computed.
    """
    known = all_signals(assemble(model.circuit))
    signals = known if names is None else tuple(name for name in known if name in set(names))
    policy = policy or model.policy
    course = follow(model, seconds, signals, policy=policy, solver=solver)
    data = {
        name: variable(
            "time", column + unstressed_volume(model.circuit, name, model.values),
            **signal_labels(model.circuit, name),
        )
        for name, column in zip(signals, course.signals.T, strict=True)
    }  # fmt: skip
    extremes = {n: (float(s.min()), float(s.max())) for n, s in zip(signals, course.signals.T, strict=True)}
    attributes = {
        "id": model.name,
        "seconds": float(seconds),
        "status": "finite" if np.isfinite(course.signals).all() else "not_finite",
        "blood_volume_policy": policy,
        "steps_per_beat": course.steps_per_beat,
        "solver": solver,
        "warnings": [f.sentence for f in findings({}, extremes)],
    }
    time = variable("time", course.time, units="s", long_name="time")
    return xr.Dataset(data, coords={"time": time}, attrs=attributes)
