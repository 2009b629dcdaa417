"""`eclsim identify`: what it refuses, what it writes, and that other commands take the result."""

import json
from functools import partial
from pathlib import Path

import pytest

from eclsim.cases.cohort import read_cohort
from eclsim.cases.fit_mark import FitMark, read_mark
from eclsim.cli.identify import _check_points
from eclsim.execution import threads
from eclsim.identification import multi_start
from eclsim.identification.settings import FitSettings
from eclsim.parameters.thiel2025 import BOUNDS, PARAMETERS

MEASURED = """[measurements]
SP = 110
DP = 75
MAP = 88
CO = 4.0
"""
KNOWN = "[parameters]\n" + "".join(
    f"{name} = {PARAMETERS[name].value}\n" for name in BOUNDS if name not in ("Rmc", "Emaxlv")
)
"""The other parameters of a fit, given, so that none is held as an assumption."""
NO_DEVICE = ",,,,"
HEAD = (
    "patient_id,measurement,sex,age_years,height_cm,weight_kg,heart_rate_bpm,SP,DP,MAP,MPAP,PCWP,CO,PF,"
    "ecmo_pump,ecmo_speed_rpm,oxygenator,drainage_fr,return_fr"
)


@pytest.fixture
def quick(monkeypatch):
    """Explores few points, so that only what is around the search is tested at length."""
    small = partial(
        multi_start.MultiStart, points_per_parameter=10, refined_share=0.2, round_size=4, rediscoveries=2
    )
    monkeypatch.setattr(multi_start, "MultiStart", small)


def cohort(folder: Path, *rows: str) -> Path:
    path = folder / "cohort.csv"
    path.write_text("\n".join((HEAD, *rows)) + "\n")
    return path


def row(number: int, pressure: str = "110") -> str:
    return f"P01,{number},male,42,187,73,83,{pressure},75,88,,,4.0,{NO_DEVICE},"


@pytest.mark.slow
def test_a_case_is_fitted_and_simulate_takes_the_result(shell, quick, tmp_path):
    case, out = shell.case(more=MEASURED), tmp_path / "fit"
    done = shell.run("identify", case, "--parameters", "Rmc,Emaxlv", "--out", str(out), "--json", "-")
    assert done.exit_code == 0, done.stderr
    (point,) = json.loads(done.stdout)["points"]
    assert point["id"] == "P01"
    assert set(point["parameters"]) == {"Rmc", "Emaxlv"}
    assert json.loads((out / "identification.json").read_text())["points"] == [point]
    assert {p.name for p in (out / "figures").glob("*.png")} == {
        "slices.png", "profiles.png", "starts.png", "residuals.png", "correlation.png",
    }  # fmt: skip

    report = (out / "report.html").read_text()
    assert point["verdict"]["level"].upper() + " FIT" in report
    assert report.count("<svg") == 5
    assert "verdict" in (out / "verdicts.csv").read_text()

    again = shell.run("simulate", str(out / "cases" / "P01.toml"), "--json", "-")
    outputs = json.loads(again.stdout)["cases"][0]["outputs"]
    assert outputs["MAP"] == pytest.approx(point["outputs"]["MAP"]["simulated"], rel=1e-5)
    assert outputs["CO"] == pytest.approx(point["outputs"]["CO"]["simulated"], rel=1e-5)


@pytest.mark.slow
def test_a_poor_fit_is_said_and_ends_with_status_1(shell, quick, tmp_path):
    case = shell.case(more=MEASURED.replace("SP = 110", "SP = 110\nMPAP = 45"))
    done = shell.run("identify", case, "--parameters", "Rmc,Emaxlv", "--out", str(tmp_path / "fit"))
    assert done.exit_code == 1, done.stderr
    head, first, *rest = done.stdout.splitlines()
    assert head.startswith("P01: POOR FIT, not to be used")
    assert "fitted against 45 measured" in first
    assert "optimum found" in done.stdout
    assert not [line for line in rest if line.startswith(("Rmc", "Emaxlv")) and "  yes" in line]


