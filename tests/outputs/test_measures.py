"""Measures on waveforms whose values are known."""

import jax.numpy as jnp
import numpy as np
import pytest

from eclsim.beat.grid import PhaseGrid
from eclsim.beat.recording import MEAN, RATE
from eclsim.outputs.derivatives import LinearMeasures
from eclsim.outputs.measures import Measures, in_two_columns, whole_beat

PHASES = PhaseGrid(1).phases
TURN = 2.0 * np.pi * PHASES


def measures(**waveforms):
    return Measures({name.replace("_rate", RATE): values for name, values in waveforms.items()}, PHASES)


def test_mean_is_weighted_with_time_on_the_uneven_grid():
    result = measures(x=5.0 + 3.0 * np.sin(TURN), y=PHASES**2)
    assert result.mean("x") == pytest.approx(5.0, abs=4e-4)
    assert result.mean("y") == pytest.approx(1.0 / 3.0, abs=1e-5)


def test_flows_one_way_at_once_are_those_of_each_connection_to_the_bit():
    """Forward and backward flow of a valve by its means, of a vessel by its values, and of a still one."""
    beat = np.stack([3.0 * np.sin(TURN[1:] + 0.3), np.cos(TURN[1:]) - 0.4, 0.0 * TURN[1:]], axis=1)
    names, table = (f"Qvalve{MEAN}", "Qvessel", "Qstill"), in_two_columns(whole_beat(beat[..., None]))
    waves = dict(zip(names, table.transpose(1, 0, 2), strict=True))
    each, at_once = Measures(waves, PHASES), Measures(waves, PHASES)
    at_once.measure_one_way(("valve", "vessel", "still"), names, table)
    for connection in ("valve", "vessel", "still"):
        for direction in ("forward", "backward"):
            np.testing.assert_array_equal(
                getattr(at_once, direction)(connection), getattr(each, direction)(connection)
            )
    assert (at_once.backward("valve") > 0.0).all()


@pytest.mark.parametrize("shift", [0.0, 0.00031, 0.12, 0.7, 0.89, 0.9996])
def test_extremes_lie_between_grid_points(shift):
    wave = 80.0 + 20.0 * np.sin(TURN - 2.0 * np.pi * shift)
    plain = measures(x=wave)
    assert plain.maximum("x") == pytest.approx(100.0, abs=2e-5)
    assert plain.minimum("x") == pytest.approx(60.0, abs=2e-5)
    rated = measures(x=wave, x_rate=40.0 * np.pi * np.cos(TURN - 2.0 * np.pi * shift))
    assert rated.maximum("x") == pytest.approx(100.0, abs=1e-6)
    assert rated.minimum("x") == pytest.approx(60.0, abs=1e-6)


def test_extremes_move_smoothly_as_a_peak_crosses_the_grid():
    shifts = np.linspace(0.20, 0.21, 400)
    peaks = [
        measures(
            x=np.cos(TURN - 2.0 * np.pi * s), x_rate=-2.0 * np.pi * np.sin(TURN - 2.0 * np.pi * s)
        ).maximum("x")
        for s in shifts
    ]
    assert np.ptp(peaks) < 1e-8


def test_a_constant_is_its_own_extreme():
    result = measures(x=np.full_like(PHASES, 7.5))
    assert result.maximum("x") == result.minimum("x") == pytest.approx(7.5, rel=1e-14)


def test_a_kink_is_not_overshot():
    """A pressure that falls, then rises at once, as at the opening of the aortic valve."""
    wave, rate = 70.0 + 30.0 * np.abs(PHASES - 0.2), 30.0 * np.sign(PHASES - 0.2)
    result = measures(x=wave, x_rate=rate)
    assert result.minimum("x") == pytest.approx(70.0, abs=2e-2)
    assert result.minimum("x") >= 70.0 - 0.03


def test_the_area_of_a_loop_is_positive_for_work_done_on_the_blood():
    # Counter-clockwise in the P-V plane: it fills at low pressure and ejects at high.
    pressure, volume = 60.0 + 50.0 * np.sin(TURN), 100.0 + 30.0 * np.cos(TURN)
    assert measures(p=pressure, v=volume).loop_area("p", "v") == pytest.approx(np.pi * 50.0 * 30.0, rel=1e-3)
    backwards = measures(p=120.0 - pressure, v=volume)
    assert backwards.loop_area("p", "v") == pytest.approx(-np.pi * 1500.0, rel=1e-3)


def test_ratio_and_value_at_the_start():
    pressure, volume = 60.0 + 50.0 * np.sin(TURN), 100.0 + 30.0 * np.cos(TURN)
    result = measures(p=pressure, v=volume)
    assert result.largest_ratio("p", "v") == pytest.approx(np.max(pressure / volume), rel=1e-12)
    assert result.at_start("p") == pytest.approx(60.0, abs=1e-9)


