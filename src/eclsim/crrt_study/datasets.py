"""The records of the study as labelled datasets with units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.crrt_study.batches import Bench
from eclsim.devices.crrt import crrt
from eclsim.orbit.status import Status
from eclsim.outputs.recirculation import recirculated_fraction
from eclsim.outputs.records import BeatRecords
from eclsim.outputs.registry import output
from eclsim.outputs.signals import unstressed_volume

if TYPE_CHECKING:
    import xarray as xr

UNITS = {"P": "mmHg", "Q": "mL/s", "V": "mL"}
WORDS = {"P": "pressure in", "Q": "flow out of", "V": "stressed blood volume of"}
GROUPS = ("patient", "ecmo", "crrt")


def means(
    bench: Bench,
    runs: Sequence[BeatRecords],
    alone: Sequence[BeatRecords],
    policies: Sequence[str],
    speeds: np.ndarray,
) -> xr.Dataset:
    """Cycle means, outputs, volumes and recirculation over `policy`, `scheme` and `speed`."""
    import xarray as xr

    dims = ("policy", "scheme", "speed")
    shape = (len(bench.schemes), len(speeds))
    data = _variables(runs, dims, shape)
    change = np.stack(
        [r.volumes["patient"].reshape(shape) - a.volumes["patient"] for r, a in zip(runs, alone, strict=True)]
    )
    about = "stressed volume of the patient at phase 0, less that without CRRT at the same speed and policy"
    data["patient_volume_change"] = (dims, change, {"units": "mL", "long_name": about})
    data["recirculated_fraction"] = (
        dims, np.stack([_recirculation(bench, r).reshape(shape) for r in runs]),
        {"units": "1", "long_name": "share of the access flow that comes straight from the return line"},
    )  # fmt: skip
    coordinates = {
        "policy": list(policies),
        "scheme": [s.letter for s in bench.schemes],
        "speed": ("speed", speeds, {"units": "rpm", "long_name": "ECMO pump speed"}),
        "connection": ("scheme", [s.name for s in bench.schemes]),
        "access_site": ("scheme", [s.access_site for s in bench.schemes]),
        "return_site": ("scheme", [s.return_site for s in bench.schemes]),
    }
    return xr.Dataset(data, coordinates)


def without(alone: Sequence[BeatRecords], policies: Sequence[str], speeds: np.ndarray) -> xr.Dataset:
    """The same without CRRT, over `policy` and `speed`."""
    import xarray as xr

    data = _variables(alone, ("policy", "speed"), (len(speeds),))
    speed = ("speed", speeds, {"units": "rpm", "long_name": "ECMO pump speed"})
    return xr.Dataset(data, {"policy": list(policies), "speed": speed})


def waveforms(bench: Bench, runs: Sequence[BeatRecords], policies: Sequence[str]) -> xr.Dataset:
    """Waveforms at the case's speed over `policy`, `scheme` and `phase`; volumes are the absolute ones."""
    import xarray as xr

    first = runs[0]
    data = {}
    for k, signal in enumerate(first.signals):
        values = np.stack([r.waveforms[:, k, :].T for r in runs])
        if signal[0] == "V":
            values = values + unstressed_volume(bench.circuit, signal[1:], bench.values)
        data[signal] = (("policy", "scheme", "phase"), values, _labels(signal))
    period = 60.0 / bench.values["heart_rate_bpm"]
    coordinates = {
        "policy": list(policies),
        "scheme": [s.letter for s in bench.schemes],
        "phase": ("phase", first.phases, {"units": "1", "long_name": "phase of the beat"}),
        "time": ("phase", first.phases * period, {"units": "s", "long_name": "time"}),
    }
    return xr.Dataset(data, coordinates)


def _variables(
    records: Sequence[BeatRecords], dims: tuple[str, ...], shape: tuple[int, ...]
) -> dict[str, Any]:
    """Means of all pressures and flows, all outputs, volumes by group, and how each beat was found."""
    first = records[0]

    def stacked(rows: list[np.ndarray]) -> np.ndarray:
        return np.stack([np.asarray(row).reshape(shape) for row in rows])

    data: dict[str, Any] = {}
    for signal in (s for s in first.signals if s[0] in "PQ"):
        labels = _labels(signal) | {"cell_methods": "phase: mean"}
        data[signal] = (dims, stacked([r.mean(signal) for r in records]), labels)
    for name in first.names:
        entry = output(name)
        labels = {"units": entry.unit, "long_name": entry.long_name, "definition": entry.definition}
        data[name] = (dims, stacked([r.output(name) for r in records]), labels)
    for group in (g for g in GROUPS if g in first.volumes):
        labels = {"units": "mL", "long_name": f"stressed volume of {group} at phase 0"}
        data[f"{group}_volume"] = (dims, stacked([r.volumes[group] for r in records]), labels)
    data["converged"] = (dims, stacked([r.converged for r in records]), {"long_name": "steady beat found"})
    words = [np.array([Status(k).name.lower() for k in r.status]) for r in records]
    data["status"] = (dims, stacked(words), {"long_name": "how the search for the steady beat ended"})
    data["beats"] = (dims, stacked([r.beats for r in records]), {"long_name": "beats computed"})
    return data


def _labels(signal: str) -> dict[str, str]:
    kind, place = signal[0], signal[1:]
    words = f"head of {place}" if kind == "P" and place.endswith("pump") else f"{WORDS[kind]} {place}"
    return {"units": UNITS[kind], "long_name": words}


def _recirculation(bench: Bench, records: BeatRecords) -> np.ndarray:
    """Recirculated share of every member, from its mean flows; shape (members,)."""
    names = [c.name for c in bench.circuit.connections]
    flows = np.stack([records.mean("Q" + name) for name in names])
    per_scheme = flows.shape[1] // len(bench.schemes)
    found = []
    for k, scheme in enumerate(bench.schemes):
        circuit = bench.without + crrt(*scheme.nodes)
        for member in range(k * per_scheme, (k + 1) * per_scheme):
            if not records.converged[member]:
                found.append(np.nan)
                continue
            share = recirculated_fraction(circuit, dict(zip(names, flows[:, member], strict=True)))
            found.append(np.nan if share is None else share)
    return np.array(found)
