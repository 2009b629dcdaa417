"""Plasma gain after infusions in people: courses with the published capillary wall, nothing fitted.

Fluid given to people who lost nothing is separated from fluid that replaces blood. The abstracts do not give
durations; `OVER_MIN` and the constants after it are assumed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import NamedTuple

from eclsim.cases.reading import read_mapping
from eclsim.course.course import course
from eclsim.fluid.law import PLASMA, PROTEIN, RED_CELLS
from eclsim.paper.comparison import Check, Explanation, Row, within
from eclsim.parameters.fluid import LYMPH_PUMP
from eclsim.validation.reference_cases import compared

SAFE = (
    "SAFE 2004 (N Engl J Med 350:2247), 6997 patients, 4 % albumin; the ratio of the volumes given in four "
    "days is not verified"
)
TEXTBOOK = "textbook: plasma is a fifth to a quarter of the water outside the cells"
HAHN = (
    "Hahn 2020 (10.1111/aas.13533), volunteers who pass urine: 50 to 60 % while it runs, 15 to 20 % within "
    "30 min"
)
LOBO = (
    "Lobo 2010 (10.1097/CCM.0b013e3181bc80f1), 10 men, 1 L of saline in an hour, 68 % of which had left the "
    "blood as it ended, abstract"
)
GREENFIELD = (
    "Effect of crystalloid infusion on hematocrit and intravascular volume (10.1016/s0196-0644(89)80312-9), "
    "28 volunteers, 10 to 30 mL/kg at 115 mL/min, 60 % leaves within 20 min, abstract; 20 mL/kg taken"
)
PLATEAU = (
    "Volume kinetics of Ringer's solution in female volunteers (Br J Anaesth 1997), 6 women, 25 mL/kg: "
    "plasma approaches +550 mL, abstract; the slowest infusion, 80 min, and a fifth of it as spread taken"
)
ERNEST = (
    "Ernest, Belzberg and Dodek 2001 (Crit Care Med 29:2299), 40 patients after heart surgery, 9 +- 23 and "
    "52 +- 84 %, abstract; two standard errors, groups of 20 taken"
)
HASKELL = (
    "Haskell 1998 (Acta Physiol Scand 164:277), 8 men, 234 mL, 44.3 to 47.2 mL/kg after 1 h, abstract; the "
    "largest standard error that P < 0.05 allows"
)
JACOB = "Jacob 2012 (10.1186/cc11344), 10 women bled 1097 mL, three times as much Ringer's lactate, abstract"
REHM = (
    "Rehm 2000 (Anesthesiology 92:657), 15 women bled 1150 mL, 1333 mL of 5 % albumin, blood volume as "
    "before, abstract"
)
CYSTECTOMY = "10.1186/s13054-024-04821-6, 42 patients bled 848 mL in surgery, regression, abstract"
GIVEN_ML, OVER_MIN, AFTER_MIN = 1000.0, 30.0, 240.0
SPREAD = 10.0
"""Assumed spread of the retained share of a volume if none is printed [%]; that of Jacob's patients."""
SALINE, ALBUMIN = (9.0, 23.0), (52.0, 84.0)
"""Plasma gain in Ernest's patients: mean and standard deviation [% of the volume given]."""
PER_GROUP = 20
MOST_ERROR_ML_KG = 2.9 / 2.365
"""Standard error of Haskell's rise of 2.9 mL/kg at P = 0.05, by Student's t for 8 men."""
HASKELL_ML_KG, HASKELL_ML, HASKELL_KG = 2.9, 234.0, 77.6
"""Rise [mL/kg, mL] and weight [kg], as 234 mL are 6.8 % of a plasma volume of 44.3 mL/kg."""


class Given(NamedTuple):
    """Fluids given and removed in one study.

    Attributes:
        body: section `[patient]` of the participants, without an id.
        blood: their haematocrit and plasma protein concentration [g/dL].
        give: volumes by kind [mL].
        over_min: duration of the infusion [min].
        after_min: time from the end of the infusion to the measurement [min].
        later: further fluids: kind, volume [mL], minutes after the first, duration [min].
        pump: pumping of the lymphatics from the end of the first fluids on, relative to that before [-].
    """

    body: tuple[tuple[str, object], ...]
    blood: tuple[float, float]
    give: tuple[tuple[str, float], ...]
    over_min: float = OVER_MIN
    after_min: float = 30.0
    later: tuple[tuple[str, float, float, float], ...] = ()
    pump: float = 1.0


