"""Courses: events are hit exactly, blood balances, moments are steady beats, an end has its reason."""

import json
from pathlib import Path

import numpy as np
import pytest

import eclsim
from eclsim.cases import read_case
from eclsim.course.alarms import alarms
from eclsim.course.beats import course_beats
from eclsim.course.course import course, course_many, default_interval_min
from eclsim.course.engine import CourseOptions
from eclsim.course.files import course_object
from eclsim.devices.description import Finding
from eclsim.inputs.mistakes import CaseError
from eclsim.orbit.model import model_of
from eclsim.outputs.uncertainty import NOT_THE_MEASURED
from eclsim.slow import SlowLaw, SlowState
from small_patient import PATIENT

VV_GAS = Path(__file__).parents[2] / "examples" / "veno_venous_gas.toml"
WITH_FLUID = f"""{PATIENT}[fluid]
capillary_refill = false
"""
EVENTS = """
[[events]]
at_min = 10
give = { blood_ml = 200 }
over_min = 20
[[events]]
at_min = 40
set = { Rmc = 1.0 }
ramp_min = 10
[[events]]
at_min = 55
set = { Rmc = 0.9, "patient.heart_rate_bpm" = 90 }
"""


def case(tmp_path, events="", settings=()):
    file = tmp_path / "case.toml"
    file.write_text(WITH_FLUID + events)
    return read_case(file, settings).case


@pytest.fixture(scope="module")
def hour(tmp_path_factory):
    return course(case(tmp_path_factory.mktemp("hour"), EVENTS), minutes=60.0, every_min=5.0)


def test_without_events_every_moment_is_the_steady_beat(tmp_path):
    own = case(tmp_path)
    result = course(own, minutes=30.0, every_min=10.0, outputs=("MAP", "CO"))
    expected = eclsim.simulate(own)
    for name in ("MAP", "CO"):
        np.testing.assert_allclose(result[name], float(expected[name]), rtol=1e-6)
    assert result.attrs["converged"] == 1


def test_moments_are_regular_and_at_every_event(hour):
    minutes = hour["time_min"].to_numpy()
    assert set(np.arange(0.0, 61.0, 5.0)) <= set(minutes)
    assert {10.0, 30.0, 40.0, 50.0, 55.0} <= set(minutes)
    assert pytest.approx(minutes[np.searchsorted(minutes, 55.0) - 1]) == 55.0 - 1.0 / 60.0


def test_what_is_given_is_there_and_blood_balances(hour):
    balance = json.loads(hour.attrs["balance"])
    assert balance["given_ml"] == pytest.approx(200.0, abs=1e-6)
    assert abs(balance["error_ml"]) < 1e-6
    given = hour["fluid.given_ml"].sel(time_min=[10.0, 20.0, 30.0, 60.0]).to_numpy()
    np.testing.assert_allclose(given, [0.0, 100.0, 200.0, 200.0], atol=1e-6)


def test_a_ramp_and_a_sudden_change_are_those_of_a_steady_beat_there(tmp_path):
    start = model_of(case(tmp_path)).values["Rmc"]
    result = course(case(tmp_path, EVENTS.partition("over_min = 20")[2]), minutes=60.0, every_min=5.0)
    at_45 = eclsim.simulate(case(tmp_path, settings=[f"Rmc={0.5 * (start + 1.0)!r}"]))
    assert result["MAP"].sel(time_min=45.0).item() == pytest.approx(float(at_45["MAP"]), abs=1e-5)
    before = eclsim.simulate(case(tmp_path, settings=["Rmc=1.0"]))
    assert result["MAP"].values[-3] == pytest.approx(float(before["MAP"]), abs=1e-5)
    at_55 = eclsim.simulate(case(tmp_path, settings=["Rmc=0.9", "patient.heart_rate_bpm=90"]))
    assert result["CO"].sel(time_min=55.0).item() == pytest.approx(float(at_55["CO"]), abs=1e-6)


class FailingHeart(SlowLaw):
    """A contractility that falls to zero in half an hour, and has no value behind."""

    states = (SlowState("heart.used", "1", "use of the heart", 0.05),)
    reads = ()

    def start(self, settings, beat):
        return {"heart.used": np.zeros_like(settings["Emaxlv"])}

    def in_effect(self, states, settings):
        return {"Emaxlv": settings["Emaxlv"] * (1.0 - states["heart.used"])}

    def rates(self, states, settings, beat, inflows):
        return {"heart.used": np.full_like(states["heart.used"], 1.0 / 1800.0)}


