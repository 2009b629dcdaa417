"""The verdict on a fit: agreement, search, plausibility of the patient, agreement of intervals."""

import json

import numpy as np
import pytest

from eclsim.identification.fitted_parameters import FittedParameter, nothing_identifiable
from eclsim.identification.multi_start import FitStatus
from eclsim.identification.output_intervals import OutputInterval, undetermined_reasons
from eclsim.identification.verdict import (
    Aspect,
    FitVerdict,
    Goodness,
    Level,
    Reason,
    agreement,
    goodness_of,
    headline,
    interval_agreement,
    not_used_as_weights,
    plausibility,
    search,
    single_start,
)
from eclsim.parameters.adult_ranges import adult_ranges

MEASURED = {"MAP": 70.0, "MPAP": 26.0, "CO": 4.0}


def goodness(probability: float | None = 0.5, **differences: float) -> Goodness:
    total = sum(d * d for d in differences.values())
    return Goodness(differences, total, 0.0 if probability is None else 2.0, probability)


def test_stated_uncertainties_that_do_not_weight_the_fit_are_named():
    """The fit was the same with any uncertainties, without a word."""
    (reason,) = not_used_as_weights({**MEASURED, "DP": 0.0}, ("MAP", "SP", "DP"), "relative")
    assert reason.level is Level.GOOD
    assert reason.sentence.startswith("the stated uncertainties of MAP judge the fit")
    assert 'weights="uncertainty"' in reason.sentence
    assert not not_used_as_weights(MEASURED, ("MAP",), "uncertainty")
    assert not not_used_as_weights(MEASURED, (), "relative")


def judged(mpap: float, weights: str = "relative", **more) -> FitVerdict:
    """The verdict on a fit that meets all but MPAP, whose standard uncertainty is 2 mmHg."""
    result = goodness(MAP=0.0, MPAP=(mpap - 26.0) / 2.0, CO=0.0, **more)
    simulated = {**MEASURED, "MPAP": mpap}
    return FitVerdict(result, ()).with_reasons(agreement(MEASURED, simulated, result, weights))


@pytest.mark.parametrize(
    ("mpap", "level"),
    [(26.0, Level.GOOD), (22.0, Level.GOOD), (20.0, Level.DOUBTFUL), (14.0, Level.POOR), (38.0, Level.POOR)],
)
def test_the_level_follows_the_largest_difference(mpap: float, level: Level):
    assert judged(mpap).level is level


def test_a_measurement_that_is_missed_is_named_with_its_numbers():
    verdict = judged(14.0)
    assert verdict.reasons[0].about == "MPAP"
    assert "MPAP 14 fitted against 26 measured: 6.0 standard uncertainties off" in verdict.reasons[0].sentence
    assert verdict.headline.startswith("POOR FIT, not to be used: ")
    assert "6.0 standard uncertainties (MPAP)" in verdict.headline
    assert any("--weights uncertainty" in r.sentence for r in verdict.reasons)
    assert not any("--weights" in r.sentence for r in judged(14.0, "uncertainty").reasons)


@pytest.mark.parametrize(("chance", "level"), [(0.5, "good"), (3e-3, "doubtful"), (1e-5, "poor")])
def test_many_small_differences_count_together(chance: float, level: str):
    result = goodness(chance, MAP=2.0, MPAP=-2.0, CO=2.0)
    reasons = agreement(MEASURED, MEASURED, result, "relative")
    assert FitVerdict(result, tuple(reasons)).level == level
    assert [r.level for r in reasons if "chi-square" in r.sentence] == [level] * (level != "good")


def test_agreement_that_cannot_fail_is_called_so():
    result = goodness(None, MAP=0.1, MPAP=0.1, CO=0.1)
    verdict = FitVerdict(result, ()).with_reasons(agreement(MEASURED, MEASURED, result, "relative"))
    assert verdict.level is Level.GOOD
    assert "no test of the model" in verdict.remarks[0].sentence


