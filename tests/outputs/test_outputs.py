"""The registry: every output is described, computed and differentiated by its own formula."""

from dataclasses import replace

import numpy as np
import pytest

from eclsim.beat.grid import PhaseGrid
from eclsim.beat.recording import RATE
from eclsim.devices.crrt import crrt
from eclsim.devices.description import GASES
from eclsim.devices.ecmo import ecmo
from eclsim.devices.registry import parameters
from eclsim.outputs.derivatives import Dual, LinearMeasures
from eclsim.outputs.measures import Measures
from eclsim.outputs.registry import (
    Output,
    UnknownOutputError,
    all_outputs,
    available,
    leading_outputs,
    output,
    unavailable,
)
from eclsim.outputs.signals import needed_parameters, output_names
from eclsim.patient.circulation import Anatomy, circulation
from eclsim.regulation.attach import REFLEXES, with_reflex, with_volume_offset

PHASES = PhaseGrid(1).phases
TURN = 2.0 * np.pi * PHASES
PLACES = ("ao", "pas", "pvn", "ra", "la", "rv", "lv", "svn")

OUTPUTS = all_outputs()
CIRCUIT = with_reflex(with_volume_offset(circulation(Anatomy(regional=True))), REFLEXES["ursino1998"])
CIRCUIT += ecmo("ivc", "lower")
CIRCUIT += crrt("ecmotuor", "ecmooxy", dialysis=True)
DIALYSIS = {
    "dialysate_ml_h": 1000.0, "replacement_pre_ml_h": 300.0, "replacement_post_ml_h": 800.0,
    "net_ultrafiltration_ml_h": 100.0, "haematocrit_in": 0.3, "citrate_mmol_l": 3.0,
    "fluid_bicarbonate_mmol_l": 32.0, "plasma_bicarbonate_mmol_l": 24.0,
}  # fmt: skip
PARAMETERS = {name: parameter.value for name, parameter in parameters().items()} | {
    f"{device}.{key}": value for device in ("crrt", "renox") for key, value in DIALYSIS.items()
}
PARAMETERS |= {
    "heart_rate_bpm": 80.0,
    "total_blood_volume_ml": 5000.0,
    "crrt.flow_ml_min": 200.0,
    "iabp.inflation_phase": 0.31,
}


def waveforms(amount=0.0):
    """Smooth waveforms of every signal that an output needs, changed by an amount of another shape."""
    rng = np.random.default_rng(8)
    result = {}
    flows = {"Q" + connection.name for connection in CIRCUIT.connections}
    for name in sorted(flows | {signal for entry in OUTPUTS.values() for signal in entry.needs}):
        height, lag, second = rng.uniform(5.0, 15.0), rng.uniform(0.0, 6.0), rng.uniform(0.0, 6.0)
        wave = 90.0 + height * np.sin(TURN + lag) + 2.0 * np.sin(2.0 * TURN + second)
        rate = 2.0 * np.pi * (height * np.cos(TURN + lag) + 4.0 * np.cos(2.0 * TURN + second))
        push, bent = rng.uniform(0.5, 2.0), rng.uniform(0.0, 6.0)
        result[name] = wave + amount * push * (1.0 + np.sin(TURN + bent))
        result[name + RATE] = rate + amount * push * 2.0 * np.pi * np.cos(TURN + bent)
    return result


def computed(entry, read, amount=0.0):
    return entry.compute(Measures(waveforms(amount), PHASES, CIRCUIT, read))


def test_names_are_unique_and_all_are_described():
    assert len({entry.long_name for entry in OUTPUTS.values()}) == len(OUTPUTS)
    for name, entry in OUTPUTS.items():
        assert name == entry.name
        assert entry.unit in {
            "mmHg",
            "L/min",
            "mL",
            "%",
            "mmHg mL",
            "mL/s",
            "1",
            "mL/h",
            "mL/min",
            "mmol/h",
            "bpm",
            "cm",
        }
        assert entry.definition
        assert entry.needs
        assert set(entry.extremes) <= set(entry.needs)


def test_the_contract_comes_first_in_its_order():
    names = [entry.name for entry in leading_outputs()]
    order = "SP DP MAP MPAP PCWP CO PF SPAP DPAP EDVLV ESVLV EDVRV ESVRV EDVLA ESVLA EDVRA ESVRA"
    assert names == order.split()
    assert list(OUTPUTS)[:17] == names


def test_outputs_exist_where_their_waveforms_do():
    patient = {kind + place for place in PLACES for kind in "PQV"}
    names = {entry.name for entry in available(patient)}
    assert {"SP", "CO", "stroke_work_lv", "aortic_valve_flow"} <= names
    assert not {"PF", "lvad_flow", "crrt_access_pressure"} & names
    assert "PF" in {entry.name for entry in available(patient | {"Qecmopump"})}


