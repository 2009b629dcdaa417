"""Gases of blood against published tables, between both sets of equations, and there and back."""

import re

import jax
import numpy as np
import pytest

from eclsim import blood
from eclsim.blood import BloodGases, checks, dash2016, standard
from eclsim.blood.gases import _at_pressures
from eclsim.blood.types import Blood

PO2 = np.array([20, 26.8, 30, 40, 50, 60, 70, 80, 90, 100, 150, 300.0])
SEVERINGHAUS = [31.98, 49.86, 57.38, 74.95, 84.99, 90.58, 93.79, 95.73, 96.94, 97.75, 99.32, 99.91]
DASH = [32.09, 49.93, 57.45, 74.99, 84.92, 90.42, 93.59, 95.51, 96.73, 97.55, 99.20, 99.88]
# PCO2, pH, saturation, haemoglobin, content after Douglas 1988
DOUGLAS = [
    (40, 7.40, 0.975, 15, 46.71), (46, 7.37, 0.73, 15, 51.09), (46, 7.37, 0.75, 10, 54.96),
    (40, 7.40, 0.975, 10, 50.62), (30, 7.50, 1.0, 10, 46.61), (60, 7.25, 0.60, 10, 55.82),
]  # fmt: skip
GRID = {"po2": np.geomspace(1, 700, 19)[:, None], "pco2": np.geomspace(5, 200, 9)}
CORNERS = ("po2", "pco2", "haemoglobin", "base_excess", "temperature")
ANAEMIC = {"haemoglobin": 8.0, "base_excess": -6.0, "temperature": 35.0}


def test_saturations_are_those_of_the_tables():
    np.testing.assert_allclose(100 * standard.severinghaus(PO2), SEVERINGHAUS, atol=0.005)
    np.testing.assert_allclose(100 * dash2016.saturation(PO2, 40.0, 7.40, Blood()), DASH, atol=0.005)


@pytest.mark.parametrize(
    ("ph", "pco2", "temperature"), [(7.2, 40.0, 37.0), (7.4, 60.0, 37.0), (7.4, 40.0, 40.0)]
)
def test_the_curve_is_shifted_as_kelman_measured(ph, pco2, temperature):
    factor = 10.0 ** (0.40 * (ph - 7.4) + 0.06 * np.log10(40.0 / pco2) + 0.024 * (37.0 - temperature))
    there = standard.saturation(26.8 / factor, pco2, ph, Blood(temperature=temperature))
    assert float(there) == pytest.approx(float(standard.saturation(26.8, 40.0, 7.4, Blood())), rel=1e-12)


@pytest.mark.parametrize(
    ("pco2", "cell_ph", "temperature", "shift"),
    [
        (40.0, 7.04, 37.0, 1.2 * (21.279 * 0.2 + 8.872 * 0.04 + 1.47 * 0.008)),
        (60.0, 7.24, 37.0, 1.7 * (0.0428 * 20.0 + 3.64e-5 * 400.0)),
        (40.0, 7.24, 40.0, 0.98 * (1.4945 * 3.0 + 0.04335 * 9.0 + 7e-4 * 27.0)),
        (40.0, 7.24, 27.0, 0.98 * (-1.4945 * 10.0 + 0.04335 * 100.0 - 7e-4 * 1000.0)),
    ],
)
def test_half_saturation_is_shifted_by_one_cause_as_dash_printed(pco2, cell_ph, temperature, shift):
    half = dash2016.half_saturation(pco2, cell_ph, Blood(temperature=temperature))
    assert float(half) == pytest.approx(26.8 + shift, rel=1e-12)


def test_oxygen_dissolves_more_in_cold_blood():
    def dissolved(temperature):
        high, higher = (
            float(dash2016.held(po2, 40.0, 7.4, Blood(temperature=temperature)).oxygen) for po2 in (1e5, 2e5)
        )
        return higher - high

    water = 0.55 * 0.94 + 0.45 * 0.65
    assert dissolved(37.0) == pytest.approx(2240.0 * 1.46e-6 * 1e5 * water, rel=1e-5)
    assert dissolved(27.0) / dissolved(37.0) == pytest.approx(1.0 + 0.1 + 0.04234, rel=1e-5)


def test_contents_after_dash_are_those_of_its_authors():
    arterial = (100.0, 40.0, 7.40, Blood())
    venous = (40.0, 46.0, 7.37, Blood())
    assert dash2016.held(*arterial).oxygen == pytest.approx(20.72, abs=0.005)
    assert dash2016.held(*arterial).carbon_dioxide == pytest.approx(43.43, abs=0.005)
    assert dash2016.saturation(*venous) == pytest.approx(0.726, abs=5e-4)
    assert dash2016.held(*venous).oxygen == pytest.approx(15.33, abs=0.005)
    assert dash2016.held(*venous).carbon_dioxide == pytest.approx(47.20, abs=0.005)
    assert dash2016.half_saturation(46.0, 7.37 + np.log10(0.69), Blood()) == pytest.approx(28.06, abs=0.005)