@pytest.mark.slow
@pytest.mark.parametrize(("trusted", "level", "status"), [(True, "poor", 1), (False, "good", 0)])
def test_a_posterior_that_excludes_the_fit_changes_its_verdict(
    shell, quick, tmp_path, monkeypatch, trusted, level, status
):
    far = {"median": 4.0, "lower": 3.9, "upper": 4.1}
    other = {
        "method": "importance", "kind": "posterior (weighted draws)", "trusted": trusted, "verdict": "",
        "doubts": [], "prior": "log-uniform", "parameters": {"Rmc": far}, "predictions": [],
    }  # fmt: skip
    monkeypatch.setattr("eclsim.cli.identify._sample", lambda *_: other)
    out = tmp_path / "fit"
    done = shell.run(
        "identify", shell.case(more=MEASURED + KNOWN), "--parameters", "Rmc,Emaxlv", "--out", str(out),
        "--posterior", "--posterior-method", "importance", "--json", "-",
    )  # fmt: skip
    assert done.exit_code == status, done.stderr
    (point,) = json.loads(done.stdout)["points"]
    assert point["verdict"]["level"] == level
    fitted = out / "cases" / "P01.toml"
    assert read_mark(fitted.read_text(encoding="utf-8")) == FitMark(level, is_changed=False)
    assert ("not to be used" in shell.run("simulate", str(fitted)).stderr) == (level == "poor")
    assert point["parameters"]["Rmc"]["identifiable"] == (not trusted)
    assert (
        "3.9 to 4.1 by the posterior: they do not overlap" in (out / "report.html").read_text()
    ) == trusted


@pytest.mark.slow
def test_what_is_fitted_stays_where_the_posterior_is_stopped(shell, quick, tmp_path, monkeypatch):
    """Only figures and a case without its verdict were left of the minutes before."""

    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("eclsim.cli.identify._sample", stopped)
    out = tmp_path / "fit"
    command = ("identify", shell.case(more=MEASURED), "--parameters", "Rmc,Emaxlv", "--out", str(out))
    assert shell.run(*command, "--posterior", "--posterior-method", "importance").exit_code == 130
    content = json.loads((out / "identification.json").read_text())
    assert "posterior" not in content
    assert content["points"][0]["parameters"]["Rmc"]["profile"]
    assert (out / "report.html").exists()


def test_workers_are_those_of_a_single_case_too(shell, tmp_path, monkeypatch):
    """A case was fitted with all processors, whatever --workers said."""
    used = []

    def fit(*_: object, **__: object) -> None:
        used.append(threads())
        raise KeyboardInterrupt

    monkeypatch.setattr("eclsim.identification.fit.fit", fit)
    shell.run("identify", shell.case(more=MEASURED), "--workers", "3", "--out", str(tmp_path / "fit"))
    assert used == [3]


@pytest.mark.slow
def test_a_cohort_with_a_bad_row_is_partial_and_can_be_gone_on_with(shell, quick, tmp_path):
    file, out = cohort(tmp_path, row(1), row(2, "high"), row(3, "118")), tmp_path / "fits"
    arguments = ("identify", str(file), "--parameters", "Rmc,Emaxlv", "--out", str(out))
    done = shell.run(*arguments, "--json", "-")
    assert done.exit_code == 1, done.stderr
    assert f"{file}:3: SP" in done.stderr
    result = json.loads(done.stdout)
    assert [p["id"] for p in result["points"]] == ["P01/1", "P01/3"]
    assert [(r["line"], r["column"]) for r in result["refused"]] == [(3, "SP")]
    assert set(result["r2"]) == {"pressures", "flows"}
    assert {p.name for p in (out / "cases").iterdir()} == {"P01_1.toml", "P01_3.toml"}
    for p in result["points"]:
        written = (out / "cases" / f"{p['id'].replace('/', '_')}.toml").read_text(encoding="utf-8")
        assert read_mark(written) == FitMark(p["verdict"]["level"], is_changed=False)
    assert {p.name for p in (out / "figures").glob("*.png")} == {"scatter.png", "boxes.png"}
    report = (out / "report.html").read_text()
    assert "Fits of 2 data points" in report
    assert "1 rows were refused" in report
    assert report.count("<svg") == 2

    refused = shell.run(*arguments)
    assert refused.exit_code == 2
    assert "--force" in refused.stderr
    resumed = shell.run(*arguments, "--resume")
    assert resumed.exit_code == 1, resumed.stderr
    assert "P01/3" in resumed.stdout
    other = shell.run(*arguments, "--resume", "--seed", "5")
    assert other.exit_code == 2
    assert "seed was 0 and is 5" in other.stderr


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--parameters", "Rmcc"), "error: --parameters: Rmcc: unknown parameter"),
        (("--bounds", "Rmc=2:0.1"), "error: --bounds: Rmc = 2, 2 to 0.1: lower bound above upper bound"),
        (("--bounds", "Rmc=5"), "NAME=LOWER:UPPER"),
        (("--uncertainty", "XY=3"), "no measurement"),
        (("--uncertainty", "PCWP=3"), "error: --uncertainty: PCWP: not measured, so its"),
        (("--resume",), "work for cohorts only"),
        (("--draws", "60"), "--chains, --warmup, --draws: need --posterior"),
        (("--prior", "log-normal"), "--prior: needs --posterior or --predict"),
        (("--predict-with", "gaussian"), "--predict-with: needs --predict"),
        (("--posterior-method", "importance"), "--posterior-method: needs --posterior"),
        (("--predict", "Rmc=0.4"), "Rmc is free, so every draw has its own"),
        (("--predict", "ecmo.rpm=4000"), "--predict: ecmo.rpm = "),
        (("--predict", "measurements.SP=90"), "no output depends on measurements.SP"),
        (
            ("--parameters", "Rmc,heart_rate_bpm", "--predict", "patient.heart_rate_bpm=90"),
            "heart_rate_bpm is free, so every draw",
        ),
        (("--predict", "CQao=300", "--predict", "CQao=300"), "--predict CQao=300: given 2 times"),
        (("--predict", "CQao=300,CQao=310"), "gives CQao 2 times; allowed: once"),
        (("--bounds", "Rmc=0.1:1,Rmc=0.2:2"), "Rmc is given twice"),
    ],
)
def test_bad_options_end_before_anything_is_computed(shell, tmp_path, arguments, text):
    done = shell.run("identify", shell.case(more=MEASURED), "--out", str(tmp_path / "fit"), *arguments)
    assert done.exit_code == 2
    assert text in done.stderr
    assert not (tmp_path / "fit").exists()