def test_chi_square_has_the_degrees_that_the_parameters_leave():
    scaled, spread = np.array([[10.0], [0.0], [0.0]]), np.array([[1e-2]])
    result = goodness_of(
        MEASURED, {**MEASURED, "MAP": 76.0}, {"MAP": 3.0, "MPAP": 2.0, "CO": 0.4}, scaled, spread
    )
    assert result.differences == {"MAP": 2.0, "MPAP": 0.0, "CO": 0.0}
    assert result.chi_square == 4.0
    assert result.degrees == pytest.approx(2.0)
    assert result.probability == pytest.approx(np.exp(-2.0))  # chi-square with 2 degrees of freedom


def test_a_search_without_end_is_doubtful_and_its_cost_an_upper_limit():
    assert search(FitStatus.FITTED) == []
    (open_end,) = search(FitStatus.NOT_SETTLED)
    assert open_end.level is Level.DOUBTFUL
    assert "upper limit" in open_end.sentence
    assert "lower bound" not in open_end.sentence
    (nothing,) = search(FitStatus.NO_STEADY_BEAT)
    verdict = FitVerdict(None, (nothing,))
    assert verdict.level is Level.POOR
    assert "nothing was fitted" in verdict.headline


def test_a_right_ventricle_of_17_ml_is_flagged_with_the_range_of_health():
    ranges = adult_ranges("female")
    (small,) = plausibility({"EDVRV": 17.0, "EDVLV": 120.0, "PCWP": 60.0}, ranges, ["PCWP"], [])
    assert small.about == "EDVRV"
    assert "17 mL" in small.sentence
    assert "78 to 218" in small.sentence
    assert plausibility({"EDVRV": 60.0, "PCWP": 20.0}, ranges, [], []) == []
    (wedge,) = plausibility({"PCWP": 60.0}, ranges, [], [])
    assert wedge.about == "PCWP"
    (extracted,) = plausibility({"O2ER": 0.95}, ranges, [], [])
    assert "oxygen extraction ratio 0.95, which" in extracted.sentence
    assert plausibility({"O2ER": 0.6}, ranges, [], []) == []
    (shut,) = plausibility({}, ranges, [], ["volume of rv falls to -3.0 mL: the chamber collapses"])
    assert shut.level is Level.DOUBTFUL


def test_ranges_are_those_of_the_sources():
    men, women = adult_ranges("male"), adult_ranges("female")
    assert men["EDVRV"].healthy == (190 - 66, 190 + 66)
    assert women["ESVLV"].healthy == (42 - 24, 42 + 24)
    for r in (*men.values(), *women.values()):
        assert r.plausible[0] < r.healthy[0] < r.healthy[1] < r.plausible[1], r.output


def interval(lower: float, upper: float, value: float = 0.55, identifiable: bool = True) -> dict:
    return {"value": value, "lower": lower, "upper": upper, "identifiable": identifiable}


@pytest.mark.parametrize(
    ("other", "level", "text"),
    [
        (
            (0.74, 0.92),
            Level.POOR,
            "0.46 to 0.66 by the Gaussian approximation, 0.74 to 0.92 by the posterior",
        ),
        ((0.58, 0.80), Level.DOUBTFUL, "0.55 is outside"),
        ((0.10, 3.00), Level.DOUBTFUL, "use the wider"),
        ((0.48, 0.70), None, ""),
    ],
)
def test_intervals_that_disagree_are_said(other, level, text):
    result = interval_agreement(
        {"Rmc": interval(0.46, 0.66)}, {"Rmc": {"lower": other[0], "upper": other[1]}}, "posterior"
    )
    assert [r.level for r in result] == ([] if level is None else [level])
    assert all(text in r.sentence and r.about == "Rmc" for r in result)


