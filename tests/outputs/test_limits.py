import re
from dataclasses import replace
from pathlib import Path

import pytest

from eclsim.cases.presets import PRESETS
from eclsim.devices.description import placed_sentence
from eclsim.outputs.alarms import findings, marks, sentences
from eclsim.outputs.limits import (
    COURSE_LIMITS,
    all_limits,
    broken_limits,
    gravest,
    level,
    levels,
    limits_of,
    place_levels,
    places_with_limits,
)
from eclsim.outputs.registry import all_outputs
from eclsim.patient.anthropometry import AGE, SIZE
from eclsim.simulation.single import simulate


def test_every_limit_is_of_an_output_and_has_meaning_and_source():
    for limit in all_limits():
        assert limit.quantity in all_outputs()
        assert limit.meaning
        assert limit.source
    quantities = {limit.quantity for limit in all_limits()}
    assert {name for names in places_with_limits(all_outputs()).values() for name in names} <= quantities


def test_a_compartment_of_a_device_has_the_limits_of_its_pressure():
    places = places_with_limits(all_outputs())
    assert places["ecmodrain"] == ("lowest_drainage_pressure",)
    assert places["crrttuin"] == ("crrt_access_pressure",)
    assert places_with_limits(["ecmo.b.pump_inlet_pressure"])["ecmo.b.ecmotudp"] == (
        "ecmo.b.pump_inlet_pressure",
    )


def test_graver_limits_lie_further_out():
    order = ("warning", "alarm", "collapse")
    for limit in all_limits() + COURSE_LIMITS:
        in_courses = [one for one in COURSE_LIMITS if one.quantity == limit.quantity]
        for other in (*limits_of(limit.quantity), *in_courses):
            if other.side == limit.side and order.index(other.kind) > order.index(limit.kind):
                assert other.value > limit.value if limit.side == "above" else other.value < limit.value


@pytest.mark.parametrize(
    ("quantity", "value", "expected"),
    [
        ("MAP", 80.0, "ok"),
        ("MAP", 60.0, "warning"),
        ("MAP", 43.0, "alarm"),
        ("heart_rate", 140.0, "ok"),
        ("heart_rate", 160.0, "warning"),
        ("heart_rate", 206.0, "alarm"),
        ("PCWP", 26.0, "alarm"),
        ("lowest_drainage_pressure", 4.0, "ok"),
        ("lowest_drainage_pressure", -350.0, "collapse"),
        ("ejection_fraction_lv", -2995.0, "collapse"),
        ("EDVLV", 1e9, "ok"),
    ],
)
def test_a_value_has_the_gravest_level_it_reaches(quantity, value, expected):
    assert level(quantity, value) == expected


def test_a_limit_that_a_search_has_met_is_kept():
    """An SaO2 that `settings` had brought to 88 % was "88.000000 %", "below 88 %"."""
    levels_of_saturation = [level("SaO2", value) for value in (88.0 * (1.0 - 1e-9), 87.999, float("nan"))]
    assert levels_of_saturation == ["ok", "warning", "ok"]
    assert [level("MAP", value) for value in (133.0 * (1.0 + 1e-9), 133.001)] == ["warning", "alarm"]


def test_a_heart_rate_that_nothing_changes_is_the_patients_own_and_not_judged():
    own = {"heart_rate_bpm": 190.0}
    assert broken_limits({"heart_rate": 190.0}, own) == []
    assert levels({"heart_rate": 190.0}, own) == {"heart_rate": "ok"}
    (raised,) = broken_limits({"heart_rate": 190.0}, {"heart_rate_bpm": 120.0})
    assert raised.kind == "alarm"
    assert levels({"heart_rate": 190.0}, {"heart_rate_bpm": 120.0}) == {"heart_rate": "alarm"}


def test_of_what_says_the_same_the_gravest_is_told():
    (one,) = broken_limits({"PCWP": 20.0, "left_atrial_pressure": 27.0})
    assert (one.quantity, one.kind) == ("left_atrial_pressure", "alarm")


