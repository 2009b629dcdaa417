import csv
import json
import os
import sys
from pathlib import Path

import pytest
import xarray as xr

from eclsim.cases.fit_mark import with_mark
from eclsim.files import file_stems
from eclsim.simulation import single


def test_json_on_standard_output_is_all_there_is(shell, instant):
    done = shell.run("simulate", shell.case(more=shell.ecmo), "--json", "-")
    assert done.exit_code == 0
    (case,) = json.loads(done.stdout)["cases"]
    assert list(case)[:5] == ["id", "converged", "beats", "residual", "blood_volume_policy"]
    assert case["id"] == "P01"
    assert case["converged"] is True
    assert case["outputs"] == {"SP": 120.0, "CO": 4.0, "PF": 3.7}
    assert case["more_outputs"] == {"stroke_volume": 50.0}


def test_a_poor_fit_is_said_in_the_results_too(shell, instant):
    """It was said on the terminal alone; the JSON went on without it."""
    file = Path(shell.case())
    file.write_text(with_mark(file.read_text(), "poor", "why"))
    done = shell.run("simulate", file, "--json", "-")
    (case,) = json.loads(done.stdout)["cases"]
    (said,) = [line for line in case["warnings"] if "POOR fit" in line]
    assert said.endswith("not to be used")
    assert done.stderr.count("POOR fit") == 1


def test_statistics_of_waveforms_are_those_of_the_beat_and_finite(shell, instant):
    done = shell.run("simulate", shell.case(), "--json", "-")
    (case,) = json.loads(done.stdout, parse_constant=pytest.fail)["cases"]
    assert case["waveforms"] == {"Pao": {"mean": 87.5, "min": 59.5, "max": 120.5}}
    assert "PF" not in case["outputs"]


def test_cases_come_in_the_order_of_the_command_line(shell, instant):
    files = [shell.case(f"{name}.toml", name) for name in ("c", "a", "b", "d")]
    target = shell.folder / "results.json"
    done = shell.run("simulate", *files, "--json", target)
    assert [case["id"] for case in json.loads(target.read_text())["cases"]] == ["c", "a", "b", "d"]
    assert [line.split()[0] for line in done.stdout.splitlines() if "yes, 9 beats" in line] == [
        "c",
        "a",
        "b",
        "d",
    ]


def test_a_table_is_shown(shell, instant):
    done = shell.run("simulate", shell.case(more=shell.ecmo))
    assert done.exit_code == 0
    assert any(
        line.split()[:5] == ["SP", "systolic", "arterial", "pressure", "120.0"]
        for line in done.stdout.splitlines()
    )
    assert "3.70" in done.stdout


def test_exit_status_1_if_one_did_not_converge(shell, instant):
    done = shell.run("simulate", shell.case(), shell.case("b.toml", "never"), "--json", "-")
    assert done.exit_code == 1
    first, second = json.loads(done.stdout)["cases"]
    assert (first["converged"], second["converged"]) == (True, False)
    assert second["message"] == "no steady beat found"
    assert second["residual"] is None
    assert "b.toml: not converged: no steady beat found" in done.stderr


def test_settings_and_options_reach_the_computation(shell, instant):
    arguments = ["--set", "ecmo.speed_rpm=3000", "--set", "Rmc=0.8", "--solver", "adaptive"]
    done = shell.run("simulate", shell.case(more=shell.ecmo), *arguments, "--volume-policy", "patient_held")
    assert "overrides" not in done.stderr.partition("--volume-policy")[2]
    ((case, options),) = instant
    assert case.ecmo.speed_rpm == 3000
    assert case.parameters == {"Rmc": 0.8}
    assert (options["solver"], case.volume_policy) == ("adaptive", "patient_held")
    assert "note: --set: ecmo.speed_rpm = 3000: overrides 3425 of" in done.stderr


def test_nothing_is_computed_if_anything_is_wrong(shell, instant):
    bad = shell.case("bad.toml").replace("bad.toml", "none.toml")
    done = shell.run("simulate", shell.case(), bad, shell.folder, "--set", "Rmc=0.8")
    assert done.exit_code == 2
    assert instant == []
    assert done.stdout == ""
    assert f"error: {bad}: no such file" in done.stderr.splitlines()
    assert f"{shell.folder}: a folder" in done.stderr