def test_intervals_of_what_is_not_determined_are_not_compared():
    open_one = {"Rmc": interval(0.46, 0.66, identifiable=False)}
    assert interval_agreement(open_one, {"Rmc": {"lower": 0.74, "upper": 0.92}}, "posterior") == []
    assert interval_agreement({"Rmc": interval(0.4, 0.6)}, {}, "posterior") == []


def test_the_worst_reason_comes_first_and_nothing_is_said_twice():
    doubt = Reason(Aspect.PLAUSIBILITY, Level.DOUBTFUL, "EDVRV", "small")
    bad = Reason(Aspect.INTERVALS, Level.POOR, "Rmc", "apart")
    verdict = FitVerdict(goodness(MAP=0.1), (doubt,)).with_reasons([bad, doubt])
    assert verdict.reasons == (bad, doubt)
    assert verdict.doubts == (bad, doubt)
    plain = json.loads(json.dumps(verdict.as_object(), allow_nan=False))
    assert plain["level"] == "poor"
    assert headline(plain) == verdict.headline
    assert plain["reasons"][1]["about"] == "EDVRV"


def test_an_interval_from_bound_to_bound_determines_nothing():
    fitted = {"Csart": {"value": 0.73, "lower": 0.29, "upper": 1.82, "identifiable": True}}
    profile, bounds = {"Csart": {"lower": 0.09, "upper": 9.0}}, {"Csart": (0.09, 9.0)}
    (reason,) = interval_agreement(fitted, profile, "profile likelihood", bounds)
    assert "do not determine the parameter" in reason.sentence


def profile_reasons(name: str, gaussian, profile, bounds, **more):
    fitted = {name: {"value": gaussian[0], "lower": gaussian[1], "upper": gaussian[2], "identifiable": True}}
    ends = {name: {"lower": profile[0], "upper": profile[1]}}
    return [r.sentence for r in interval_agreement(fitted, ends, "profile likelihood", bounds, **more)]


def test_an_interval_that_ends_at_a_bound_is_not_determined_on_that_side():
    bounds = {"Csart": (0.09, 9.0)}
    (sentence,) = profile_reasons("Csart", (0.73, 0.29, 1.82), (0.09, 1.7), bounds)
    assert sentence.endswith("the second ends at the lower bound, so the measurements give no lower limit")
    (sentence,) = profile_reasons("Csart", (0.9, 0.55, 1.47), (0.55, 9.0), bounds)
    assert sentence.endswith("no upper limit")
    assert profile_reasons("Csart", (0.9, 0.55, 1.47), (0.5, 1.6), bounds) == []


def test_no_shunt_at_all_is_a_limit_of_what_there_can_be():
    bounds = {"gas.shunt_fraction": (0.0, 1.0)}
    assert profile_reasons("gas.shunt_fraction", (0.03, 0.0, 0.1), (0.0, 0.12), bounds) == []
    bounds = {"gas.shunt_fraction": (0.1, 1.0)}
    assert profile_reasons("gas.shunt_fraction", (0.13, 0.1, 0.2), (0.1, 0.22), bounds)


def test_an_end_a_factor_of_six_further_out_is_said_though_widths_are_alike():
    (sentence,) = profile_reasons("Csart", (1.268, 0.615, 2.62), (0.094, 3.05), {"Csart": (0.09, 9.0)})
    assert sentence.endswith("use the wider of the two")


def test_an_interval_that_no_heartbeat_was_found_beyond_has_no_limit_there():
    bounds, ends_without_beat = {"Rmc": (0.05, 5.0)}, {"Rmc": ("upper",)}
    (sentence,) = profile_reasons(
        "Rmc", (0.52, 0.45, 0.6), (0.48, 0.55), bounds, ends_without_beat=ends_without_beat
    )
    assert "no steady heartbeat was found beyond the upper end of the second" in sentence


