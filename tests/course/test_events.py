"""Events of a case file: what is wrong with them is said all at once, one line each."""

import re

import pytest

from eclsim.cases import Case, read_case
from eclsim.cases.reading import case_text, read_mapping
from eclsim.circuit.volumes import start_volume
from eclsim.course.beats import course_beats
from eclsim.course.course import course
from eclsim.course.timeline import Change, Timeline
from eclsim.inputs.mistakes import CaseError
from eclsim.parameters.fluid import sets_initial_value
from small_patient import ON_ECMO


@pytest.mark.parametrize("minutes", [0.0, -3.0, float("nan"), float("inf"), 1e9])
def test_a_course_needs_a_length(tmp_path, minutes):
    (tmp_path / "case.toml").write_text(ON_ECMO)
    with pytest.raises(
        CaseError, match=re.escape(f"minutes = {minutes:g}; allowed: a length above 0 min, up to 44640 min")
    ):
        course(tmp_path / "case.toml", minutes=minutes)


def mistakes(tmp_path, events):
    file = tmp_path / "case.toml"
    file.write_text(ON_ECMO + events)
    with pytest.raises(CaseError) as error:
        read_case(file)
    return [str(mistake).removeprefix(str(file)) for mistake in error.value.mistakes]


@pytest.mark.parametrize(
    ("event", "message"),
    [
        ('at_min = 30\nset = { "ecmo.speed_rmp" = 3000 }', "did you mean ecmo.speed_rpm?"),
        ("at_min = 30\nset = { Rmcc = 1 }", "events[1].set.Rmcc = 1: unknown key"),
        ('at_min = 30\nset = { "ecmo.speed_rpm" = 30000 }', "outside the allowed range"),
        ('at_min = 30\nset = { "crrt.net_ultrafiltration_ml_h" = 9000 }', "together below 7812 mL/h"),
        ("at_min = 30\ngive = { bleed_ml = 9000 }", "more blood than the patient has; allowed: below 49"),
        ("at_min = 30\ngive = { crystaloid_ml = 500 }", "did you mean crystalloid_ml?"),
        ("at_min = 30\ngive = { blood_ml = -5 }", "did you mean bleed_ml = 5?"),
        ("at_min = -1\ngive = { blood_ml = 5 }", "events[1].at_min = -1: outside the allowed range"),
        (
            'at_min = "2 h"\ngive = { blood_ml = 5 }',
            "in h, but at_min is in min; allowed: 0 to 44640 min; did you mean 2 h = 120 min?",
        ),
        (
            'at_min = 3\ngive = { blood_ml = "0.5 L" }',
            "in L, but blood_ml is in mL; allowed: 0 to 20000 mL; did you mean 0.5 L = 500 mL?",
        ),
        ("set = { Rmc = 1 }", "events[1].at_min: missing"),
        ("at_min = 3", "events[1]: nothing happens"),
        ("at_min = 3\nat_mn = 4\nset = { Rmc = 1 }", "did you mean at_min?"),
        ("at_min = 3\nover_min = 4\nset = { Rmc = 1 }", "over_min = 4: is allowed only with give"),
        ('at_min = 3\nramp_min = 4\nset = { "ecmo.drainage_site" = "svn" }', "only numbers change"),
        ('at_min = 3\nset = { "patient.id" = "Q" }', "has no effect on a course"),
        ('at_min = 3\nset = { "crrt.haematocrit_in" = 0.3 }', "is a value at the start of the course"),
        (
            'at_min = 3\nset = { "ecmo.flow_l_min" = 3 }',
            "a course keeps the pump's speed, not its flow; set the speed",
        ),
    ],
)
def test_a_mistake_is_one_line_with_key_and_way_out(tmp_path, event, message):
    (line,) = mistakes(tmp_path, f"[[events]]\n{event}\n")
    assert message in line
    assert line.startswith(":")  # the line of the file is there


def test_more_blood_than_there_is_blames_no_event_behind_it(tmp_path):
    """The event behind was refused too, with "allowed: below -3808 mL"."""
    events = """[[events]]
at_min = 10
give = { bleed_ml = 9000 }
[[events]]
at_min = 30
give = { blood_ml = 500, bleed_ml = 0 }
"""
    (line,) = mistakes(tmp_path, events)
    assert "events[1].give.bleed_ml = 9000" in line


def test_order_and_overlap_are_said_with_everything_else(tmp_path):
    events = """[[events]]
at_min = 30
set = { Rmc = 1.2 }
ramp_min = 10
[[events]]
at_min = 35
set = { Rmc = 1.0 }
[[events]]
at_min = 20
give = { blod_ml = 5 }
"""
    first, second, third = mistakes(tmp_path, events)
    assert "events[2].at_min = 35: overlaps the change of Rmc from 30 to 40 min" in first
    assert "out of order: the event before is at 35 min" in second
    assert "blood_ml" in third


@pytest.mark.parametrize("event", [{"at_min": 10**400}, {"at_min": 5, "give": {"bleed_ml": -(10**400)}}])
def test_a_number_beyond_all_floats_is_refused(event):
    patient = {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 80}
    with pytest.raises(CaseError, match="more than 60 digits"):
        read_mapping({"format": 1, "patient": patient, "events": [event]})


def test_a_change_may_follow_another_of_its_key(tmp_path):
    file = tmp_path / "case.toml"
    one = "[[events]]\nat_min = {}\nset = {{ Rmc = 1.2 }}\nramp_min = 10\n"
    file.write_text(ON_ECMO + one.format(30) + one.format(40))
    case = read_case(file).case
    assert [event.at_min for event in case.events] == [30.0, 40.0]
    assert case.events[0].set == {"Rmc": 1.2}


