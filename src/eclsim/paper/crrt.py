"""Sections 3.3 and 4, Figures 5 and 6, Tables S-1 to S-4: the CRRT study of the paper's patient.

Of the patient of section 3.3, the paper prints sex and age (female, 69 years), the parameters of Table S-4,
pump, speed and CRRT flow, but not height, weight and heart rate. Height, weight and age enter the model only
through the blood volume. Two numbers are therefore open, blood volume and heart rate, which are estimated
from the numbers of section 3.3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from eclsim.cases.case import Case
from eclsim.cases.resolve import blood_volume_ml, resolve_parameters
from eclsim.circuit.network import BLOOD_VOLUME, HEART_RATE
from eclsim.crrt_study.beats import SUMMARISED, study_circuits, summarise, value
from eclsim.crrt_study.limits import LIMITS
from eclsim.crrt_study.schemes import select_schemes
from eclsim.crrt_study.study import CrrtStudy, crrt_study
from eclsim.devices.registry import parameters
from eclsim.orbit.model import AS_PUBLISHED
from eclsim.paper.comparison import Row, Statement, Verdict, printed_number, statements
from eclsim.paper.printed import (
    AT_CASE,
    HIGH,
    LOW,
    NEAR_ZERO,
    PARAMETER_TABLES,
    TEXT,
    FlowAtLimit,
    OfScheme,
    OverSchemes,
    Printed,
)
from eclsim.parameters.thiel2025 import TABLE_S4

if TYPE_CHECKING:
    import xarray as xr

VOLUMES_ML = np.linspace(3000.0, 3600.0, 5)
RATES_BPM = np.array([85.0, 100.0, 115.0, 130.0, 145.0])
MODEL_TOLERANCE = 0.001
"""Numerical error of eclsim relative to a value, added to half a unit of the last printed digit."""


def paper_case() -> Case:
    """Return the assumed patient: 70 years, 165 cm, 60 kg, 120 beats/min; cannulae 21 and 17 Fr."""
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
            "crrt": {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy"},
            "parameters": dict(TABLE_S4),
        }
    )  # fmt: skip


def with_blood_volume(case: Case, volume_ml: float) -> Case:
    """Return the case with the weight that gives a blood volume."""
    one_kg = blood_volume_ml(case.patient.model_copy(update={"weight_kg": 1.0}))
    patient = case.patient.model_copy(update={"weight_kg": (volume_ml / one_kg) ** 2})
    return case.model_copy(update={"patient": patient})


@dataclass(frozen=True)
class UnprintedValues:
    """Estimates of blood volume and heart rate of the paper's patient, which are not printed.

    Args:
        blood_volume_ml: best total blood volume [mL].
        heart_rate_bpm: best heart rate [beats/min].
        misfit: root mean square of the differences, relative to their tolerances, at the best values.
        assumed_misfit: misfit of the assumed patient.
    """

    blood_volume_ml: float
    heart_rate_bpm: float
    misfit: float
    assumed_misfit: float


@lru_cache(maxsize=1)
def search_unprinted_values() -> UnprintedValues:
    """Find the blood volume and heart rate that reproduce the numbers of section 3.3 best."""
    from scipy.interpolate import RegularGridInterpolator
    from scipy.optimize import minimize

    case = paper_case()
    printed = [p for p in TEXT if isinstance(p.what, OverSchemes) and not p.remark]
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
    if not best.success:
        raise RuntimeError(f"blood volume and heart rate of the paper's patient: {best.message}")
    rate, volume = (float(x) for x in best.x)
    assumed = misfit(case.patient.heart_rate_bpm, blood_volume_ml(case.patient))
    return UnprintedValues(volume, rate, misfit(rate, volume), assumed)


def explained_case(values: UnprintedValues) -> Case:
    """Return the patient with the printed age, and with heart rate and blood volume as estimated."""
    case = paper_case()
    known = {"age_years": 69.0, "height_cm": 160.0, "heart_rate_bpm": values.heart_rate_bpm}
    patient = case.patient.model_copy(update=known)
    return with_blood_volume(case.model_copy(update={"patient": patient}), values.blood_volume_ml)


def tolerance_of(printed: Printed) -> float:
    """Tolerance of a printed number: half a unit of the last digit plus the error of eclsim."""
    return 0.5 * 10.0**-printed.decimals + MODEL_TOLERANCE * abs(printed.value)


def _on_grid(case: Case, printed: list[Printed]) -> np.ndarray:
    """Printed quantities on a grid of heart rates and volumes, shape (rates, volumes, quantities)."""
    import xarray as xr

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
    definitions = [p.what for p in printed if isinstance(p.what, OverSchemes)]
    surfaces = [summary[f"{w.quantity}_{w.statistic}"].sel(speed=w.speed) for w in definitions]
    return np.stack([surface.transpose("rate", "volume").values for surface in surfaces], axis=-1)


# --- the numbers of sections 3.3 and 4 --------------------------------------------------------------


SMALL_FLOW_L_MIN = 1.2


@dataclass(frozen=True)
class CrrtComparison:
    """The CRRT study compared with the paper.

    Args:
        rows: one row for each number and statement.
        unprinted: estimated values of the patient of section 3.3 that the paper does not print.
        study: CRRT study of the assumed patient.
        explained: CRRT study with the estimated values.
    """

    rows: tuple[Row, ...]
    unprinted: UnprintedValues
    study: CrrtStudy
    explained: CrrtStudy


def reproduce_crrt(progress: Callable[[str], None] = lambda _: None) -> CrrtComparison:
    """Compute the study with the assumed and with the estimated values, and compare it with the paper."""
    progress("blood volume and heart rate of the paper's patient")
    unprinted = search_unprinted_values()
    studies = []
    for label, case in (("as assumed", paper_case()), ("as found", explained_case(unprinted))):
        progress(f"CRRT study of the paper's patient, {label}")
        studies.append(crrt_study(case, volume_policy=AS_PUBLISHED))
    study, explained = studies
    rows = [_row(printed, study, explained, unprinted) for printed in TEXT]
    rows += statements(STATEMENTS, study, explained)
    return CrrtComparison(tuple(rows), unprinted, study, explained)


def _row(printed: Printed, study: CrrtStudy, explained: CrrtStudy, unprinted: UnprintedValues) -> Row:
    volume = f"{unprinted.blood_volume_ml:.0f} mL"
    reason = printed.remark or f"{volume} of blood, which are not printed, bring it nearer"
    row = printed_number(
        printed.section, printed.description, printed.unit, printed.value, compute(printed, study),
        decimals=printed.decimals, tolerance=tolerance_of(printed), explained=compute(printed, explained),
        reason=reason, other_data=printed.other_data,
    )  # fmt: skip
    if row.verdict is Verdict.EXPLAINED:
        return row.because(f"by {volume} of blood, which are not printed")
    return row.because(reason + _needed_median(printed, explained)) if printed.remark == NEAR_ZERO else row


def compute(printed: Printed, study: CrrtStudy) -> float:
    """Return the study's value for a printed number."""
    match printed.what:
        case OverSchemes(quantity, statistic, speed):
            return float(study.summary[f"{quantity}_{statistic}"].sel(policy=AS_PUBLISHED, speed=speed))
        case OfScheme(quantity, scheme, speed):
            return float(study.means[quantity].sel(policy=AS_PUBLISHED, speed=speed, scheme=scheme))
        case FlowAtLimit(limit, low_alarm=True):
            return _lowest_alarm(study, limit)
        case FlowAtLimit(limit, schemes):
            flows = study.limits["largest_flow"].sel(policy=AS_PUBLISHED, limit=limit)
            return float(flows.sel(scheme=list(schemes)).mean(skipna=False) if schemes else flows.min())


