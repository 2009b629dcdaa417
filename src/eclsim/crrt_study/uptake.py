"""How a scheme changes the patient: by the blood that the CRRT tubing takes up, and by where blood flows.

Compared with the patient on ECMO alone at the same speed, every difference splits exactly in two. `flow` is
what is left when the patient keeps the stressed volume of the patient without CRRT (the circuit is primed
with as much as it takes up); `uptake` is the rest: what the missing blood does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.crrt_study.unknown_beats import NOT_ASKED
from eclsim.orbit.model import AS_PUBLISHED, PATIENT_HELD
from eclsim.orbit.status import Status
from eclsim.outputs.records import BeatRecords

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.crrt_study.batches import Bench

SPLIT = ("Psart", "Psvn", "Ppart", "MAP", "CO", "PF", "EDVRV", "ESVRV")


def split_differences(
    bench: Bench, published: BeatRecords, without: BeatRecords, at: np.ndarray, speed: float
) -> xr.Dataset:
    """Differences to the patient without CRRT at one speed, split into uptake and flow.

    Args:
        bench: of the study.
        published: records of all schemes with the published volume policy.
        without: record of the patient without CRRT at the speed.
        at: members of `published` at the speed, one per scheme.
        speed: [rpm].

    Returns:
        Over `scheme`: `<name>_difference`, `<name>_uptake`, `<name>_flow`, and `blood_taken_up` [mL]; NaN
        where one of the beats was not found. `status` tells how the search with the volume kept ended.
    """
    import xarray as xr

    volume, letters = float(without.volumes["patient"][0]), [scheme.letter for scheme in bench.schemes]
    primed, status = None, [NOT_ASKED] * len(letters)
    if without.converged[0]:
        primed = bench.run(np.array([speed]), PATIENT_HELD, patient_volume_ml=volume)
        status = [Status(k).name.lower() for k in primed.status]
    found: dict[str, Any] = {"status": ("scheme", np.array(status))}
    for name in SPLIT:
        base = float(value(without, name)[0])
        total = value(published, name)[at] - base
        flow = np.full_like(total, np.nan) if primed is None else value(primed, name) - base
        for word, part in (("difference", total), ("uptake", total - flow), ("flow", flow)):
            found[f"{name}_{word}"] = ("scheme", part)
    found["blood_taken_up"] = ("scheme", volume - published.volumes["patient"][at], {"units": "mL"})
    attributes = {"compared_with": "patient on ECMO without CRRT", "blood_volume_policy": AS_PUBLISHED}
    return xr.Dataset(found, {"scheme": letters}, attributes)


def value(records: BeatRecords, name: str) -> np.ndarray:
    """A quantity by name: an output of the registry, else the mean of a waveform."""
    return records.output(name) if name in records.names else records.mean(name)
