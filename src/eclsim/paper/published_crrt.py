"""Numbers printed in sections 3.3 and 4 of Thiel et al. 2025, as facts to compare with."""

from __future__ import annotations

from dataclasses import dataclass

NEAR_ZERO = "relative to a median near zero"


@dataclass(frozen=True, slots=True)
class Printed:
    """A printed number.

    Args:
        section: where it is printed.
        words: what it is.
        value: as printed.
        unit: of the value.
        digits: decimals printed.
        key: how to compute it, see `eclsim.paper.reproduction`: a kind and its arguments.
        remark: said where ours differs.
        other_data: whether it was measured on patients or circuits that are not the paper's model.
    """

    section: str
    words: str
    value: float
    unit: str
    digits: int
    key: tuple[object, ...]
    remark: str = ""
    other_data: bool = False


AT_CASE, LOW, HIGH = 3425.0, 1750.0, 5000.0
"""Speeds [rpm] of the text: the patient's own; the grid points nearest to 1.2 and 6 L/min."""

_WORDS = {
    "Psart": "arterial pressure",
    "Psvn": "venous pressure",
    "Ppart": "pulmonary arterial pressure",
    "Pcrrttuin": "access pressure",
    "Pcrrttuout": "return pressure",
    "Pecmodrain": "drainage pressure",
    "EDVRV": "right ventricle's end-diastolic volume",
    "ESVRV": "right ventricle's end-systolic volume",
}


def _rows(speed: float, where: str, name: str, *printed: tuple[str, float, int, str]) -> list[Printed]:
    unit = "mL" if name.endswith("RV") else "mmHg"
    return [
        Printed(
            f"3.3, {where}", f"{_WORDS[name]}, {word.replace('_percent', ' relative')}", value,
            "%" if word.endswith("percent") else unit, digits, ("summary", speed, f"{name}_{word}"), remark,
        )
        for word, value, digits, remark in printed
    ]  # fmt: skip


def _all(speed: float, where: str, name: str, median: float, variation: float, percent: float,
         digits: int = 1, remark: str = "") -> list[Printed]:  # fmt: skip
    return _rows(
        speed, where, name,
        ("median", median, 1, ""), ("variation", variation, 1, ""),
        ("variation_percent", percent, digits, remark),
    )  # fmt: skip


SECTION_3_3 = (
    Printed("3.3, 3425 rpm", "ECMO flow, median", 3.7, "L/min", 1, ("summary", AT_CASE, "PF_median")),
    *_all(AT_CASE, "3425 rpm", "Psart", 70.3, 5.4, 7.7),
    *_all(AT_CASE, "3425 rpm", "Psvn", 3.7, 1.0, 26.3),
    *_all(AT_CASE, "3425 rpm", "Pcrrttuin", 161.4, 296.6, 183.7),
    *_all(AT_CASE, "3425 rpm", "Pcrrttuout", 258.2, 295.9, 114.6),
    *_rows(AT_CASE, "3425 rpm", "EDVRV", ("variation", 27.7, 1, ""), ("variation_percent", 24.6, 1, "")),
    *_rows(AT_CASE, "3425 rpm", "ESVRV", ("variation", 24.5, 1, ""), ("variation_percent", 24.0, 1, "")),
    Printed("3.3, 1.2 L/min", "ECMO flow, median", 1.2, "L/min", 1, ("summary", LOW, "PF_median")),
    *_all(LOW, "1.2 L/min", "Psart", 49.4, 1.4, 2.9),
    *_all(LOW, "1.2 L/min", "Pecmodrain", 1.7, 1.3, 79.8, remark=NEAR_ZERO),
    *_all(LOW, "1.2 L/min", "Pcrrttuin", 2.6, 81.3, 3163.8, remark=NEAR_ZERO),
    *_all(LOW, "1.2 L/min", "Pcrrttuout", 136.5, 81.6, 59.8),
    Printed("3.3, 6 L/min", "ECMO flow, median", 6.0, "L/min", 0, ("summary", HIGH, "PF_median")),
    *_all(HIGH, "6 L/min", "Psart", 85.2, 10.5, 12.3),
    *_all(HIGH, "6 L/min", "Pecmodrain", -129.6, 3.9, 3.0, 0),
    *_rows(HIGH, "6 L/min", "Ppart", ("variation", 5.3, 1, ""), ("variation_percent", 202.5, 1, NEAR_ZERO)),
    *_all(HIGH, "6 L/min", "Pcrrttuin", 397.4, 624.5, 157.1),
    *_all(HIGH, "6 L/min", "Pcrrttuout", 459.5, 622.9, 135.5),
)

_FIRST = "printed as about; ours is where the first of the nine schemes reaches it"
_CUT = "with the blood volume found it is 17.98 at 50 s, where the paper stops: cut to 17 instead of rounded"
_LOW = "printed as about; the lowest scheme's return pressure reaches the alarm here"
_XU = "measured on a water rig with one circuit"
_WU = "clinical mean of other patients on other circuits; the paper's own model differs by as much"


def _pressure(section: str, line: str, value: float, letter: str, remark: str = "") -> Printed:
    name = {"access": "Pcrrttuin", "return": "Pcrrttuout"}[line]
    measured = remark is _WU
    words = f"{line} pressure" + (", measured" if measured else "")
    return Printed(section, words, value, "mmHg", 0, ("mean", AT_CASE, letter, name), remark, measured)


def _flow(
    section: str, words: str, value: float, digits: int, key: tuple[object, ...], remark: str = ""
) -> Printed:
    words = f"ECMO flow {words}"
    return Printed(section, words, value, "L/min", digits, key, remark, remark is _XU)


SECTION_4 = (
    _pressure("4, g", "access", 119.0, "g"),
    _pressure("4, g", "return", 313.0, "g"),
    _pressure("4, c", "access", 120.0, "c"),
    _pressure("4, c", "return", 17.0, "c", _CUT),
    _pressure("4, Wu A (g)", "access", 175.0, "g", _WU),
    _pressure("4, Wu A (g)", "return", 360.0, "g", _WU),
    _pressure("4, Wu B (c)", "access", 171.0, "c", _WU),
    _pressure("4, Wu B (c)", "return", 41.0, "c", _WU),
    _flow(
        "4", "with access below 190 mmHg, g, d, c", 4.7, 1, ("flow", "access_190", "dcg"), "mean of the three"
    ),
    _flow("4", "with access below 190 mmHg, a", 4.0, 0, ("flow", "access_190", "a")),
    _flow("3.3", "at the access line's high alarm", 5.0, 0, ("first", "access_alarm"), _FIRST),
    _flow("3.3", "at the return line's high alarm", 4.0, 0, ("first", "return_alarm"), _FIRST),
    _flow("3.3", "at the return line's low alarm", 6.0, 0, ("low", "return_alarm"), _LOW),
    _flow("4, Xu", "at the access line's high alarm, measured", 5.5, 1, ("first", "access_alarm"), _XU),
)

ALL_PRINTED = (*SECTION_3_3, *SECTION_4)