def _lowest_alarm(study: CrrtStudy, name: str) -> float:
    """Smallest ECMO flow at which any scheme reaches a low alarm [L/min]."""
    (limit,) = (candidate for candidate in LIMITS if candidate.name == name)
    result = []
    for letter in study.means["scheme"].values:
        candidate = study.means.sel(policy=AS_PUBLISHED, scheme=letter)
        pressure, flow = candidate[limit.quantity].values, candidate["PF"].values
        if pressure.min() < limit.low:
            result.append(float(np.interp(-limit.low, -pressure, flow)))
    return min(result, default=np.nan)


def _needed_median(printed: Printed, explained: CrrtStudy) -> str:
    """Error of the median that would explain the printed percentage, as text."""
    assert isinstance(printed.what, OverSchemes)
    summary = explained.summary.sel(policy=AS_PUBLISHED, speed=printed.what.speed)
    median, variation = (float(summary[f"{printed.what.quantity}_{w}"]) for w in ("median", "variation"))
    needed = 100.0 * variation / printed.value - abs(median)
    return f": a median {abs(needed):.3f} mmHg {'larger' if needed > 0.0 else 'smaller'} gives it"


def table_rows() -> list[Row]:
    """Return a row for each printed and used value of Tables S-1 to S-4."""
    known = parameters()
    used = {key: parameter.value for key, parameter in known.items()}
    patient = resolve_parameters(paper_case())
    return [
        printed_number(f"Table {table}", name, known[name].unit, float(value),
                       (patient if table == "S-4" else used)[name], decimals=6, tolerance=0.0)
        for table, name, value in (row.values() for row in PARAMETER_TABLES)
    ]  # fmt: skip


