"""`eclsim track` and `eclsim identify --predict`, as typed."""

import csv
import json
from pathlib import Path

import pytest

from eclsim.cases.case import Measurements
from eclsim.cli.cases import read_usable_cohort
from eclsim.cli.track import TrackOptions, _check_points, _series, _settings, _settings_of_each
from eclsim.identification import tracks
from eclsim.identification.settings import FitSettings
from eclsim.identification.tracking import TrackSettings
from eclsim.identification.tracks import followed
from eclsim.parameters.thiel2025 import BOUNDS, PARAMETERS

HEAD = (
    "patient_id,measurement,sex,age_years,height_cm,weight_kg,heart_rate_bpm,SP,DP,MAP,MPAP,PCWP,CO,PF,"
    "ecmo_pump,ecmo_speed_rpm,oxygenator,drainage_fr,return_fr\n"
)
ROWS = (
    "=A,1,female,60,165,60,80,112,74,88,,,4.0,,,,,,\n"
    "=A,2,female,60,165,60,82,108,71,85,,,4.1,,,,,,\n"
    "=A,3,female,60,165,60,85,104,70,82,,,8.9,,,,,,\n"
)
FEW = ("--parameters", "Rmc,Emaxlv")


@pytest.fixture
def table(shell):
    file = shell.folder / "series.csv"
    file.write_text(HEAD + ROWS)
    return file


@pytest.mark.slow
def test_a_table_is_followed(shell, table):
    out = shell.folder / "out"
    result = shell.run("track", table, "--out", out, *FEW)
    assert result.exit_code == 0, result.output
    assert "CO does not fit" in result.stdout
    content = json.loads((out / "track.json").read_text())
    (series,) = content["series"]
    assert [p["id"] for p in series["points"]] == ["1", "2", "3"]
    assert series["points"][2]["measurements"]["CO"]["unusual"]
    assert not series["points"][2]["measurements"]["CO"]["used"]
    with (out / "outputs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert rows[0]["patient"] == "'=A"
    assert float(rows[-1]["expected_lower"]) < float(rows[-1]["expected_upper"])
    assert len(list((out / "figures").glob("*.png"))) == 2
    page = " ".join((out / "report.html").read_text().split())
    assert page.count("<svg") == 2
    assert "http" not in page.replace("http-equiv", "")
    assert "CO does not fit the forecast" in page
    assert "24 h from one to the next are assumed" in " ".join(page.split())
    assert max(map(len, result.stdout.splitlines())) < 120


@pytest.mark.slow
def test_case_files_are_followed_in_their_order(shell):
    files = [
        shell.case(f"{k}.toml", more=f"[measurements]\nMAP = {80 - k}\nCO = 4.0\nSP = 100\n")
        for k in range(2)
    ]
    out = shell.folder / "out"
    result = shell.run("track", *files, "--out", out, *FEW, "--json", "-", "--drift", "0.1")
    assert result.exit_code == 0, result.output
    content = json.loads(result.stdout)
    assert [p["id"] for p in content["series"][0]["points"]] == ["0", "1"]
    assert content["series"][0]["points"][1]["drift"] == pytest.approx(0.1)
    assert content["series"][0]["points"][1]["hours_since_last"] == 24.0
    assert content["series"][0]["assumed_interval_hours"] == 24.0
    assert "24 h from one to the next are assumed (interval)" in result.stderr
    assert "differs from" not in result.stderr


@pytest.mark.slow
def test_a_refused_row_between_others_keeps_its_time(shell, table):
    table.write_text(HEAD + ROWS.replace(",108,71,85,", ",108,71,9999,"))
    result = shell.run("track", table, "--out", shell.folder / "out", *FEW, "--json", "-", "--drift", "0.1")
    assert result.exit_code == 1
    points = json.loads(result.stdout)["series"][0]["points"]
    assert [(p["id"], p["hours_since_last"]) for p in points] == [("1", None), ("3", 48.0)]
    assert "=A: measurements left out: 1; each still counts as 24 h of time" in result.stderr


TWO_PATIENTS = (
    HEAD + "".join(ROWS.splitlines(keepends=True)[:2]) + ROWS.splitlines()[0].replace("=A", "B") + "\n"
)


def without_seconds(content):
    for series in content["series"]:
        for point in series["points"]:
            del point["seconds"]
    return content


@pytest.mark.slow
def test_patients_are_stored_one_by_one(shell, table, monkeypatch):
    """Stopped in the last of many patients, all were lost."""
    table.write_text(TWO_PATIENTS)
    asked, whole = ("track", table, *FEW, "--drift", "0.1"), shell.folder / "whole"
    assert shell.run(*asked, "--out", whole).exit_code == 0
    wanted = without_seconds(json.loads((whole / "track.json").read_text()))
    assert [series["id"] for series in wanted["series"]] == ["=A", "B"]

    kept, begun = shell.folder / "kept", []

    def stopped_at_the_second(series):
        begun.append(series.points[0][1].patient.id)
        if begun == ["=A", "B"]:
            raise KeyboardInterrupt
        return followed(series)

    monkeypatch.setattr(tracks, "followed", stopped_at_the_second)
    stopped = shell.run(*asked, "--out", kept)
    assert stopped.exit_code == 130
    assert "the same command with --resume goes on" in stopped.stderr
    refused = shell.run(*asked, "--out", kept)
    assert refused.exit_code == 2
    assert "--resume goes on" in refused.stderr
    other = shell.run(*asked, "--out", kept, "--resume", "--interval", "12")
    assert other.exit_code == 2
    assert "interval_hours" in other.stderr
    assert shell.run(*asked, "--out", kept, "--resume").exit_code == 0
    assert begun == ["=A", "B", "B"]
    assert without_seconds(json.loads((kept / "track.json").read_text())) == wanted

    parts = shell.folder / "parts"
    for part in ("2/2", "1/2"):
        assert shell.run(*asked, "--out", parts, "--shard", part).exit_code == 0
    assert shell.run("merge", parts).exit_code == 0
    assert without_seconds(json.loads((parts / "track.json").read_text())) == wanted


def test_the_files_of_a_patient_are_not_distributed(shell):
    result = shell.run("track", shell.case(more=MEASURED), "--out", shell.folder / "out", "--shard", "1/2")
    assert result.exit_code == 2
    assert "--resume, --shard, --dask: work for tables only" in result.stderr


VALUES = "[measurements]\nMAP = 80\nCO = 4.0\nSP = 100\n"


def test_files_of_different_patients_are_refused(shell):
    files = [shell.case(f"{n}.toml", n, VALUES) for n in ("P01", "P02")]
    result = shell.run("track", *files, "--out", shell.folder / "out", *FEW)
    assert result.exit_code == 2
    assert "files of 2 patients: 'P01' in" in result.stderr
    assert "P02.toml" in result.stderr
    assert not (shell.folder / "out").exists()


def test_the_collision_warning_is_for_ids_that_differ(shell):
    """Refused for the other reason, so that nothing is computed."""
    same = [shell.case(f"{k}.toml", "P01", VALUES) for k in range(2)]
    alike = [same[0], shell.case("alike.toml", "p01", VALUES)]
    for files, warned in ((same, False), (alike, True)):
        result = shell.run("track", *files, "--out", shell.folder / "out", "--parameters", "Rmd")
        assert result.exit_code == 2
        assert ("only in case, spaces or Unicode form" in result.stderr) == warned
        assert "files of 2 patients" not in result.stderr


def test_times_that_run_back_are_refused(shell):
    files = [shell.case(f"2024-03-0{k}.toml", "P01", VALUES) for k in (2, 1)]
    result = shell.run("track", *files, "--out", shell.folder / "out", *FEW)
    assert result.exit_code == 2
    assert "earlier than" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--parameters", "Rmd"), "error: --parameters: Rmd: unknown parameter"),
        (("--uncertainty", "XX=3"), "--uncertainty XX"),
        (("--bounds", "Rmc=2:1"), "error: --bounds: Rmc = 2, 2 to 1: lower bound above upper bound"),
    ],
)
def test_mistakes_are_told_before_anything_is_computed(shell, table, arguments, message):
    result = shell.run("track", table, "--out", shell.folder / "out", *arguments)
    assert result.exit_code == 2
    assert message in result.stderr
    assert not (shell.folder / "out").exists()


