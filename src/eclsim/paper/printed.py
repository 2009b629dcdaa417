"""Numbers printed by Thiel et al. 2025 for comparison: tables, and numbers of sections 3.3 and 4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

AT_CASE, LOW, HIGH = 3425.0, 1750.0, 5000.0
"""Speeds in the text [rpm]: the patient's own, and the grid points nearest to 1.2 and 6 L/min."""
NEAR_ZERO = "relative to a median near zero"
MEDIAN, VARIATION, PERCENT = "median", "variation", "variation_percent"
"""Statistics over the nine schemes; the variation is the largest minus the smallest value."""

QUANTITIES = {
    "PF": "ECMO flow",
    "Psart": "arterial pressure",
    "Psvn": "venous pressure",
    "Ppart": "pulmonary arterial pressure",
    "Pcrrttuin": "access pressure",
    "Pcrrttuout": "return pressure",
    "Pecmodrain": "drainage pressure",
    "EDVRV": "right ventricle's end-diastolic volume",
    "ESVRV": "right ventricle's end-systolic volume",
}


class OverSchemes(NamedTuple):
    """Median or variation of a quantity over the nine schemes at a speed."""

    quantity: str
    statistic: str
    speed: float


class OfScheme(NamedTuple):
    """A quantity of one scheme at a speed."""

    quantity: str
    scheme: str
    speed: float


class FlowAtLimit(NamedTuple):
    """ECMO flow at which a limit is reached: the mean of some schemes, or the first of all schemes."""

    limit: str
    schemes: str = ""
    low_alarm: bool = False


@dataclass(frozen=True, slots=True)
class Printed:
    """A printed number.

    Args:
        section: section where the number is printed.
        description: description of the number.
        value: value as printed.
        unit: unit of the value.
        decimals: number of printed decimals.
        what: definition for computing it.
        remark: explanation if the computed number differs.
        other_data: whether it was measured on other patients or circuits than the paper's model.
    """

    section: str
    description: str
    value: float
    unit: str
    decimals: int
    what: OverSchemes | OfScheme | FlowAtLimit
    remark: str = ""
    other_data: bool = False


_Statistics: TypeAlias = "dict[str, tuple[float | None, float | None, float | None]]"


def _section(
    where: str, speed: float, numbers: _Statistics, decimals: dict[tuple[str, str], int] | None = None
) -> list[Printed]:
    """Median, variation and relative variation of quantities; those near zero have a remark."""
    units = {"PF": "L/min", "EDVRV": "mL", "ESVRV": "mL"}
    result = []
    for name, values in numbers.items():
        for statistic, value in zip((MEDIAN, VARIATION, PERCENT), values, strict=True):
            if value is None:
                continue
            description = f"{QUANTITIES[name]}, {statistic.replace('_percent', ' relative')}"
            unit = "%" if statistic == PERCENT else units.get(name, "mmHg")
            places = (decimals or {}).get((name, statistic), 1)
            remark = NEAR_ZERO if statistic == PERCENT and (name, speed) in _NEAR_ZERO else ""
            definition = OverSchemes(name, statistic, speed)
            result.append(Printed(f"3.3, {where}", description, value, unit, places, definition, remark))
    return result


_NEAR_ZERO = {("Pecmodrain", LOW), ("Pcrrttuin", LOW), ("Ppart", HIGH)}

SECTION_3_3 = (
    *_section("3425 rpm", AT_CASE, {
        "PF": (3.7, None, None), "Psart": (70.3, 5.4, 7.7), "Psvn": (3.7, 1.0, 26.3),
        "Pcrrttuin": (161.4, 296.6, 183.7), "Pcrrttuout": (258.2, 295.9, 114.6),
        "EDVRV": (None, 27.7, 24.6), "ESVRV": (None, 24.5, 24.0),
    }),
    *_section("1.2 L/min", LOW, {
        "PF": (1.2, None, None), "Psart": (49.4, 1.4, 2.9), "Pecmodrain": (1.7, 1.3, 79.8),
        "Pcrrttuin": (2.6, 81.3, 3163.8), "Pcrrttuout": (136.5, 81.6, 59.8),
    }),
    *_section("6 L/min", HIGH, {
        "PF": (6.0, None, None), "Psart": (85.2, 10.5, 12.3), "Pecmodrain": (-129.6, 3.9, 3.0),
        "Ppart": (None, 5.3, 202.5), "Pcrrttuin": (397.4, 624.5, 157.1), "Pcrrttuout": (459.5, 622.9, 135.5),
    }, {("PF", MEDIAN): 0, ("Pecmodrain", PERCENT): 0}),
)  # fmt: skip

_FIRST = "printed as about; ours is where the first of the nine schemes reaches it"
_CUT = "with the blood volume found it is 17.98 at 50 s, where the paper stops: cut to 17 instead of rounded"
_LOW = "printed as about; the lowest scheme's return pressure reaches the alarm here"
_XU = "measured on a water rig with one circuit"
_WU = "clinical mean of other patients on other circuits; the paper's own model differs by as much"


def _pressure(section: str, name: str, value: float, scheme: str, remark: str = "") -> Printed:
    measured = remark is _WU
    description = QUANTITIES[name] + (", measured" if measured else "")
    definition = OfScheme(name, scheme, AT_CASE)
    return Printed(section, description, value, "mmHg", 0, definition, remark, measured)