@pytest.mark.parametrize("reads", [(), ("MAP",)], ids=["seen in moments", "seen in steps"])
def test_an_end_has_its_reason_and_what_came_before_is_kept(tmp_path, monkeypatch, reads):
    def laws(circuit, settings):
        FailingHeart.reads = reads
        return (FailingHeart(),)

    monkeypatch.setattr("eclsim.course.course.laws_of", laws)
    result = course(case(tmp_path), minutes=60.0, every_min=10.0, outputs=("MAP", "CO"))
    assert result.attrs["converged"] == 0
    assert result.attrs["message"].startswith("stopped at 00:")
    assert "a value is not allowed" in result.attrs["message"]
    assert "Emaxlv" in result.attrs["message"]
    assert np.isfinite(result["MAP"]).all()
    assert list(result["time_min"][:3]) == [0.0, 10.0, 20.0]
    assert 29.7 < float(result["time_min"][-1]) < 30.1
    assert course_object(result)["warnings"][0].startswith("stopped at 00:")


def test_an_event_after_the_end_is_refused(tmp_path):
    with pytest.raises(CaseError, match=r"events\[3\].at_min = 55: after the end of the course at 50 min"):
        course(case(tmp_path, EVENTS), minutes=50.0)


@pytest.mark.slow
def test_side_by_side_or_alone_is_the_same(tmp_path, hour):
    changes = {"Emaxlv": [2.0, 1.5]}
    two = course_many(case(tmp_path, EVENTS), changes, minutes=60.0, every_min=20.0, outputs=("MAP",))
    single = course(case(tmp_path, EVENTS, ["Emaxlv=1.5"]), minutes=60.0, every_min=20.0, outputs=("MAP",))
    np.testing.assert_allclose(two[1]["MAP"], single["MAP"], rtol=1e-6)
    assert two[0]["MAP"].values[0] > two[1]["MAP"].values[0]


def test_the_object_has_what_the_contract_says(hour):
    result = course_object(hour)
    assert {
        "id",
        "converged",
        "time_min",
        "outputs",
        "balance",
        "events",
        "warnings",
        "seconds",
    } <= result.keys()
    assert len(result["outputs"]["MAP"]) == len(result["time_min"])
    assert result["events"][0] == {"at_min": 10.0, "give": {"blood_ml": 200.0}, "over_min": 20.0}


def test_the_usual_moments_are_round():
    assert [default_interval_min(minutes) for minutes in (10.0, 60.0, 1440.0, 7 * 1440.0)] == [
        0.1,
        0.5,
        10.0,
        120.0,
    ]


def test_the_figure_shows_every_event(hour, tmp_path):
    from eclsim.course.figures import plot_course

    fig = plot_course(hour)
    assert "blood 200 mL over 20 min" in fig._supxlabel.get_text()
    panels = {ax.get_title(loc="left"): ax for ax in fig.axes}
    assert "Arterial pressure" in panels
    assert np.diff(panels["Fluid and blood"].get_ylim()) > 100.0


def test_the_figure_has_the_units_of_events_and_says_where_remarks_are(hour):
    """ "drugs.noradrenaline = 0.2" had no unit, and nothing pointed to how the course is to be read."""
    from eclsim.course.figures import plot_course

    events = [
        {"at_min": 5.0, "set": {"drugs.noradrenaline": 0.2, "crrt.access_site": "svn", "gas.FiO2": 0.4}}
    ]
    attrs = {"events": json.dumps(events), "approximations": ["one"], "cautions": ["two", "three"]}
    words = plot_course(hour.assign_attrs(attrs))._supxlabel.get_text()
    assert "drugs.noradrenaline = 0.2 µg/kg/min, crrt.access_site = " in words
    assert words.endswith("3 remarks on how to read this course: `warnings` in its JSON file, "
                          "`approximations` and `cautions` in its NetCDF file")  # fmt: skip
    none = plot_course(hour.assign_attrs(approximations=[], cautions=[]))._supxlabel.get_text()
    assert "how to read this course" not in none


