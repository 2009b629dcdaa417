"""A centre's own rule of ranking: what it may hold, what it changes, and that the usual one is as it was."""

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from eclsim.crrt_study.files import study_object, tables
from eclsim.crrt_study.limits import KEPT_TO_THE_END, largest_flows
from eclsim.crrt_study.ranking import choice_text, first_choice, rank
from eclsim.crrt_study.report import show, study_page
from eclsim.crrt_study.rule import DEFAULT_RULE, Criterion, Rule, RuleError, check_quantities, read_rule
from eclsim.crrt_study.schemes import nine_schemes, select_schemes
from eclsim.crrt_study.study import crrt_study
from eclsim.paper.crrt import paper_case


def ranked_by(study, *criteria, limits=DEFAULT_RULE.limits):
    at = {"policy": "as_published"}
    means = study.means.sel(at | {"speed": study.case_speed})
    return rank(means, study.limits.sel(at), study.schemes, Rule("own", criteria, limits))


def test_the_usual_rule_is_written_and_read_again(tmp_path):
    text = json.dumps(DEFAULT_RULE.as_object())
    assert read_rule(json.loads(text)) == DEFAULT_RULE
    assert read_rule(None) is DEFAULT_RULE
    file = tmp_path / "ours.toml"
    file.write_text("[limits]\nreturn_alarm = [-20, inf]\n")
    own = read_rule(file)
    assert own.name == "ours"
    assert own.criteria == DEFAULT_RULE.criteria
    assert [limit.high for limit in own.limits if limit.name == "return_alarm"] == [np.inf]


def test_order_and_direction_of_criteria_decide(study):
    by_flow = ranked_by(study, Criterion("PF", prefer="larger"))
    flows = [one.numbers["PF"] for one in by_flow]
    assert flows == sorted(flows, reverse=True)
    assert by_flow[0].decided_by == ""
    assert by_flow[1].decided_by == "PF: the larger"
    steps = ranked_by(
        study, Criterion("PF", prefer="larger", step=100.0), Criterion("margin", prefer="larger")
    )
    margins = [one.margin for one in steps]
    assert margins == sorted(margins, reverse=True)


def test_schemes_that_tie_in_all_criteria_share_a_place(study):
    ranking = ranked_by(study, Criterion("lowest_site_pressure", at_least=0.0))
    assert sorted(one.rank for one in ranking) == [1] * 5 + [6] * 4
    assert sum(bool(one.decided_by) for one in ranking) == 1
    tied = replace(study, ranking={"as_published": ranking})
    answer, by, *reasons = choice_text(tied, "as_published")
    assert answer.startswith("First for this patient: schemes ")
    assert answer.endswith("which the rule does not tell apart")
    assert by.startswith("what places them before scheme ")
    assert len(reasons) == 5


def test_venous_blood_past_the_oxygenator_can_be_a_criterion(study):
    ranking = ranked_by(study, Criterion("past_oxygenator", at_most=0.0), *DEFAULT_RULE.criteria)
    assert {one.letter for one in ranking[-2:]} == {"e", "f"}
    assert ranking[-2].decided_by == "past_oxygenator: at most 0"
    share = study.means["past_oxygenator"].sel(policy="as_published", speed=3425.0, scheme="e")
    assert float(share) == pytest.approx(0.054, abs=0.001), "0.2 of 3.7 L/min"
    behind = study.means["behind_oxygenator"].to_series()
    assert sorted(behind.index[behind]) == ["d", "e", "f"]


def test_a_quantity_of_the_rule_that_is_not_known_leaves_places_open(study):
    saturation = xr.full_like(study.means["PF"], 95.0)
    saturation.loc[{"scheme": "e"}] = np.nan
    status = xr.where(np.isnan(saturation), "no_oxygen", "steady")
    means = study.means.assign(SaO2=saturation, gas_status=status)
    ranking = ranked_by(
        replace(study, means=means), Criterion("SaO2", at_least=90.0), Criterion("margin", prefer="larger")
    )
    last = next(one for one in ranking if one.letter == "e")
    assert (last.rank, last.places) == (None, (1, 9))
    assert last.why_no_rank == "place 1 to 9: its SaO2 is not known"
    assert "no steady gas state at 3425 rpm (a tissue gets less than a tenth" in "; ".join(last.reasons)
    assert {one.rank for one in ranking} == {None}
    assert ranking[0].why_no_rank == "place 1 to 2: the SaO2 of scheme e is not known"
    assert first_choice(ranking) is None
    lost = replace(study, means=means).unsettled
    assert {(one.place, one.status, one.state) for one in lost} == {("scheme e", "no_oxygen", "gas state")}
    assert "no steady gas state at" in lost[0].sentence
    assert "raise the ventilation or the sweep" in lost[0].advice


