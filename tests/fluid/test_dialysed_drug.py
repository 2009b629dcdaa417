"""A drug that dialysis removes: closed forms, its balance, effective clearance, and what a case may say."""

from __future__ import annotations

import json
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from eclsim import course, derivatives, simulate
from eclsim.cases.reading import read_mapping
from eclsim.components.dialysis import drug_clearance
from eclsim.course.drug import drug_in_words, drug_record, share_above
from eclsim.course.files import course_object
from eclsim.inputs.mistakes import CaseError

CRRT = {"flow_ml_min": 150, "access_site": "svn", "return_site": "ra", "replacement_post_ml_h": 2000}
DRUG = {
    "name": "test drug", "dose_mg": 1000, "every_h": 8, "over_min": 30, "central_volume_l": 15,
    "peripheral_volume_l": 10, "transfer_ml_min": 150, "body_clearance_ml_min": 35,
    "unbound_fraction": 0.9, "target_mg_l": 15,
}  # fmt: skip
CASE: dict[str, Any] = {
    "format": 1,
    "patient": {"id": "x", "sex": "male", "age_years": 50, "height_cm": 180, "weight_kg": 80,
                "heart_rate_bpm": 80},
    "crrt": CRRT,
    "dialysed_drug": DRUG,
}  # fmt: skip


def _case(**changes: Any) -> Any:
    return read_mapping(CASE | changes).case


def _settings(**given: float) -> list[float]:
    fluids = {"dialysate": 0.0, "before": 0.0, "after": 0.0, "net": 0.0} | given
    return [*fluids.values(), 0.3, 32.0, 24.0, 0.0, 37.0, 300.0, 230.0, 300.0, 240.0, 170.0]


def test_hemofiltration_clears_sieving_times_filtrate() -> None:
    cleared, plasma = drug_clearance(jnp.array([150.0, 0.6, 200.0, 0.2, *_settings(after=2400.0)]))
    assert float(cleared) == pytest.approx(0.6 * 40.0, rel=1e-12)
    assert float(plasma) == pytest.approx(150.0 * 0.7)


def test_fluid_before_the_filter_dilutes_the_drug() -> None:
    cleared, plasma = drug_clearance(jnp.array([150.0, 0.6, 200.0, 0.2, *_settings(before=2400.0)]))
    assert float(cleared) == pytest.approx(0.6 * 40.0 * float(plasma) / (float(plasma) + 40.0), rel=1e-12)


def test_a_large_membrane_saturates_the_effluent() -> None:
    settings = _settings(dialysate=1200.0, after=600.0)
    cleared, _ = drug_clearance(jnp.array([200.0, 0.4, 3000.0, 0.2, *settings]))
    assert float(cleared) == pytest.approx(0.4 * 30.0, rel=1e-3)


def test_no_clearance_where_all_water_of_the_plasma_would_be_filtered() -> None:
    cleared, _ = drug_clearance(jnp.array([50.0, 0.9, 200.0, 0.2, *_settings(after=2200.0)]))
    assert math.isnan(float(cleared))


@pytest.mark.slow
def test_clearance_is_differentiable_in_sieving_and_koa() -> None:
    numbers = jnp.array([150.0, 0.6, 60.0, 0.2, *_settings(dialysate=2000.0, after=1000.0)])
    slopes = jax.jacfwd(drug_clearance)(numbers)[0]
    for place, step in ((1, 1e-5), (2, 1e-3)):
        ends = (float(drug_clearance(numbers.at[place].add(way * step))[0]) for way in (1.0, -1.0))
        assert float(slopes[place]) == pytest.approx((next(ends) - next(ends)) / (2 * step), rel=1e-6)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("infusion_mg_h", 60000, "allowed: 0 to 2000 mg/h; did you mean 60000 ug/h = 60 mg/h?"),
        ("infusion_mg_h", 8000, "allowed: 0 to 2000 mg/h; did you mean 8000 ug/min = 480 mg/h?"),
        ("dose_mg", 2e6, "allowed: 0 to 20000 mg; did you mean 2e+06 ug = 2000 mg?"),
    ],
)
def test_an_impossible_dose_is_answered_with_the_unit_it_is_probably_in(key, value, said) -> None:
    """60000 mg/h were taken for 60000 ng/min = 3.6 mg/h, as little as no antibiotic is given."""
    with pytest.raises(CaseError) as caught:
        read_mapping(CASE | {"dialysed_drug": CASE["dialysed_drug"] | {key: value}})
    (mistake,) = map(str, caught.value.mistakes)
    assert mistake == f"dialysed_drug.{key} = {value:.0f}: outside the allowed range; {said}"