# --- statements of the text -----------------------------------------------------------------------


def _means(study: CrrtStudy) -> xr.Dataset:
    return study.means.sel(policy=AS_PUBLISHED)


def _at_case(study: CrrtStudy) -> xr.Dataset:
    return _means(study).sel(speed=AT_CASE)


def _upper(study: CrrtStudy) -> xr.Dataset:
    """Means from the smallest flow that the text discusses upwards."""
    means = _means(study)
    return means.isel(speed=means["PF"].median("scheme").values >= 0.95 * SMALL_FLOW_L_MIN)


def _extreme(study: CrrtStudy, name: str, word: str) -> str:
    return str(study.summary[f"{name}_{word}"].sel(policy=AS_PUBLISHED, speed=AT_CASE).item())


def _most_on_veins(study: CrrtStudy) -> bool:
    summary = study.summary.sel(policy=AS_PUBLISHED, speed=AT_CASE)
    names = ("Psart", "Ppart", "Psvn")
    ordered = sorted(names, key=lambda name: float(summary[f"{name}_variation_percent"]))
    return (ordered[0], ordered[-1]) == ("Psart", "Psvn")


def _loops_show_schemes_a_and_h(study: CrrtStudy) -> bool:
    """Whether a has the smallest right ventricular volumes and stroke volume, and h the largest volumes."""
    means = _at_case(study)
    stroke = means["EDVRV"] - means["ESVRV"]
    smallest = str(stroke["scheme"].values[np.argmin(stroke.values)])
    ends = {(n, w): _extreme(study, n, w) for n in ("EDVRV", "ESVRV") for w in ("lowest", "highest")}
    return smallest == "a" and all(ends[n, w] == ("a" if w == "lowest" else "h") for n, w in ends)


def _within_alarms(study: CrrtStudy) -> bool:
    means = _at_case(study)
    alarms = [limit for limit in LIMITS if limit.name.endswith("alarm")]
    return all(bool((limit.margin(means[limit.quantity].values) >= 0.0).all()) for limit in alarms)


def _negative_only_in_h(study: CrrtStudy) -> bool:
    means = _at_case(study)
    negative = (means["Pcrrttuin"] < 0.0) | (means["Pcrrttuout"] < 0.0)
    return means["scheme"].values[negative.values].tolist() == ["h"]


def _monotone(study: CrrtStudy, name: str, sign: float) -> bool:
    return bool((sign * _upper(study)[name].diff("speed") > 0.0).all())


