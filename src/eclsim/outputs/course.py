"""The course in time as an xarray Dataset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from eclsim.beat.recording import all_signals
from eclsim.orbit.adaptive import adaptive_program
from eclsim.orbit.model import Model
from eclsim.orbit.transient import SEMI_IMPLICIT, follow
from eclsim.outputs.alarms import findings
from eclsim.outputs.dataset import UNITS, WORDS
from eclsim.outputs.signals import unstressed_volume


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
    known = all_signals(adaptive_program(model.circuit).explicit.assembly)
    signals = known if names is None else tuple(name for name in known if name in set(names))
    policy = policy or model.policy
    course = follow(model, seconds, signals, policy=policy, solver=solver)
    time = xr.DataArray(course.time, dims="time", attrs={"units": "s", "long_name": "time"})
    data = {name: _labelled(model, name, course.signals[:, k]) for k, name in enumerate(signals)}
    finite = bool(np.isfinite(course.signals).all())
    extremes = {n: (float(s.min()), float(s.max())) for n, s in zip(signals, course.signals.T, strict=True)}
    attributes = {
        "id": model.name,
        "seconds": float(seconds),
        "status": "finite" if finite else "not_finite",
        "blood_volume_policy": policy,
        "steps_per_beat": course.steps_per_beat,
        "solver": solver,
        "warnings": [f.sentence for f in findings({}, extremes)],
    }
    return xr.Dataset(data, coords={"time": time}, attrs=attributes)


def _labelled(model: Model, name: str, values: np.ndarray) -> tuple[str, Any, dict[str, str]]:
    place = name[1:]
    is_store = any(c.name == place for c in model.circuit.compartments)
    words = f"{WORDS[name[0]]} {place}" if name[0] != "P" or is_store else f"head of {place}"
    shift = unstressed_volume(model.circuit, place, model.values) if name[0] == "V" else 0.0
    return "time", values + shift, {"units": UNITS[name[0]], "long_name": words}