@pytest.mark.parametrize("without", [["access_190"], [limit.name for limit in DEFAULT_RULE.limits]])
def test_a_limit_without_bounds_is_kept_at_every_speed(study, without):
    """It was said to be kept at no speed whose beat was found, and without limits no scheme had a rank."""
    rule = read_rule({"name": "none", "limits": {name: [None, None] for name in without}})
    limits = largest_flows(study.means, study.case_speed, rule.limits)
    free = limits.sel(limit=without)
    assert set(free["state"].values.flat) == {KEPT_TO_THE_END}
    fastest = study.means["PF"].isel(speed=-1)
    assert bool((free["largest_flow"] == fastest).all())
    assert set(free["in_words"].values.flat) == {"this rule sets no limits"}
    ranking = ranked_by(replace(study, limits=limits), *rule.criteria, limits=rule.limits)
    assert all(one.rank is not None for one in ranking)


def test_without_limits_nothing_is_said_to_be_kept_and_the_machines_alarms_are_still_named(study, capsys):
    """Nine schemes of up to 584 mmHg "kept their limits", and no alarm was mentioned."""
    off = {name: [None, None] for name in (limit.name for limit in DEFAULT_RULE.limits)}
    criterion = {"quantity": "PF", "at_least": 0.0}
    rule = read_rule({"name": "no limits", "limits": off, "criteria": [criterion]})
    means = study.means.copy(deep=True)
    means["Pcrrttuout"].loc[{"scheme": ["a", "g"]}] = 584.0
    limits = largest_flows(means, study.case_speed, rule.limits)
    free = replace(study, means=means, limits=limits, rule=rule, warnings=())
    at = {"policy": "as_published"}
    ranking = rank(means.sel(at | {"speed": study.case_speed}), limits.sel(at), study.schemes, rule)
    free = replace(free, ranking={"as_published": ranking, "patient_held": ranking})
    answer = " ".join(choice_text(free, "as_published"))
    assert "keeps its limits" not in answer
    assert "this rule sets no limits" in answer
    assert (
        "schemes a and g break the machine's usual alarms; best of the schemes that keep them: schemes b"
        in answer
    )
    of_a = "; ".join(next(one.reasons for one in ranking if one.letter == "a"))
    assert "beyond the usual alarms of CRRT machines (return −50 to 350 mmHg), which no limits does" in of_a
    show(free)
    shown = capsys.readouterr().out
    assert shown.count("no limit ") == 2 * 9
    assert shown.count(" broken") == 2 * 2
    drawn = dict.fromkeys(("schemes", "beat", "speeds", "limits", "uptake"), "<svg></svg>")
    page = study_page(free, drawn)
    assert "inf mmHg" not in page
    assert page.count("<td>broken</td>") == 2


def test_the_best_scheme_that_keeps_the_machines_alarms_is_named_where_the_rule_prefers_another(study):
    """The first scheme broke an alarm, two of ten did not, and no sentence or mark said which."""
    by_flow = (Criterion("PF", prefer="larger"),)
    means = study.means.copy(deep=True)
    first, *others = (one.letter for one in ranked_by(study, *by_flow))
    means["Pcrrttuout"].loc[{"scheme": [first, *others[:4]]}] = 400.0
    broken = replace(study, means=means, limits=largest_flows(means, study.case_speed))
    ranking = ranked_by(broken, *by_flow)
    assert [one.usual_alarms_kept for one in ranking] == [False] * 5 + [True] * 4
    shown = replace(broken, ranking={"as_published": ranking})
    answer = choice_text(shown, "as_published")
    assert answer[0].startswith(f"First choice for this patient: scheme {first}")
    assert answer[1].startswith("it breaks the machine's usual alarms; best of the schemes that keep them: ")
    assert f"scheme {ranking[5].letter} (" in answer[1]
    assert answer[1].endswith(", place 6")
    assert tables(shown)["ranking"]["usual_alarms_kept"].tolist() == [False] * 5 + [True] * 4
    means["Pcrrttuout"].loc[{}] = 400.0
    every = replace(broken, ranking={"as_published": ranked_by(replace(broken, means=means), *by_flow)})
    assert "as do all schemes with a place" in choice_text(every, "as_published")[1]