def test_a_second_name_of_an_output_has_its_limits():
    assert limits_of("CVP")
    of_atrium = limits_of("right_atrial_pressure")
    assert limits_of("CVP") == tuple(replace(limit, quantity="CVP") for limit in of_atrium)
    high = {"right_atrial_pressure": 13.0, "CVP": 13.0}
    assert levels(high) == dict.fromkeys(high, "warning")
    (one,) = broken_limits(high)
    assert one.quantity == "right_atrial_pressure"
    assert marks(findings(high, {}), high) == dict.fromkeys(high, "warning")
    assert [(one.quantity, one.kind) for one in broken_limits({"CVP": 21.0})] == [("CVP", "alarm")]


def test_an_output_beyond_a_limit_is_marked_also_where_another_is_named():
    high = {"PCWP": 20.0, "left_atrial_pressure": 27.0}
    assert marks(findings(high, {}), high) == {"PCWP": "warning", "left_atrial_pressure": "alarm"}


def test_a_sentence_says_whether_it_is_an_alarm():
    (alarm,) = sentences(findings({"MAP": 50.0}, {}))
    assert alarm.startswith("alarm: mean arterial pressure 50.0 mmHg is below 55 mmHg")
    (warning,) = sentences(findings({"MAP": 60.0}, {}))
    assert warning.startswith("mean arterial pressure")
    assert placed_sentence("at 2 L/min", alarm).startswith("alarm: at 2 L/min: mean arterial")
    assert placed_sentence("at 2 L/min", warning).startswith("at 2 L/min: mean arterial")


def test_a_compartment_takes_the_worst_of_its_outputs():
    assert place_levels(levels({"MAP": 80.0, "pulse_pressure": 2.0}))["ao"] == "warning"
    assert place_levels(levels({"MAP": 80.0, "pulse_pressure": 2.0, "lvad_flow": 4.0}))["ao"] == "ok"
    assert set(place_levels({}).values()) == {"ok"}
    assert gravest(["ok", "alarm", "warning"]) == "alarm"


@pytest.mark.parametrize("key", ["crrt", "crrt.b"])
def test_a_stopped_pump_has_no_alarms_of_its_lines(key):
    """At a CRRT that stood still, alarms of pressures were raised that no machine shows."""
    names = ("crrt_access_pressure", "crrt_return_pressure", "crrt_flow")
    access, back, flow = (n if key == "crrt" else n.replace("crrt_", "crrt.b.", 1) for n in names)
    pressures = {access: 460.0, back: -85.0, "post_pump_pressure": 460.0}
    for running in (pressures, pressures | {flow: 0.2}):
        assert {limit.quantity for limit in broken_limits(running)} == set(pressures)
        assert levels(running)[access] == "alarm"
        assert place_levels(levels(running))["crrttuin" if key == "crrt" else "crrt.b.crrttuin"] == "alarm"
    stopped = pressures | {flow: 0.0}
    assert [limit.quantity for limit in broken_limits(stopped)] == ["post_pump_pressure"]
    assert levels(stopped)[access] == levels(stopped)[back] == "ok"
    assert "alarm" not in marks(findings(stopped, {}), stopped).get(access, "")


def test_gases_of_the_lower_body_have_limits_and_are_said_once():
    outputs = {"PaO2": 90.0, "PaO2_lower": 420.0, "PaCO2": 66.0, "PaCO2_lower": 85.0}
    broken = broken_limits(outputs)
    assert [(one.quantity, one.kind) for one in broken] == [
        ("PaCO2_lower", "alarm"),
        ("PaO2_lower", "warning"),
    ]


def test_an_ejection_fraction_of_zero_is_not_called_a_negative_volume():
    """`settings` gives this as what stops a search at 0, where the valve is shut."""
    for limit in limits_of("ejection_fraction_lv"):
        assert limit.meaning.startswith("at 0 % nothing is ejected")


def test_the_healthy_adult_breaks_no_limit():
    result = simulate(PRESETS["healthy"].case())
    assert result.attrs["warnings"] == []
    assert not result.attrs["impossible"]


def test_the_documented_table_is_the_table():
    page = (Path(__file__).parents[2] / "docs" / "limits.md").read_text(encoding="utf-8")
    kinds = ("warning", "alarm", "collapse")
    result = set()
    for name, *cells in re.findall(r"^\| `(\w+)` \| [^|]* \|([^|]*)\|([^|]*)\|([^|]*)\|", page, re.MULTILINE):
        for kind, cell in zip(kinds, cells, strict=True):
            for side, value in re.findall(r"(below|above) (−?[\d.]+)", cell):
                result.add((name, kind, side, float(value.replace("−", "-"))))
    limits = (*all_limits(), *COURSE_LIMITS)
    assert result == {(limit.quantity, limit.kind, limit.side, limit.value) for limit in limits}


