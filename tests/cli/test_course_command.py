"""`eclsim course` and `eclsim plan` as a user runs them."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from eclsim.cases.fit_mark import with_mark
from eclsim.cli.course import (
    SHOWN_OUTPUTS,
    CourseOptions,
    _cases,
    _is_unchanged,
    _rows,
    _text,
    _unchanged_text,
)
from eclsim.cli.plan import _kept_text, _table, _weaning
from eclsim.course.files import course_object
from eclsim.course.weaning import WeaningStep
from eclsim.paper.cohort import SYNTHETIC

EVENTS = "[[events]]\nat_min = 2\ngive = { blood_ml = 100 }\nover_min = 4\n"


@pytest.mark.slow
def test_a_course_is_written_as_table_netcdf_and_json(shell):
    case, folder = shell.case(more=EVENTS), shell.folder / "out"
    figures = shell.folder / "figures"
    arguments = ("course", case, "--until", "10", "--every", "5", "--out", folder, "--figures", figures)
    done = shell.run(*arguments, "--json", "-")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["time_min"] == [0.0, 2.0, 5.0, 6.0, 10.0]
    assert abs(found["balance"]["given_ml"] - 100.0) < 1e-6
    assert abs(found["balance"]["error_ml"]) < 1e-6
    files = {"P01_course.csv", "P01_course.nc", "command.json"}
    assert {path.name for path in folder.iterdir()} == files
    assert "time_min [min]" in (folder / "P01_course.csv").read_text().splitlines()[0]
    again = shell.run(*arguments)
    assert (again.exit_code, "P01_course.csv already; --force overwrites" in again.stderr) == (2, True)
    drawn = shell.run("course", case, "--figures", figures)
    assert (drawn.exit_code, "P01_course" in drawn.stderr) == (2, True)


@pytest.mark.slow
def test_a_course_without_events_is_two_rows_and_says_that_nothing_changes(shell):
    """It was a table of 25 equal rows."""
    done = shell.run("course", shell.case(), "--until", "600", "--out", shell.folder / "out")
    assert done.exit_code == 0, done.stderr
    table, words, *_ = done.stdout.split("\n\n")
    assert [line.split()[0] for line in table.splitlines()[-2:]] == ["00:00", "10:00"]
    assert len(table.splitlines()) == 3
    assert words == (
        "nothing changes between the first and the last moment: the case has no [[events]], and no fluid "
        "enters or leaves the patient"
    )
    assert done.stdout.startswith(
        shell.run("course", shell.case(), "--until", "600").stdout.partition("\n\n")[0]
    )
    bled = Path(shell.case(more=EVENTS))
    changed = shell.run("course", bled, "--until", "10", "--every", "1", "--out", shell.folder / "bled")
    assert "nothing changes" not in changed.stdout
    assert len(changed.stdout.partition("\n\n")[0].splitlines()) == 12


def test_a_course_in_which_only_a_hidden_number_changes_is_shown_whole():
    minute, still = np.arange(50.0), np.full(50, 70.0)
    moving = np.where(minute > 40.0, 9.0, 8.0)
    same = xr.Dataset({"MAP": ("time_min", still), "status": ("time_min", ["x"] * 50)}, {"time_min": minute})
    assert _is_unchanged(same)
    assert not _is_unchanged(same.assign(urea=("time_min", moving)))
    assert not _is_unchanged(same.isel(time_min=[0]))
    band = xr.Dataset({"MAP": (("quantile", "time_min"), np.tile(still, (5, 1)))}, {"time_min": minute})
    assert _is_unchanged(band)
    assert _unchanged_text(same.assign_attrs(events='[{"at_min": 1}]')).endswith("last moment")


def test_a_doubtful_fit_is_said_in_the_course_too(shell):
    file = Path(shell.case())
    file.write_text(with_mark(file.read_text(), "doubtful", "why"))
    done = shell.run("course", file, "--until", "1", "--json", "-")
    assert json.loads(done.stdout)["warnings"][0].startswith("its parameters are a DOUBTFUL fit")
    assert done.stderr.count("DOUBTFUL fit") == 1


def test_what_cannot_be_meant_is_said_before_anything_is_computed(shell):
    case = shell.case(more=EVENTS)
    for arguments, said in (
        (("course", case, case), "--out DIR, --json FILE or --figures DIR"),
        (("course", case, "--until", "1.5", "--json", "-"), "after the end of the course at 1.5 min"),
        (("course", case, "--beats", "--json", "-"), "--beats: 1440 min; allowed: up to 120 min"),
        (("course", case, "--every", "0.01", "--json", "-"), "144000 moments; allowed: up to 20000"),
        (("plan", case), "--remove-ml, --wean: give exactly one"),
        (("plan", case, "--remove-ml", "500"), "--remove-ml needs --keep"),
        (("plan", case, "--remove-ml", "500", "--keep", "MAPP > 60"), "did you mean MAP"),
        (("plan", case, "--remove-ml", "500", "--keep", "SaO2 > 90"), "it needs [gas] in the case file"),
        (("plan", case, "--remove-ml", "500", "--keep", "MAP > 60"), "no device that removes fluid"),
        (("plan", case, "--wean", "3000"), "no ECMO to wean from"),
    ):
        done = shell.run(*arguments)
        assert done.exit_code == 2, arguments
        assert said in done.stderr, done.stderr


@pytest.mark.parametrize(
    ("command", "wrong"),
    [
        (("course", "--beats"), "--beats: 1440 min"),
        (("track", "--out", "none/track"), "--out none/track: the folder none does not exist"),
        (("simulate", "--transient", "5"), "--transient needs --out FILE.nc or --csv DIR"),
        (("plan", "--wean", "fast"), "--wean fast: allowed"),
        (("plan", "--wean", "ecmo.a=fast"), "--wean fast: allowed"),
        (("settings", "--goal", "MAP > 60", "--json", "none/a.json"), "--json none/a.json: the folder"),
        (("sensitivity", "--until", "-1"), "--until -1: allowed"),
        (("identifiability", "--limit", "inf"), "--limit, --threshold: infinite"),
        (("identify", "--out", "fitted", "--shared", "Rmc"), "--shared: works for cohorts only"),
        (("crrt-study", "--schemes", "zz"), "--schemes 'zz' is not a scheme"),
    ],
)
def test_mistakes_of_case_and_options_are_reported_together(shell, command, wrong):
    """Those of the options came after those of the case had been mended, or the other way round."""
    name, *options = command
    done = shell.run(name, shell.case(more="[ecmo]\nmode = 'VX'\n"), *options)
    assert done.exit_code == 2
    assert "ecmo.mode" in done.stderr
    assert wrong in done.stderr
    assert "drainage_site: missing" not in done.stderr, "mode would fill it in"


@pytest.mark.slow
def test_a_patient_without_a_steady_gas_state_does_not_begin_and_says_why(shell):
    case = shell.case(more="[gas]\nalveolar_ventilation_l_min = 0\n")
    done = shell.run("course", case, "--until", "5", "--json", "-", "--figures", shell.folder / "figures")
    assert done.exit_code == 1, done.stderr
    assert json.loads(done.stdout)["time_min"] == []
    assert "not begun: steady beat found, but no steady gas state" in done.stderr
    shown = shell.run("course", case, "--until", "5", "--out", shell.folder / "out")
    assert "no moment of this course has a steady beat" in shown.stdout
    assert "blood volume" not in shown.stdout


@pytest.mark.slow
def test_a_cohort_goes_through_shards_and_merge(shell):
    folder, table = shell.folder / "cases", shell.folder / "events.toml"
    folder.mkdir()
    shell.case("cases/a.toml", "P01"), shell.case("cases/b.toml", "P02")
    shell.case("events.toml", more=EVENTS)
    chosen = ("course", folder, "--events", table, "--until", "8", "--every", "4")
    one = shell.run(*chosen, "--json", "-")
    assert one.exit_code == 0, one.stderr
    found = json.loads(one.stdout)
    assert [course["id"] for course in found["courses"]] == ["P01", "P02"]
    assert abs(found["courses"][1]["balance"]["given_ml"] - 100.0) < 1e-6
    out = shell.folder / "out"
    for shard in ("1/2", "2/2"):
        done = shell.run(*chosen, "--out", out, "--shard", shard)
        assert f"when all shards are done: eclsim merge {out}" in done.stderr
    merged = shell.run("merge", out, "--json", "-")
    assert merged.exit_code == 0, merged.stderr
    assert json.loads(merged.stdout) == found == json.loads((out / "courses.json").read_text())
    assert (out / "courses" / "P02_course.nc").exists()
    assert "holds courses.json already" in shell.run(*chosen, "--out", out).stderr


@pytest.mark.slow
def test_rows_that_are_not_followed_are_in_the_results_too(shell):
    """They were named on standard error alone, and the files looked as if nobody was missing."""
    head, first, second, *_ = SYNTHETIC.read_text().splitlines()
    table, out = shell.folder / "rows.csv", shell.folder / "out"
    table.write_text("\n".join([head, first, second.replace(",6.6,", ",six,")]) + "\n")
    done = shell.run("course", table, "--until", "1", "--out", out, "--json", "-")
    assert done.exit_code == 1
    found = json.loads(done.stdout)
    assert [course["id"] for course in found["courses"]] == ["P01/1"]
    assert found["refused"] == {"line 3 (P01)": 'CO = "six": not a number; allowed: 0 to 20 L/min'}
    assert 'line 3 (P01),refused,,,,,"CO = ""six"": not a number' in (out / "courses.csv").read_text()


def test_events_of_a_file_have_to_fit_each_patient(shell):
    case, other, events = shell.case(), shell.case("b.toml", "P02"), shell.folder / "events.toml"
    chosen = ("course", case, other, "--events", events, "--until", "8", "--json", "-")
    shell.case("events.toml")
    assert "events.toml: holds no [[events]]" in shell.run(*chosen).stderr
    crrt = '[crrt]\nflow_ml_min = 200\naccess_site = "ra"\nreturn_site = "ra"\n'
    event = '[[events]]\nat_min = 2\nset = { "crrt.net_ultrafiltration_ml_h" = 100 }\n'
    shell.case("events.toml", more=crrt + event)
    done = shell.run(*chosen)
    assert done.exit_code == 2
    assert "events[1].set.crrt.net_ultrafiltration_ml_h" in done.stderr
    assert "(for P01, P02)" in done.stderr


def test_a_file_of_events_alone_is_enough(shell):
    """It was refused for want of a patient, and a missing [ecmo] was said in eight lines of missing keys."""
    case, events = shell.case(more=shell.ecmo), shell.folder / "events.toml"
    event = '[[events]]\nat_min = 2\nset = { "ecmo.speed_rpm" = 2500 }\n'
    events.write_text(f"format = 1\n{event}")
    (reading,), _ = _cases(CourseOptions(files=[case], events=str(events)))
    assert reading.case.events[0].as_object()["set"] == {"ecmo.speed_rpm": 2500.0}
    done = shell.run("course", shell.case("b.toml", "P02"), "--events", events, "--until", "8", "--json", "-")
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("error")]
    assert "events.toml:4: events[1].set.ecmo.speed_rpm = 2500: the case has no [ecmo]" in line


def test_an_event_of_a_file_that_is_without_effect_in_a_patient_is_named(shell, capsys):
    """A sweep turned off in patients without gases was followed without a word."""
    event = '[[events]]\nat_min = 2\nset = { "ecmo.sweep_l_min" = 0.5 }\n'
    case = shell.case(more=shell.ecmo)
    shell.case("events.toml", more=f"{shell.ecmo}[gas]\n{event}")
    (reading,), _ = _cases(CourseOptions(files=[case], events=str(shell.folder / "events.toml")))
    assert len(reading.case.events) == 1
    assert "events[1].set.ecmo.sweep_l_min = 0.5: without effect" in capsys.readouterr().err


@pytest.mark.slow
def test_draws_of_a_posterior_become_a_band(shell):
    import xarray as xr

    draws, case = shell.folder / "posterior.nc", shell.case(more=EVENTS)
    group = xr.Dataset({"Rmc": (("chain", "draw"), [[0.8, 0.9], [1.0, 1.1]])}, attrs={"doubts": "r_hat 1.4"})
    xr.DataTree.from_dict({"posterior": group}).to_netcdf(draws, engine="h5netcdf")
    chosen = ("course", case, "--until", "8", "--every", "4", "--posterior", draws)
    done = shell.run(*chosen, "--json", "-", "--figures", shell.folder / "figures")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["draws"], found["failed"], found["parameters"]) == (4, 0, ["Rmc"])
    assert found["warnings"][0] == "posterior: r_hat 1.4"
    assert "posterior: r_hat 1.4" in done.stderr
    low, high = (found["quantiles_percent"]["MAP"][q] for q in ("5", "95"))
    assert all(a < b for a, b in zip(low, high, strict=True))
    assert (shell.folder / "figures" / "P01_course.png").exists()
    xr.DataTree.from_dict({"posterior": group.rename(Rmc="Rmcc")}).to_netcdf(draws, engine="h5netcdf")
    refused = shell.run(*chosen, "--json", "-")
    assert (refused.exit_code, "did you mean Rmc" in refused.stderr) == (2, True)


@pytest.mark.slow
def test_a_cohort_says_in_whom_steady_beats_run_ahead_of_the_blood(shell):
    examples, folder = Path(__file__).parents[2] / "examples", shell.folder / "cases"
    sweep = '[[events]]\nat_min = 2\nset = { "ecmo.sweep_l_min" = %s }\nramp_min = 2\n'
    folder.mkdir()
    for name, end in (("low", 0.05), ("high", 1.8)):
        case = (examples / "veno_venous_gas.toml").read_text().replace("vv-gas", name)
        (folder / f"{name}.toml").write_text(case + sweep % end)
    chosen = (
        "course",
        folder,
        "--until",
        "5",
        "--every",
        "1",
        "--steady-only",
        "--out",
        shell.folder / "out",
    )
    done = shell.run(*chosen)
    assert done.exit_code == 0, done.stderr
    assert "in 1 of 2 patients: at 00:04 steady beats run ahead: SaO2 goes from 97 to" in done.stderr
    high, low = csv.DictReader((shell.folder / "out" / "courses.csv").read_text().splitlines())
    assert "steady beats run ahead" in low["approximations"]
    assert high["approximations"] == ""


def test_moments_of_one_minute_are_told_apart_in_the_table():
    """A course of ten minutes had two rows 00:00, two rows 00:01 and so on."""
    halves = xr.Dataset(coords={"time_min": [0.0, 0.5, 1.0]})
    assert list(_rows(halves).values()) == ["00:00:00", "00:00:30", "00:01:00"]
    assert list(_rows(halves.isel(time_min=[0, 2])).values()) == ["00:00", "00:01"]


def test_the_table_of_a_course_holds_gases_and_potassium():
    """A sweep that failed, and a dialysis of potassium, were tables in which nothing changed."""
    assert {"SaO2", "PaCO2", "potassium", "bicarbonate"} <= set(SHOWN_OUTPUTS)


def test_a_table_that_explains_a_star_has_a_row_with_it():
    """A single impossible moment between two rows left the explanation without any star."""
    minute = np.arange(60.0)
    result = xr.Dataset({}, {"time_min": minute})
    rows = _rows(result, impossible=minute == 17.0)
    assert rows[17] == "00:17"
    assert len(rows) == len(_rows(result)) + 1
    assert list(_rows(result, impossible=minute == 18.0)) == list(_rows(result))


def test_moments_that_no_patient_can_have_are_marked_in_table_and_json():
    """2.5 L were bled on ECMO: rows with a right atrium at -17 mmHg stood among the others, plain."""
    pressure = xr.Variable("time_min", [70.0, 60.0, 36.0, 60.0], {"units": "mmHg"})
    ends = {"blood_volume_start_ml": 5000.0, "blood_volume_end_ml": 2500.0}
    balance = ends | {"given_ml": 0.0, "removed_ml": 2500.0, "refilled_ml": 0.0}
    course = xr.Dataset(
        {"MAP": pressure, "impossible": ("time_min", [0, 0, 1, 0])},
        {"time_min": [0.0, 1.0, 2.0, 4.0]},
        {
            "alarms": "[]", "balance": json.dumps(balance), "beat_by_beat": 0, "seconds": 1.0,
            "settling_s": 0.0, "id": "P", "converged": 1, "status": "finished", "message": "",
            "events": "[]", "warnings": [], "blood_volume_policy": "as_published",
            "case": "{}", "case_values": "{}",
        },
    )  # fmt: skip
    assert course_object(course)["impossible"] == [False, False, True, False]
    shown = _text(course)
    assert next(line for line in shown.splitlines() if "*" in line).split() == ["00:02", "*", "36.0"]
    assert "* a beat that no patient can have" in shown
    assert "*" not in _text(course.assign(impossible=("time_min", [0, 0, 0, 0])))


@pytest.mark.parametrize(
    ("reached", "words"),
    [
        ((True, True), "kept at every speed"), ((False, False), "kept at no speed"),
        ((True, False), "kept at 3000 rpm, not at 2500 rpm"),
    ],
)  # fmt: skip
def test_weaning_says_at_which_speeds_the_goals_are_kept(reached, words):
    """With `--keep` alone a table without a word on the goals came out where all were kept."""
    steps = [WeaningStep(s, None, r, {}, "") for s, r in zip((3000.0, 2500.0), reached, strict=True)]
    assert _kept_text(steps, "MAP > 65") == f"\n\nMAP > 65: {words}"
    assert _kept_text(steps, None) == ""


def test_weaning_says_where_goals_are_kept_with_a_pump_that_stands_still():
    """ "MAP > 60: kept at every speed" included one at which the pump carried nothing."""
    steps = [
        WeaningStep(2000.0, None, True, {}, ""),
        WeaningStep(1400.0, None, True, {}, "PF > 0.5 is not kept there: -0.004 L/min"),
    ]
    words = "kept at every speed, but with alarms at 1400 rpm (last column)"
    assert _kept_text(steps, "MAP > 60") == f"\n\nMAP > 60: {words}"


@pytest.mark.parametrize(
    ("text", "circuit"),
    [("3000:2000:-500", None), ("ecmo.va=3000:2000:-500", "ecmo.va"), ("ecmo.va.speed_rpm=3000,2500,2000",
     "ecmo.va")],
)  # fmt: skip
def test_the_circuit_to_wean_may_be_named_before_its_speeds(text, circuit):
    assert _weaning(text) == (circuit, [3000.0, 2500.0, 2000.0])


def test_weaning_names_every_speed_with_an_alarm_and_marks_its_numbers():
    """ "kept at every speed, but with an alarm at 1800 rpm" stood over an SaO2 of 69 % at 2200."""
    steps = [
        WeaningStep(s, None, True, {"MAP": 90.0, "SaO2": sao2, "PCWP": 12.9}, "", (), kinds, ("SaO2", "PCWP"))
        for s, sao2, kinds in (
            (3400.0, 82.6, {"SaO2": "warning", "PCWP": "caution"}), (2200.0, 69.3, {"SaO2": "alarm"}),
            (1800.0, 59.0, {"SaO2": "alarm", "DO2": "alarm", "Vra": "collapse"}),
        )
    ]  # fmt: skip
    assert _kept_text(steps, "MAP > 65").endswith(
        "kept at every speed, but with alarms at 2200 rpm (SaO2), 1800 rpm (SaO2, DO2, Vra)"
    )
    table = _table(steps, None).splitlines()
    assert table[1].split() == ["3400", "90", "82.6!*", "12.9*"]
    assert table[3].split() == ["1800", "90", "59!*", "12.9"]
    assert table[-1] == "! beyond a limit, * to be read with care: the warnings say why"