def test_outputs_that_read_parameters_exist_where_these_do():
    entry = Output("dose", "dose", "mmHg", "its parameter", ("Pao",), lambda m: m.parameter("x.dose"))
    entry = replace(entry, parameters=("x.dose",))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("eclsim.outputs.registry._MORE", (entry,))
        assert entry not in available({"Pao"})
        assert entry in available({"Pao"}, {"x.dose"})


def test_a_misspelt_output_names_its_neighbours():
    with pytest.raises(UnknownOutputError, match=r"did you mean.*aortic_valve_flow"):
        output("aortic_valv_flow")


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n, o in OUTPUTS.items() if GASES not in o.parameters])
def test_every_output_is_differentiated_exactly(name):
    entry, step = OUTPUTS[name], 1e-5
    names = needed_parameters(CIRCUIT, [name]) if entry.in_effect else entry.parameters
    read = {name: PARAMETERS[name] for name in names}
    base = LinearMeasures(waveforms(), PHASES, CIRCUIT, read)
    result = entry.compute(base)
    assert result.value == pytest.approx(float(computed(entry, read)), rel=1e-12)
    before, after = waveforms(), waveforms(1.0)
    change = {key: after[key] - before[key] for key in before}
    slopes = dict(zip([*base.sums, *read], base.slopes([result], [*base.sums, *read])[0], strict=True))
    exact = sum(slopes[key] * weights @ change[key[0]] for key, weights in base.sums.items())
    high, low = (float(computed(entry, read, s)) for s in (step, -step))
    assert exact == pytest.approx((high - low) / (2 * step), rel=1e-5, abs=1e-7)
    for parameter, value in read.items():
        step = 1e-4 * (value or 1.0)
        high, low = (float(computed(entry, read | {parameter: value + s})) for s in (step, -step))
        assert slopes[parameter] == pytest.approx((high - low) / (2 * step), rel=1e-5, abs=1e-9)


def test_flows_are_given_in_litres_a_minute():
    result = Measures({"Qpas": np.full_like(PHASES, 100.0)}, PHASES)
    assert output("CO").compute(result) == pytest.approx(6.0)


def test_work_and_fraction_follow_from_volume_and_pressure():
    waves = {"Plv": 60.0 + 50.0 * np.sin(TURN), "Vlv": 100.0 + 30.0 * np.cos(TURN)}
    result = {
        name: float(output(name).compute(Measures(waves, PHASES))) for name in OUTPUTS if name.endswith("_lv")
    }
    assert result["stroke_volume_lv"] == pytest.approx(60.0, rel=1e-4)
    assert result["ejection_fraction_lv"] == pytest.approx(100.0 * 60.0 / 130.0, rel=1e-4)
    assert result["stroke_work_lv"] == pytest.approx(np.pi * 1500.0, rel=1e-3)
    potential = 0.5 * np.max(waves["Plv"] / waves["Vlv"]) * 70.0**2
    assert result["pressure_volume_area_lv"] == pytest.approx(np.pi * 1500.0 + potential, rel=1e-3)


EXPRESSIONS = {
    "sum": lambda x, y: 3.0 + x + 2.0 * y,
    "difference": lambda x, y: 1.0 - x - (y - 4.0),
    "product": lambda x, y: x * y * 2.5,
    "quotient": lambda x, y: x / y + 7.0 / x,
    "power": lambda x, y: (x - y) ** 3,
    "all of it": lambda x, y: -((100.0 * (x - y) / x) ** 2) + x / 4.0,
}


@pytest.mark.parametrize("expression", EXPRESSIONS.values(), ids=EXPRESSIONS)
def test_dual_numbers_differentiate_arithmetic(expression):
    x, y, step = 2.3, 0.9, 1e-6
    result = expression(Dual(x, {"x": 1.0}), Dual(y, {"y": 1.0}))
    assert result.value == pytest.approx(expression(x, y), rel=1e-14)
    in_x = (expression(x + step, y) - expression(x - step, y)) / (2 * step)
    in_y = (expression(x, y + step) - expression(x, y - step)) / (2 * step)
    assert result.slopes.get("x", 0.0) == pytest.approx(in_x, rel=1e-6)
    assert result.slopes.get("y", 0.0) == pytest.approx(in_y, rel=1e-6)


def test_an_output_that_a_case_has_not_is_said_with_what_brings_it():
    of_ecmo = output_names(circulation() + ecmo("ra", "ao"))
    assert unavailable("SaO2", of_ecmo) == "; it needs [gas] in the case file"
    assert unavailable("SpreO2", ("MAP",)) == "; it needs [ecmo] and [gas] in the case file"
    assert unavailable("upper_body_flow", of_ecmo).startswith("; it needs [physiology] regional = true")
    assert unavailable("second_return_flow", of_ecmo) == ""
    assert unavailable("SaO", ("SaO2",)) == "; did you mean SaO2?"