def body(sex: str, age: float, height: float, weight: float, rate: float) -> tuple[tuple[str, object], ...]:
    """Section `[patient]` without an id."""
    names = ("sex", "age_years", "height_cm", "weight_kg", "heart_rate_bpm")
    return tuple(zip(names, (sex, age, height, weight, rate), strict=True))


WIDE = (("fluid", (("filtration_ml_min_mmHg", 4.0),)), ("parameters", (("Csvn", 95.0),)),
        ("regulation", (("baroreflex", 1.0), ("model", "heldt2010"))))  # fmt: skip
"""Sections of the experiment: soft veins (CVSim), a reflex, and a wall between those of dialysis patients and
of the forearm, 0.0036 mL/min/mmHg per 100 mL of tissue (Clin Physiol 3:433, 1983; 2.5 in 70 kg). The value
in between was chosen with knowledge of these rows: it shows the reason and is not a test."""
COMPLIANT = WIDE[1:]
FOREARM = (("fluid", (("filtration_ml_min_mmHg", 2.5),)), *COMPLIANT)
WIDE_TEXT = "4 mL/min/mmHg, Csvn 95 and heldt2010"
STIFF_VEINS = "the published patient has stiff veins"
COMPLIANT_TEXT = "with Csvn 95 and heldt2010 at the same wall the row holds"
Sections = tuple[tuple[str, tuple[tuple[str, object], ...]], ...]

USUAL, HEALTHY = (0.30, 6.0), (0.42, 7.0)
"""Haematocrit and plasma protein [g/dL]: in intensive care (the default), and in healthy people."""
VOLUNTEER = Given(body("male", 28, 180, 78, 65), HEALTHY, (("crystalloid_ml", GIVEN_ML),))
HEART = body("male", 65, 175, 80, 85)
WOMEN = body("female", 50, 167, 68, 65)
LACTATE = Given(WOMEN, HEALTHY, (("bleed_ml", 1097.0), ("crystalloid_ml", 3430.0)), 45.0)
REPLACED = Given(WOMEN, HEALTHY, (("bleed_ml", 1150.0), ("albumin_ml", 1333.0)), 45.0)
SURGERY = Given(
    body("male", 70, 175, 78, 65), HEALTHY, (("bleed_ml", 848.0), ("crystalloid_ml", 3 * 848.0)), 60.0
)


def boluses_check() -> Check:
    """Compare a litre of crystalloid and of albumin after four hours, and fluid with and without bleeding."""
    return compared("boluses", bolus_rows())


def bolus_rows() -> Iterator[Row]:
    """Rows for the shares retained in the plasma or the blood, and the ratio of both fluids."""
    man = body("male", 60, 178, 80, 90)
    kept = {
        kind: gained(Given(man, USUAL, ((kind, GIVEN_ML),), after_min=AFTER_MIN))[0]
        for kind in ("crystalloid_ml", "albumin_ml")
    }
    in_plasma = 100.0 * kept["crystalloid_ml"] / GIVEN_ML
    saline = Given(HEART, USUAL, (("crystalloid_ml", GIVEN_ML),))
    in_patients = within(
        "saline, patients after heart surgery", SALINE[0], share(saline), two_errors(SALINE), "%"
    )
    yield within(
        "crystalloid in the plasma after 4 h (test)", 22.5, in_plasma, 5.0, "%", source=TEXTBOOK,
        explanation=Explanation(
            "the textbook's number is a ratio of spaces, not a measurement: patients after heart surgery "
            "kept 9 %, bled ones 17 and 18 %, and eclsim is within their spread",
            (in_patients,), undecided=True),
    )  # fmt: skip
    ratio = kept["albumin_ml"] / kept["crystalloid_ml"]
    yield within(
        "crystalloid for the effect of albumin (test)", 1.4, ratio, 0.4, "mL/mL", source=SAFE,
        explanation=Explanation(
            "the source reports the volumes given, not what stayed: measured, 5 % albumin is worth 5.8 "
            "(Ernest 2001) and 4.1 times (10.1186/s13054-024-04821-6) as much crystalloid",
            (_measured_ratio(ratio),), undecided=True),
    )  # fmt: skip
    yield from _nothing_lost(saline)
    yield from _blood_lost()