@pytest.mark.parametrize(("pco2", "ph", "saturation", "haemoglobin", "content"), DOUGLAS)
def test_carbon_dioxide_after_douglas(pco2, ph, saturation, haemoglobin, content):
    result = standard.carbon_dioxide_content(pco2, ph, saturation, Blood(haemoglobin))
    assert result == pytest.approx(content, abs=0.005)


def test_ph_and_contents_of_healthy_blood():
    arterial, venous = blood.gases(po2=100.0), blood.gases(po2=40.0, pco2=46.0)
    assert (round(float(arterial.ph), 3), round(float(venous.ph), 3)) == (7.401, 7.373)
    assert arterial.carbon_dioxide == pytest.approx(46.79, abs=0.005)
    assert venous.carbon_dioxide == pytest.approx(51.36, abs=0.005)


@pytest.mark.slow
def test_both_sets_of_equations_agree_within_their_errors():
    one, other = (blood.gases(po2=PO2, law=law) for law in blood.LAWS)
    assert np.abs(one.saturation - other.saturation).max() < 0.007
    here, there = (blood.gases(po2=100.0, law=law) for law in blood.LAWS)
    assert here.oxygen == pytest.approx(float(there.oxygen), rel=0.04)  # 1.34 against 1.39 mL/g


@pytest.mark.slow
@pytest.mark.parametrize("law", blood.LAWS)
def test_contents_lead_back_to_the_pressures(law):
    there = blood.gases(**GRID, **ANAEMIC, law=law)
    back = blood.gases_with_contents(
        oxygen=there.oxygen, carbon_dioxide=there.carbon_dioxide, **ANAEMIC, law=law
    )
    np.testing.assert_allclose(back.po2, there.po2, rtol=1e-11)
    np.testing.assert_allclose(back.pco2, there.pco2, rtol=1e-11)


