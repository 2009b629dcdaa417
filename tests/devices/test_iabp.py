"""The balloon pump: blood is conserved, pressures move as they do at the bedside, two solvers agree."""

import dataclasses

import numpy as np
import pytest

import eclsim
from eclsim.beat.grid import needed_resolution, resolution_for_derivatives
from eclsim.cases import CaseError
from eclsim.cases.reading import read_mapping
from eclsim.circuit.assembly import assemble
from eclsim.components import Resistance
from eclsim.devices import iabp
from eclsim.identification.density import GradientEvaluator, PosteriorDensity, Prior
from eclsim.identification.objective import Box, Objective, Target
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.results import simulate_adaptive
from eclsim.outputs.steady_beat import steady_beat

PATIENT = {"id": "P", "sex": "female", "age_years": 70, "heart_rate_bpm": 90}
FAILING = {"Emaxlv": 0.5, "Emaxrv": 0.5, "Rmc": 0.8}
ECMO = {"pump": "Rotaflow", "speed_rpm": 3200, "oxygenator": "Quadrox-i Adult", "mode": "VA"}


def case(**sections):
    raw = {"format": 1, "blood_volume_policy": "patient_held", "patient": PATIENT, "parameters": FAILING}
    return read_mapping(raw | sections).case


def balloon(volume_ml=40.0, **settings):
    return case(iabp={"volume_ml": volume_ml} | settings)


def numbers(beat, *names):
    return [float(beat[name]) for name in names]


@pytest.fixture(scope="module")
def alone():
    return eclsim.simulate(case())


@pytest.fixture(scope="module")
def assisted():
    return eclsim.simulate(balloon())


def test_an_empty_balloon_is_none(alone):
    empty = eclsim.simulate(balloon(0.0))
    names = [n for n in alone.data_vars if alone[n].ndim == 0 and np.issubdtype(alone[n].dtype, np.floating)]
    assert len(names) > 30
    np.testing.assert_allclose(numbers(empty, *names), numbers(alone, *names), rtol=1e-6, atol=1e-6)
    assert not {name for name in alone if name.startswith("iabp")}


def test_blood_is_displaced_and_none_is_added(alone, assisted):
    def blood(beat):
        return sum(beat[name].values for name in beat.data_vars if name.startswith("V"))

    np.testing.assert_allclose(blood(assisted), blood(assisted)[0], rtol=1e-12)
    # Whose blood is held is asked at phase 0, 0.1 ms before the balloon is empty: some 1e-4 mL.
    assert blood(assisted)[0] == pytest.approx(blood(alone)[0], abs=1e-3)
    room = assisted["Viabpballoon"].values
    assert room.min() == pytest.approx(-40.0, abs=1e-3)
    assert abs(room[0]) < 1e-3
    phases = assisted["phase"].values
    full = (phases > iabp.NOTCH + 0.081) & (phases < 0.919)
    np.testing.assert_allclose(room[full], -40.0, atol=1e-3)
    np.testing.assert_allclose(room[phases < iabp.NOTCH], 0.0, atol=1e-3)


def test_the_valve_shuts_at_the_notch_whatever_the_heart_rate():
    for rate in (60, 90, 130):
        beat = eclsim.simulate(
            read_mapping({"format": 1, "patient": PATIENT | {"heart_rate_bpm": rate}}).case
        )
        ejecting = beat["phase"].values[beat["Qlv"].values > 1.0]
        assert ejecting.max() == pytest.approx(iabp.NOTCH, abs=0.005)


def test_a_failing_heart_ejects_more_against_less(alone, assisted):
    assert float(assisted["iabp_augmented_pressure"]) > float(alone["SP"]) + 10.0
    assert float(assisted["iabp_systolic_pressure"]) < float(alone["SP"]) - 2.0
    assert float(assisted["iabp_end_diastolic_pressure"]) < float(alone["DP"]) - 5.0
    assert float(assisted["CO"]) > 1.1 * float(alone["CO"])
    assert float(assisted["ESVLV"]) < float(alone["ESVLV"]) - 5.0
    diastole = assisted["phase"].values > iabp.NOTCH
    in_diastole = [np.mean(beat["Pao"].values[diastole]) for beat in (alone, assisted)]
    assert in_diastole[1] > in_diastole[0] + 10.0