def test_a_case_with_events_is_written_and_read_back(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(ON_ECMO + "[[events]]\nat_min = 5\ngive = { bleed_ml = 100 }\n")
    case = read_case(file).case
    file.write_text(case_text(case))
    assert read_case(file).case == case
    assert Case.model_validate(case.as_mapping()) == case
    assert case.at_rest().events == ()


@pytest.mark.parametrize(
    ("key", "refused"),
    [("renox.haematocrit_in", True), ("crrt.a.haematocrit_in", True), ("renox.dialysate_ml_h", False)],
)
def test_the_haematocrit_at_any_filter_says_how_a_course_starts(key, refused):
    assert sets_initial_value(key) is refused


def test_a_first_event_before_the_start_is_one_mistake(tmp_path):
    (only,) = mistakes(tmp_path, "[[events]]\nat_min = -5\nset = { Rmc = 1.2 }\n")
    assert "at_min = -5: outside the allowed range" in only


def test_what_is_doubtful_in_a_case_file_is_doubtful_in_an_event(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(ON_ECMO + '[[events]]\nat_min = 5\nset = { "drugs.noradrenaline" = 2.5 }\n')
    (doubt,) = [warning for warning in read_case(file).warnings if "noradrenaline" in str(warning)]
    assert "beyond the usual 1 ug/kg/min" in str(doubt)


@pytest.mark.parametrize(("bled", "doubted"), [(1500, False), (2500, True), (4900, True)])
def test_a_loss_that_is_soon_fatal_is_doubted_before_anything_is_computed(tmp_path, bled, doubted):
    """4.9 of 4.93 L were accepted without a word; only the beats after it were marked impossible."""
    file = tmp_path / "case.toml"
    file.write_text(f"{ON_ECMO}[[events]]\nat_min = 5\ngive = {{ bleed_ml = {bled} }}\n")
    lines = [str(warning) for warning in read_case(file).warnings if "bleed_ml" in str(warning)]
    assert [f"events[1].give.bleed_ml = {bled}: leaves " in line for line in lines] == [True] * doubted


def test_what_goes_on_past_the_end_of_a_course_is_said(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(
        ON_ECMO
        + "[[events]]\nat_min = 5\ngive = { crystalloid_ml = 500 }\nover_min = 20\n"
        + "[[events]]\nat_min = 6\nset = { Rmc = 1.2 }\nramp_min = 8\n"
    )
    case = read_case(file).case
    gift, ramp = Timeline(case, 10 * 60.0).cut_short()
    assert gift.endswith(
        "continues past the end of the course at 10 min, which covers only 125 of 500 mL crystalloid"
    )
    assert ramp.endswith("which covers only 50 % of the ramp of Rmc")
    assert Timeline(case, 25 * 60.0).cut_short() == []


def test_wider_veins_hold_what_they_held(tmp_path):
    """An event on a compliance filled it to the pressure of the start: 30 % more of Csvn gave 25 mL."""
    file = tmp_path / "case.toml"
    file.write_text(ON_ECMO + "[[events]]\nat_min = 5\nset = { Csvn = 26.65, Csart = 1.2 }\n")
    timeline = Timeline(read_case(file).case, 10 * 60.0)
    (circuit, before), after = timeline.start, timeline.settings(1, 400.0)
    assert (before["Csvn"], after["Csvn"]) == (20.5, 26.65)
    stretching = [
        sum(start_volume(c, values) for c in circuit.compartments) - values["unstressed_volume_ml"]
        for values in (before, after)
    ]
    assert stretching[1] == pytest.approx(stretching[0], abs=1e-9)
    assert after["Csart"] == 1.2


@pytest.mark.slow
def test_pressures_fall_in_wider_veins_with_steady_beats_as_beat_by_beat(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(ON_ECMO + "[[events]]\nat_min = 1\nset = { Csvn = 26.65 }\n")
    steady = course(file, minutes=3.0, every_min=0.5, outputs=["venous_pressure", "MAP"])
    beats = course_beats(file, minutes=3.0, every_min=0.5, outputs=["venous_pressure", "MAP"])
    for name, bar in (("venous_pressure", 0.1), ("MAP", 0.5)):
        end, as_beats = float(steady[name][-1]), float(beats[name][-1])
        assert end == pytest.approx(as_beats, abs=bar)
        assert end < 0.99 * float(steady[name][0])


@pytest.mark.slow
def test_what_is_solved_for_with_the_gases_is_changed_by_no_ramp(tmp_path):
    """Its parameter is NaN until then, and NaN is not itself: every event within a ramp was refused."""
    organs = "[gas]\n[regulation]\nhypoxic_vasodilation = 1.0\n"
    ramp = '[[events]]\nat_min = 2\nset = { "ecmo.sweep_l_min" = 1.0 }\nramp_min = 6\n'
    within = "[[events]]\nat_min = 4\nset = { Rmc = 1.2 }\n"
    (tmp_path / "case.toml").write_text(ON_ECMO + organs + ramp + within)
    sweep, resistance = Timeline(read_case(tmp_path / "case.toml").case, 600.0).changes
    assert set(sweep.after) == {"ecmo.sweep_l_min"}
    assert set(resistance.after) == {"Rmc"}


def test_a_sudden_change_is_whole_at_a_time_rounded_to_just_before_it():
    """A plan that ended after 2.77 h ended with a division by zero."""
    begin = 9999.99951
    change = Change(begin, begin, {"a": 0.0}, {"a": 1.0}, None)
    assert change.share(round(begin, 3) - 1e-6) == 1.0
    ramp = Change(begin, begin + 10.0, {"a": 0.0}, {"a": 1.0}, None)
    assert ramp.share(begin - 1e-3) == 0.0
    assert ramp.share(begin + 5.0) == pytest.approx(0.5)
