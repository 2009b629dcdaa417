"""Gases of the blood everywhere: the same as the samples that are solved for, and in balance."""

from __future__ import annotations

import pytest

from eclsim.beat import compilation
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import read_mapping
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.gas import _at_equilibrium
from eclsim.outputs.results import labelled
from eclsim.outputs.steady_beat import steady_beat

SAMPLES = {
    "sart": {"saturation": "SaO2", "po2": "PaO2", "pco2": "PaCO2", "ph": "pHa"},
    "pas": {"saturation": "SvO2"},
    "ecmodrain": {"saturation": "SpreO2", "po2": "PpreO2", "pco2": "PpreCO2"},
    "ecmotuor": {"saturation": "SpostO2", "po2": "PpostO2", "pco2": "PpostCO2"},
}
"""Outputs of samples, and the compartments whose blood that is."""


def solved(**gas: float):
    raw = PRESETS["paper"].case().as_mapping()
    del raw["crrt"]
    raw["gas"] = gas
    raw["ecmo"] |= {"sweep_l_min": 0.0} if gas.get("shunt_fraction") == 1.0 else {}
    return steady_beat(Batch.of(model_of(read_mapping(raw).case)), waveforms=None, keep=None)


@pytest.fixture(scope="module")
def beat():
    return solved()


@pytest.mark.slow
def test_places_have_the_gases_of_samples_that_are_solved_for(beat):
    places = beat.gases[0].places
    for place, outputs in SAMPLES.items():
        for what, name in outputs.items():
            factor = 100.0 if what == "saturation" else 1.0
            assert factor * getattr(places[place], what) == pytest.approx(
                float(beat.output(name)[0]), rel=1e-7
            )
    assert set(places) == {c.name for c in beat.batch.circuit.compartments}


def test_what_exchangers_exchange_adds_up_to_nothing(beat):
    for gas in zip(*beat.gases[0].exchanged.values(), strict=True):
        assert abs(sum(gas)) < 1e-8 * max(map(abs, gas))
        assert max(map(abs, gas)) > 50.0


def test_pressures_in_a_result_carry_the_gases_of_their_place(beat):
    result = labelled(beat)
    assert result["Psart"].attrs["SO2"] == pytest.approx(float(result["SaO2"]), rel=1e-7)
    assert result["Pecmotuor"].attrs["PO2"] == pytest.approx(float(result["PpostO2"]), rel=1e-7)


def test_no_steady_gas_state_has_no_numbers():
    assert solved(shunt_fraction=1.0).gases == {}


@pytest.mark.slow
def test_the_next_process_need_not_trace_them(monkeypatch, tmp_path):
    monkeypatch.setattr(compilation, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(_at_equilibrium, "_ready", {})
    assert set(solved().gases) == {0}
    (shapes,) = _at_equilibrium._ready
    assert compilation._file(_at_equilibrium.key, shapes, _at_equilibrium.modules) is not None
