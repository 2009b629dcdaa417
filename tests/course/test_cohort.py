"""Courses of a cohort and of draws: as followed side by side, resumable, what failed said."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import eclsim.course.cohort as cohort
from eclsim.cases import read_case
from eclsim.cases.events import Event
from eclsim.cases.fit_mark import with_mark
from eclsim.cli.course import _cohort_text
from eclsim.course.band import band_object, band_of, course_band
from eclsim.course.course import course_many
from eclsim.course.files import write_band_tables, write_courses
from eclsim.course.timeline import Timeline
from eclsim.execution import Distribution, ExecutionError, Shard, ShardDone
from eclsim.inputs.mistakes import CaseError
from small_patient import ON_ECMO, PATIENT

EVENTS = "[[events]]\nat_min = 2\ngive = { blood_ml = 100 }\nover_min = 4\n"
CHOSEN = {"minutes": 10.0, "every_min": 5.0}


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    file, read = tmp_path_factory.mktemp("cohort") / "case.toml", []
    for text, setting in ((PATIENT, "Rmc=0.9"), (PATIENT, "Rmc=1.1"), (ON_ECMO, "ecmo.speed_rpm=2500")):
        file.write_text(text + EVENTS)
        read.append(read_case(file, [setting]).case)
    unreachable = ON_ECMO.replace("speed_rpm = 3000", "flow_l_min = 7.9")
    file.write_text(unreachable + EVENTS)
    return [*read, read_case(file).case]


@pytest.fixture(scope="module")
def whole(cases):
    return cohort.course_cohort(cases, **CHOSEN)


def same(one, other):
    return all(
        a.drop_attrs().identical(b.drop_attrs()) and a.attrs["balance"] == b.attrs["balance"]
        for a, b in zip(one, other, strict=True)
    )


@pytest.mark.slow
def test_a_cohort_is_what_is_followed_side_by_side(cases, whole):
    plain = course_many(cases[:3], **CHOSEN)
    for own, other in zip(whole[:3], plain, strict=True):
        np.testing.assert_array_equal(own["MAP"], other["MAP"])
        assert own.attrs["warnings"] == other.attrs["warnings"]
        assert own["MAP"].attrs == other["MAP"].attrs


@pytest.mark.slow
def test_a_patient_who_cannot_begin_says_why_and_stops_no_other(whole, tmp_path):
    lost = whole[3]
    assert lost.sizes["time_min"] == 0
    assert lost.attrs["message"].startswith("not begun: ")
    assert "flow" in lost.attrs["message"]
    content = write_courses(whole, tmp_path)
    assert content["failed"] == 1
    assert sorted(path.name for path in (tmp_path / "courses").glob("*.csv")) == [
        "P01-2_course.csv", "P01-3_course.csv", "P01_course.csv",
    ]  # fmt: skip
    table = (tmp_path / "courses.csv").read_text().splitlines()
    assert len(table) == 5
    assert "not begun" in table[4]
    json.loads((tmp_path / "courses.json").read_text())
    (tmp_path / "courses" / "notes.txt").write_text("mine")
    write_courses(whole[:1], tmp_path)
    left = sorted(path.name for path in (tmp_path / "courses").iterdir())
    assert left == ["P01_course.csv", "P01_course.nc", "notes.txt"], "those of another cohort are gone"


def test_table_and_terminal_count_the_same_alarms_and_impossible_beats_are_named(tmp_path):
    """An arrest was no alarm in `courses.csv`, and a course that never began had none, too."""
    kinds = ("collapse", "alarm", "warning", "caution")
    broken = [{"kind": kind, "quantity": "MAP", "at_min": 4.0} for kind in kinds]
    arrest = drawn([70.0, 20.0, 20.0], (0.0, 5.0, 15.0), alarms=broken)
    arrest["impossible"] = ("time_min", [0, 0, 1])
    lost = summarised(drawn([], ()).drop_vars("MAP"), "not begun")
    courses = [summarised(arrest), summarised(drawn([70.0], (0.0,))), lost]
    content = write_courses(courses, tmp_path)
    rows = list(csv.DictReader((tmp_path / "courses.csv").read_text().splitlines()))
    assert [row["alarms"] for row in rows] == ["2", "0", ""]
    assert [row["impossible_from_min"] for row in rows] == ["15", "", ""]
    assert [one["impossible_from_min"] for one in content["courses"]] == [15.0, None, None]
    shown = [line.split() for line in _cohort_text(content).splitlines()[1:]]
    assert shown[0][:4] == ["P", "finished", "00:15", "2"]
    assert shown[2] == ["P", "stopped"]


def test_files_that_a_killed_process_left_unfinished_are_removed(tmp_path):
    (tmp_path / "courses").mkdir()
    (tmp_path / "courses" / ".eclsim-x1y2.nc").write_text("half")
    write_courses([summarised(drawn([70.0], (0.0,)))], tmp_path)
    left = sorted(path.name for path in (tmp_path / "courses").iterdir())
    assert left == ["P_course.csv", "P_course.nc"]


def summarised(course, message=""):
    """A course with the attributes that files of a cohort need."""
    status = "stopped" if message else "finished"
    about = {"status": status, "message": message, "case_values": "{}", "balance": "{}", "warnings": []}
    return course.assign_attrs(about, cautions=[], approximations=[])


@pytest.mark.slow
def test_nothing_is_followed_of_a_poor_fit(tmp_path):
    """A folder of fitted cases was followed, poor fits and all."""
    plain, poor, good = (tmp_path / name for name in ("plain.toml", "poor.toml", "good.toml"))
    plain.write_text(PATIENT)
    poor.write_text(with_mark(PATIENT, "poor", "POOR FIT"))
    good.write_text(with_mark(PATIENT, "good", "good fit"))
    results = cohort.course_cohort([read_case(plain), poor, read_case(good)], **CHOSEN)
    assert [result.attrs["converged"] for result in results] == [1, 0, 1]
    lost = results[1]
    assert lost.sizes["time_min"] == 0
    assert "POOR fit" in lost.attrs["message"]
    assert "studies leave such a fit out" in lost.attrs["message"]
    assert write_courses(results, tmp_path / "out")["failed"] == 1


@pytest.mark.slow
def test_shards_and_a_stopped_run_give_the_same_bits(cases, whole, monkeypatch, tmp_path):
    monkeypatch.setattr(cohort, "MEMBERS_PER_GROUP", 2)
    in_groups = cohort.course_cohort(cases, **CHOSEN)
    for number in (2, 1):
        with Distribution(shard=Shard(number, 2)).running() as executor, pytest.raises(ShardDone):
            cohort.course_cohort(cases, **CHOSEN, folder=tmp_path, executor=executor)
    with Distribution(merge=True).running() as executor:
        merged = cohort.course_cohort(cases, **CHOSEN, folder=tmp_path, executor=executor)
    assert same(in_groups, merged)
    (tmp_path / "00001.json").unlink()
    with Distribution(resume=True, workers=2).running() as executor:
        resumed = cohort.course_cohort(cases, **CHOSEN, folder=tmp_path, executor=executor)
    assert same(in_groups, resumed)
    with Distribution(resume=True).running() as executor, pytest.raises(ExecutionError, match="minutes"):
        cohort.course_cohort(cases, minutes=11.0, every_min=5.0, folder=tmp_path, executor=executor)


@pytest.mark.slow
def test_dask_gives_the_same_bits(cases, monkeypatch):
    monkeypatch.setattr(cohort, "MEMBERS_PER_GROUP", 2)
    with Distribution(dask="local", workers=2).running(cohort.PRELOAD) as executor:
        assert same(
            cohort.course_cohort(cases, **CHOSEN, executor=executor), cohort.course_cohort(cases, **CHOSEN)
        )


def test_an_event_after_the_end_is_refused(cases):
    with pytest.raises(CaseError, match="after the end of the course at 1 min"):
        cohort.course_cohort(cases, minutes=1.0)


# --- draws as a band ------------------------------------------------------------------------------


def drawn(values, minutes, *, message="", alarms=(), ahead=()):
    about = {
        "id": "P", "case": "{}", "events": "[]", "blood_volume_policy": "as_published", "settling_s": 1.0,
        "beat_by_beat": 0,
        "approximations": ahead,
        "converged": int(not message), "message": message, "alarms": json.dumps(list(alarms)), "seconds": 1.0,
    }  # fmt: skip
    data = {"MAP": ("time_min", np.array(values, dtype=float), {"units": "mmHg"})}
    return xr.Dataset(data, {"time_min": np.array(minutes, dtype=float)}, about)


def test_quantiles_and_probabilities_are_those_of_the_draws_that_came_so_far(tmp_path):
    """Two of five draws below the limit have no such alarm of their own, as where a graver one hides it."""
    broken = {
        "at_min": 4.0,
        "until_min": None,
        "kind": "warning",
        "quantity": "MAP",
        "limit": 65.0,
        "worst": 61.0,
    }
    draws = [drawn([70.0 + k, 60.0 + k], (0.0, 5.0), alarms=[broken] if k < 3 else []) for k in range(11)]
    early = drawn([90.0, 91.0], (0.0, 3.0), message="stopped at 00:03: no beat (x)")
    band = band_of([*draws, early], ("Rmc",))
    np.testing.assert_allclose(band["MAP"].sel(time_min=5.0), [60.5, 62.5, 65.0, 67.5, 69.5])
    assert band["draws_followed"].values.tolist() == [12, 11]
    assert (band.attrs["draws"], band.attrs["failed"], band.attrs["converged"]) == (12, 1, 0)
    assert "1 of 12 draws ended early and count up to where they ended: no beat (1)" in band.attrs["message"]
    assert band["alarm"].values.tolist() == ["MAP below 65 mmHg (warning)"]
    np.testing.assert_allclose(band["alarm_probability"].values, [[0.0, 5.0 / 11.0]])
    found = band_object(band)
    assert found["quantiles_percent"]["MAP"]["50"] == [75.5, 65.0]
    table, netcdf, alarms = write_band_tables(band, tmp_path)
    assert table.read_text().splitlines()[1].startswith("0,MAP,mmHg,12,")
    assert alarms.read_text().splitlines()[2] == "5,MAP below 65 mmHg (warning),0.45454545"
    with xr.open_dataset(netcdf) as stored:
        np.testing.assert_array_equal(stored["MAP"], band["MAP"])


@pytest.mark.slow
def test_a_band_holds_the_courses_of_its_draws(cases, tmp_path):
    from eclsim.course.figures import plot_course

    samples = {"Rmc": [0.8, 1.0, 1.2], "Emaxlv": [2.0, 2.2, 2.4]}
    band = course_band(cases[0], samples, **CHOSEN, folder=tmp_path / "draws")
    courses = course_many(cases[0], samples, **CHOSEN)
    expected = np.quantile([one["MAP"].to_numpy() for one in courses], [0.05, 0.5], axis=0)
    np.testing.assert_array_equal(band["MAP"].sel(quantile=[0.05, 0.5]), expected)
    assert band.attrs["failed"] == 0
    assert Path(tmp_path / "draws" / "00000.json").exists()
    assert "median of 3 draws" in plot_course(band)._supxlabel.get_text()
    with Distribution(merge=True).running() as executor:
        again = course_band(cases[0], samples, **CHOSEN, folder=tmp_path / "draws", executor=executor)
    np.testing.assert_array_equal(again["MAP"], band["MAP"])
    samples["Rmc"][1] = 1.01
    with (
        Distribution(resume=True).running() as executor,
        pytest.raises(ExecutionError, match=r"other inputs \(values\)"),
    ):
        course_band(cases[0], samples, **CHOSEN, folder=tmp_path / "draws", executor=executor)


def test_a_draw_of_what_the_case_has_not_is_refused(cases):
    with pytest.raises(CaseError, match=r"regulation\.sensitivity: the course of this case has no such"):
        course_band(cases[0], {"regulation.sensitivity": [1.0, 2.0]}, **CHOSEN)
    with pytest.raises(CaseError, match="samples = Rmc 2, Rsvn 1: numbers of samples"):
        course_band(cases[0], {"Rmc": [0.8, 0.9], "Rsvn": [0.01]}, **CHOSEN)


def test_an_event_sets_what_draws_differ_in(cases):
    event = Event(at_min=4.0, set={"Rmc": 1.1}, ramp_min=2.0)
    own = cases[0].model_copy(update={"events": (event,)})
    one = Timeline(own, 600.0, {"Rmc": 0.7, "Emaxlv": 2.4})
    at = [one.settings(segment, time) for segment, time in ((0, 0.0), (1, 300.0), (2, 600.0))]
    assert [round(values["Rmc"], 9) for values in at] == [0.7, 0.9, 1.1]
    assert {values["Emaxlv"] for values in at} == {2.4}


def test_where_steady_beats_stand_for_what_takes_time_is_said_of_a_band():
    ahead = [[f"at 00:05 SaO2 from {k} to 3 % at once"] for k in (94, 92)] + [[]]
    band = band_of([drawn([70.0], (0.0,), ahead=said) for said in ahead])
    assert band.attrs["warnings"] == ["in 2 of 3 draws, here of one: at 00:05 SaO2 from 94 to 3 % at once"]


def test_draws_whose_numbers_are_not_to_be_read_are_counted_and_left_out():
    own = [drawn([70.0, 60.0], (0.0, 5.0)) for _ in range(3)]
    own[1]["impossible"] = ("time_min", [0, 1])
    own[2]["status"] = ("time_min", ["one_of_many", "one_of_many"])
    for one, pressure in ((own[1], 5.0), (own[2], 7.0)):
        one["MAP"] = one["MAP"] * 0.0 + pressure
    band = band_of(own)
    assert band["MAP"].sel(quantile=0.5).values.tolist() == [37.5, 60.0]
    assert band["draws_impossible"].values.tolist() == [0, 1]
    assert band_object(band)["draws_undetermined"] == [1, 1]
    first, second = band.attrs["warnings"]
    assert first.startswith("in 1 of 3 draws, most at 00:05, the beat is one that no patient can have")
    assert second.startswith("in 1 of 3 draws, most at 00:00, no valve opens during the beat")
    assert second.endswith("the quantiles leave them out there")