def test_a_batch_is_measured_like_each_alone():
    rng = np.random.default_rng(2)
    waves = [
        80 + 20 * np.sin(TURN + rng.uniform(0, 6)) + 5 * np.sin(2 * TURN + rng.uniform(0, 6))
        for _ in range(6)
    ]
    together = Measures({"p": np.stack(waves, axis=1), "v": np.stack(waves[::-1], axis=1)}, PHASES)
    for k in range(6):
        single = Measures({"p": waves[k], "v": waves[5 - k]}, PHASES)
        for ask in ("mean", "maximum", "minimum", "at_start"):
            assert getattr(together, ask)("p")[k] == pytest.approx(getattr(single, ask)("p"), rel=1e-13)
        for ask in ("loop_area", "largest_ratio"):
            assert getattr(together, ask)("p", "v")[k] == pytest.approx(
                getattr(single, ask)("p", "v"), rel=1e-10
            )


def test_forward_and_backward_flow_are_means_of_what_goes_either_way():
    flow = 50.0 * np.sin(TURN) + 10.0
    result = measures(Qcannula=np.stack([flow, np.full_like(flow, -20.0)], axis=1))
    share = np.arcsin(0.2) / (2.0 * np.pi) + 0.25  # of half a beat, with flow ahead
    ahead = 2.0 * share * 10.0 + 50.0 / np.pi * np.sqrt(1.0 - 0.04)
    assert result.forward("cannula") == pytest.approx([0.06 * ahead, 0.0], rel=2e-4)
    assert result.backward("cannula")[1] == pytest.approx(1.2, rel=1e-12)
    net = result.forward("cannula") - result.backward("cannula")
    np.testing.assert_allclose(net, 0.06 * result.mean("Qcannula"), rtol=1e-12)


@pytest.mark.parametrize("offset", [-90.0, 0.0, 90.0])
def test_which_sums_derivatives_need_does_not_depend_on_the_direction_of_flow(offset):
    """The beat with tangents is compiled for a list of sums: a valve that leaks must not ask for another."""
    linear = LinearMeasures({"Qy": 50.0 * np.sin(TURN) + offset}, PHASES)
    flows = linear.forward("y"), linear.backward("y")
    assert sorted(linear.sums) == [("Qy", 0), ("Qy", 1)]
    assert (flows[0] - flows[1]).value == pytest.approx(0.06 * linear.mean("Qy").value, abs=1e-12)


def _quotient(numbers):
    return jnp.stack([numbers[0] / numbers[1], jnp.exp(-numbers[2])])


def test_a_law_is_applied_to_measures_and_parameters_with_its_derivatives():
    waves = {"Px": 90.0 + 10.0 * np.sin(TURN), "Qy": 30.0 + np.cos(TURN)}

    def computed(kind, shift=0.0, dose=0.3):
        m = kind({**waves, "Px": waves["Px"] + shift}, PHASES, None, {"dose": dose})
        return m, m.apply(_quotient, [m.mean("Px"), m.forward("y"), m.parameter("dose")])

    _, plain = computed(Measures)
    linear, duals = computed(LinearMeasures)
    assert [d.value for d in duals] == pytest.approx([float(v) for v in plain], rel=1e-14)
    step = 1e-4
    high, low = (float(computed(Measures, shift=s)[1][0]) for s in (step, -step))
    slopes = linear.slopes(duals, [*linear.sums, "dose"])
    by_pressure = sum(
        slope * linear.sums[key].sum()
        for key, slope in zip(linear.sums, slopes[0, :-1], strict=True)
        if key[0] == "Px"
    )
    assert by_pressure == pytest.approx((high - low) / (2.0 * step), rel=1e-6)
    assert slopes[1, -1] == pytest.approx(-np.exp(-0.3), rel=1e-14)


def test_a_law_of_what_a_law_gave_follows_the_chain_rule():
    m = LinearMeasures({"Px": 90.0 + 10.0 * np.sin(TURN)}, PHASES, None, {"dose": 0.3})
    first = m.apply(_quotient, [m.mean("Px"), 2.0, m.parameter("dose")])
    second = m.apply(_quotient, [first[0], 2.0 * first[1], 1.0 - m.parameter("dose")])
    # d/d(dose) of (x / 2) / (2 exp(-dose)) is itself, that of exp(-(1 - dose)) too.
    slopes = m.slopes(second, ["dose", *m.sums])
    assert slopes[:, 0] == pytest.approx([d.value for d in second], rel=1e-12)
    assert slopes[:, 1] == pytest.approx([second[0].value / m.mean("Px").value, 0.0], rel=1e-12)


def test_laws_of_a_large_batch_are_those_of_each_alone():
    doses, pressures = np.linspace(0.0, 2.0, 37), np.linspace(60.0, 100.0, 37)
    few, many = (
        Measures({}, PHASES, batch=count).apply(_quotient, [pressures, 2.0, doses]) for count in (37, 4000)
    )
    for alone, together, exact in zip(few, many, (pressures / 2.0, np.exp(-doses)), strict=True):
        assert alone == pytest.approx(exact, rel=1e-14)
        assert together == pytest.approx(exact, rel=1e-14)