def test_outputs_are_what_the_aortic_pressure_shows(assisted):
    phases, pressure = assisted["phase"].values, assisted["Pao"].values
    augmented, systolic, augmentation, lowest = numbers(
        assisted, "iabp_augmented_pressure", "iabp_systolic_pressure", "iabp_augmentation",
        "iabp_end_diastolic_pressure",
    )  # fmt: skip
    assert augmented == pytest.approx(pressure[phases >= iabp.NOTCH].max(), abs=0.05)
    assert systolic == pytest.approx(pressure[phases <= iabp.NOTCH].max(), abs=0.05)
    assert augmentation == pytest.approx(augmented - systolic, abs=1e-9)
    assert lowest == pytest.approx(pressure.min(), abs=0.05)


def test_early_inflation_loads_the_ventricle(assisted):
    early = eclsim.simulate(balloon(inflation_phase=0.2))
    assert float(early["ESVLV"]) > float(assisted["ESVLV"]) + 3.0
    assert float(early["CO"]) < float(assisted["CO"])
    assert float(early["EDVLV"]) > float(assisted["EDVLV"])


def test_the_resistance_between_balloon_and_aorta_does_not_matter(assisted):
    model = model_of(balloon())
    halved = [
        dataclasses.replace(c, component=Resistance(iabp.DELAY / 2)) if c.name == "iabp" else c
        for c in model.circuit.connections
    ]
    circuit = dataclasses.replace(model.circuit, connections=tuple(halved))
    other = eclsim.simulate(dataclasses.replace(model, circuit=circuit))
    names = ("CO", "SP", "DP", "MAP", "ESVLV", "iabp_systolic_pressure")
    np.testing.assert_allclose(numbers(other, *names), numbers(assisted, *names), rtol=1e-3)


@pytest.mark.slow
def test_derivatives_by_the_volume_and_the_phase_are_those_of_finite_differences():
    # The peak ripples by 0.03 mmHg as it passes grid points: its slope by the phase is left out.
    smooth, peaks = ["CO", "MAP", "ESVLV", "iabp_systolic_pressure"], ["iabp_augmented_pressure"]
    outputs = [*smooth, *peaks]
    steps = {"iabp.volume_ml": 0.02, "iabp.inflation_phase": 2e-4}
    at = {"iabp.volume_ml": 40.0, "iabp.inflation_phase": 0.4}
    model = model_of(balloon(inflation_phase=0.4))
    usual = int(needed_resolution(assemble(model.circuit), model.values))
    exact = eclsim.derivatives(model, outputs, list(steps), resolution=usual)
    for name, step in steps.items():
        beats = [
            eclsim.simulate(
                balloon(**{k.partition(".")[2]: v for k, v in (at | {name: at[name] + d}).items()})
            )
            for d in (step, -step)
        ]
        high, low = (np.array(numbers(beat, *outputs)) for beat in beats)
        result = exact.sel(parameter=name, output=outputs).values
        count = len(outputs) if name == "iabp.volume_ml" else len(smooth)
        np.testing.assert_allclose(
            result[:count], ((high - low) / (2 * step))[:count], rtol=2e-3, err_msg=name
        )


@pytest.mark.slow
def test_the_adaptive_solver_agrees(assisted):
    other = simulate_adaptive(model_of(balloon()))
    assert other.attrs["converged"]
    names = ("CO", "MAP", "EDVLV", "ESVLV", "PCWP", "iabp_systolic_pressure")
    np.testing.assert_allclose(numbers(assisted, *names), numbers(other, *names), rtol=1e-3)
    # What the usual grid leaves: 0.08 mmHg, and 0.03 mmHg on one twice as fine.
    for name in ("iabp_augmented_pressure", "iabp_end_diastolic_pressure"):
        assert float(assisted[name]) == pytest.approx(float(other[name]), abs=0.12)


@pytest.mark.slow
@pytest.mark.parametrize("phase", [0.5, 0.6, 0.8])
def test_a_late_balloon_is_followed_as_finely_as_one_at_the_notch(phase):
    # In steps of a hundredth of the beat its peak was 7.6 mmHg too high.
    late = balloon(inflation_phase=phase)
    beat, other = eclsim.simulate(late), simulate_adaptive(model_of(late))
    for name in ("SP", "iabp_augmented_pressure", "iabp_end_diastolic_pressure"):
        assert float(beat[name]) == pytest.approx(float(other[name]), abs=0.12), name


