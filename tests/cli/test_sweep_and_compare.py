"""`eclsim simulate --sweep` and `--compare` as a user runs them."""

import json

import pandas as pd
import pytest

from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import case_text
from eclsim.cli.simulate import read_sweep
from eclsim.devices.registry import parameter_of


def rows(text: str) -> dict[str, list[str]]:
    return {line.split()[0]: line.split() for line in text.splitlines() if line.strip()}


@pytest.mark.slow
def test_a_sweep_shows_a_row_and_writes_an_object_for_each_value(shell):
    case, folder = shell.case(more=shell.ecmo), shell.folder / "figures"
    folder.mkdir()
    others = [folder / "P01_circuit.svg", folder / "outputs.csv"]
    for other in others:
        other.write_text("of the case itself")
    sweep = ("--sweep", "ecmo.speed_rpm=2500:3500:500")
    done = shell.run("simulate", case, *sweep, "--figures", folder, "--csv", folder)
    assert done.exit_code == 0, done.stderr
    table = rows(done.stdout)
    assert {value: table[value][-1] for value in ("2500", "3000", "3500")} == dict.fromkeys(
        ("2500", "3000", "3500"), "steady"
    )
    assert sorted(path.name for path in folder.iterdir() if path not in others) == [
        "P01_sweep.csv",
        "P01_sweep.png",
        "P01_sweep.svg",
    ]
    again = shell.run("simulate", case, *sweep, "--csv", folder)
    assert (again.exit_code, "--force overwrites" in again.stderr) == (2, True)
    written = json.loads(shell.run("simulate", case, *sweep, "--json", "-").stdout)
    assert written["sweep"]["own_value"] == 3425
    flows = [one["outputs"]["PF"] for one in written["cases"]]
    assert flows == sorted(flows)
    assert float(table["3000"][9].rstrip("!*x")) == pytest.approx(flows[1], abs=0.006)


def test_a_value_out_of_reach_is_blank_with_its_reason_and_the_exit_status_is_1(shell):
    done = shell.run("simulate", shell.case(more=shell.ecmo), "--sweep", "ecmo.flow_l_min=3,9")
    assert done.exit_code == 1
    assert rows(done.stdout)["9"] == ["9", "none:", "flow", "not", "reached"]
    assert "case.toml: ecmo.flow_l_min at 9 L/min: no beat: ecmo.flow_l_min = 9 cannot be" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--sweep", "Rmc=1,2", "--sweep", "Csvn=1,2"), "one key is varied at a time"),
        (("--sweep", "Rmc=1,2", "--compare"), "--sweep, --compare: give only one"),
        (("--sweep", "Rmc=1,2", "--transient", "3"), "which apply to one beat"),
        (("--sweep", "Rmc=1:2"), "is not a sweep"),
        (("--sweep", "Rmx=1,2"), "did you mean Rm"),
        (("--sweep", "patient.id=a,b"), "changes nothing"),
        (("--sweep", "measurements.SP=80,90"), "changes nothing"),
        (("--sweep", "ecmo.speed_rpm=3000,30000"), "--sweep: ecmo.speed_rpm = 30000: outside"),
        (("--sweep", "Rmc=1:2:0"), "a step of 0"),
        (("--sweep", "Rmc=1,2", "--set", "Rmc=0.9"), "is also given by --set"),
        (("--save", "Pao"), "only with --out or --csv"),
        (("--compare",), "1 case file(s) and no --set; allowed: one case file with --set"),
    ],
)
def test_what_cannot_be_swept_or_compared_is_refused(shell, arguments, text):
    done = shell.run("simulate", shell.case(more=shell.ecmo), *arguments)
    assert done.exit_code == 2
    assert done.stdout == ""
    assert text in done.stderr


def test_before_and_after_stand_side_by_side_with_the_change(shell):
    case = shell.case(more=shell.ecmo)
    done = shell.run("simulate", case, "--set", "ecmo.speed_rpm=4000", "--compare")
    assert done.exit_code == 0, done.stderr
    assert done.stdout.startswith("before: as in the file\nafter:  ecmo.speed_rpm=4000\n")
    *_, before, after, difference, unit = rows(done.stdout)["PF"]
    assert unit == "L/min"
    assert float(difference) == pytest.approx(float(after) - float(before), abs=0.011)
    assert difference.startswith("+")
    written = json.loads(shell.run("simulate", case, "--set", "Rmc=0.8", "--compare", "--json", "-").stdout)
    first, second = (one["outputs"]["MAP"] for one in written["cases"])
    assert written["compare"]["change"]["MAP"] == pytest.approx(second - first)


def test_files_of_a_comparison_say_which_is_before_and_which_after(shell, tmp_path):
    case, folder = shell.case(more=shell.ecmo), tmp_path / "compared"
    options = ("--set", "Rmc=0.8", "--compare", "--csv", str(folder), "--figures", str(folder))
    done = shell.run("simulate", case, *options)
    assert done.exit_code == 0, done.stderr
    names = {path.name for path in folder.iterdir()}
    assert {"P01_before_overview.svg", "P01_after_overview.svg", "comparison_pressure_volume.png"} <= names
    assert "P01, after" in (folder / "P01_after_overview.svg").read_text(encoding="utf-8")
    assert "after: Rmc=0.8" in (folder / "comparison_pressure_volume.svg").read_text(encoding="utf-8")
    table = pd.read_csv(folder / "outputs.csv")
    assert list(table["id"]) == ["P01", "P01"]
    assert list(table["compared"]) == ["before", "after"]
    for path in folder.iterdir():
        if not path.name.startswith("comparison"):
            path.unlink()
    again = shell.run("simulate", case, *options)
    assert again.exit_code == 2
    assert "comparison_pressure_volume" in again.stderr


def test_two_files_are_compared_and_a_case_without_a_beat_has_no_change(shell):
    files = shell.case("a.toml", more=shell.ecmo), shell.case("b.toml", "P02", more=shell.ecmo)
    done = shell.run("simulate", *files, "--set", "Csvn=30", "--compare", "--json", "-")
    assert done.exit_code == 0, done.stderr
    compared = json.loads(done.stdout)["compare"]
    assert (compared["before"], compared["after"]) == files
    assert compared["change"]["MAP"] == 0.0
    lost = shell.run("simulate", files[0], "--set", "ecmo.flow_l_min=9", "--compare")
    assert lost.exit_code == 1
    *_, before, after, unit = rows(lost.stdout)["MAP"]
    assert float(before) > 20
    assert (after, unit) == ("-", "mmHg")
    assert f"{files[0]}, after: ecmo.flow_l_min = 9 cannot be reached" in lost.stderr


def test_a_constant_of_a_device_can_be_varied(tmp_path):
    """Its unit is that of the device's parameter, though the paper's tables do not have it."""
    file = tmp_path / "P01.toml"
    file.write_text(case_text(PRESETS["paper"].case()), encoding="utf-8")
    readings = read_sweep(str(file), ["crrt.dialysate_ml_h=1000"], "KoAurea=300,500")
    assert readings.unit == parameter_of("KoAurea").unit != ""
    assert [case.parameters["KoAurea"] for case in readings.cases.values()] == [300.0, 500.0]