def test_the_same_file_is_no_second_measurement(shell):
    case = shell.case(more=MEASURED)
    result = shell.run("track", case, case, "--out", shell.folder / "out")
    assert result.exit_code == 2
    assert "given 2 times; give each measurement once" in result.stderr
    (shell.folder / "tuesday").mkdir()
    (shell.folder / "tuesday" / "case.toml").write_text(Path(case).read_text())
    result = shell.run("track", case, shell.folder / "tuesday" / "case.toml", "--out", shell.folder / "out")
    assert result.exit_code == 2
    assert "case.toml: measurements have the names of their files; give each file" in result.stderr


def test_results_are_not_overwritten(shell, table):
    out = shell.folder / "out"
    out.mkdir()
    (out / "track.json").write_text("{}")
    result = shell.run("track", table, "--out", out)
    assert result.exit_code == 2
    assert "--force" in result.stderr


def test_tables_and_case_files_do_not_mix(shell, table):
    result = shell.run("track", table, shell.case(), "--out", shell.folder / "out")
    assert result.exit_code == 2
    assert "allowed: one table, or case files" in result.stderr


MEASURED = "[measurements]\nSP = 110\nDP = 75\nMAP = 88\nCO = 4.0\n"
KNOWN = "[parameters]\n" + "".join(
    f"{name} = {PARAMETERS[name].value}\n" for name in BOUNDS if name not in ("Rmc", "Emaxlv")
)
"""The other parameters of a fit, given, so that none is held as an assumption."""