@pytest.mark.parametrize("law", blood.LAWS)
def test_a_saturation_leads_back_to_the_pressure(law):
    there = blood.gases(**GRID, **ANAEMIC, law=law)
    back = blood.gases_with_saturation(saturation=there.saturation, pco2=there.pco2, **ANAEMIC, law=law)
    np.testing.assert_allclose(back.po2, there.po2, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("law", blood.LAWS)
def test_derivatives_are_those_of_differences(law):
    outputs = ("ph", "saturation", "oxygen", "carbon_dioxide", "bicarbonate")
    at = {"po2": 41.0, "pco2": 46.0, "haemoglobin": 9.0, "base_excess": -3.0, "temperature": 36.0}

    def values(at):
        return {output: getattr(blood.gases(**at, law=law), output) for output in outputs}

    step, slopes = 1e-4, jax.jacrev(values)(at)
    for key, value in at.items():
        high, low = (values(at | {key: value + s}) for s in (step, -step))
        for output in outputs:
            difference = float((high[output] - low[output]) / (2 * step))
            assert slopes[output][key] == pytest.approx(difference, rel=1e-6, abs=1e-9), (output, key)


@pytest.mark.slow
def test_derivatives_of_the_inverse_are_those_of_differences():
    def po2(oxygen):
        return blood.gases_with_contents(oxygen=oxygen, carbon_dioxide=50.0, haemoglobin=10.0).po2

    difference = (po2(10.0 + 1e-4) - po2(10.0 - 1e-4)) / 2e-4
    assert jax.grad(po2)(10.0) == pytest.approx(float(difference), rel=1e-7)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"oxygen": [12.0, -1.0]}, "oxygen = -1; allowed: 0 to 80 mL/dL (200 mL/L are 20 mL/dL, 9 mmol/L"),
        ({"oxygen": 200.0, "carbon_dioxide": 480.0}, "oxygen = 200; allowed: 0 to 80 mL/dL"),
        ({"oxygen": 15.0, "haemoglobin": 3.0}, "haemoglobin = 3, base_excess = 0: po2 would be 35"),
        ({"carbon_dioxide": 480.0}, "mmHg (480 mL/L are 48 mL/dL, 22 mmol/L are 49 mL/dL)"),
        ({"carbon_dioxide": 0.0}, "no partial pressures give them"),
    ],
)
def test_contents_that_no_blood_has_are_refused(given, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        blood.gases_with_contents(**{"oxygen": 12.0, "carbon_dioxide": 50.0, **given})


@pytest.mark.slow
def test_traced_contents_are_not_judged():
    none = jax.jit(blood.gases_with_contents)(oxygen=np.array([-1.0, 12.0]), carbon_dioxide=50.0)
    assert np.isnan(none.po2[0])
    assert np.isfinite(none.po2[1])


@pytest.mark.parametrize("law", blood.LAWS)
def test_blood_without_oxygen_has_none_at_its_carbon_dioxide(law):
    there = blood.gases(po2=[0.0, 40.0], pco2=46.0, law=law)
    back = blood.gases_with_contents(oxygen=there.oxygen, carbon_dioxide=there.carbon_dioxide, law=law)
    assert float(back.po2[0]) == 0.0
    assert float(back.oxygen[0]) == 0.0
    np.testing.assert_allclose(back.pco2, 46.0, rtol=1e-9)


@pytest.mark.parametrize("law", blood.LAWS)
def test_allowed_values_give_blood_or_say_that_they_do_not(law):
    """Bounds of single values; corners of them together have a pH that no search finds, or no blood has."""
    bounds = {name: checks.ALLOWED_BY_LAW.get(law, {}).get(name, checks.ALLOWED[name]) for name in CORNERS}
    draws = np.random.default_rng(7).uniform(size=(len(CORNERS), 2000))
    at = {n: b.low + (b.high - b.low) * u**3 for (n, b), u in zip(bounds.items(), draws, strict=True)}
    found = _at_pressures(at["po2"], at["pco2"], Blood(**{n: at[n] for n in CORNERS[2:]}), law)
    refused = 0
    for k in range(len(found.ph)):
        one = BloodGases(*(np.asarray(value)[k] for value in found))
        own = {name: value[k] for name, value in at.items()}
        try:
            checks.refuse_results(
                one, {n: own[n] for n in CORNERS[:2]}, Blood(**{n: own[n] for n in CORNERS[2:]})
            )
        except ValueError:
            refused += 1
        else:
            assert np.isfinite(one).all(), own
            assert min(one.oxygen, one.carbon_dioxide) > -1e-9, own
    assert 0 < refused < 1500


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"po2": 95.0, "pco2": 0.0}, "pco2 = 0; allowed: 0.01 to 1000 mmHg"),
        ({"po2": 95.0, "temperature": 4.0, "law": "dash2016"}, "temperature = 4; allowed: 10 to 50 C"),
        (
            {"po2": 1436.0, "pco2": 0.98, "base_excess": 83.0},
            "base_excess = 83: no blood; allowed: values that",
        ),
        ({"po2": 95.0, "ph": 9.0, "pco2": 900.0}, "the base excess would be"),
        ({"po2": 95.0, "ph": 7.4, "base_excess": 1.0}, "allowed: one of them"),
    ],
)
def test_what_the_laws_cannot_tell_is_refused(given, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        blood.gases(**given)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"hb": 10.0}, "blood.gases() has no argument 'hb'; allowed: po2, pco2, ph, law, haemoglobin"),
        ({"hb": 10.0}, "did you mean haemoglobin?"),
        ({"hemoglobin": 10.0}, "did you mean haemoglobin?"),
        ({"po2": None}, "po2 = None; allowed: a number"),
        ({"base_excess": None}, "base_excess = None; allowed: a number"),
        ({"po2": [95.0, None]}, "po2 = a list; allowed: a number"),
    ],
)
def test_an_argument_that_is_none_or_misspelt_is_named(given, said):
    with pytest.raises(TypeError, match=re.escape(said)):
        blood.gases(**{"po2": 95.0, **given})


def test_lists_are_arrays():
    both = blood.gases(po2=[95.0, 90.0], haemoglobin=[10.0, 12.0])
    assert float(both.oxygen[1]) == float(blood.gases(po2=90.0, haemoglobin=12.0).oxygen)


@pytest.mark.parametrize("law", blood.LAWS)
def test_a_measured_ph_stands_for_the_base_excess(law):
    arterial = blood.gases(po2=[95.0, 60.0], pco2=40.0, ph=7.3, haemoglobin=10.0, law=law)
    np.testing.assert_allclose(arterial.ph, 7.3, rtol=1e-12)
    excess = blood.base_excess(ph=7.3, saturation=arterial.saturation, haemoglobin=10.0)
    same = blood.gases(po2=[95.0, 60.0], base_excess=excess, haemoglobin=10.0, law=law)
    np.testing.assert_allclose(same.oxygen, arterial.oxygen, rtol=1e-12)
    half = blood.gases_with_saturation(saturation=0.5, ph=7.4, law=law)
    assert float(half.po2) == pytest.approx(26.8, abs=0.1)
    assert float(half.ph) == pytest.approx(7.4, abs=1e-12)