def test_numbers_of_events_minutes_apart_are_joined(hour):
    """Those of events at 60, 62 and 64 minutes of 10 hours lay on each other."""
    from eclsim.course.figures import joined_numbers, plot_course

    places = [0.5, 1.0, 62 / 60, 64 / 60, 3.0, 400 / 60]
    assert joined_numbers(places, 10.0) == [(0.5, "1"), (1.0, "2–4"), (3.0, "5"), (400 / 60, "6")]
    assert joined_numbers([10.0, 20.0], 60.0) == [(10.0, "1"), (20.0, "2")]
    events = [{"at_min": at, "set": {"Emaxlv": 1.0}} for at in (10.0, 10.5, 11.0, 40.0, 900.0)]
    figure = plot_course(hour.assign_attrs(events=json.dumps(events)))
    numbers = [text for text in figure.axes[0].texts if text.get_text()]
    assert [text.get_text() for text in numbers] == ["1–3", "4"]


def test_a_course_of_another_patient_than_the_measured_one_says_so_above_the_figure(hour):
    """Of "MPAP 26 measured, 13.96 here" the figure said only that there were 3 remarks."""
    from eclsim.course.figures import plot_course

    doubt = f"the beat at 00:00 {NOT_THE_MEASURED} (MPAP 26 measured, 13.96 here): the case is as written"
    fig = plot_course(hour.assign_attrs(approximations=["one"], cautions=["two", doubt]))
    assert " ".join(fig.get_suptitle().splitlines()[1:]) == doubt
    assert "2 remarks on how to read this course" in fig.get_supxlabel()


def test_outputs_to_be_read_with_care_have_a_dagger(hour):
    """The warnings said not to read the wedge pressure as a patient's; its curve looked like any other."""
    from eclsim.course.figures import plot_course
    from eclsim.course.result import mark_read_with_care

    shown = hour.copy(deep=True)
    caution = Finding.without_limit("caution", "PCWP", 5.0, "do not read it", "PCWP", "EDVLV", "unknown")
    mark_read_with_care(shown, [[], [caution]])
    fig = plot_course(shown)
    labels = {text.get_text() for ax in fig.axes for text in ax.get_legend().get_texts()}
    assert {"wedge †", "left, end-diastolic †", "right, end-diastolic"} <= labels
    assert "† to be read with care; the warnings of the results say why" in fig.get_supxlabel()


def test_the_outputs_that_a_caution_concerns_are_known_from_the_course(tmp_path):
    """Blood of V-A ECMO returns to the arteries."""
    pump = {"pump": "Rotaflow", "oxygenator": "Quadrox-i Adult", "mode": "VA", "speed_rpm": 3425}
    of_ecmo = case(tmp_path, settings=[f"ecmo.{key}={value}" for key, value in pump.items()])
    result = course(of_ecmo, minutes=10.0, every_min=10.0)
    marked = {str(name) for name, values in result.data_vars.items() if values.attrs.get("read_with_care")}
    assert {"PCWP", "EDVLV"} <= marked
    assert "MAP" not in marked


def test_doubts_about_the_fit_stand_above_the_figure(hour):
    from eclsim.course.figures import plot_course

    doubt = "its parameters are a DOUBTFUL fit of eclsim identify: see why in its report"
    fig = plot_course(hour.assign_attrs(warnings=[doubt, *hour.attrs["warnings"]]))
    assert fig.get_suptitle().splitlines()[1:] == [doubt]
    assert "DOUBTFUL" not in fig.get_supxlabel()


@pytest.mark.slow
def test_no_legend_of_a_course_or_a_band_runs_beyond_the_page(hour):
    """In a band, "right, end-diastolic" ended in the middle of the word, at the edge of the page."""
    from eclsim.course.figures import plot_course

    fig = plot_course(hour)
    fig.draw_without_rendering()
    for ax in fig.axes:
        end = ax.get_legend().get_window_extent().x1
        assert end <= fig.bbox.x1, (ax.get_title(loc="left"), end, fig.bbox.x1)
        assert end <= ax.get_window_extent().x1 + 0.02 * fig.bbox.x1, ax.get_title(loc="left")


def test_the_figure_shades_beats_that_no_patient_can_have(hour):
    """An LVAD that emptied the ventricle to -50 mL was drawn like any other curve."""
    from matplotlib.colors import to_rgba

    from eclsim.course.figures import impossible_spans, plot_course

    marked = np.zeros(hour.sizes["time_min"], dtype=int)
    marked[3:5] = 1
    shaded = hour.assign(impossible=("time_min", marked))
    minute = hour["time_min"].to_numpy()
    assert impossible_spans(shaded) == [(minute[3], minute[5])]
    assert impossible_spans(hour) == []
    fig = plot_course(shaded)
    assert "grey areas: beats that no patient can have" in fig._supxlabel.get_text()
    assert all(any(p.get_facecolor() == to_rgba("0.85") for p in ax.patches) for ax in fig.axes)


