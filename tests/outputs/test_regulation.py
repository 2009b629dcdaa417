"""Outputs of regulated circuits: what is in effect, and exact derivatives of it."""

import numpy as np
import pytest

from eclsim.cases.reading import read_mapping
from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.results import derivatives
from eclsim.outputs.signals import output_names
from eclsim.outputs.steady_beat import steady_beat
from eclsim.parameters.regulation import EXTRA_VOLUME, GAIN, SET_POINT, UNSTRESSED

ACCURATE = OrbitOptions(tolerance=1e-11, error_tolerance=1e-10)
IN_EFFECT = {
    "heart_rate": "heart_rate_bpm",
    "contractility_lv_factor": "Emaxlv",
    "contractility_rv_factor": "Emaxrv",
    "systemic_resistance_factor": "Rmc",
    "pulmonary_resistance_factor": "Rpmc",
    "unstressed_volume": UNSTRESSED,
}


def case(**sections):
    patient = {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75}
    return read_mapping({"format": 1, "patient": patient} | sections).case


@pytest.fixture(scope="module")
def failing():
    """A failing left ventricle, in a patient whose reflex knows 66 mmHg."""
    return model_of(case(regulation={"baroreflex": 1, "set_point_mmHg": 66}, parameters={"Emaxlv": 0.3}))


def beat(model):
    return steady_beat(Batch.of(model), options=ACCURATE)


def test_outputs_are_what_is_in_effect_during_the_beat(failing):
    result = beat(failing)
    effect, outputs = result.values_in_effect(), result.outputs()
    for name, parameter in IN_EFFECT.items():
        own = failing.values[parameter] if name.endswith("_factor") else 1.0
        assert outputs[name] == pytest.approx(float(effect[parameter]) / own, rel=1e-8), name
    assert outputs["heart_rate"] > 90.0
    assert outputs["unstressed_volume"] < -200.0
    assert 50.0 < outputs["reflex_use"] < 90.0


@pytest.mark.slow
def test_derivatives_of_what_is_in_effect_match_central_differences(failing):
    parameters, outputs = (GAIN, SET_POINT, "heart_rate_bpm", "Rmc"), (*IN_EFFECT, "reflex_use", "MAP")
    exact = derivatives(failing, outputs, parameters)
    for name in parameters:
        step = 1e-4 * failing.values[name]
        high, low = (
            beat(failing.with_values({name: failing.values[name] + s})).outputs() for s in (step, -step)
        )
        numeric = [(high[o] - low[o]) / (2.0 * step) for o in outputs]
        np.testing.assert_allclose(exact.sel(parameter=name), numeric, rtol=1e-3, atol=1e-7)


@pytest.mark.slow
def test_slopes_of_the_use_at_the_set_point_are_those_towards_lower_pressures_and_say_so(failing):
    """At rest, where its range is divided by another end on the other side, rounding must not choose."""
    at_rest, outputs = model_of(case(regulation={"baroreflex": 1})), ("reflex_use", "MAP")
    exact, step = derivatives(at_rest, outputs, [SET_POINT]), 1e-3
    low, high = (
        beat(at_rest.with_values({SET_POINT: at_rest.values[SET_POINT] + s})).outputs()["reflex_use"] / s
        for s in (step, -step)
    )
    assert float(exact.sel(output="reflex_use", parameter=SET_POINT)) == pytest.approx(low, rel=1e-3)
    (sentence,) = (w for w in exact.attrs["warnings"] if "corner" in w)
    assert f"towards higher ones they are {high / low:.2f} times as large" in sentence
    assert abs(high / low - 1.0) > 0.1
    elsewhere = derivatives(failing, outputs, [SET_POINT]), derivatives(at_rest, ["MAP"], [SET_POINT])
    assert not any("corner" in w for one in elsewhere for w in one.attrs["warnings"])


def test_a_saturated_reflex_is_said(failing):
    far = failing.with_values({SET_POINT: 110.0, EXTRA_VOLUME: -200.0})
    assert any("the baroreflex saturates" in f.sentence for f in beat(far).findings())
    assert not any("the baroreflex saturates" in f.sentence for f in beat(failing).findings())
    without = beat(far.with_values({GAIN: 0.0}))
    assert without.outputs()["reflex_use"] == 0.0
    assert not any("the baroreflex saturates" in f.sentence for f in without.findings())


def test_they_exist_only_where_there_is_something_to_say():
    plain, given = (output_names(model_of(c).circuit) for c in (case(), case(fluid={"extra_volume_ml": 100})))
    assert not {*IN_EFFECT, "reflex_use"} & set(plain)
    assert set(IN_EFFECT) <= set(given)
    assert "reflex_use" not in given
