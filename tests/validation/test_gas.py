"""The rows of gas exchange: fits are met, tests are what they are, and reasons are shown by experiments."""

import csv
from functools import cache

import numpy as np
import pytest

from eclsim.validation import gas, gas_bench
from eclsim.validation.gas_bench import single_pass, veno_venous
from eclsim.validation.reference_cases import DATA


def rows():
    with (DATA / "gas.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module", autouse=True)
def _bench_and_loss_of_blood_are_computed_once():
    """Numbers of their own that the whole check has, too."""
    with pytest.MonkeyPatch.context() as patch:
        for module, name in ((gas, "_oxygenators"), (gas_bench, "_loss_of_blood")):
            patch.setattr(module, name, cache(getattr(module, name)))
        yield


def test_every_row_says_what_it_was_used_for_and_where_it_comes_from():
    assert {row["use"] for row in rows()} == {"fit", "test", "size", "sign", "cross-model"}
    assert all(row["source"] and row["how_read"] for row in rows())
    assert all(float(row["low"]) <= float(row["expected"]) <= float(row["high"]) for row in rows())


@pytest.mark.slow
def test_the_oxygen_transfer_of_the_bench_is_met_at_every_flow():
    found = gas._oxygenators()
    bench = [
        row for row in rows() if row["study"] == "Khadka 2024" and row["key"].startswith(("oxygen", "po2"))
    ]
    assert len(bench) == 9
    for row in bench:
        assert float(row["low"]) <= found[row["key"]] <= float(row["high"]), row["quantity"]


@pytest.mark.slow
def test_oxygen_transfer_in_bypass_is_as_measured_with_pure_oxygen_and_with_less():
    bypass = {row["key"]: row for row in rows() if row["study"].startswith("Inspire")}
    found = {f"bypass {f:g}": gas._bypass(f) for f in gas.BYPASS_FRACTIONS}
    assert found.keys() == bypass.keys()
    for key, row in bypass.items():
        assert float(row["low"]) <= found[key] <= float(row["high"]), row["quantity"]


@pytest.mark.slow
def test_the_line_through_the_origin_of_the_bypass_study_is_that_of_the_models_transfers():
    """The study has no other form: its 60 % is a point of the line, where transfer ends at the PO2 of air."""
    fractions = np.array([0.5, 0.6, 0.8, 1.0])
    found = np.array([gas._bypass(f) for f in fractions.tolist()])
    slope, offset = np.polyfit(fractions, found, 1)
    assert np.abs(slope * fractions + offset - found).max() < 1.0
    assert -offset / slope == pytest.approx(gas.BYPASS_PO2 / 713.0, abs=0.06)
    through_origin = float(fractions @ found / (fractions @ fractions))
    assert through_origin == pytest.approx(284.34, rel=0.03)
    assert 0.6 * through_origin == pytest.approx(170.6, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("saturation", [0.2, 0.3, 0.4, 0.5, 0.6])
def test_poor_blood_and_thin_gas_leave_less_saturated_but_take_up_more(saturation):
    poor = single_pass(3.9, 4.0, saturation, hb=9.0, fdo2=0.8)
    rich = single_pass(3.9, 4.0, saturation + 0.1, hb=9.0, fdo2=0.8)
    assert poor.saturation < rich.saturation
    assert poor.oxygen > rich.oxygen
    assert poor.saturation > 80.0


@pytest.mark.slow
def test_at_complete_shunt_venous_blood_does_not_depend_on_the_output():
    low, high = (veno_venous(q, 3.3, shunt_fraction=1.0, vo2_ml_min=260.0) for q in (6.0, 10.0))
    assert low.svo2 == pytest.approx(high.svo2, abs=1e-6)
    assert low.sao2 > high.sao2 + 5.0


@pytest.mark.slow
def test_at_given_pressures_blood_with_more_haemoglobin_gives_off_more_carbon_dioxide():
    """By either set of equations: the sign that regressions in pigs contradict."""
    assert all(gas._released_carbon_dioxide(law) > 5.0 for law in gas.LAWS)


@pytest.mark.slow
def test_all_fits_are_met_and_what_misses_has_a_reason():
    check = gas.gas_check()
    assert not check.required
    assert len(check.rows) == len(rows()) + 3
    assert not [row.name for row in check.missed if "(fit)" in row.name]
    assert not [row.name for row in check.missed if not row.explained and "(sign)" in row.name]
    undecided = [row.name for row in check.missed if row.explanation and row.explanation.undecided]
    assert len(undecided) == 14
    assert all(row.explained for row in check.missed if row.name in undecided)
    assert not [row.name for row in check.missed if not row.explained]
    pigs = [row for row in check.rows if row.name.startswith("Strassmann")]
    assert len(pigs) == 4
    assert all(row.holds for row in pigs)


@pytest.mark.slow
def test_recirculation_in_the_whole_circulation_is_that_of_the_mixed_blood():
    beats = gas_bench.beats(flow=[2.0, 4.0, 6.0], mixing=[0.2, 0.5, 1.0])
    drained = np.array([0.2, 0.5, 1.0]) * [2.0, 4.0, 6.0]
    expected = drained / (beats["CO"].values + drained)
    assert beats["recirculation_fraction"].values == pytest.approx(expected, rel=1e-5)


@pytest.mark.slow
def test_blood_lost_on_vv_ecmo_recirculates_more_and_leaves_the_drainage_pressure():
    numbers = gas_bench._loss_of_blood()
    assert numbers["bled"] > 20.0
    assert numbers["given back"] < -20.0
    assert abs(numbers["bled drainage"]) < 2.0