def test_rounding_is_no_curve_in_the_figure(tmp_path):
    from eclsim.course.figures import plot_course

    rest = course(case(tmp_path), minutes=60.0, every_min=20.0, outputs=("MAP",))
    spread = 1e-9 * np.arange(rest.sizes["time_min"])
    rest = rest.assign({name: rest[name] + spread for name in ("haematocrit", "fluid.refilled_ml")})
    panels = {ax.get_title(loc="left"): ax for ax in plot_course(rest).axes}
    assert np.diff(panels["Haematocrit"].get_ylim()) == pytest.approx(0.005)
    assert np.diff(panels["Fluid and blood"].get_ylim()) == pytest.approx(2.0)


def test_a_limit_that_is_another_number_each_moment_is_one_alarm():
    text = "CO 0.20 L/min is above the flow {:.2f} L/min"
    of_moments = [[Finding("warning", "CO", 0.2, flow, text.format(flow))] for flow in (0.1, 0.12)]
    (result,) = alarms(of_moments, {}, np.arange(2.0))
    assert (result.at_min, result.until_min) == (0.0, None)


def _pressures(wedge, filling):
    """Findings of moments with these pressures, as beats have them: one of outputs that say the same."""
    limits = (("PCWP", "warning", wedge, 18.0), ("end_diastolic_pressure_lv", "warning", filling, 16.0))
    of_moments = []
    for k in range(len(wedge)):
        said = [
            Finding(kind, name, v[k], most, f"{name}: high") for name, kind, v, most in limits if v[k] > most
        ]
        of_moments.append(said[:1])
    outputs = {"PCWP": np.array(wedge), "end_diastolic_pressure_lv": np.array(filling)}
    return {one.quantity: (one.at_min, one.until_min) for one in alarms(of_moments, outputs, np.arange(4.0))}


def test_an_alarm_lasts_as_long_as_its_limit_is_broken_whatever_else_is_named_meanwhile():
    """Of outputs that say the same a beat names one, the wedge pressure before the ventricle's."""
    lasting = _pressures([20.0, 20.0, 20.0, 10.0], [26.0, 26.0, 26.0, 26.0])
    assert lasting == {"PCWP": (0.0, 2.2), "end_diastolic_pressure_lv": (0.0, None)}


def test_of_alarms_that_say_the_same_the_longest_is_named():
    venous = {"right_atrial_pressure": [10.0, 13.0, 13.0, 10.0], "venous_pressure": [14.0, 14.0, 14.0, 14.0]}
    named = ("venous_pressure", "right_atrial_pressure", "right_atrial_pressure", "venous_pressure")
    of_moments = [[Finding("warning", n, venous[n][k], 12.0, "high")] for k, n in enumerate(named)]
    (one,) = alarms(of_moments, {n: np.array(v) for n, v in venous.items()}, np.arange(4.0))
    assert (one.quantity, one.at_min, one.until_min) == ("venous_pressure", 0.0, None)


def test_a_limit_broken_in_a_beat_is_so_from_the_start_of_that_beat():
    """What a pump does after it was stopped at 00:01:00 does not stand before it."""
    of_moments = [
        [],
        [],
        [Finding("alarm", "PF", -0.8, 0.0, "ECMO pump flow -0.8 L/min is below 0 L/min: clamp it")],
    ]
    flows, minutes = {"PF": np.array([3.7, 3.7, -0.8])}, np.array([118.0, 119.0, 120.0]) / 120.0
    (beats,) = alarms(of_moments, flows, minutes, np.ones(3, dtype=bool))
    assert beats.at_min == 1.0
    assert "at 00:01:00" in beats.sentence
    (steady,) = alarms(of_moments, flows, 10.0 * minutes)
    assert 10.0 * minutes[1] < steady.at_min < 10.0, "between steady beats it is crossed in between"
    (sudden,) = alarms(of_moments, flows, np.array([4.0, 5.0 - 1.0 / 60.0, 5.0]))
    assert sudden.at_min == 5.0, "a moment stands a second before what is sudden, the alarm does not"


SWEEP = '[[events]]\nat_min = 5\nset = { "ecmo.sweep_l_min" = %s }\n'
OF_GASES = ("SaO2", "PaCO2")


