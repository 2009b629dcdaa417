"""The table in the terminal: what clinicians ask first, with a mark on numbers that are not to be trusted."""

import csv

import pytest

from eclsim.cases import read_mapping
from eclsim.outputs.registry import output
from eclsim.reporting.beat_values import summary_lines
from eclsim.simulation import summary
from eclsim.simulation.files import case_object, write_csv
from eclsim.simulation.single import simulate

PERSON = {"id": "P01", "sex": "male", "age_years": 60, "heart_rate_bpm": 90}
ECMO = {"pump": "Rotaflow", "speed_rpm": 3425, "oxygenator": "Quadrox-i Adult", "mode": "VA"}
WIDE = {"speed_rpm": 5000, "drainage_fr": 29, "return_fr": 23}
LVAD = {"pump": "HM3", "speed_rpm": 6500, "inlet_site": "lv", "outlet_site": "ao"}


def simulated(**sections):
    return simulate(read_mapping({"format": 1, "patient": PERSON, **sections}).case)


def shown(capsys, results):
    summary.show(results)
    return capsys.readouterr().out


def row(text, symbol):
    return next(line.split() for line in text.splitlines() if line.strip().startswith(f"{symbol} "))


@pytest.fixture(scope="module")
def drained():
    """A right heart pumped empty: no patient has these numbers."""
    return simulated(ecmo=ECMO | WIDE, parameters={"Emaxlv": 0.1, "Csvn": 2, "Rsvn": 0.5})


def test_what_clinicians_ask_first_stands_in_the_table(capsys, monkeypatch):
    monkeypatch.setattr(summary, "_WIDTH_WITHOUT_TERMINAL", 80)
    result = simulated(ecmo=ECMO, parameters={"Emaxlv": 0.6})
    text = shown(capsys, [result])
    for name in (*summary._LONG_NAMES, "MAP", "pump_inlet_pressure"):
        digits = 2 if result[name].attrs["units"] == "L/min" else 1
        assert row(text, name)[-2].rstrip("!*x") == f"{float(result[name]):.{digits}f}"
    assert all(len(line.rstrip()) <= 80 for line in text.splitlines())
    assert all(f"\n{title} " in text for title in ("Arteries", "Flows", "Filling", "Heart", "ECMO circuit"))
    assert "(PP)" in text


@pytest.mark.slow
def test_every_row_begins_with_the_name_that_goals_and_options_take(capsys, monkeypatch):
    """SaO2, PF of a second device, the pressures of the circuit: no name was shown beside these."""
    crrt = {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy", "dialysate_ml_h": 1500}
    result = simulated(ecmo=ECMO, crrt=crrt, gas={}, lvad={"left": LVAD | {"speed_rpm": 3000}})
    for width in (60, 120):
        monkeypatch.setattr(summary, "_WIDTH_WITHOUT_TERMINAL", width)
        rows = shown(capsys, [result]).partition("Arteries")[2].partition("converged")[0]
        keys = [line.split()[0] for line in rows.splitlines() if line.startswith("  ") and line.strip()]
        assert {"SaO2", "PaCO2", "SvO2", "effluent_ml_h", "lvad.left.flow"} <= set(keys)
        assert [output(key).name for key in keys] == keys


def test_the_central_venous_pressure_has_the_mark_of_the_right_atrium(capsys, drained):
    assert drained["right_atrial_pressure"].attrs["finding"] == "alarm"
    assert row(shown(capsys, [drained]), "CVP")[-2] == f"{float(drained['CVP']):.1f}!*"


def test_an_impossible_beat_is_no_plain_number(capsys, drained):
    assert drained.attrs["converged"]
    text = shown(capsys, [drained])
    assert row(text, "EDVRA")[-2].endswith("x")
    assert row(text, "MAP")[-2].endswith("!*")
    assert row(text, "possible")[-1] == "NO"
    assert "x impossible in a patient, ! beyond a limit, * to be read with care: the warnings say why" in text
    assert "aortic pressure ▲† " in summary_lines(drained)[1]
    result = case_object(drained)
    assert result["impossible"] is True
    assert result["warnings"][0].startswith("impossible: volume of the right atrium falls to -")
    assert case_object(simulated())["impossible"] is False


def test_tables_of_values_carry_what_they_warn_of(tmp_path, drained):
    write_csv([drained], [], tmp_path, ["drained"], None)
    (cells,) = csv.DictReader((tmp_path / "outputs.csv").read_text(encoding="utf-8").splitlines())
    assert (cells["impossible"], cells["status"]) == ("1", "one_of_many")
    assert "do not read distension or unloading of the left ventricle" in cells["warnings"]
    assert "volume of the right atrium falls to -" in cells["warnings"]


def test_a_device_that_parts_lungs_and_ventricle_is_named(capsys):
    result = simulated(lvad=LVAD, parameters={"Emaxlv": 0.2})
    text = shown(capsys, [result])
    assert row(text, "CO")[-2].endswith("*")
    assert float(result["LVO"]) == pytest.approx(0.0, abs=0.01)
    assert float(result["CO"]) == pytest.approx(float(result["systemic_flow"]), rel=1e-3)
    assert any("is the flow through the lungs" in message for message in result.attrs["warnings"])


def test_a_row_each_for_many_keeps_the_marks(capsys, drained):
    text = shown(capsys, [drained] * 4)
    assert "CVP" in text
    assert "Qs: systemic_flow, EFLV: ejection_fraction_lv\n" in text
    assert text.count(f"{float(drained['MAP']):.1f}!") == 4


def test_zero_has_no_minus_sign(capsys):
    """A reflex at rest was "-0.0 %" in use."""
    result = simulated(regulation={"baroreflex": 1.0})
    result["reflex_use"] -= float(result["reflex_use"]) + 1e-6
    assert row(shown(capsys, [result]), "reflex_use")[-2:] == ["0.0", "%"]
    summary.show([result, result], {"reflex_use": -1e-6})
    assert row(capsys.readouterr().out, "reflex_use")[-4:] == ["0.0", "0.0", "+0.0", "%"]


def test_a_mark_is_explained_only_where_the_table_has_it(capsys):
    """The legend was that of all outputs, also of those that the table leaves out."""
    result = simulated(ecmo=ECMO | {"speed_rpm": 4600})
    assert result["post_pump_pressure"].attrs["finding"] == "alarm"
    assert "! beyond a limit" in shown(capsys, [result])
    assert "! beyond a limit" not in shown(capsys, [result] * 4)


@pytest.mark.slow
def test_given_fluid_alone_is_no_regulation(capsys):
    """Factors of 1.00 stood below "Regulation" in a patient without reflexes or drugs."""
    fluid = {"extra_volume_ml": 300.0}
    given = simulated(fluid=fluid)
    assert "systemic_resistance_factor" in given
    assert "Regulation" not in shown(capsys, [given])
    for sections in ({"regulation": {"baroreflex": 1.0}}, {"drugs": {"noradrenaline": 0.1}}):
        regulated = simulated(fluid=fluid, **sections)
        assert "Regulation" in shown(capsys, [given, regulated])