def _flow(
    section: str, condition: str, value: float, decimals: int, definition: FlowAtLimit, remark: str = ""
) -> Printed:
    return Printed(
        section, f"ECMO flow {condition}", value, "L/min", decimals, definition, remark, remark is _XU
    )


SECTION_4 = (
    _pressure("4, g", "Pcrrttuin", 119.0, "g"),
    _pressure("4, g", "Pcrrttuout", 313.0, "g"),
    _pressure("4, c", "Pcrrttuin", 120.0, "c"),
    _pressure("4, c", "Pcrrttuout", 17.0, "c", _CUT),
    _pressure("4, Wu A (g)", "Pcrrttuin", 175.0, "g", _WU),
    _pressure("4, Wu A (g)", "Pcrrttuout", 360.0, "g", _WU),
    _pressure("4, Wu B (c)", "Pcrrttuin", 171.0, "c", _WU),
    _pressure("4, Wu B (c)", "Pcrrttuout", 41.0, "c", _WU),
    _flow("4", "with access below 190 mmHg, g, d, c", 4.7, 1, FlowAtLimit("access_190", "dcg"),
          "mean of the three"),
    _flow("4", "with access below 190 mmHg, a", 4.0, 0, FlowAtLimit("access_190", "a")),
    _flow("3.3", "at the access line's high alarm", 5.0, 0, FlowAtLimit("access_alarm"), _FIRST),
    _flow("3.3", "at the return line's high alarm", 4.0, 0, FlowAtLimit("return_alarm"), _FIRST),
    _flow("3.3", "at the return line's low alarm", 6.0, 0, FlowAtLimit("return_alarm", low_alarm=True), _LOW),
    _flow("4, Xu", "at the access line's high alarm, measured", 5.5, 1, FlowAtLimit("access_alarm"), _XU),
)  # fmt: skip

TEXT = (*SECTION_3_3, *SECTION_4)
"""All numbers of sections 3.3 and 4."""

TABLE_1 = {
    "SP": (111.0, 70.0, 183.0), "DP": (69.5, 42.0, 88.0), "MAP": (79.0, 55.0, 113.0),
    "MPAP": (19.5, 6.0, 30.0), "PCWP": (11.0, 7.0, 15.0), "CO": (3.4, 1.5, 7.5), "PF": (2.5, 1.2, 3.8),
}  # fmt: skip
"""Median, smallest and largest measured value [mmHg, L/min], with one decimal each."""
POINTS, PATIENTS, FEMALE_POINTS = 30, 8, 17
R2 = {"pressures": 0.99, "flows": 0.98}

TABLE_2 = {
    "Rmc": 3.80, "Emaxlv": 1.60, "Rpmc": 0.60, "Emaxrv": 0.32, "Csart": 0.25, "Edla": 0.19, "Rsvn": 0.14,
}  # fmt: skip
"""Sum of the total orders over the seven outputs, for the parameters selected for the fits."""
SAMPLES, RUNS = 2048, 102400
"""Number of rows N of the sensitivity analysis, and of its runs."""

PARAMETER_TABLES: dict[str, dict[str, float]] = {
    "S-1": {
        "etaB": 0.003, "rhoB": 0.00106, "Rao": 0.003, "Rsart": 0.05, "Rmc": 0.5, "Rsvn": 0.01, "Rpas": 0.002,
        "Rpart": 0.01, "Rpmc": 0.05, "Rpvn": 0.006, "Cao": 0.08, "Csart": 0.9, "Csvn": 20.5, "Cpas": 0.18,
        "Cpart": 3.8, "Cpvn": 20.5, "Lao": 6.2e-5, "Lsart": 0.0017, "Lpas": 5.2e-5, "Lpart": 0.0017,
        "CQtri": 400.0, "CQpa": 350.0, "CQmi": 400.0, "CQao": 350.0, "Emaxra": 0.225, "Edra": 0.1575,
        "Emaxrv": 0.45, "RV_Pd_beta": 2.5, "RV_Pd_kappa": 0.028, "RV_Pd_alpha": 0.047, "Emaxla": 0.45,
        "Edla": 0.2125, "Emaxlv": 1.8, "LV_Pd_beta": 2.5, "LV_Pd_kappa": 0.033, "LV_Pd_alpha": 0.064,
    },
    "S-2": {
        "Decmotudp": 0.9625, "Lecmotudp": 200.0, "Decmotupo": 0.9625, "Lecmotupo": 20.0, "Decmotuor": 0.9625,
        "Lecmotuor": 200.0, "Recmooxy": 0.6744, "Cecmodrain": 0.1, "Cecmotudp": 0.1, "Cecmotupo": 0.1,
        "Cecmooxy": 0.008, "Cecmotuor": 0.1, "Cecmoreturn": 0.1,
    },
    "S-3": {
        "Lcrrttuin": 250.0, "Dcrrttuin": 0.3175, "Lcrrttupf": 100.0, "Dcrrttupf": 0.3175, "Lcrrttuout": 250.0,
        "Dcrrttuout": 0.3175, "Rcrrtfil": 15.75, "Ccrrttuin": 0.1, "Ccrrttupf": 0.1, "Ccrrtfil": 0.008,
        "Ccrrttuout": 0.1,
    },
    "S-4": {
        "Csart": 3.1852, "Edla": 2.1167, "Emaxlv": 1.3297, "Emaxrv": 0.10791, "Rmc": 0.75989, "Rpmc": 0.3369,
        "Rsvn": 0.00304,
    },
}  # fmt: skip