@pytest.mark.slow
def test_closed_blood_that_is_cooled_behaves_as_measured():
    """0.0147 in pH (Rosenthal 1948) and about 0.02 in log10 PCO2 for each degree."""
    warm = blood.gases(po2=100.0)
    cold = blood.gases_with_contents(oxygen=warm.oxygen, carbon_dioxide=warm.carbon_dioxide, temperature=30.0)
    assert (cold.ph - warm.ph) / 7 == pytest.approx(0.0147, abs=0.001)
    assert np.log10(warm.pco2 / cold.pco2) / 7 == pytest.approx(0.0195, abs=0.0015)


def test_oxygen_drives_carbon_dioxide_out():
    """Haldane: at one PCO2 deoxygenated blood holds more carbon dioxide, and is less acid."""
    full, empty = blood.gases(po2=500.0), blood.gases(po2=5.0)
    assert empty.carbon_dioxide - full.carbon_dioxide > 4.0
    assert empty.ph > full.ph


@pytest.mark.slow
def test_an_unknown_law_is_named():
    with pytest.raises(ValueError, match="'hill'; allowed: severinghaus1979, dash2016"):
        blood.gases(po2=90.0, law="hill")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {"po2": 90.0, "haemoglobin": 150.0},
            "= 150; allowed: 0 to 33 g/dL (150 g/L are 15 g/dL",
        ),
        (
            {"po2": 90.0, "temperature": 310.15},
            "= 310.15; allowed: 0 to 50 C (310.15 K are 37 C)",
        ),
        ({"po2": [90.0, -1.0]}, "po2 = -1; allowed: 0 to 3000 mmHg"),
        ({"po2": 90.0, "oxygen_capacity": 0.0134}, "oxygen_capacity = 0.0134"),
    ],
)
def test_values_in_another_unit_are_refused_with_the_one_meant(given, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        blood.gases(**given)


def test_all_values_in_another_unit_are_said_at_once_and_a_saturation_is_a_fraction():
    with pytest.raises(ValueError, match=r"95 % is 0\.95.*\n.*haemoglobin = 140"):
        blood.gases_with_saturation(saturation=95.0, haemoglobin=140.0)


def test_what_is_not_known_is_no_mistake_and_derivatives_pass():
    assert np.isnan(blood.gases(po2=np.nan).saturation)
    slope = jax.grad(lambda po2: blood.gases(po2=po2).saturation)(40.0)
    assert 0.0 < slope < 0.05


def test_diphosphoglycerate_moves_the_curve_of_dash_to_the_right():
    low, high = (float(blood.gases(po2=27.0, law="dash2016", dpg=dpg).saturation) for dpg in (3.0, 7.0))
    assert high < low - 0.05


@pytest.mark.slow
def test_little_carbon_dioxide_is_never_less_than_none():
    """The published factor for red cells has a pole at pH 8.142: contents were negative below 6 mmHg."""
    pressures = np.geomspace(0.05, 60.0, 60)
    for base_excess, haemoglobin in ((0.0, 15.0), (15.0, 15.0), (0.0, 25.0)):
        found = blood.gases(po2=300.0, pco2=pressures, base_excess=base_excess, haemoglobin=haemoglobin)
        assert (found.carbon_dioxide > 0.0).all()
        assert (np.diff(found.carbon_dioxide) > 0.0).all()
    alkalotic = blood.gases(po2=300.0, pco2=pressures, base_excess=15.0)
    back = blood.gases_with_contents(
        oxygen=alkalotic.oxygen, carbon_dioxide=alkalotic.carbon_dioxide, base_excess=15.0
    )
    np.testing.assert_allclose(back.pco2, pressures, rtol=1e-7)


def test_above_ph_7_6_contents_after_douglas_come_nearer_to_those_of_dash():
    pressures = np.array([5.0, 8.0, 12.0, 15.0])
    here, there = (
        np.asarray(blood.gases(po2=400.0, pco2=pressures, law=law).carbon_dioxide) for law in blood.LAWS
    )
    ph = np.asarray(blood.gases(po2=400.0, pco2=pressures).ph)
    plasma = here / (1.0 - 0.0289 * 15.0 / (3.352 - 0.456) * np.asarray(standard._term_of_ph(ph)))
    published = plasma * (1.0 - 0.0289 * 15.0 / ((3.352 - 0.456) * (8.142 - ph)))
    assert (np.abs(here - there) < np.abs(published - there)).all()
    below, above = (standard._term_of_ph(standard.DOUGLAS_PH + by) for by in (-1e-6, 1e-6))
    assert float(above - below) == pytest.approx(2e-6 / (8.142 - standard.DOUGLAS_PH) ** 2, rel=1e-4)


@pytest.mark.parametrize(("law", "given"), [("dash2016", "oxygen_capacity"), ("severinghaus1979", "dpg")])
def test_what_a_law_does_not_read_is_refused(law, given):
    with pytest.raises(ValueError, match=given):
        blood.gases(po2=90.0, law=law, **{given: 1.36})