@pytest.mark.slow
def test_a_sweep_that_stops_takes_its_time_or_a_warning_says_that_it_does_not(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(VV_GAS.read_text() + SWEEP % 0)
    every = course_beats(file, minutes=16.0, outputs=OF_GASES, every_min=0.02)
    result = course(file, minutes=16.0, every_min=2.0, outputs=OF_GASES)
    (span,) = json.loads(result.attrs["spans"])
    assert span["from_min"] == 5.0
    assert span["reason"].startswith("SaO2 goes from 97 to 2")
    shown = result["time_min"].to_numpy()
    shown = shown[(shown < 15.7) & ((shown < 5.0) | (shown > 5.5))]
    for name, bar in (("SaO2", 0.5), ("PaCO2", 0.2)):
        distance = np.interp(shown, every["time_min"], every[name]) - np.interp(
            shown, result["time_min"], result[name]
        )
        assert np.abs(distance).max() < bar
    assert float(np.interp(6.0, result["time_min"], result["SaO2"])) > 50.0
    assert "at 00:05:" in next(line for line in result.attrs["warnings"] if "below 80 %" in line)
    single = CourseOptions(hand_over=False)
    steady = course(file, minutes=16.0, every_min=2.0, outputs=OF_GASES, options=single)
    (message,) = [line for line in steady.attrs["warnings"] if "at once" in line]
    assert message.startswith("at 00:05 steady beats run ahead: SaO2 goes from 97 to 2")


@pytest.mark.slow
def test_a_sweep_that_comes_back_is_followed_until_its_blood_has_come_too(tmp_path):
    """The span went by how far the first event's goal was, and its end had the settings of that event."""
    file = tmp_path / "case.toml"
    back = SWEEP.replace("at_min = 5", "at_min = 8") % 2
    file.write_text(VV_GAS.read_text() + SWEEP % 0 + back)
    every = course_beats(file, minutes=14.0, outputs=OF_GASES, every_min=0.02)
    result = course(file, minutes=16.0, every_min=2.0, outputs=OF_GASES)
    time, saturation = result["time_min"].to_numpy(), result["SaO2"].to_numpy()
    (span,) = json.loads(result.attrs["spans"])
    assert 10.0 < span["until_min"] < 16.0
    shown = (time < 13.9) & ((time < 5.0) | (time > 5.5))
    distance = np.interp(time[shown], every["time_min"], every["SaO2"]) - saturation[shown]
    assert np.abs(distance).max() < 1.0
    (end,) = saturation[np.abs(time - span["until_min"]) < 1e-6]
    assert end == pytest.approx(saturation[time > span["until_min"] + 1e-6][0], abs=0.5)


@pytest.mark.slow
def test_a_sweep_that_changes_little_stays_with_steady_beats(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(VV_GAS.read_text() + SWEEP % 1.9)
    quiet = course(file, minutes=8.0, every_min=2.0, outputs=OF_GASES)
    assert json.loads(quiet.attrs["spans"]) == []
    assert not [line for line in quiet.attrs["warnings"] if "at once" in line]


@pytest.mark.slow
def test_without_any_oxygen_a_patient_is_followed_and_the_course_ends(tmp_path):
    """No steady beat is ahead: a loop of blood that passes no lung."""
    file = tmp_path / "case.toml"
    file.write_text(VV_GAS.read_text() + (SWEEP % 0).replace("}", ', "gas.shunt_fraction" = 1 }'))
    result = course(file, minutes=60.0, every_min=2.0, outputs=OF_GASES)
    assert not result.attrs["converged"]
    assert "no steady gas state" in result.attrs["message"]
    saturation = result["SaO2"].to_numpy()
    assert np.isfinite(saturation).all()
    assert saturation[-1] < 1.0 < 50.0 < float(np.interp(5.7, result["time_min"], saturation))
    assert 14.5 < float(result["time_min"][-1]) < 15.1


def test_what_is_connected_is_not_ramped(tmp_path):
    """A reflex that was not there would start at its set point's default, not at nothing."""
    event = '[[events]]\nat_min = 5\nset = { "regulation.baroreflex" = 1.0 }\nramp_min = 20\n'
    with pytest.raises(CaseError, match=r"events\[1\]\.ramp_min = 20: connects or disconnects part"):
        course(case(tmp_path, event), minutes=30.0)