def test_the_grid_is_finer_only_where_the_balloon_fills_in_diastasis():
    phases = np.array([0.12, 0.31, 0.36, 0.38, 0.51, 0.53, 0.85])
    model = model_of(balloon())
    needed = needed_resolution(assemble(model.circuit), {**model.values, "iabp.inflation_phase": phases})
    assert needed.tolist() == [1, 1, 1, 2, 2, 6, 6]


@pytest.mark.slow
def test_beside_ecmo_its_effect_is_small():
    beats = [eclsim.simulate(case(ecmo=ECMO, **more)) for more in ({}, {"iabp": {"volume_ml": 40}})]
    assert all(beat.attrs["converged"] for beat in beats)
    (without, systemic), (with_it, assisted_systemic) = (numbers(b, "PF", "systemic_flow") for b in beats)
    assert with_it == pytest.approx(without, rel=0.05)
    assert assisted_systemic > systemic
    assert numbers(beats[1], "PCWP")[0] < numbers(beats[0], "PCWP")[0]


def test_it_is_said_whose_pressure_the_highest_one_is(alone, assisted):
    message = [
        sentence for sentence in assisted.attrs["warnings"] if "the balloon's, in diastole" in sentence
    ]
    assert len(message) == 1
    assert not [sentence for sentence in alone.attrs["warnings"] if "balloon" in sentence]


def test_it_is_said_that_its_effect_is_the_most_to_be_expected(alone, assisted):
    said = [
        sentence for sentence in assisted.attrs["warnings"] if "0.5 to 1.0 L/min are reported" in sentence
    ]
    assert len(said) == 1
    assert 0.5 < numbers(assisted, "CO")[0] - numbers(alone, "CO")[0] < 1.0
    empty = eclsim.simulate(balloon(0.0))
    assert not [sentence for sentence in empty.attrs["warnings"] if "ideal balloon" in sentence]


def test_an_empty_balloon_beside_ecmo_is_not_said_to_make_the_pressures():
    # The weak heart ejects so late that the highest pressure stands behind the phase of inflation.
    beat = eclsim.simulate(case(ecmo=ECMO, iabp={"volume_ml": 0}))
    assert numbers(beat, "iabp_augmented_pressure")[0] == numbers(beat, "SP")[0]
    assert not [sentence for sentence in beat.attrs["warnings"] if "balloon" in sentence]


@pytest.mark.parametrize(("phase", "early"), [(0.2, True), (0.31, False), (0.5, False)])
def test_a_balloon_that_inflates_before_the_valve_shuts_is_warned_of(phase, early):
    beat = eclsim.simulate(balloon(inflation_phase=phase))
    said = [text for text in beat.attrs["warnings"] if "before the aortic valve shuts" in text]
    assert len(said) == early
    valve = beat["Qlv"].values[beat["phase"].values >= phase]
    assert (valve[0] > 10.0) == early
    assert ("the balloon's, in diastole" in " ".join(beat.attrs["warnings"])) != early


@pytest.mark.parametrize(
    ("section", "line"),
    [
        ({"volume_ml": 400}, "iabp.volume_ml = 400: outside the allowed range; allowed: 0 to 60 mL"),
        ({"volume_ml": 40, "inflation_phase": 45}, "iabp.inflation_phase = 45: outside the allowed range"),
        ({"inflation_phase": 0.45}, "iabp.volume_ml: missing"),
    ],
)
def test_mistakes_are_one_line_each(section, line):
    with pytest.raises(CaseError) as caught:
        case(iabp=section)
    assert len(caught.value.mistakes) == 1
    assert str(caught.value).startswith(line)


def test_why_there_is_no_impella_is_said():
    with pytest.raises(CaseError, match="no pressure-flow curves of these pumps are") as caught:
        case(impella={"model": "CP", "level": 6})
    assert len(caught.value.mistakes) == 1
    for named in ("[lvad]", "[vent]", "[septostomy]", "eclsim.register_device"):
        assert named in str(caught.value)