def test_files_are_written_and_hold_what_was_asked_for(shell, instant):
    folder = shell.folder
    files = [shell.case("a.toml", "A"), shell.case("b.toml", "B")]
    done = shell.run(
        "simulate", *files, "--out", folder / "o.nc", "--csv", folder / "tables", "--save", "Pao"
    )
    assert done.exit_code == 0
    with xr.open_dataset(folder / "o.nc", group="case2", engine="h5netcdf") as stored:
        assert stored.attrs["id"] == "B"
        assert "Pao" in stored
        assert "Vlv" not in stored
    with open(folder / "tables" / "A_waveforms.csv", newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["phase", "time", "Pao [mmHg]"]
    assert [float(cell) for cell in rows[2]] == [0.1, 0.05, 120.0]
    with open(folder / "tables" / "outputs.csv", newline="") as file:
        assert [row["id"] for row in csv.DictReader(file)] == ["A", "B"]
    assert not list(folder.rglob(".*"))


def test_a_table_tells_why_a_case_has_no_numbers(shell, instant):
    """Its row was empty, and the reason was in JSON and NetCDF alone."""
    files = [shell.case("a.toml", "A"), shell.case("b.toml", "never")]
    assert shell.run("simulate", *files, "--csv", shell.folder / "tables").exit_code == 1
    with open(shell.folder / "tables" / "outputs.csv", newline="") as file:
        rows = [(row["status"], row["message"]) for row in csv.DictReader(file)]
    assert rows == [("converged", "steady beat found"), ("not_converged", "no steady beat found")]


def test_the_course_in_time_is_stored_beside_the_beat(shell, instant, monkeypatch):
    course = xr.Dataset({"Pao": ("time", [80.0, 81.0])}, coords={"time": [0.0, 0.1]})
    monkeypatch.setattr("eclsim.simulation.single.simulate_transient", lambda case, *_, **__: course)
    out = shell.folder / "o.nc"
    done = shell.run("simulate", shell.case(), "--transient", "5", "--out", out, "--csv", shell.folder / "t")
    assert done.exit_code == 0
    with xr.open_dataset(out, group="transient", engine="h5netcdf") as stored:
        assert stored["Pao"].values.tolist() == [80.0, 81.0]
    assert (shell.folder / "t" / "P01_transient.csv").read_text().splitlines()[0] == "time,Pao"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--out", "{folder}/none/x.nc"], "the folder {folder}/none does not exist"),
        (["--json", "{folder}/none/x.json"], "the folder {folder}/none does not exist"),
        (["--json", "{folder}"], "is a folder; give a file name"),
        (["--json", "{folder}/old"], "already exists; --force overwrites it"),
        (["--json", ""], "--json: an empty name"),
        (["--json", "{folder}/" + "x" * 300], "File name too long"),
        (["--out", "{folder}/x.csv"], "ends in .nc"),
        (["--csv", "{folder}/old"], "is a file; give a folder"),
        (["--figures", "{folder}/none/deep"], "the folder {folder}/none does not exist"),
        (["--csv", "{folder}/full"], "holds results of these cases (outputs.csv); --force"),
        (["--json", "{folder}/case.toml", "--force"], "and would be overwritten"),
        (["--json", "{folder}/x.nc", "--out", "{folder}/x.nc"], "name the same file"),
        (["--transient", "5"], "--transient needs --out"),
        (["--transient", "-5"], "--transient"),
        (["--transient", "nan"], "--transient"),
        (["--save", "Pao,Qlvv"], "--save Qlvv: no such waveform; did you mean Qlv?"),
        (["--save", ","], "--save: empty"),
        (["--solver", "magic"], "semi-implicit"),
        (["--volume-policy", "held"], "patient_held"),
        (["--set", "Rmcc=1"], "Rmc"),
        (["--jsn", "x"], "--json"),
        (["--seed", "abc"], "No such option: --seed"),
    ],
)
def test_bad_destinations_and_options_are_refused_before_computing(shell, instant, arguments, message):
    (shell.folder / "old").write_text("old")
    (shell.folder / "full").mkdir()
    (shell.folder / "full" / "outputs.csv").write_text("old")
    filled = [argument.format(folder=shell.folder) for argument in arguments]
    done = shell.run("simulate", shell.case(), *filled)
    assert done.exit_code == 2
    assert message.format(folder=shell.folder) in done.stderr
    assert instant == []
    assert (shell.folder / "old").read_text() == "old"