@pytest.mark.slow
def test_predictions_at_other_settings(shell):
    case, out = shell.case(more=MEASURED), shell.folder / "out"
    result = shell.run(
        "identify", case, "--out", out, *FEW, "--predict", "patient.heart_rate_bpm=90", "--json", "-"
    )
    assert result.exit_code == 0, result.output
    posterior = json.loads(result.stdout)["posterior"]
    assert posterior["method"] == "importance"
    assert posterior["checked"]
    assert posterior["pareto_k"] < 0.7
    assert posterior["effective_draws"] > 400
    there = posterior["predictions"][1]
    assert there["settings"] == "patient.heart_rate_bpm=90"
    assert there["outputs"]["CO"]["lower"] < there["outputs"]["CO"]["upper"]
    assert (out / "posterior" / "posterior.nc").exists()
    assert (out / "posterior" / "figures" / "predictive.png").exists()


@pytest.mark.slow
def test_gaussian_predictions_are_called_that_and_unchecked(shell):
    case, out = shell.case(more=MEASURED + KNOWN), shell.folder / "out"
    result = shell.run(
        "identify", case, "--out", out, *FEW, "--predict", "patient.heart_rate_bpm=90",
        "--predict-with", "gaussian",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "patient.heart_rate_bpm=90: Gaussian approximation" in result.stdout
    assert result.stdout.count("NOT CHECKED") == 3
    posterior = json.loads((out / "posterior" / "posterior.json").read_text())
    assert not posterior["trusted"]
    assert not posterior["checked"]


def test_a_misspelt_prediction_is_told_at_once(shell):
    result = shell.run(
        "identify",
        shell.case(more=MEASURED),
        "--out",
        shell.folder / "out",
        "--predict",
        "ecmo.sped_rpm=4000",
    )
    assert result.exit_code == 2
    assert "--predict" in result.stderr
    assert not (shell.folder / "out").exists()


def test_a_cohort_has_no_posterior(shell, table):
    result = shell.run("identify", table, "--out", shell.folder / "out", "--posterior")
    assert result.exit_code == 2
    assert "for case files" in result.stderr


def test_assumed_numbers_that_measured_gases_tell_of_are_warned_of(capsys):
    table = Path(__file__).parents[2] / "examples" / "ageing_oxygenator.csv"
    points = read_usable_cohort(str(table)).points
    series = {"vv-ageing": [(point.measurement, point.case) for point in points]}
    _check_points(series, {"vv-ageing": TrackSettings(FitSettings(("Rmc",)))})
    message = capsys.readouterr().err
    assert (
        "vv-ageing: the shunt of the lungs is held at an assumed value although SaO2, PaO2 would help"
        in message
    )
    assert "gas.vo2_ml_min" in message
    # Whichever row has the gases.
    (first, case), *later = series["vv-ageing"]
    without = case.model_copy(update={"gas": None, "measurements": Measurements(MAP=70)})
    series["vv-ageing"] = [(first, without), *later]
    _check_points(series, {"vv-ageing": TrackSettings(FitSettings(("Rmc",)))})
    assert "the shunt of the lungs is held at an assumed value" in capsys.readouterr().err
    free = ("Rmc", "gas.shunt_fraction", "gas.vo2_ml_min")
    _check_points(series, {"vv-ageing": TrackSettings(FitSettings(free))})
    message = capsys.readouterr().err
    assert "assumed value" not in message
    assert "note: vv-ageing: the blood volume is held" in message


def test_what_gases_and_cvp_tell_of_is_free_unasked(shell, capsys):
    """Row by row, and for each patient of a table."""
    head = HEAD.strip() + ",SaO2,haemoglobin_g_dl,CVP\n"
    rows = (
        "=A,1,female,60,165,60,80,112,74,88,,,4.0,,,,,,,,,\n",
        "=A,2,female,60,165,60,80,112,74,88,,,4.0,,,,,,,93,10,\n",
        "=B,1,female,60,165,60,80,112,74,88,,,4.0,,,,,,,,,4\n",
    )
    file = shell.folder / "gases.csv"
    file.write_text(head + "".join(rows))
    options = TrackOptions(files=[str(file)], out=str(shell.folder / "out"))
    series, *_ = _series(options)
    each = _settings_of_each(options, series, _settings(options))
    assert each["=A"].fit.parameters == ("gas.shunt_fraction", *BOUNDS)
    assert each["=B"].fit.parameters == ("fluid.extra_volume_ml", *BOUNDS)
    assert (
        "=A: blood gases, CVP or pressures of the CRRT were measured: the free parameters are "
        "gas.shunt_fraction" in capsys.readouterr().err
    )
    _check_points(series, each)
    chosen = TrackOptions(files=[str(file)], out="out", parameters="Rmc", bounds="Rmc=0.1:2")
    each = _settings_of_each(chosen, series, _settings(chosen))
    assert {settings.fit.parameters for settings in each.values()} == {("Rmc",)}