def test_a_rule_for_dialysis_ranks_by_clearance_and_an_unknown_quantity_is_refused():
    case = paper_case()
    crrt = {"flow_ml_min": 200.0, "access_site": "post_oxy", "return_site": "pre_oxy"}
    crrt |= {"dialysate_ml_h": 2000.0}
    case = type(case).model_validate({**case.model_dump(exclude_none=True), "crrt": crrt})
    rule = {"name": "dose", "criteria": [{"quantity": "clearance_urea", "prefer": "larger"}]}
    options = {"schemes": "g,h", "speeds": "3425", "volume_policy": "as_published"}
    study = crrt_study(case, **options, rule=rule)
    assert "clearance_urea" in study.ranking["as_published"][0].numbers
    result = study_object(study)
    assert result["rule"]["name"] == "dose"
    assert result["rule"]["in_words"] == ["clearance_urea: the larger"]
    rule["criteria"][0]["quantity"] = "clearance_ureas"
    with pytest.raises(RuleError, match=r"clearance_ureas.*did you mean clearance_urea\?"):
        crrt_study(case, **options, rule=rule)
    check_quantities(DEFAULT_RULE, ("recirculated_fraction", "past_oxygenator"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("nam = 'x'", r"nam = x: unknown key.*did you mean name"),
        ("[limits]\nacces_alarm = [0, 1]", r"is not a limit.*did you mean access_alarm"),
        ("[limits]\naccess_alarm = [5, 1]", r"low below high"),
        ("[limits]\naccess_190 = 150", r"access_190 = 150: allowed: \[low, high\] in mmHg"),
        ("[limits]\naccess_190 = [150]", r"access_190 = \[150\]: allowed: \[low, high\] in mmHg"),
        ("[limits]\naccess_190 = ['a', 150]", r"access_190 = a: allowed: \[low, high\] in mmHg"),
        ("[[criteria]]\nat_least = 0", r"criteria.0: quantity is missing"),
        ("criteria = []", r"one or more"),
        ("[[criteria]]\nquantity = 'alarms'", r"at_least or at_most, or prefer"),
        ("[[criteria]]\nquantity = 'alarms'\nprefer = 'bigger'", r"criteria.0.prefer = bigger: .*larger"),
        ("[[criteria]]\nquantity = 'PF'\nprefer = 'larger'\nstep = -1", r"zero or above"),
        ("[[criteria]]\nquantity = 'PF'\nat_least = 1\nstep = 0.5", r"a bound is compared unrounded"),
        ("[[criteria]]\nquantity = 'PF'\nat_least = 5\nat_most = 1", r"no value meets both"),
        ("[[criteria]]\nquantity = 'PF'\nat_least = nan", r"at_least = nan: allowed: finite numbers"),
        ("[[criteria]]\nquantity = 'PF'\nprefer = 'larger'\nstep = inf", r"step = inf: allowed: finite"),
        ("[[criteria]]\nquantity = 'PF'\nat_least = true", r"at_least = True: allowed: a number, not true"),
        ("[limits]\naccess_alarm = [true, 250]", r"access_alarm = True: allowed: \[low, high\] in mmHg"),
        ("criteria = ['alarms']", r"allowed: a table, \[\[criteria\]\] with quantity"),
        ("[[criteria", r"cannot be read as TOML"),
    ],
)
def test_mistakes_in_a_rule_are_said(tmp_path, content, message):
    file = tmp_path / "rule.toml"
    file.write_text(content)
    with pytest.raises(RuleError, match=message) as refused:
        read_rule(file)
    assert all(line.startswith(str(file)) for line in str(refused.value).splitlines())


def test_a_rules_file_that_is_missing_or_a_folder_is_said(tmp_path):
    with pytest.raises(RuleError, match=r"none\.toml: no such file$"):
        read_rule(tmp_path / "none.toml")
    with pytest.raises(RuleError, match=r": cannot be read: (Is a directory|Permission denied)$"):
        read_rule(tmp_path)


def test_a_rule_by_an_output_that_the_case_lacks_says_what_to_add():
    rule = read_rule({"name": "ours", "criteria": [{"quantity": "SaO2", "prefer": "larger"}]})
    with pytest.raises(RuleError, match=r"not computed for this case; .*; it needs \[gas\] in the case file"):
        check_quantities(rule, ("Psart", "PF", "MAP"))
    misspelt = read_rule({"name": "ours", "criteria": [{"quantity": "alarm", "prefer": "smaller"}]})
    with pytest.raises(RuleError, match=r"did you mean alarms"):
        check_quantities(misspelt, ("Psart", "PF", "MAP"))


def test_schemes_know_their_side_of_the_oxygenator():
    nine = nine_schemes()
    assert [k for k, s in nine.items() if s.returns_behind_oxygenator] == ["d", "e", "f"]
    assert [k for k, s in nine.items() if s.past_oxygenator] == ["e", "f"]