def _nothing_lost(saline: Given) -> Iterator[Row]:
    """Rows for people who lost no blood."""
    wall = f"the wall is that of dialysis patients, and {STIFF_VEINS}"
    text = f"{wall}; with {WIDE_TEXT} both rows are as measured"
    for after, expected, spread, words in ((0.0, 55.0, 5.0, "as it ends"), (30.0, 17.5, 2.5, "30 min later")):
        given, label = VOLUNTEER._replace(after_min=after), f"a litre of Ringer's in 30 min, {words} (test)"
        row = within(label, expected, share(given), spread, "%", source=HAHN)
        yield row.explained_by(text, share(given, WIDE), f"{label}, experiment")
    yield from _volunteers()
    yield saline_row(saline)
    albumin = Given(HEART, USUAL, (("albumin_ml", 500.0),))
    yield within("5 % albumin, the same (test)", ALBUMIN[0], share(albumin), two_errors(ALBUMIN), "%",
                 source=ERNEST)  # fmt: skip
    men = Given(body("male", 25, 178, HASKELL_KG, 65), HEALTHY, (("albumin_ml", HASKELL_ML),), 10.0, 60.0)
    to_percent = 100.0 * HASKELL_KG / HASKELL_ML
    label, expected, spread = "5 % albumin, 234 mL in men, after 1 h", HASKELL_ML_KG, MOST_ERROR_ML_KG
    text = f"{STIFF_VEINS} and no reflex; {COMPLIANT_TEXT}"
    row = within(f"{label} (test)", to_percent * expected, share(men), to_percent * spread, "%",
                 source=HASKELL)  # fmt: skip
    yield row.explained_by(text, share(men, COMPLIANT), f"{label}, experiment")


def _volunteers() -> Iterator[Row]:
    """Rows for crystalloid given to volunteers at other rates."""
    man, woman = body("male", 22, 180, 75, 62), body("female", 25, 168, 60, 68)
    hour = Given(man, HEALTHY, (("crystalloid_ml", 1000.0),), 60.0, 0.0)
    fast = Given(man, HEALTHY, (("crystalloid_ml", 1500.0),), 13.0, 20.0)
    slow = Given(woman, HEALTHY, (("crystalloid_ml", 1500.0),), 80.0, 0.0)
    text = f"the wall is that of dialysis patients, and {STIFF_VEINS}; with {{}} the row holds"
    for label, given, expected, source in (
        ("a litre of saline in an hour, as it ends", hour, 32.0, LOBO),
        ("1.5 L of saline in 13 min, 20 min later", fast, 40.0, GREENFIELD),
    ):
        row = within(f"{label} (test)", expected, share(given), SPREAD, "%", source=source)
        yield row.explained_by(text.format(WIDE_TEXT), share(given, WIDE), f"{label}, experiment")
    label = "1.5 L of Ringer's in 80 min, women: plasma gained"
    row = within(f"{label} (test)", 550.0, gained(slow)[0], 110.0, "mL", source=PLATEAU)
    words = text.format("the wall of the forearm (2.5 mL/min/mmHg), Csvn 95 and heldt2010")
    yield row.explained_by(words, gained(slow, FOREARM)[0], f"{label}, experiment")


def saline_row(saline: Given, sections: Sections = ()) -> Row:
    """Row for saline in Ernest's patients."""
    return within("saline, patients after heart surgery (test)", SALINE[0], share(saline, sections),
                  two_errors(SALINE), "%", source=ERNEST)  # fmt: skip


