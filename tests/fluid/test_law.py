"""The law of fluid on its own: rest, closed forms, doors and balances."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from eclsim.components.exchangers import HAEMOGLOBIN
from eclsim.fluid import law as fluid
from eclsim.fluid.law import FluidLaw
from eclsim.fluid.starling import (
    ALBUMIN_EQUIVALENT,
    DEHYDRATED_PER_MMHG,
    EXCLUDED_SHARE,
    LYMPH_PER_MMHG,
    OEDEMA_MMHG,
    Spaces,
    Wall,
    capillary_pressure,
    convected_and_mixed,
    exchange,
    forces,
    interstitial_pressure,
    oncotic_pressure,
    relative_flow,
)
from eclsim.parameters.fluid import HAEMATOCRIT, INTERSTITIUM_TO_BLOOD, PARAMETERS
from eclsim.parameters.regulation import EXTRA_VOLUME
from eclsim.slow import INFLOWS

NEAR = fluid.PERICAPILLARY_PROTEIN.name
LAW = FluidLaw(ultrafiltration=("uf",), haematocrits=("crrt.haematocrit_in",), gas=True)
BEAT = {"MAP": 80.0, "venous_pressure": 6.0, "systemic_resistance_factor": 1.0}


def settings(**changes):
    values = {key: one.value for key, one in PARAMETERS.items()} | {
        "total_blood_volume_ml": 5200.0, EXTRA_VOLUME: -150.0, "Rmc": 0.5, "uf": 0.0, HAEMOGLOBIN: 10.0,
        "crrt.haematocrit_in": 0.28,
    }  # fmt: skip
    return arrays(values | {f"fluid.{k}" if k != "uf" else k: v for k, v in changes.items()})


def arrays(values):
    return {key: np.array([value]) for key, value in values.items()}


def rates(states, values, beat=None, law=LAW, **inflows):
    return law.rates(
        states, values, arrays(BEAT | (beat or {})), arrays(dict.fromkeys(INFLOWS, 0.0) | inflows)
    )


def course(values, minutes, step_s=15.0, beat=None, law=LAW, **inflows):
    """States along the classical Runge-Kutta method at steady pressures."""
    states = law.start(values, arrays(BEAT))
    for _ in range(round(60 * minutes / step_s)):
        slopes = [rates(states, values, beat, law, **inflows)]
        for part in (0.5, 0.5, 1.0):
            moved = {k: states[k] + part * step_s * slopes[-1][k] for k in states}
            slopes.append(rates(moved, values, beat, law, **inflows))
        a, b, c, d = slopes
        states = {k: x + step_s / 6.0 * (a[k] + 2.0 * b[k] + 2.0 * c[k] + d[k]) for k, x in states.items()}
    return states


@pytest.fixture
def spaces():
    plasma, interstitium = np.array([3500.0]), np.array([13500.0])
    room = interstitium - EXCLUDED_SHARE * interstitium
    return Spaces(plasma, interstitium, 0.06 * plasma, 0.024 * room, interstitium)


WALL = Wall(*(np.array([x]) for x in (10.0, 0.9, 2.0)))


def test_nothing_moves_at_the_start_and_what_is_set_is_the_cases_own_to_the_bit():
    values = settings()
    states = LAW.start(values, arrays(BEAT))
    assert set(states) == {state.name for state in LAW.states}
    for name, rate in rates(states, values).items():
        assert abs(rate).max() < 1e-15, name
    effect = LAW.in_effect(states, values)
    assert {key: effect[key] for key in effect} == {key: values[key] for key in effect}
    assert set(effect) == {EXTRA_VOLUME, HAEMATOCRIT, HAEMOGLOBIN, "crrt.haematocrit_in"}


def test_oncotic_pressure_is_that_of_landis_and_pappenheimer():
    np.testing.assert_allclose(
        oncotic_pressure(np.array([0.0, 7.0])), [0.0, 2.1 * 7 + 0.16 * 49 + 0.009 * 343]
    )


def test_five_per_cent_albumin_draws_what_albumin_draws_and_so_does_what_is_added_to_plasma():
    """Landis and Pappenheimer: albumin alone; with globulin, each in proportion to its share."""

    def albumin(c):
        return c * (2.8 + c * (0.18 + 0.012 * c))

    def globulin(c):
        return c * (1.6 + c * (0.15 + 0.006 * c))

    assert oncotic_pressure(100.0 * fluid.ALBUMIN_G_ML) == pytest.approx(albumin(5.0), abs=0.1)

    def mixed(a, g):
        return (a * albumin(a + g) + g * globulin(a + g)) / (a + g)

    for total in (5.0, 6.0, 7.0):
        half, step = 0.5 * total, 1e-4
        added = (mixed(half + step, half) - mixed(half, half)) / step
        of_plasma = (oncotic_pressure(total + step) - oncotic_pressure(total)) / step
        assert added / of_plasma == pytest.approx(ALBUMIN_EQUIVALENT, abs=0.02)


def test_interstitium_stiffens_below_and_gives_way_above_its_normal_volume():
    normal, step = np.array(10000.0), 1e-3
    below, above = (
        (interstitial_pressure(normal * (1 + d), normal) / d).item() for d in (-step, step)
    )  # the same slope on both sides
    assert below == pytest.approx(above, rel=0.01)
    swollen = interstitial_pressure(normal * np.array([1.5, 2.0]), normal)
    assert 2.0 < swollen[0] < swollen[1] < 2.61


def test_constricted_arterioles_lower_the_pressure_of_capillaries():
    wide, tight = (capillary_pressure(np.array(90.0), np.array(5.0), np.array(tone)) for tone in (1.0, 2.0))
    assert wide == pytest.approx(5.0 + 0.15 * 85.0)
    assert tight < wide


def test_venules_that_follow_keep_their_share_of_the_pressure():
    before = capillary_pressure(np.array(60.0), np.array(5.0), np.array(1.0))
    alike = capillary_pressure(np.array(90.0), np.array(5.0), np.array(1.8), np.array(1.8))
    assert before == pytest.approx(5.0 + 0.15 * 55.0)
    assert alike == pytest.approx(5.0 + 0.15 * 85.0)


def test_forces_are_none_at_the_start_and_drive_what_crosses(spaces):
    np.testing.assert_array_equal(np.array(forces(spaces, spaces, np.zeros(1))), 0.0)
    now = spaces._replace(plasma=spaces.plasma - 200.0, interstitium=spaces.interstitium - 500.0)
    rise = np.array([-1.5])
    capillary, swollen, drawn, drawn_out = forces(now, spaces, rise)
    assert capillary == rise
    assert drawn > 0.0
    assert drawn_out > 0.0
    assert swollen < 0.0
    driven = WALL.filtration * (rise - swollen - WALL.reflection * (drawn - drawn_out))
    lymph_less = WALL.lymph * np.expm1(LYMPH_PER_MMHG * swollen)
    np.testing.assert_allclose(exchange(now, spaces, rise, WALL).fluid, driven - lymph_less)


def test_protein_crosses_by_the_equation_of_kedem_and_katchalsky_and_lymph_brings_it_back(spaces):
    now = spaces._replace(plasma_protein=spaces.plasma_protein * 1.1)
    (inside, outside), (inside_0, outside_0) = now.concentrations, spaces.concentrations
    wall = WALL._replace(reflection=np.array([0.7]))
    held = 0.7 * (oncotic_pressure(inside) - oncotic_pressure(inside_0))
    filtered = 2.0 - 10.0 * held
    ps = (2.0 * outside_0 - 0.3 * 2.0 * (inside_0 + outside_0) / 2.0) / (inside_0 - outside_0)  # mL/min
    diffused = ps * (inside - outside)
    moved = 0.3 * filtered * (inside + outside) / 2.0 + diffused - 2.0 * outside
    crossed = exchange(now, spaces, np.zeros(1), wall)
    np.testing.assert_allclose(crossed.protein, moved / 100.0)
    np.testing.assert_allclose(crossed.fluid, filtered - 2.0)


def test_lymphatics_that_pump_twice_as_hard_bring_back_twice_the_water_and_protein():
    values, harder = settings(), settings(lymph_pump=2.0)
    states = LAW.start(values, arrays(BEAT))
    usual, more = (rates(states, one) for one in (values, harder))
    lymph = values["fluid.lymph_ml_min"].item()
    back = 60.0 * (usual[fluid.INTERSTITIUM] - more[fluid.INTERSTITIUM])
    np.testing.assert_allclose(back, lymph)
    protein = 60.0 * (usual[fluid.INTERSTITIAL_PROTEIN] - more[fluid.INTERSTITIAL_PROTEIN])
    np.testing.assert_allclose(protein, 0.01 * lymph * values["fluid.interstitial_protein_g_dl"])
    assert more[fluid.PROTEIN] == -more[fluid.INTERSTITIAL_PROTEIN]


LAYERED = replace(LAW, has_pericapillary_layer=True)


def test_what_is_next_to_capillaries_is_in_balance_at_the_start():
    values = settings(pericapillary_share=0.12)
    states = LAYERED.start(values, arrays(BEAT))
    assert states[NEAR] == pytest.approx(0.12 * states[fluid.INTERSTITIAL_PROTEIN])
    assert max(abs(rate).max() for rate in rates(states, values, law=LAYERED).values()) < 1e-15


def test_a_share_of_all_of_the_interstitium_is_the_interstitium_that_is_one():
    """In a batch whose other members have a smaller share."""
    fallen = {"MAP": 70.0, "venous_pressure": 4.0}
    whole, layered = (course(settings(), 60.0, beat=fallen, law=law) for law in (LAW, LAYERED))
    for name, value in whole.items():
        assert layered[name] == value, name


@pytest.mark.slow
def test_protein_thickened_by_what_comes_back_holds_back_the_rest():
    values = {share: settings(pericapillary_share=share, lymph_ml_min=2.0) for share in (0.12, 1.0)}
    fallen = {"MAP": 70.0, "venous_pressure": 3.0}
    start = LAYERED.start(values[0.12], arrays(BEAT))
    at_once = [rates(start, one, fallen, LAYERED)[fluid.REFILLED] for one in values.values()]
    np.testing.assert_allclose(*at_once)
    early, late = (
        [course(one, minutes, 5.0, fallen, LAYERED)[fluid.REFILLED].item() for one in values.values()]
        for minutes in (2.0, 120.0)
    )
    assert 0.85 < early[0] / early[1] < 1.0
    assert 0.3 < late[0] / late[1] < 0.7


@pytest.mark.slow
def test_what_leaves_next_to_capillaries_arrives_in_the_rest_and_protein_balances():
    values = settings(pericapillary_share=0.12, uf=300.0)
    start = LAYERED.start(values, arrays(BEAT))
    end = course(values, 240.0, law=LAYERED)
    assert end[fluid.PROTEIN] + end[fluid.INTERSTITIAL_PROTEIN] == pytest.approx(
        start[fluid.PROTEIN] + start[fluid.INTERSTITIAL_PROTEIN], abs=1e-9
    )
    assert 0.12 * end[fluid.INTERSTITIAL_PROTEIN] < end[NEAR] < end[fluid.INTERSTITIAL_PROTEIN]


def test_where_filtration_holds_on_what_is_next_to_capillaries_is_as_thin_as_what_crosses_the_wall():
    """Closed form: where flow carries all, a concentration is protein over the water that goes on."""
    values = settings(pericapillary_share=0.2, lymph_ml_min=4.0)
    raised = {"MAP": 80.0, "venous_pressure": 20.0}
    states = LAYERED.start(values, arrays(BEAT))

    def gains(protein):
        return rates({**states, NEAR: np.array([protein])}, values, raised, LAYERED)[NEAR].item()

    settled = brentq(gains, 1e-6, states[NEAR].item(), xtol=1e-12)
    change = rates({**states, NEAR: np.array([settled])}, values, raised, LAYERED)
    normal = INTERSTITIUM_TO_BLOOD * values["total_blood_volume_ml"].item()
    room = states[fluid.INTERSTITIUM].item() - EXCLUDED_SHARE * normal
    lymph = 4.0 * (states[fluid.INTERSTITIAL_PROTEIN].item() - settled) / (0.8 * room)  # g/min
    crosses = 60.0 * change[fluid.INTERSTITIAL_PROTEIN].item() + lymph
    onward = 4.0 + (1.0 - 0.2) * 60.0 * change[fluid.INTERSTITIUM].item()  # mL/min
    near = 100.0 * settled / (0.2 * room)
    assert near == pytest.approx(100.0 * crosses / onward, rel=1e-6)
    assert near < 0.5 * values["fluid.interstitial_protein_g_dl"]


def test_flow_carries_downstream_and_mixing_evens_out():
    up, down = np.array(3.0), np.array(2.0)
    for peclet, expected in ((1e4, 3e4), (-1e4, -2e4), (0.0, 1.0)):
        assert convected_and_mixed(np.array(peclet), up, down) == pytest.approx(expected)
    around = convected_and_mixed(np.array([-1.01e-3, -0.99e-3, 0.99e-3, 1.01e-3]), up, down)
    np.testing.assert_allclose(np.diff(around), [5e-5, 4.95e-3, 5e-5], rtol=1e-3)


def test_lymph_of_a_dry_interstitium_fades_and_goes_on(spaces):
    """A closed form at 0.7 of the volume, where the straight line of the model of Xie is below 0."""
    now = spaces._replace(interstitium=0.7 * spaces.interstitium)
    _, swollen, drawn, drawn_out = forces(now, spaces, np.zeros(1))
    assert 1.0 + LYMPH_PER_MMHG * swollen < 0.0
    filtered = 2.0 + 10.0 * (-swollen - 0.9 * (drawn - drawn_out))
    lymph = 2.0 * np.exp(LYMPH_PER_MMHG * swollen)
    np.testing.assert_allclose(exchange(now, spaces, np.zeros(1), WALL).fluid, filtered - lymph)


def test_flow_has_one_slope_at_rest_rises_in_proportion_and_never_stops():
    np.testing.assert_allclose(relative_flow(np.array([-1e-6, 0.0, 1e-6, 2.0])), [1 - 1e-6, 1, 1 + 1e-6, 3])
    assert 0.0 < relative_flow(np.array(-30.0)) < 1e-12


@pytest.mark.parametrize(("rise", "pressed"), [(5.0, 1.25), (-5.0, np.exp(-0.25))])
def test_protein_leaks_by_the_pressure_across_the_wall(spaces, rise, pressed):
    """What diffuses at rest, by a quarter of the pressure of large pores more or less; drag is as it was."""
    wall = WALL._replace(reflection=np.array(1.0))
    leak_at_rest = 0.02 * spaces.concentrations[1]
    crossed = exchange(spaces, spaces, np.array([rise]), wall).protein
    np.testing.assert_allclose(crossed, leak_at_rest * (pressed - 1.0))


def test_constants_are_those_of_the_model_of_xie():
    assert pytest.approx(510.0 / 8400.0, rel=1e-3) == DEHYDRATED_PER_MMHG
    assert pytest.approx(43.0 / 120.0, rel=5e-3) == LYMPH_PER_MMHG
    np.testing.assert_allclose((OEDEMA_MMHG, EXCLUDED_SHARE), (2.6, 0.25))


def relaxation_time(rest, wall):
    """Time constant [min] of refill after a small change of capillary pressure, protein staying in place.

    1 / (LpS (dPi/dVi + sigma (d pi_p/dVp + d pi_i/dVi)) + dL/dVi), derivatives at the start.
    """

    def slope(protein, volume):
        return (2.1 + protein * (0.32 + 0.027 * protein)) * protein / volume

    inside, outside = rest.concentrations
    over = np.maximum(rest.interstitium / rest.normal - 1.0, 0.0) / DEHYDRATED_PER_MMHG / OEDEMA_MMHG
    stiffness = np.exp(-over) / (DEHYDRATED_PER_MMHG * rest.normal)
    room = rest.interstitium - EXCLUDED_SHARE * rest.normal
    drawn = wall.reflection * (slope(inside, rest.plasma) + slope(outside, room))
    return 1.0 / (wall.filtration * (stiffness + drawn) + wall.lymph * LYMPH_PER_MMHG * stiffness)


def test_refill_relaxes_with_the_time_constant_of_its_linear_form(spaces):
    """Closed form against the slope of the law itself."""

    def out(volume):
        now = spaces._replace(plasma=spaces.plasma - volume, interstitium=spaces.interstitium + volume)
        return exchange(now, spaces, np.zeros(1), WALL).fluid

    slope = (out(1.0) - out(-1.0)) / 2.0  # fluid that leaves for each mL that has left
    np.testing.assert_allclose(-1.0 / slope, relaxation_time(spaces, WALL), rtol=1e-4)
    assert out(0.0) == 0.0


@pytest.mark.slow
def test_fluid_given_divides_so_that_what_drives_it_out_carries_its_flow():
    """At steady pressures, without lymph and with a wall tight to protein: a closed form for slow giving."""
    values = settings(lymph_ml_min=1e-9, reflection=1.0)
    start, end = LAW.start(values, arrays(BEAT)), course(values, 240.0, crystalloid_ml=0.01)
    gained = {name: end[name] - start[name] for name in (fluid.PLASMA, fluid.INTERSTITIUM)}
    normal = INTERSTITIUM_TO_BLOOD * values["total_blood_volume_ml"]

    def outward(states):
        room = states[fluid.INTERSTITIUM] - EXCLUDED_SHARE * normal
        inside = oncotic_pressure(100.0 * start[fluid.PROTEIN] / states[fluid.PLASMA])
        outside = oncotic_pressure(100.0 * start[fluid.INTERSTITIAL_PROTEIN] / room)
        return outside - inside - interstitial_pressure(states[fluid.INTERSTITIUM], normal)

    assert sum(gained.values()) == pytest.approx(144.0, abs=1e-9)
    flow = values["fluid.filtration_ml_min_mmHg"] * (outward(end) - outward(start))
    assert flow == pytest.approx(0.6 * gained[fluid.INTERSTITIUM] / 144.0, rel=0.15)
    assert flow == pytest.approx(60.0 * rates(end, values, crystalloid_ml=0.01)[fluid.INTERSTITIUM])


def test_bleeding_is_refilled_and_blood_thins():
    values = settings()
    start = LAW.start(values, arrays(BEAT))
    fallen = {"MAP": 70.0, "venous_pressure": 4.0, "systemic_resistance_factor": 1.2}
    end = course(values, 20.0, beat=fallen, bleed_ml=1000.0 / 1200.0)
    assert end[fluid.REMOVED] == pytest.approx(1000.0)
    assert 200.0 < end[fluid.REFILLED].item() < 800.0
    thinned = LAW.in_effect(end, values)
    assert (thinned[HAEMATOCRIT] < values[HAEMATOCRIT]).all()
    assert thinned[HAEMOGLOBIN] / 10.0 == pytest.approx(thinned["crrt.haematocrit_in"] / 0.28)
    dry = course(settings(capillary_refill=0.0), 20.0, beat=fallen, bleed_ml=1000.0 / 1200.0)
    assert dry[fluid.REFILLED] == 0.0
    assert dry[fluid.RED_CELLS] < start[fluid.RED_CELLS]


@pytest.mark.parametrize(
    "inflows",
    [
        {"crystalloid_ml": 0.3}, {"albumin_ml": 0.2}, {"red_cells_ml": 0.2}, {"blood_ml": 0.3},
        {"bleed_ml": 0.3, "crystalloid_ml": 0.5, "red_cells_ml": 0.1},
    ],
)  # fmt: skip
def test_fluid_red_cells_and_protein_balance(inflows):
    values = settings(uf=200.0)
    start, end = LAW.start(values, arrays(BEAT)), course(values, 60.0, 60.0, **inflows)
    gained = {name: (end[name] - start[name]).item() for name in start}
    blood = gained[fluid.PLASMA] + gained[fluid.RED_CELLS]
    assert blood == pytest.approx(
        gained[fluid.GIVEN] - gained[fluid.REMOVED] + gained[fluid.REFILLED], abs=1e-6
    )
    assert gained[fluid.INTERSTITIUM] == pytest.approx(-gained[fluid.REFILLED], abs=1e-6)
    assert gained[fluid.RED_CELLS] == pytest.approx(gained[fluid.RED_CELLS_GIVEN], abs=1e-6)
    protein = gained[fluid.PROTEIN] + gained[fluid.INTERSTITIAL_PROTEIN]
    assert protein == pytest.approx(gained[fluid.PROTEIN_GIVEN], abs=1e-9)
    expected = 3600.0 * sum(v for k, v in inflows.items() if k != "bleed_ml")
    assert gained[fluid.GIVEN] == pytest.approx(expected)
    assert gained[fluid.REMOVED] == pytest.approx(200.0 + 3600.0 * inflows.get("bleed_ml", 0.0))


def test_giving_back_what_was_bled_at_the_same_time_changes_nothing():
    values = settings(capillary_refill=0.0)
    end, start = course(values, 30.0, blood_ml=0.5, bleed_ml=0.5), LAW.start(values, arrays(BEAT))
    for name in (fluid.PLASMA, fluid.RED_CELLS, fluid.PROTEIN):
        assert end[name] == pytest.approx(start[name], abs=1e-9)