def test_a_case_without_measurements_has_nothing_to_fit(shell, tmp_path):
    done = shell.run("identify", shell.case(), "--out", str(tmp_path / "fit"))
    assert done.exit_code == 2
    assert "nothing to fit" in done.stderr


def test_points_that_cannot_share_a_parameter_are_named(tmp_path, capsys):
    on_ecmo = row(2).removesuffix(f"{NO_DEVICE},") + ",Rotaflow,3000,Quadrox-i Adult,25,15"
    file = cohort(tmp_path, row(1), on_ecmo, row(3))
    _check_points(read_cohort(file), FitSettings(("Rmc",), shared=("Csart",)), "f.csv")
    said = capsys.readouterr().err
    assert "f.csv: P01: lines 2, 3, 4 are points of different circuits: those of the same" in said
    _check_points(read_cohort(file), FitSettings(("Rmc",)), "f.csv")
    assert "circuits" not in capsys.readouterr().err


def test_a_table_without_a_usable_row_is_bad_input(shell, tmp_path):
    done = shell.run("identify", str(cohort(tmp_path, row(1, "x"))), "--out", str(tmp_path / "fits"))
    assert done.exit_code == 2
    assert "no row can be used" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("command", ["identify", "identifiability", "sensitivity", "track"])
def test_no_command_writes_over_what_it_reads(shell, tmp_path, command):
    case = shell.case(more=MEASURED)
    before = Path(case).read_bytes()
    out = ("--out", str(tmp_path / "out"))
    done = shell.run(command, case, *out, "--json", case, "--force")
    assert (done.exit_code, Path(case).read_bytes()) == (2, before)
    assert "is an input of this command and would be overwritten" in done.stderr


def test_a_parameter_that_some_rows_have_not_is_refused_with_their_lines(shell, tmp_path):
    on_ecmo = "P02,1,male,42,187,73,83,110,75,88,,,4.0,2.2,Rotaflow,2725,Quadrox-i Adult,25,15"
    rows = (row(1), on_ecmo, *(row(k) for k in range(2, 8)))
    arguments = ("identify", str(cohort(tmp_path, *rows)), "--out", str(tmp_path / "fits"))
    done = shell.run(*arguments, "--parameters", "Rmc,Recmooxy,Rmcc")
    assert done.exit_code == 2
    assert "so it cannot be fitted (lines 2, 4, 5, 6, 7 and 2 more)" in done.stderr
    assert done.stderr.count("Rmcc: unknown parameter") == 1
    assert "Rmcc: unknown parameter (line" not in done.stderr


def test_an_uncertainty_that_no_row_measures_is_refused(shell, quick, tmp_path):
    arguments = ("identify", str(cohort(tmp_path, row(1))), "--out", str(tmp_path / "fits"))
    done = shell.run(*arguments, "--uncertainty", "PCWP=3,CO=5%")
    assert done.exit_code == 2
    assert "PCWP: not measured" in done.stderr
    assert "allowed: SP, DP, MAP, CO" in done.stderr


def test_limits_that_are_no_numbers_are_refused(shell, tmp_path):
    case = shell.case(more=MEASURED)
    assert "infinite" in shell.run("identifiability", case, "--threshold", "inf").stderr
    done = shell.run("sensitivity", case, "--samples", "64", "--until", "nan")
    assert (done.exit_code, "--until nan: allowed: above 0" in done.stderr) == (2, True)


def test_where_it_would_write_is_checked_first(shell, tmp_path):
    case = shell.case(more=MEASURED)
    missing = shell.run("identify", case, "--out", str(tmp_path / "no" / "where"))
    assert missing.exit_code == 2
    assert "does not exist" in missing.stderr
    (tmp_path / "file").write_text("")
    assert shell.run("identify", case, "--out", str(tmp_path / "file")).exit_code == 2