def test_without_the_section_nothing_changes() -> None:
    bare = {key: value for key, value in CASE.items() if key != "dialysed_drug"}
    without, with_drug = simulate(read_mapping(bare).case), simulate(_case())
    assert "clearance_drug" not in without
    for name in without.data_vars:
        np.testing.assert_array_equal(without[name].to_numpy(), with_drug[name].to_numpy())


def test_the_effective_clearance_is_less_where_blood_recirculates() -> None:
    apart = simulate(_case())
    same = simulate(_case(crrt=CRRT | {"return_site": "svn"}))
    assert float(apart["effective_clearance_drug"]) == pytest.approx(float(apart["clearance_drug"]), rel=1e-7)
    assert float(same["effective_clearance_drug"]) < 0.995 * float(same["clearance_drug"])
    assert float(same["crrt_recirculated_fraction"]) > 0.01


@pytest.mark.slow
def test_derivatives_of_the_effective_clearance_are_exact() -> None:
    key = "crrt.flow_ml_min"
    slope = derivatives(_case(crrt=CRRT | {"return_site": "svn"}), ("effective_clearance_drug",), (key,))
    lines = CRRT | {"return_site": "svn"}
    beats = [simulate(_case(crrt=lines | {"flow_ml_min": 150 + change})) for change in (0.5, -0.5)]
    ends = [float(beat["effective_clearance_drug"]) for beat in beats]
    assert float(slope.squeeze()) == pytest.approx(ends[0] - ends[1], rel=1e-3)


def _closed_form(hours: np.ndarray, clearance: float) -> np.ndarray:
    """Concentration of two compartments under repeated short infusions, by superposition."""
    v1, v2, q = 15.0, 10.0, 150.0 * 0.06
    k10, k12, k21 = clearance * 0.06 / v1, q / v1, q / v2
    total, root = k10 + k12 + k21, math.sqrt((k10 + k12 + k21) ** 2 - 4 * k10 * k21)
    fast, slow = (total + root) / 2, (total - root) / 2
    result = np.zeros_like(hours)
    for rate, share in ((fast, (fast - k21) / (fast - slow)), (slow, (k21 - slow) / (fast - slow))):
        for dose_at in (0.0, 8.0, 16.0):
            since = np.clip(hours - dose_at, 0.0, None)
            infused = np.minimum(since, 0.5)
            result += (
                2000.0 / v1 * share / rate * (1 - np.exp(-rate * infused)) * np.exp(-rate * (since - infused))
            )
    return result


@pytest.mark.slow
def test_repeated_doses_follow_the_two_compartment_solution() -> None:
    result = course(_case(), minutes=1440.0, every_min=10.0)
    hours = result["time_min"].to_numpy() / 60.0
    cleared = result["effective_clearance_drug"].to_numpy()
    assert np.ptp(cleared) < 1e-6
    expected = _closed_form(hours, 35.0 + cleared[0])
    np.testing.assert_allclose(result["drug_concentration"].to_numpy(), expected, atol=2e-3 * expected.max())
    np.testing.assert_allclose(result["drug_unbound"], 0.9 * result["drug_concentration"])
    record = drug_record(result)
    assert record is not None
    assert abs(record["error_mg"]) < 1e-9 * record["given_mg"]
    assert record["given_mg"] == pytest.approx(3000.0, rel=1e-12)
    minutes = np.arange(0.0, 1440.0, 0.5)
    exact = float((0.9 * _closed_form(minutes / 60.0, 35.0 + cleared[0]) > 15.0).mean())
    assert record["share_above_target"] == pytest.approx(exact, abs=0.005)
    assert f"unbound above 15 mg/L for {100 * exact:.0f} % of the time" in drug_in_words(result)
    assert json.loads(json.dumps(course_object(result)))["drug"]["name"] == "test drug"