def _grows_with_speed(study: CrrtStudy) -> bool:
    variation = study.summary["Psart_variation"].sel(policy=AS_PUBLISHED).sel(speed=_upper(study)["speed"])
    return bool((variation.diff("speed") > 0.0).all())


def _order_changes(study: CrrtStudy) -> bool:
    summary = study.summary.sel(policy=AS_PUBLISHED).sel(speed=_upper(study)["speed"])
    return any(len(set(summary[f"Psart_{word}"].values.tolist())) > 1 for word in ("highest", "lowest"))


def _falls_upstream_of_the_pump(study: CrrtStudy) -> bool:
    """Whether return pressure falls with flow for return lines upstream of the pump and rises for others."""
    change = _upper(study)["Pcrrttuout"].diff("speed")
    falls, rises = (change < 0.0).all("speed"), (change > 0.0).all("speed")
    upstream = np.isin(change["scheme"].values.astype(str), list("bchi"))
    return bool((falls.values == upstream).all() and (rises.values == ~upstream).all())


def _g_d_c_keep_access_limit(study: CrrtStudy) -> bool:
    """Whether g, d and c keep the access pressure below 190 mmHg up to larger flows than all others but h."""
    flows = study.limits["largest_flow"].sel(policy=AS_PUBLISHED, limit="access_190")
    return float(flows.sel(scheme=list("gdc")).min()) > float(flows.sel(scheme=list("abefi")).max())


_AT_ITS_SPEED, _ANY = "3.3, 3425 rpm", "3.3"
_ORDER = "the same schemes at all flows of the text"
_LARGEST = "it grows up to 4750 rpm; at 5000 rpm it is 2 % less"
_UNPRINTED = "the variation in the pulmonary artery is not printed"

STATEMENTS: tuple[Statement[CrrtStudy], ...] = (
    (_AT_ITS_SPEED, "the scheme of the highest arterial pressure is h",
     lambda s: _extreme(s, "Psart", "highest") == "h"),
    (_AT_ITS_SPEED, "the scheme of the lowest arterial pressure is a",
     lambda s: _extreme(s, "Psart", "lowest") == "a"),
    (_AT_ITS_SPEED, "relative variation is largest in the veins, smallest in the arteries",
     _most_on_veins, _UNPRINTED),
    (_AT_ITS_SPEED, "right ventricle: a smallest volumes and stroke volume, h largest volumes",
     _loops_show_schemes_a_and_h),
    (_AT_ITS_SPEED, "all line pressures are within the usual alarms", _within_alarms),
    (_AT_ITS_SPEED, "a line pressure is negative in scheme h alone", _negative_only_in_h),
    (_ANY, "arterial pressure rises with flow in every scheme",
     lambda s: _monotone(s, "Psart", 1.0)),
    (_ANY, "pulmonary arterial pressure falls with flow in every scheme",
     lambda s: _monotone(s, "Ppart", -1.0)),
    (_ANY, "venous pressure falls with flow in every scheme", lambda s: _monotone(s, "Psvn", -1.0)),
    (_ANY, "the variation of the arterial pressure grows with speed", _grows_with_speed, _LARGEST),
    (_ANY, "which scheme has the highest or lowest arterial pressure depends on flow",
     _order_changes, _ORDER),
    (_ANY, "return pressure falls with flow in b, c, h, i and rises in the others",
     _falls_upstream_of_the_pump),
    ("4", "return pressures are positive in all schemes at 3425 rpm",
     lambda s: bool((_at_case(s)["Pcrrttuout"] > 0.0).all())),
    ("4", "access is below 190 mmHg up to larger flows in g, d, c than in a, b, e, f, i",
     _g_d_c_keep_access_limit),
    ("4", "the ECMO flow lies between those of Wu et al., 3.1 and 4.4 L/min",
     lambda s: 3.1 <= float(_at_case(s)["PF"].median()) <= 4.4),
)  # fmt: skip
"""Statements of sections 3.3 and 4."""
