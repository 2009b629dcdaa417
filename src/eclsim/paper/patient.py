"""The patient of section 3.3 of Thiel et al. 2025, and what the paper does not say about her.

Printed are sex and age (female, 69 years), the parameters of Table S-4, pump, speed and CRRT flow. Not
printed are height, weight and heart rate. Height, weight and age enter the model through the blood volume
alone, so two numbers are open: blood volume and heart rate. They are searched for with the numbers of
section 3.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eclsim.cases.case import Case
from eclsim.cases.resolve import blood_volume_ml
from eclsim.paper.printed import AT_CASE, HIGH, LOW, SECTION_3_3, OverSchemes, Printed
from eclsim.parameters.thiel2025 import TABLE_S4

BLOOD_VOLUME = "total_blood_volume_ml"
HEART_RATE = "heart_rate_bpm"
VOLUMES_ML = np.linspace(3000.0, 3600.0, 5)
RATES_BPM = np.array([85.0, 100.0, 115.0, 130.0, 145.0])
MODEL_TOLERANCE = 0.001
"""Our own error, relative to a value: added to the half unit of the last printed digit."""


def paper_case(access_site: str = "post_oxy", return_site: str = "pre_oxy") -> Case:
    """The patient as assumed here: 70 years, 165 cm, 60 kg, 120 beats/min; cannulae 21 and 17 Fr."""
    return Case.model_validate(
        {
            "patient": {
                "id": "Thiel 2025, section 3.3", "sex": "female", "age_years": 70, "height_cm": 165,
                "weight_kg": 60, "heart_rate_bpm": 120,
            },
            "ecmo": {
                "pump": "Rotaflow", "speed_rpm": AT_CASE, "oxygenator": "Quadrox-i Adult",
                "drainage_site": "ra", "drainage_cannula": "venous", "drainage_fr": 21,
                "return_site": "ao", "return_cannula": "arterial", "return_fr": 17,
            },
            "crrt": {"flow_ml_min": 200, "access_site": access_site, "return_site": return_site},
            "parameters": dict(TABLE_S4),
        }
    )  # fmt: skip


def with_blood_volume(case: Case, volume_ml: float) -> Case:
    """The case with the weight that gives a blood volume."""
    one_kg = blood_volume_ml(case.patient.model_copy(update={"weight_kg": 1.0}))
    patient = case.patient.model_copy(update={"weight_kg": (volume_ml / one_kg) ** 2})
    return case.model_copy(update={"patient": patient})


@dataclass(frozen=True)
class Unstated:
    """What the search found.

    Args:
        blood_volume_ml: best total blood volume.
        heart_rate_bpm: best heart rate.
        misfit: root mean square of the differences, each in units of its tolerance, at the best values.
        assumed_misfit: the same for the patient as assumed.
    """

    blood_volume_ml: float
    heart_rate_bpm: float
    misfit: float
    assumed_misfit: float


def search_unstated(case: Case | None = None) -> Unstated:
    """Blood volume and heart rate with which the numbers of section 3.3 come out best."""
    from scipy.interpolate import RegularGridInterpolator
    from scipy.optimize import minimize

    case = paper_case() if case is None else case
    printed = [p for p in SECTION_3_3 if not p.remark]
    computed = _on_grid(case, printed)
    surfaces = RegularGridInterpolator((RATES_BPM, VOLUMES_ML), computed, method="cubic")
    target = np.array([p.value for p in printed])
    tolerance = np.array([tolerance_of(p) for p in printed])

    def misfit(rate: float, volume: float) -> float:
        return float(np.sqrt(np.mean(((surfaces([(rate, volume)])[0] - target) / tolerance) ** 2)))

    rates = np.linspace(RATES_BPM[0], RATES_BPM[-1], 76)[::5]
    volumes = np.linspace(VOLUMES_ML[0], VOLUMES_ML[-1], 81)
    coarse = np.array([[misfit(r, v) for v in volumes] for r in rates])
    r, v = np.unravel_index(int(np.argmin(coarse)), coarse.shape)
    bounds = ((RATES_BPM[0], RATES_BPM[-1]), (VOLUMES_ML[0], VOLUMES_ML[-1]))
    start = np.array([rates[r], volumes[v]])
    best = minimize(lambda x: misfit(x[0], x[1]), start, method="Nelder-Mead", bounds=bounds)
    rate, volume = (float(x) for x in best.x)
    assumed = misfit(case.patient.heart_rate_bpm, blood_volume_ml(case.patient))
    return Unstated(volume, rate, misfit(rate, volume), assumed)


def explained_case(found: Unstated) -> Case:
    """The patient with the age printed, the heart rate found, and a weight for the blood volume found."""
    case = paper_case()
    known = {"age_years": 69.0, "height_cm": 160.0, "heart_rate_bpm": found.heart_rate_bpm}
    patient = case.patient.model_copy(update=known)
    return with_blood_volume(case.model_copy(update={"patient": patient}), found.blood_volume_ml)


def tolerance_of(printed: Printed) -> float:
    """Half a unit of the last printed digit, and our own error."""
    return 0.5 * 10.0**-printed.decimals + MODEL_TOLERANCE * abs(printed.value)


def _on_grid(case: Case, printed: list[Printed]) -> np.ndarray:
    """Printed quantities on the grid of heart rates and blood volumes, shape (rates, volumes, quantities)."""
    import xarray as xr

    from eclsim.crrt_study.beats import SUMMARISED, study_circuits, summarise, value
    from eclsim.crrt_study.schemes import select_schemes
    from eclsim.orbit.model import AS_PUBLISHED

    circuits = study_circuits(case, select_schemes(), 200.0)
    speeds = np.array([LOW, AT_CASE, HIGH])
    rate, volume = np.meshgrid(RATES_BPM, VOLUMES_ML, indexing="ij")
    patients = {HEART_RATE: rate.ravel(), BLOOD_VOLUME: volume.ravel()}
    records = circuits.run(speeds, AS_PUBLISHED, patients=patients)
    shape = (len(circuits.schemes), len(speeds), *rate.shape)
    dims = ("scheme", "speed", "rate", "volume")
    data = {name: (dims, value(records, name).reshape(shape)) for name in SUMMARISED}
    coordinates = {"scheme": [s.letter for s in circuits.schemes], "speed": speeds}
    summary = summarise(xr.Dataset(data, coordinates))
    what = [p.what for p in printed if isinstance(p.what, OverSchemes)]
    surfaces = [summary[f"{w.quantity}_{w.statistic}"].sel(speed=w.speed) for w in what]
    return np.stack([one.transpose("rate", "volume").values for one in surfaces], axis=-1)