@pytest.mark.slow
def test_events_give_doses_and_bleeding_takes_the_drug_along() -> None:
    quiet = {"dose_mg": 0, "body_clearance_ml_min": 0, "start_mg_l": 40, "central_volume_l": 15}
    events = [
        {"at_min": 10, "give": {"drug_mg": 300}, "over_min": 10},
        {"at_min": 30, "give": {"bleed_ml": 500}, "over_min": 10},
        {"at_min": 50, "set": {"dialysed_drug.infusion_mg_h": 60}},
    ]
    bare = {key: value for key, value in CASE.items() if key not in ("dialysed_drug", "crrt")}
    raw = bare | {"fluid": {"haematocrit": 0.3}, "dialysed_drug": quiet, "events": events}
    case = read_mapping(raw).case
    result = course(case, minutes=110.0)
    record = drug_record(result)
    assert record is not None
    assert record["given_mg"] == pytest.approx(360.0, rel=1e-9)
    assert record["bled_mg"] == pytest.approx(500.0 * 0.7 * 1e-3 * (600.0 + 300.0) / 15.0, rel=0.03)
    assert abs(record["error_mg"]) < 1e-9
    assert case.events[0].summary == "drug 300 mg"
    assert "bleeding" in drug_in_words(result)


@pytest.mark.slow
def test_a_later_dose_follows_an_event() -> None:
    events = [{"at_min": 200, "set": {"dialysed_drug.dose_mg": 500}}]
    record = drug_record(course(_case(events=events), minutes=600.0))
    assert record is not None
    assert record["given_mg"] == pytest.approx(1500.0, rel=1e-9)


@pytest.mark.slow
def test_a_dose_on_a_ramp_is_that_of_its_moment() -> None:
    events = [{"at_min": 240, "set": {"dialysed_drug.dose_mg": 500}, "ramp_min": 480}]
    record = drug_record(course(_case(events=events), minutes=600.0))
    assert record is not None
    assert record["given_mg"] == pytest.approx(1000.0 + 750.0, rel=1e-9)


def test_shares_above_a_target_are_those_of_lines_between_moments() -> None:
    minute = np.array([0.0, 10.0, 20.0, 40.0])
    assert share_above(minute, np.array([0.0, 10.0, 10.0, 0.0]), 5.0) == pytest.approx((5 + 10 + 10) / 40)
    assert share_above(minute, np.full(4, 5.0), 4.0) == 1.0
    assert share_above(minute[:1], np.array([5.0]), 6.0) == 0.0


@pytest.mark.parametrize(
    ("drug", "words"),
    [
        ({"over_min": 3000}, "dialysed_drug.over_min"),
        ({"unbound_fraction": 90}, "dialysed_drug.unbound_fraction"),
        ({"dose_mg": -5}, "dialysed_drug.dose_mg"),
        ({"half_life_h": 2}, "half_life_h"),
    ],
)
def test_impossible_values_are_refused(drug: dict[str, Any], words: str) -> None:
    with pytest.raises(CaseError, match=words):
        read_mapping(CASE | {"dialysed_drug": DRUG | drug})


def test_doubtful_and_assumed_values_are_named() -> None:
    reading = read_mapping(CASE | {"dialysed_drug": {"every_h": 6, "sieving": 0.9, "unbound_fraction": 0.1}})
    said = "\n".join(map(str, (*reading.warnings, *reading.notes)))
    assert "no effect without dose_mg" in said
    assert "more passes the membrane than is unbound" in said
    assert "central_volume_l = 15" in said
    long = read_mapping(CASE | {"dialysed_drug": DRUG | {"over_min": 600}})
    assert "doses run side by side" in "".join(map(str, long.warnings))


@pytest.mark.parametrize("event", [{"give": {"drug_mg": 100}}, {"set": {"dialysed_drug.dose_mg": 100}}])
def test_events_need_the_section(event: dict[str, Any]) -> None:
    bare = {key: value for key, value in CASE.items() if key != "dialysed_drug"}
    with pytest.raises(CaseError, match="the case has no drug"):
        read_mapping(bare | {"events": [{"at_min": 5, **event}]})


def test_volumes_of_the_drug_do_not_change_in_a_course() -> None:
    with pytest.raises(CaseError, match="at the start of the course"):
        _case(events=[{"at_min": 5, "set": {"dialysed_drug.central_volume_l": 30}}])