def test_force_overwrites(shell, instant):
    target = shell.folder / "r.json"
    target.write_text("old")
    assert shell.run("simulate", shell.case(), "--json", target, "--force").exit_code == 0
    assert json.loads(target.read_text())["cases"]


def test_a_write_that_fails_leaves_the_old_file_and_no_rest(shell, instant, monkeypatch):
    target = shell.folder / "r.json"
    target.write_text("old")

    def full(*_arguments, **_options):
        raise OSError(28, "No space left on device", str(target))

    monkeypatch.setattr("pathlib.Path.write_text", full)
    done = shell.run("simulate", shell.case(), "--json", target, "--force")
    assert done.exit_code == 2
    assert "No space left on device" in done.stderr
    assert target.read_bytes() == b"old"
    assert sorted(item.name for item in shell.folder.iterdir()) == ["case.toml", "r.json"]


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="root writes everywhere")
def test_a_read_only_folder_is_refused(shell, instant):
    locked = shell.folder / "locked"
    locked.mkdir(mode=0o500)
    done = shell.run("simulate", shell.case(), "--json", locked / "r.json")
    assert done.exit_code == 2
    assert "no permission" in done.stderr


def test_ids_that_look_the_same_are_a_warning(shell, instant):
    files = [shell.case("a.toml", "P01"), shell.case("b.toml", "p 01")]
    done = shell.run("simulate", *files, "--json", "-")
    assert done.exit_code == 0
    assert "b.toml: patient.id 'p 01' differs from 'P01' in" in done.stderr


def test_the_same_id_twice_is_no_collision(shell, instant):
    """Such as a patient before and after a change."""
    files = [shell.case("a.toml", "P01"), shell.case("b.toml", "P01")]
    done = shell.run("simulate", *files, "--json", "-")
    assert done.exit_code == 0
    assert "patient.id" not in done.stderr


def test_warnings_name_the_oxygenators_label(shell, instant):
    small = shell.ecmo.replace("Quadrox-i Adult", "Quadrox-i Small Adult").replace(
        '"Rotaflow"', "{ roller_l_min = 6 }"
    )
    done = shell.run("simulate", shell.case(more=small.replace("speed_rpm = 3425\n", "")), "--json", "-")
    assert "0.5 to 5 L/min" in done.stderr


def test_a_warning_of_the_beat_is_said_once_and_is_in_the_file_too(shell, instant, monkeypatch):
    said = ["ECMO flow of 6.5 L/min is outside the label", "alarm: suction", "caution: read with care"]
    plain, warned = single.simulate, {"warnings": said}
    monkeypatch.setattr(
        single, "simulate", lambda case, **options: plain(case, **options).assign_attrs(warned)
    )
    done = shell.run("simulate", shell.case(more=shell.ecmo), "--json", "-")
    assert json.loads(done.stdout)["cases"][0]["warnings"] == warned["warnings"]
    assert " ".join(done.stderr.split()).count(warned["warnings"][0]) == 1
    labels = [line.partition(": ")[0] for line in done.stderr.splitlines()]
    assert [label for label in labels if label != "note"] == ["warning", "alarm", "caution"]


def test_file_names_are_safe_and_all_different():
    assert file_stems(["../../etc/passwd", "P 01", "P_01", "p_01", "", "Jürgen", "x" * 200]) == (
        "etc_passwd",
        "P_01",
        "P_01-2",
        "p_01-3",
        "case",
        "Jürgen",
        "x" * 60,
    )
