"""RenOx, oxygenator and dialyzer in one housing, on the beats of the study, and beside the schemes.

RenOx has no lines, so blood flows as without CRRT, and only the exchange across the membrane is added to the
beats of the patient on ECMO alone. Its fluids are those of the case's section [renox]; without it, all
dialysate and replacement fluid of the case's CRRT is used as dialysate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from eclsim.cases.resolve import resolve_parameters
from eclsim.components.dialysis import PLASMA_WATER
from eclsim.crrt_study.beats import SPEED
from eclsim.devices.crrt import CRRT, Crrt
from eclsim.devices.dialysed_blood import FILTER_PARAMETERS, FLUIDS, HAEMATOCRIT_IN
from eclsim.devices.renox import GROUP, Renox
from eclsim.orbit.model import circuit_of, values_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.alarms import assumptions
from eclsim.outputs.results import output_labels
from eclsim.outputs.signals import output_names
from eclsim.outputs.steady_beat import steady_beat

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.crrt_study.study import CrrtStudy

PERMEABILITY = FILTER_PARAMETERS[0].key
GASES = ("SreturnO2", "PreturnCO2", "SaO2", "PaCO2")
COLUMNS = {
    "access_mmhg": "Pcrrttuin", "return_mmhg": "Pcrrttuout", "urea_ml_min": "effective_clearance_urea",
    "filtration_fraction": "filtration_fraction", "effluent_pressure_mmhg": "effluent_pressure",
    "SreturnO2": "SreturnO2", "SaO2": "SaO2", "PaCO2": "PaCO2",
}  # fmt: skip
"""Quantities of a scheme that are compared with RenOx, by their keys in JSON."""


def without_renox(case: Case) -> Case:
    """Return the case without RenOx; without a CRRT, it gets one with the fluids of its RenOx."""
    crrt, renox = case.crrt, case.renox
    if crrt is None and renox is not None:
        crrt = Crrt(**CRRT.usual, **renox.model_dump())
    return case.model_copy(update={"renox": None, "crrt": crrt})


def renox_fluids(case: Case) -> Renox | None:
    """Return the fluids of RenOx; None if the case has neither its section nor a CRRT with dialysis."""
    if case.renox is not None:
        return case.renox
    if case.crrt is None or not case.crrt.dialyses:
        return None
    fluids = (case.crrt.dialysate_ml_h, case.crrt.replacement_pre_ml_h, case.crrt.replacement_post_ml_h)
    shared = ("haematocrit_in", "fluid_bicarbonate_mmol_l", "plasma_bicarbonate_mmol_l")
    return Renox.model_construct(
        dialysate_ml_h=sum(flow or 0.0 for flow in fluids),
        net_ultrafiltration_ml_h=case.crrt.net_ultrafiltration_ml_h or 0.0,
        **{key: getattr(case.crrt, key) for key in shared},
    )


def in_one_housing(case: Case, policies: Sequence[str], speeds: np.ndarray) -> xr.Dataset | None:
    """Outputs of RenOx and the patient's gases over `policy` and `speed`; None without fluids of RenOx."""
    fluids = renox_fluids(case)
    if fluids is None:
        return None
    case = case.model_copy(update={"crrt": None, "renox": fluids})
    circuit, values = circuit_of(case), values_of(case)
    known = output_names(circuit)
    names = [n for n in known if n.startswith(f"{GROUP}_")] + [n for n in ("PF", *GASES) if n in known]
    beats = []
    for policy in policies:
        batch = Batch(circuit, values | {SPEED: speeds}, len(speeds), policy)
        beats.append(steady_beat(batch, names, start=values).determined_only())
    dims = ("policy", "speed")
    data = {name: (dims, np.stack([b.output(name) for b in beats]), output_labels(name)) for name in names}
    attributes = {key: value for key, value in fluids.model_dump().items() if value is not None}
    attributes["assumed"] = [
        f"RenOx: {assumption.sentence}" for assumption in assumptions(names, circuit, values)
    ]
    return xr.Dataset(data, {"policy": list(policies), "speed": speeds}, attributes)


def compared_with_schemes(study: CrrtStudy, policy: str) -> dict[str, Mapping[str, float | bool | None]]:
    """RenOx and every scheme at the case's speed, in the order of the ranking; empty without RenOx.

    RenOx has no lines, hence no line pressures and alarms; without a beat all its numbers are unknown.
    `open_effluent_l_h` is the filtration by blood pressure through a membrane whose effluent side is open to
    the atmosphere, at most all water of the plasma that reaches it.
    """
    if study.renox is None:
        return {}
    renox = study.renox.sel(policy=policy, speed=study.case_speed)
    has_beat = bool(np.isfinite(float(renox["PF"])))
    result: dict[str, Mapping[str, float | bool | None]] = {
        "RenOx": {
            "access_mmhg": None, "return_mmhg": None, "alarms_kept": True if has_beat else None,
            "blood_taken_up_ml": 0.0 if has_beat else None,
            "urea_ml_min": float(renox["renox_clearance_urea"]),
            "filtration_fraction": float(renox["renox_filtration_fraction"]),
            "effluent_pressure_mmhg": float(renox["renox_effluent_pressure"]),
            "open_effluent_l_h": 1e-3 * float(renox["renox_free_ultrafiltration_ml_h"]),
            **{name: float(renox[name]) for name in GASES if name in renox and name in COLUMNS},
        }
    }  # fmt: skip
    means = study.means.sel(policy=policy, speed=study.case_speed)
    for ranked in study.ranking[policy]:
        scheme = means.sel(scheme=ranked.letter)
        numbers: dict[str, float | bool | None] = {
            key: float(scheme[name]) for key, name in COLUMNS.items() if name in scheme
        }
        numbers["alarms_kept"] = ranked.alarms_kept
        numbers["blood_taken_up_ml"] = -float(scheme["patient_volume_change"])
        if "effluent_pressure" in scheme:
            blood = float(scheme["effluent_pressure"] + scheme["transmembrane_pressure"])
            numbers["open_effluent_l_h"] = 1e-3 * _open_effluent_ml_h(study, blood)
        result[ranked.letter] = numbers
    return result


def _open_effluent_ml_h(study: CrrtStudy, pressure: float) -> float:
    """Filtration of the CRRT's filter [mL/h] at a blood pressure [mmHg] if nothing holds its effluent."""
    values = resolve_parameters(without_renox(study.case))
    plasma = 60.0 * study.crrt_flow_ml_min * (1.0 - values[HAEMATOCRIT_IN])
    water = PLASMA_WATER * plasma + values[f"{CRRT.key}.{FLUIDS[1]}"]
    return min(values[PERMEABILITY] * pressure, water)