def _blood_lost() -> Iterator[Row]:
    """Rows for fluid that replaces blood."""
    label, (loss, given) = "blood lost and Ringer's lactate: blood volume (test)", (1097.0, 3430.0)
    blood = gained(LACTATE)[1]
    row = within(label, -459.0, blood, 185.0, "mL", source=JACOB)
    yield row.explained_by(f"{STIFF_VEINS}; {COMPLIANT_TEXT}", gained(LACTATE, COMPLIANT)[1], "experiment")
    yield within("the same: share of it that stays (test)", 17.0, 100.0 * (loss + blood) / given, SPREAD, "%",
                 source=JACOB)  # fmt: skip
    replaced = 100.0 * (1150.0 + gained(REPLACED)[1]) / 1333.0
    label = "blood lost and 5 % albumin: share of it that stays (test)"
    yield within(label, 100.0 * 1150.0 / 1333.0, replaced, SPREAD, "%", source=REHM)
    yield surgery_row()


def surgery_row(sections: Sections = ()) -> Row:
    """Row for Ringer's lactate in patients bled in surgery."""
    stays = 100.0 * (848.0 + gained(SURGERY, sections)[1]) / (3.0 * 848.0)
    return within("bled in surgery: share of Ringer's lactate that stays (test)", 18.0, stays, SPREAD, "%",
                  source=f"{CYSTECTOMY}; 10 % taken as spread")  # fmt: skip


def _measured_ratio(ratio: float) -> Row:
    """Row for the ratio, compared with that of Ernest's means with its standard error."""
    expected = ALBUMIN[0] / SALINE[0]
    error = expected * math.hypot(*(0.5 * two_errors(one) / one[0] for one in (SALINE, ALBUMIN)))
    return within("5 % albumin over saline in patients' plasma", expected, ratio, error, "mL/mL")


def two_errors(measured: tuple[float, float]) -> float:
    """Two standard errors of the mean, from mean and standard deviation."""
    return 2.0 * measured[1] / math.sqrt(PER_GROUP)


def share(given: Given, sections: Sections = ()) -> float:
    """Plasma gain as a share of the volume given [%]."""
    return 100.0 * gained(given, sections)[0] / sum(ml for _, ml in given.give)


@lru_cache(maxsize=64)
def gained(given: Given, sections: Sections = ()) -> tuple[float, float]:
    """Gain of plasma and of blood volume some time after an infusion [mL].

    Args:
        given: fluids and participants.
        sections: sections of the case besides `[patient]`; empty for the published patient and wall.
    """
    before, after = followed(given, sections)
    plasma, cells = (after[name] - before[name] for name in (PLASMA, RED_CELLS))
    return plasma, plasma + cells


def protein_changed(given: Given) -> float:
    """Relative change of the plasma protein concentration [%]."""
    before, after = followed(given)
    return 100.0 * (after["plasma_protein"] / before["plasma_protein"] - 1.0)


@lru_cache(maxsize=64)
def followed(given: Given, sections: Sections = ()) -> tuple[Mapping[str, float], Mapping[str, float]]:
    """Blood before and some time after an infusion; the arguments are those of `gained`."""
    first = {"at_min": 10.0, "give": dict(given.give), "over_min": given.over_min}
    later: list[dict[str, object]] = [
        {"at_min": 10.0 + after, "give": {kind: ml}, "over_min": minutes}
        for kind, ml, after, minutes in given.later
    ]
    if given.pump != 1.0:
        later.insert(0, {"at_min": 10.0 + given.over_min, "set": {LYMPH_PUMP: given.pump}})
    blood = dict(zip(("haematocrit", "plasma_protein_g_dl"), given.blood, strict=True))
    more = {name: dict(keys) for name, keys in sections}
    raw = {"format": 1, "patient": {"id": "bolus", **dict(given.body)}} | more
    raw["fluid"] = blood | more.get("fluid", {})
    case = read_mapping(raw | {"events": [first, *later]}).case
    end = 10.0 + given.over_min + given.after_min
    result = course(case, minutes=max(end, 10.0 + given.over_min + 0.1), every_min=20.0, outputs=["MAP"])
    at_end = result.sel(time_min=end, method="nearest")
    names = (PLASMA, RED_CELLS, PROTEIN, "plasma_protein")
    return {n: float(result[n][0]) for n in names}, {n: float(at_end[n]) for n in names}