@pytest.mark.parametrize("site", ["pvn", "la", "lv", "ao", "sart", "arch", "descending", "upper", "lower"])
def test_a_return_line_in_the_left_heart_or_an_artery_has_no_trap_for_air_and_clots(site):
    """Nothing was said of such a scheme, while scheme d was said to have no trap."""
    (from_vein, from_artery) = select_schemes(f"svn:{site},post_oxy:{site}")
    assert from_vein.returns_behind_oxygenator
    assert from_artery.returns_behind_oxygenator
    assert from_vein.past_oxygenator, "nor are there lungs"
    assert not from_artery.past_oxygenator


@pytest.mark.parametrize("site", ["svn", "ra", "rv", "pas", "part", "svc", "ivc"])
def test_lungs_follow_a_return_line_in_a_vein_or_the_right_heart(site):
    (scheme,) = select_schemes(f"post_oxy:{site}")
    assert not scheme.returns_behind_oxygenator


def test_the_reasons_name_the_embolism_of_a_return_line_in_the_left_heart():
    schemes = "g,svn:lv,ra:ao"
    study = crrt_study(paper_case(), schemes=schemes, speeds="3425", volume_policy="as_published")
    reasons = {one.letter: "; ".join(one.reasons) for one in study.ranking["as_published"]}
    assert "returns to the left ventricle: air or clots from the CRRT go to the" in reasons["svn:lv"]
    assert "returns to the aorta" in reasons["ra:ao"]
    assert "embolism" not in reasons["g"]
    assert "carries venous blood past oxygenator and lungs: 5.2 % of what" in reasons["svn:lv"]


def test_limits_that_break_nowhere_are_no_rank(study):
    """Flows at the last speed studied are no limits: schemes that keep theirs to the end tie."""
    limits = study.limits.copy(deep=True)
    at = {"policy": "as_published", "limit": "crrt"}
    for letter, flow in (("d", 3.43), ("e", 3.47), ("g", 3.41)):
        limits["state"].loc[at | {"scheme": letter}] = "kept_to_the_end"
        for name in ("largest_flow", "flow_at_most"):
            limits[name].loc[at | {"scheme": letter}] = flow
    ranking = ranked_by(replace(study, limits=limits), Criterion("largest_flow", prefer="larger", step=0.1))
    places = {one.letter: one.rank for one in ranking}
    assert {places[letter] for letter in "deg"} == {1}
    assert min(places[letter] for letter in "abcfhi") == 4, "any flow at which a limit breaks is behind"
    assert next(one for one in ranking if one.letter == "e").largest_flow == 3.47


def test_the_usual_rule_knows_of_blood_past_the_oxygenator(study):
    order = [one.letter for one in study.ranking["as_published"]]
    assert order[:5] == ["d", "g", "a", "e", "f"]
    by = next(one.decided_by for one in study.ranking["as_published"] if one.letter == "e")
    assert by == "carries less of the ECMO's blood past the oxygenator, rounded to 1 %"
    answer = choice_text(study, "as_published")
    assert answer[-1] == (
        "best of the schemes that return before the oxygenator: scheme g (post oxygenator – pre oxygenator), "
        "place 2"
    )


def test_a_step_says_that_it_rounds():
    assert Criterion("PF", prefer="larger", step=0.1).sentence == "PF: the larger, rounded to 0.1"
    sentence = next(c.sentence for c in DEFAULT_RULE.criteria if c.quantity == "largest_flow")
    assert "rounded to 0.1 L/min" in sentence


def test_a_limit_of_a_centre_has_its_own_words(study):
    rule = read_rule({"name": "our centre", "limits": {"access_190": [None, 150.0]}})
    sentences = [criterion.sentence for criterion in rule.criteria]
    assert "keeps the access pressure below 150 mmHg at this speed" in sentences
    assert not any("190" in sentence for sentence in sentences)
    assert read_rule(json.loads(json.dumps(rule.as_object()))).limits == rule.limits
    limits = study.limits.copy(deep=True)
    limits["margin"].loc[{"limit": "access_190"}] = study.limits["margin"].sel(limit="access_190") - 40.0
    ranking = ranked_by(replace(study, limits=limits), *rule.criteria, limits=rule.limits)
    reasons = " ".join(next(one.reasons for one in ranking if one.letter == "a"))
    assert "access pressure above 150 mmHg, the limit of own" in reasons
    assert "early failure" not in reasons
    usual = next(limit for limit in rule.limits if limit.name == "access_alarm")
    assert usual.meaning == "usual alarms of the access line"
    assert "Sansom" not in next(limit.meaning for limit in rule.limits if limit.name == "access_190")


def test_venous_blood_of_the_patient_passes_the_oxygenator_too():
    (scheme,) = select_schemes("svn:post_oxy")
    assert scheme.past_oxygenator
    assert not select_schemes("ao:post_oxy")[0].past_oxygenator
