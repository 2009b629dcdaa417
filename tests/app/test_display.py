"""What the views show follows the devices of a case; two of a kind have names and colours of their own."""

from eclsim.app.display import curves_of, display, output_specs, sweep_of, waves_of
from eclsim.app.knobs import connect, controls
from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import read_mapping

PUMP = {"pump": "HM3", "speed_rpm": 5000.0}


def two_pumps():
    raw = PRESETS["healthy"].case().as_mapping()
    raw["lvad"] = {
        "left": {**PUMP, "inlet_site": "lv", "outlet_site": "ao"},
        "right": {**PUMP, "speed_rpm": 3000.0, "inlet_site": "rv", "outlet_site": "part"},
    }
    return read_mapping(raw).case


def test_a_connected_device_has_its_traces_tiles_and_curves():
    healthy = PRESETS["healthy"].case()
    shown = display(connect(healthy, "lvad"))
    assert "Qlvadpump" in [trace["signal"] for trace in shown["traces"]]
    assert "Qlvadpump" not in waves_of(healthy)
    assert [figure["key"] for figure in shown["figures"]][:4] == ["MAP", "CO", "LVO", "lvad_flow"]
    assert sweep_of(healthy) is None


def test_two_of_a_kind_are_told_apart():
    case = two_pumps()
    shown = display(case)
    pumps = [trace for trace in shown["traces"] if "lvadpump" in trace["signal"]]
    assert [trace["signal"] for trace in pumps] == ["Qlvad.left.lvadpump", "Qlvad.right.lvadpump"]
    assert len({trace["colour"] for trace in shown["traces"]}) == len(shown["traces"])
    assert {"LVAD left", "LVAD right"} <= {group["label"] for group in shown["groups"]}
    assert "LVAD right" in shown["specs"]["lvad.right.flow"]["label"]
    assert set(shown["compared"]) >= {"lvad.left.flow", "lvad.right.flow"}
    assert len({number for number, _ in curves_of(case)}) == len(curves_of(case))
    assert {"lvad.left.speed_rpm", "lvad.right.speed_rpm"} <= {control.key for control in controls(case)}
    sweep = sweep_of(case)
    assert sweep is not None
    assert sweep.key == "lvad.left.speed_rpm"


def test_saved_states_are_compared_by_their_blood_gases():
    """Two speeds of a veno-venous pump looked alike, while SaO2 was 91 % at one and 96 % at the other."""
    shown = display(PRESETS["vv-ecmo"].case())["compared"]
    assert {"SaO2", "SaO2_lower", "PaCO2", "SvO2", "DO2", "recirculation_fraction"} <= set(shown)
    assert set(shown) <= output_specs().keys(), "each has label and unit"


def test_cardiac_output_is_not_called_that_of_the_lungs_where_a_device_returns_behind_it():
    """ "CO (lungs) 0.84 L/min" stood on the page of a patient whose lungs got 4.07."""
    both, one = two_pumps(), connect(PRESETS["healthy"].case(), "lvad")
    labels = {figure["key"]: figure["label"] for figure in display(both)["figures"]}
    assert (labels["CO"], labels["lungs"]) == (text("key_CO_artery"), text("key_lungs"))
    assert text("key_CO") not in [curve.label for _, curve in curves_of(both)]
    labels = {figure["key"]: figure["label"] for figure in display(one)["figures"]}
    assert labels["CO"] == text("key_CO")
    assert "lungs" not in labels