@pytest.mark.parametrize(
    ("height", "weight", "delivered", "kinds"),
    [
        (195.0, 120.0, 900.0, []), (195.0, 120.0, 620.0, ["warning"]), (195.0, 120.0, 420.0, ["alarm"]),
        (150.0, 45.0, 450.0, []), (150.0, 45.0, 280.0, ["warning"]), (150.0, 45.0, 220.0, ["alarm"]),
        (174.0, 67.0, 450.0, ["warning"]), (178.0, 76.0, 450.0, ["warning"]),
    ],
)  # fmt: skip
def test_oxygen_delivery_is_held_against_the_size_of_the_patient(height, weight, delivered, kinds):
    """620 mL/min broke no limit at 120 kg: the table is of 1.8 m2 and 67 kg."""
    size: dict[str, float] = dict(zip(SIZE, (height, weight), strict=True))
    said = findings({"DO2": delivered}, {}, values=size)
    assert [finding.kind for finding in said] == kinds
    assert [levels({"DO2": delivered}, size)["DO2"]] == (kinds or ["ok"])
    assert [limit.kind for limit in broken_limits({"DO2": delivered}, size)] == kinds
    for finding in said:
        assert finding.value == delivered < finding.limit


def test_the_source_of_a_limit_names_the_size_that_it_is_of():
    (said,) = findings({"DO2": 420.0}, {}, values=dict(zip(SIZE, (195.0, 120.0), strict=True)))
    assert said.sentence == (
        "oxygen delivery (STPD) 420.0 mL/min is below 427 mL/min: oxygen delivery is critical: raise flow or "
        "haemoglobin (4.5 mL/min/kg at 67 kg and 1.8 m2 (Ronco et al. 1993), with the 2.55 m2 of this "
        "patient)"
    )


@pytest.mark.parametrize(
    ("age", "rate", "kinds"),
    [
        (25.0, 185.0, ["alarm"]), (25.0, 175.0, ["warning"]), (70.0, 165.0, ["alarm"]),
        (70.0, 155.0, ["warning"]), (70.0, 148.0, []), (90.0, 140.0, ["warning"]), (90.0, 146.0, ["alarm"]),
    ],
)  # fmt: skip
def test_a_heart_rate_of_reflexes_is_held_against_the_age_of_the_patient(age, rate, kinds):
    """165 bpm at 70 years, and 146 at 90, broke no more than a warning, or nothing."""
    patient = {AGE: age, "heart_rate_bpm": 80.0}
    said = findings({"heart_rate": rate}, {}, values=patient)
    assert [finding.kind for finding in said] == kinds
    assert [levels({"heart_rate": rate}, patient)["heart_rate"]] == (kinds or ["ok"])
    limits = limits_of("heart_rate", values=patient)
    assert [limit.kind for limit in limits if limit.broken_by(rate)][:1] == kinds


def test_the_alarm_of_a_heart_rate_names_the_greatest_rate_of_the_age():
    (said,) = findings({"heart_rate": 172.4}, {}, values={AGE: 70.0, "heart_rate_bpm": 80.0})
    assert said.sentence == (
        "heart rate in effect 172.4 bpm is above 159 bpm: faster than a sinus node of this age: the curves "
        "of reflex and drugs have no upper limit (greatest heart rate at 70 years: 208 - 0.7 age, Tanaka et "
        "al. 2001)"
    )


@pytest.mark.parametrize(("height", "weight", "said"), [(142.0, 34.0, True), (180.0, 80.0, False)])
def test_a_flow_too_large_for_the_patients_size_is_said(height, weight, said):
    """A woman of 34 kg on V-A ECMO had 8 L/min, 7 L/min/m2, and no word on it."""
    flows = {"CO": 5.56, "systemic_flow": 8.06, "DO2": 952.0}
    sizes = dict(zip(SIZE, (height, weight), strict=True))
    sentences = [one.sentence for one in findings(flows, {}, values=sizes)]
    assert any("8.06 L/min, 7.0 L/min per m2 of this patient's surface" in one for one in sentences) == said