@pytest.mark.parametrize(("probability", "untested"), [(None, True), (0.4, False)])
def test_agreement_with_as_many_measurements_as_parameters_is_no_praise(probability, untested):
    """Of a mean pressure alone, which determines nothing, the first line was the same as of seven values."""
    verdict = FitVerdict(Goodness({"MAP": 0.0}, 0.0, 0.0, probability), ())
    assert verdict.headline.startswith("GOOD FIT: all measurements are met")
    assert ("no test of the model with so few measurements" in verdict.headline) == untested


def test_a_doubtful_fit_that_meets_all_measurements_has_no_largest_difference():
    """It read: the largest difference from a measurement is 0.0 standard uncertainties."""
    implausible = Reason(Aspect.PLAUSIBILITY, Level.DOUBTFUL, "EDVRV", "an empty right ventricle")
    verdict = FitVerdict(Goodness({"MAP": 0.04, "CO": -0.02}, 0.0, 1.0, 0.9), (implausible,))
    assert verdict.headline.startswith("DOUBTFUL FIT, although all measurements are met; read the reasons")


def test_a_doubt_about_something_else_is_not_blamed_on_the_measurements():
    """It read: DOUBTFUL FIT: the largest difference is 1.7 standard uncertainties, which no limit breaks."""
    open_output = Reason(Aspect.INTERVALS, Level.DOUBTFUL, "CO", "CO was not measured")
    verdict = FitVerdict(Goodness({"MAP": 1.7, "PF": -0.2}, 3.0, 1.0, 0.1), (open_output,))
    assert "although no measurement is missed by more than 1.7 standard uncer" in verdict.headline
    missed = Reason(Aspect.AGREEMENT, Level.DOUBTFUL, "MAP", "MAP is missed")
    verdict = FitVerdict(Goodness({"MAP": 2.7}, 7.0, 1.0, 0.01), (open_output, missed))
    assert verdict.headline.startswith("DOUBTFUL FIT: the largest difference from a measurement is 2.7")


@pytest.mark.parametrize(("agreeing", "refined", "remarks"), [(1, 60, 1), (2, 60, 0), (1, 1, 0), (0, 60, 0)])
def test_an_optimum_of_one_start_alone_is_remarked(agreeing, refined, remarks):
    """The line "optimum found (1 of 60 starts agree)" left the reader to guess what follows from it."""
    reasons = single_start(agreeing, refined)
    assert len(reasons) == remarks
    assert all(r.level is Level.GOOD and "1 of 60 starts" in r.sentence for r in reasons)


@pytest.mark.parametrize(
    ("name", "level"), [("SP", "doubtful"), ("MPAP", "doubtful"), ("CVP", "doubtful"), ("PaO2", "good")]
)
def test_a_fit_that_leaves_open_what_every_reader_takes_off_it_is_not_good(name, level):
    """From MAP and CO alone SP was 127 (44 to 210) mmHg under "GOOD FIT ... plausible"."""
    fitted, intervals = {"MAP": 65.0, name: 127.0}, {"MAP": OutputInterval(60.0, 70.0, True)}
    intervals[name] = OutputInterval(43.6, 210.0, False)
    (reason,) = undetermined_reasons(intervals, fitted, ())
    assert f"{name} 127 (43.6 to 210 mmHg)" in reason.sentence
    assert reason.level == level
    assert undetermined_reasons(intervals, fitted, (name,)) == []


def test_a_fit_that_determines_no_parameter_is_not_good():
    """0 of 7 parameters were identifiable under "GOOD FIT"."""
    open_one = FittedParameter(3.2, 0.1, 4.5, False, False, "too little effect")
    (reason,) = nothing_identifiable({"Emaxrv": open_one, "Rmc": open_one})
    assert reason.level is Level.DOUBTFUL
    assert "none of the fitted parameters (Emaxrv, Rmc)" in reason.sentence
    known = FittedParameter(0.8, 0.7, 0.9, False, True, "")
    assert nothing_identifiable({"Emaxrv": open_one, "Rmc": known}) == nothing_identifiable({}) == []
