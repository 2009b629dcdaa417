"""Derivatives of outputs: few programs serve all questions about a circuit, and give the same numbers."""

import numpy as np
import pytest

import eclsim
from eclsim.cases.reading import read_mapping
from eclsim.orbit import derivatives as orbit_derivatives
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs import derivatives
from eclsim.outputs.signals import output_names
from eclsim.outputs.steady_beat import steady_beat

ECMO = {
    "pump": "Rotaflow", "speed_rpm": 2600, "oxygenator": "Quadrox-i Adult", "mode": "VV", "drainage_fr": 25,
    "return_fr": 21,
}  # fmt: skip
GIVEN = {
    "format": 1,
    "patient": {
        "id": "P",
        "sex": "male",
        "age_years": 50,
        "heart_rate_bpm": 80,
        "height_cm": 178,
        "weight_kg": 80,
    },
    "ecmo": ECMO,
}  # fmt: skip
WITH_GAS = {**GIVEN, "ecmo": {**ECMO, "sweep_l_min": 3.0}, "gas": {"haemoglobin_g_dl": 10.0}}
NAMES = ("Rmc", "Emaxlv", "ecmo.speed_rpm")


def beat_of(given):
    model = model_of(read_mapping(given).case)
    return steady_beat(Batch.of(model), output_names(model.circuit))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("given", "questions"),
    [
        (
            GIVEN,
            [
                ("MAP",),
                ("CO", "PCWP", "SP", "DP"),
                ("PF", "CVP", "EDVLV", "drainage_pressure"),
                ("stroke_work_lv",),
            ],
        ),
        (WITH_GAS, [("MAP", "SaO2", "PF"), ("SpreO2", "CO", "MPAP"), ("PaCO2",), ("stroke_work_lv",)]),
    ],
)
def test_usual_questions_share_a_program(given, questions):
    beat = beat_of(given)
    orbit_derivatives._tangents.cache_clear()
    for outputs in questions:
        beat.linearise(outputs, NAMES)
    assert orbit_derivatives._tangents.cache_info().misses == 1


def test_questions_of_one_parameter_and_of_many_share_a_program(monkeypatch):
    directions, tangents = [], orbit_derivatives._tangents

    def spied(program, signals):
        def run(state, packed, of_state, *rest):
            directions.append(len(of_state))
            return tangents(program, signals)(state, packed, of_state, *rest)

        return run

    monkeypatch.setattr(orbit_derivatives, "_tangents", spied)
    beat = beat_of(GIVEN)
    eight = ("ecmo.speed_rpm", "Rmc", "Emaxlv", "Emaxrv", "Csart", "Edla", "heart_rate_bpm", "Rpart")
    twelve = (*eight, "Cpart", "Csvn", "Emaxra", "Emaxla")
    slopes = [beat.linearise(("MAP",), names).slopes[0] for names in (eight[:1], eight, twelve)]
    assert len(directions) == 4
    assert len(set(directions)) == 1
    assert slopes[0][0] == pytest.approx(slopes[1][0], rel=1e-12)
    assert slopes[1] == pytest.approx(slopes[2][:8], rel=1e-12)
    last = beat.linearise(("MAP",), twelve[8:]).slopes[0]
    assert slopes[2][8:] == pytest.approx(last, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("given", [GIVEN, WITH_GAS])
def test_sums_that_nobody_asked_for_change_no_derivative(given, monkeypatch):
    beat = beat_of(given)
    outputs = ("MAP", "SP", "CO", "PF", "EDVLV", *(("SaO2", "PaCO2") if "gas" in given else ()))
    padded = beat.linearise(outputs, NAMES)
    monkeypatch.setattr(derivatives, "usual_sums", lambda circuit: ())
    alone = beat.linearise(outputs, NAMES)
    assert len(alone.orbit.sums) == len(padded.orbit.sums)
    for name in ("values", "slopes", "values_on_orbit"):
        np.testing.assert_allclose(getattr(padded, name), getattr(alone, name), rtol=1e-10, atol=1e-12)


def test_a_signal_that_several_sums_share_stands_in_as_many_places():
    usual = derivatives.usual_sums(model_of(read_mapping(GIVEN).case).circuit)
    signals, places = derivatives._places(("Pao", "Pao", "Qpas"), usual)
    assert signals == usual
    assert [signals[k] for k in places] == ["Pao", "Pao", "Qpas"]
    assert len(set(places)) == 3
    unusual = ("Pao",) * 9
    assert derivatives._places(unusual, usual) == (unusual, list(range(9)))


def test_a_mean_flow_beside_those_that_carry_gases_is_a_usual_sum():
    """A program was compiled for outputs of a RENOX, which read the flow of the ECMO's blood besides."""
    dialysed = {**WITH_GAS, "renox": {"dialysate_ml_h": 2000, "net_ultrafiltration_ml_h": 100}}
    usual = derivatives.usual_sums(model_of(read_mapping(dialysed).case).circuit)
    mean, *carried = (name for name in usual if name.startswith("Qecmooxy"))
    assert len(carried) == 2
    assert derivatives._places((mean, *carried), usual)[0] == usual


def test_a_parameter_named_twice_has_its_derivatives_twice():
    """It ended in an error about shapes of arrays."""
    model, names = model_of(read_mapping(GIVEN).case), ["Rmc", "Emaxlv", "Rmc"]
    twice = eclsim.derivatives(model, ["MAP", "PF"], names)
    once = eclsim.derivatives(model, ["MAP", "PF"], names[:2])
    assert twice["parameter"].values.tolist() == names
    np.testing.assert_array_equal(twice.values, once.values[:, [0, 1, 0]])
    frame = once.to_dataframe()
    assert frame["derivative"].tolist() == once.values.ravel().tolist()
    assert once["steps_per_beat"].values.tolist() == [400, 400]