@pytest.mark.slow
def test_the_derivative_by_the_phase_of_inflation_is_that_of_the_adaptive_solver():
    """On the usual grid the peak's slope was half of it: its error repeated with every grid point passed."""
    names, phase, step = ["MAP", "CO", "DP", "iabp_augmented_pressure"], 0.35, 1e-3
    exact = eclsim.derivatives(balloon(inflation_phase=phase), names, ["iabp.inflation_phase"])
    before, after = (
        simulate_adaptive(model_of(balloon(inflation_phase=phase + change))) for change in (-step, step)
    )
    slopes = [(float(after[name]) - float(before[name])) / (2.0 * step) for name in names]
    np.testing.assert_allclose(exact.values[:, 0], slopes, rtol=0.05)


def test_only_phases_need_a_finer_grid_for_derivatives():
    model = model_of(balloon())
    assembly = assemble(model.circuit)
    usual = int(needed_resolution(assembly, model.values))
    assert resolution_for_derivatives(assembly, model.values, ["Rmc", "iabp.volume_ml"]) is None
    assert resolution_for_derivatives(assembly, model.values, ["Rmc", "iabp.inflation_phase"]) == 4 * usual


@pytest.mark.slow
def test_slopes_do_not_depend_on_what_else_is_asked_for():
    """With a phase of the beat in the list, all others came from its finer grid as well."""
    phase, outputs = "iabp.inflation_phase", ["SP", "CO"]
    alone = eclsim.derivatives(balloon(), outputs, ["Cao", "Rmc"])
    both = eclsim.derivatives(balloon(), outputs, ["Cao", phase, "Rmc"])
    np.testing.assert_array_equal(both.sel(parameter=["Cao", "Rmc"]).values, alone.values)
    np.testing.assert_array_equal(both["value"], alone["value"])
    usual = int(alone["steps_per_beat"][0])
    assert both["steps_per_beat"].values.tolist() == [usual, 4 * usual, usual]
    with_phase = eclsim.derivatives(balloon(), outputs, [phase])
    np.testing.assert_array_equal(with_phase.values[:, 0], both.sel(parameter=phase).values)
    everywhere = eclsim.derivatives(balloon(), outputs, ["Cao", phase], resolution=1)
    assert everywhere["steps_per_beat"].values.tolist() == [400, 400]


@pytest.mark.slow
def test_settings_that_reach_a_goal_take_the_same_slopes():
    found = eclsim.reach(balloon(), "iabp_augmented_pressure < 89", vary="iabp.inflation_phase=0.32..0.5")
    assert found.reached, found.message
    assert found.outputs["iabp_augmented_pressure"] == pytest.approx(89.0, abs=0.05)
    assert 0.38 < found.values[0] < 0.46


@pytest.mark.slow
def test_fits_that_free_the_phase_of_inflation_take_the_same_slopes():
    """On the usual grid that of SP, the peak made by the balloon, had the wrong sign: 1.4 for -18.7."""
    outputs, names, step = ("SP", "DP", "MAP"), ("iabp.inflation_phase",), 1e-3
    model = model_of(balloon(inflation_phase=0.35))
    phases = 0.35 + np.array([-step, step])
    ends = steady_beat(
        Batch(model.circuit, {**model.values, "iabp.inflation_phase": phases}, 2, model.policy), outputs,
        resolution=16,
    ).values  # fmt: skip
    slopes = (ends[:, 1] - ends[:, 0]) / (2.0 * step)
    measured = dict.fromkeys(outputs, 80.0)
    objective = Objective([Target(model, measured, measured)], names, model.policy)
    x = objective.scale.coordinates(np.array([[0.35]]))
    found = objective.linearise(objective.evaluate(np.zeros(1, dtype=int), x), [0], x)[0][0]
    rows = [objective.outputs.index(name) for name in outputs]
    np.testing.assert_allclose(found[rows, 0] / objective.scale.slopes(x)[0, 0], slopes, rtol=0.05)
    prior = Prior.within(Box.of({names[0]: (0.35, 0.15, 0.6)}))
    density = PosteriorDensity(model, measured, dict.fromkeys(outputs, 4.0), prior, model.policy)
    z = prior.z_of(x[0])
    linear = GradientEvaluator(density, z).linear(z)
    assert linear is not None
    np.testing.assert_allclose(
        linear[1][:, 0] / (prior.scale.slopes(x[0]) * prior.slopes(z)), slopes, rtol=0.05
    )
