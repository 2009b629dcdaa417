"""The law of a hemofilter against its limits, a numerical solution along the fibres, and balances."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_bvp

from eclsim.components.dialysis import (
    Fluids,
    Hemofilter,
    Performance,
    Settings,
    Solute,
    _bernoulli,
    _log1p_ratio,
    clearance,
    filtration_fraction,
    performance,
    solute_removed,
)

FREE = Solute(0.0, 1.0, 200.0)


def cleared(water, dialysate, before=0.0, after=0.0, net=0.0, solute=FREE):
    return float(
        clearance(jnp.asarray(water), Fluids(*map(jnp.asarray, (dialysate, before, after, net))), solute)
    )


def along_the_fibres(water, dialysate, filtered, area_product):
    """Clearance from the two balances along the fibres, solved numerically."""
    mixing = area_product if filtered == 0.0 else filtered / np.expm1(filtered / area_product)

    def slopes(x, c):
        difference = c[0] - c[1]
        on_the_way = water - filtered * x, dialysate + filtered * (1.0 - x)
        return np.array(
            [-mixing * difference / on_the_way[0], -(mixing + filtered) * difference / on_the_way[1]]
        )

    ends = lambda first, last: np.array([first[0] - 1.0, last[1]])  # noqa: E731
    result = solve_bvp(
        slopes, ends, np.linspace(0, 1, 200), np.full((2, 200), 0.5), tol=1e-9, max_nodes=50000
    )
    return (dialysate + filtered) * result.y[1, 0]


@pytest.mark.parametrize(
    ("water", "dialysate", "filtered", "area_product"),
    [(130, 16.7, 18, 200), (130, 40, 30, 60), (100, 5, 30, 20), (150, 100, 70, 300), (100, 150, 30, 300)],
)
def test_convection_and_diffusion_together_follow_the_balances_along_the_fibres(
    water, dialysate, filtered, area_product
):
    result = cleared(water, dialysate, after=filtered, solute=FREE._replace(area_product=area_product))
    assert result == pytest.approx(along_the_fibres(water, dialysate, filtered, area_product), rel=1e-8)


def test_dialysis_alone_is_the_counter_current_formula():
    water, dialysate, area_product = 130.0, 40.0, 200.0
    z = area_product / water * (1.0 - water / dialysate)
    formula = water * (np.exp(z) - 1.0) / (np.exp(z) - water / dialysate)
    assert cleared(water, dialysate) == pytest.approx(formula, rel=1e-13)
    assert cleared(40.0, 40.0) == pytest.approx(40.0 * 5.0 / 6.0, rel=1e-6)  # equal flows: KoA/(1 + KoA/Q)


@pytest.mark.parametrize("sieving", [1.0, 0.7])
def test_filtration_alone_clears_what_it_filters(sieving):
    solute = FREE._replace(sieving=sieving)
    assert cleared(130.0, 0.0, after=33.0, solute=solute) == pytest.approx(33.0 * sieving, rel=1e-10)
    diluted = cleared(130.0, 0.0, before=33.0, solute=solute)
    assert diluted == pytest.approx(33.0 * sieving * 130.0 / 163.0, rel=1e-10)
    assert cleared(130.0, 0.0) == 0.0


def test_a_large_membrane_saturates_the_effluent_and_a_small_one_only_filters():
    assert cleared(130.0, 20.0, after=33.0, solute=FREE._replace(area_product=1e6)) == pytest.approx(
        53.0, rel=1e-4
    )
    assert cleared(130.0, 20.0, after=33.0, solute=FREE._replace(area_product=1e-3)) == pytest.approx(
        33.0, rel=1e-4
    )
    assert np.isnan(cleared(20.0, 10.0, after=33.0))


@pytest.mark.slow
def test_clearance_lies_between_filtration_and_effluent_and_grows_with_every_flow():
    rng = np.random.default_rng(3)
    for _ in range(200):
        water, dialysate, after, area = rng.uniform((80, 1, 1, 20), (300, 60, 40, 500))
        solute = FREE._replace(area_product=area)
        result = cleared(water, dialysate, after=after, solute=solute)
        assert after * (1 - 1e-12) <= result <= (dialysate + after) * (1 + 1e-12)
        assert cleared(water * 1.01, dialysate, after=after, solute=solute) >= result * (1 - 1e-12)
        assert cleared(water, dialysate * 1.01, after=after, solute=solute) >= result


@pytest.mark.parametrize("x", [-9e-5, -1e-6, 1e-6, 3e-5, 9e-5, 2e-4, 0.3])
def test_series_stand_in_for_logarithms_near_nothing(x):
    assert float(_log1p_ratio(jnp.asarray(x))) == pytest.approx(np.log1p(x) / x, rel=1e-13)
    assert float(_bernoulli(jnp.asarray(x))) == pytest.approx(x / np.expm1(x), rel=1e-13)


@pytest.mark.parametrize("at", [(130.0, 16.7, 18.0), (130.0, 20.0, 0.0), (130.0, 0.0, 20.0)])
def test_derivatives_are_those_of_finite_differences(at):
    def law(x):
        return clearance(x[0], Fluids(x[1], jnp.zeros(()), x[2], jnp.zeros(())), FREE)

    exact = np.asarray(jax.grad(law)(jnp.array(at)))
    assert np.isfinite(exact).all()
    for k in range(3):
        step = 1e-4
        ahead, further = (float(law(jnp.array(at).at[k].add(s))) for s in (step, 2.0 * step))
        slope = (4.0 * ahead - further - 3.0 * float(law(jnp.array(at)))) / (2.0 * step)
        assert exact[k] == pytest.approx(slope, rel=2e-3, abs=2e-5)


def test_predilution_loses_what_was_measured():
    """Troyanov et al. 2003, M-100 filter: 40 % less at 4.5 L/h before the filter (here at 150 mL/min)."""
    for solute in (FREE, FREE._replace(red_cell_water=0.8)):
        water = float(solute.water_flow(150.0, 0.3))
        loss = 1.0 - cleared(water, 0.0, before=75.0, solute=solute) / 75.0
        assert 0.33 < loss < 0.45


def test_what_fluids_and_blood_share_is_lost_with_the_net_ultrafiltrate_alone():
    assert float(solute_removed(30.0, 25.0, 25.0, 2.0)) == pytest.approx(0.05)
    # 2 L/h of effluent at 26 mmol/L and none in the fluids: 52 mmol/h
    assert float(solute_removed(2000 / 60, 26.0, 0.0, 0.0)) == pytest.approx(52.0 / 60.0)


NUMBERS = Settings(1000.0, 200.0, 900.0, 100.0, 0.3, 32.0, 24.0, 3.0, 37.0, 300.0, 230.0, 300.0, 240.0, 170.0)


GASES = (46.0, 7.36, 37.0)
"""PCO2, pH and temperature of the blood that enters."""


def filter_at(patients_haematocrit=0.4, **changes):
    numbers = [200.0, 180.0, 120.0, *GASES, patients_haematocrit, *NUMBERS._replace(**changes)]
    return Performance(*np.asarray(performance(jnp.array(numbers))))


def test_a_haematocrit_of_0_is_that_of_the_patient():
    assert filter_at() == filter_at(patients_haematocrit=0.2)
    own = filter_at(haematocrit=0.0, patients_haematocrit=0.25)
    assert own == filter_at(haematocrit=0.25)
    assert own != filter_at()


def test_a_filter_is_computed_with_all_its_numbers():
    result = filter_at()
    fluids = NUMBERS.fluids
    assert result.effluent == pytest.approx(2200.0)
    assert result.filtration_fraction == pytest.approx(20.0 / (140.0 + 200.0 / 60.0))
    assert result.filtration_fraction == pytest.approx(float(filtration_fraction(200.0, 0.3, fluids)))
    assert result.transmembrane_pressure == pytest.approx(1200.0 / 37.0)
    assert result.effluent_pressure == pytest.approx(150.0 - 1200.0 / 37.0)
    assert result.urea > result.creatinine
    assert filter_at(urea=1e5).urea > result.urea


def test_carbon_and_base_are_balanced():
    result = filter_at()
    none = filter_at(citrate=0.0)
    assert none.citrate == 0.0
    assert none.base_gain == pytest.approx(-none.carbon_dioxide / 22.26 * 60.0, rel=1e-12)
    assert result.base_gain - none.base_gain == pytest.approx(3.0 * result.citrate, rel=1e-12)
    assert 0.5 < result.citrate / (3.0 * 0.2 * 60.0) < 1.0
    neutral = filter_at(citrate=0.0, plasma_bicarbonate=32.0, net=0.0)
    assert neutral.base_gain == pytest.approx(0.0, abs=1e-12)


def test_carbon_dioxide_is_the_bloods_own_unless_it_is_set():
    held, dissolved = 0.0307 * 46.0 * 10.0 ** (7.36 - 6.1), 0.0307 * 46.0
    own, given = filter_at(plasma_bicarbonate=0.0), filter_at(plasma_bicarbonate=held + dissolved)
    assert own.carbon_dioxide == pytest.approx(given.carbon_dioxide, rel=1e-12)
    # Of it bicarbonate alone is base; fluids bring no dissolved carbon dioxide.
    single = filter_at(plasma_bicarbonate=held)
    assert own.base_gain == pytest.approx(single.base_gain, rel=1e-12)
    assert given.base_gain < own.base_gain


def test_a_filter_is_renamed_with_its_parameters():
    names = tuple(f"crrt.{field}" for field in Settings._fields)
    renamed = Hemofilter(names).renamed(lambda name: name.replace("crrt", "crrt.left"))
    assert renamed.parameter_names() == tuple(f"crrt.left.{field}" for field in Settings._fields)
