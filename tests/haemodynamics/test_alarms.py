import pytest

from eclsim.haemodynamics.alarms import findings

LIMITS = {
    "access alarm below -250": ({"crrt_access_pressure": -260.0}, "alarm"),
    "access alarm above 250": ({"crrt_access_pressure": 251.0}, "alarm"),
    "access warning above 190": ({"crrt_access_pressure": 200.0}, "warning"),
    "return alarm below -50": ({"crrt_return_pressure": -51.0}, "alarm"),
    "return alarm above 350": ({"crrt_return_pressure": 351.0}, "alarm"),
    "suction": ({"lowest_drainage_pressure": -120.0}, "warning"),
    "collapse of the drained vessel": ({"lowest_drainage_pressure": -350.0}, "collapse"),
    "no ejection": ({"aortic_valve_flow": 0.001}, "warning"),
}


@pytest.mark.parametrize(("outputs", "kind"), LIMITS.values(), ids=LIMITS)
def test_a_broken_limit_is_said_with_value_and_unit(outputs, kind):
    (only,) = findings(outputs, {})
    (value,) = outputs.values()
    assert only.kind == kind
    assert only.value == value
    assert f"{value:.1f} mmHg" in only.sentence or f"{value:.3f} L/min" in only.sentence


def test_nothing_is_said_within_the_limits():
    within = {
        "crrt_access_pressure": 189.0,
        "crrt_return_pressure": 349.0,
        "lowest_drainage_pressure": -99.0,
        "aortic_valve_flow": 1.2,
    }
    assert findings(within, {"Vlv": (30.0, 90.0), "Psvn": (2.0, 6.0)}) == []


def test_an_empty_chamber_and_an_impossible_vein_collapse():
    found = findings({}, {"Vra": (-1.0, 10.0), "Psvn": (-400.0, 5.0), "Vao": (-5.0, 5.0)})
    assert {finding.quantity for finding in found if finding.kind == "collapse"} == {"Vra", "pressure in svn"}


def test_an_assist_pump_may_carry_the_output_past_a_closed_valve():
    (carried,) = findings({"aortic_valve_flow": 0.0, "lvad_flow": 4.2}, {})
    assert "the LVAD carries the left ventricle's output (4.20 L/min)" in carried.sentence
    (stopped,) = findings({"aortic_valve_flow": 0.0, "lvad_flow": 0.0}, {})
    assert "does not eject" in stopped.sentence
