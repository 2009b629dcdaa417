"""The simulator under a small design: inputs of a case, states, failures, files, the command line."""

import csv
import json
import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from eclsim.cases import read_case
from eclsim.cases.case import Case, Patient
from eclsim.cli import main
from eclsim.devices.crrt import SCHEMES
from eclsim.orbit.model import UnknownValueError
from eclsim.orbit.status import Status
from eclsim.outputs.uncertainty import Uncertainty
from eclsim.sensitivity.analysis import (
    TARGETS,
    Analysis,
    SobolSettings,
    StateError,
    plan_analysis,
    sensitivity,
    state_values,
)
from eclsim.sensitivity.identifiability import identifiability
from eclsim.sensitivity.inputs import CARDIOVASCULAR, Categorical, InputError, varied_inputs
from eclsim.sensitivity.results import indices_of_runs
from eclsim.validation.reference_cases import DATA

CASE = """
format = 1
[patient]
id = "P"
sex = "female"
age_years = 70
height_cm = 165
weight_kg = 60
heart_rate_bpm = 120
[ecmo]
mode = "VA"
pump = "Rotaflow"
speed_rpm = 3425
oxygenator = "Quadrox-i Adult"
"""
CRRT = """
[crrt]
flow_ml_min = 200
access_site = "post_oxy"
return_site = "pre_oxy"
"""


def planned(case, **settings) -> Analysis:
    return plan_analysis(case, SobolSettings(**settings))


@pytest.fixture
def case_file(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(CASE)
    return path


@pytest.fixture
def case(case_file):
    return read_case(case_file).case


@pytest.fixture
def crrt_case(tmp_path):
    path = tmp_path / "crrt.toml"
    path.write_text(CASE + CRRT)
    return read_case(path).case


def run_command(*arguments) -> int:
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    return stop.value.code or 0


def test_the_default_inputs_are_the_papers(case):
    plan = planned(case, samples=2048)
    assert plan.design.factors == CARDIOVASCULAR
    assert plan.design.evaluations == 102_400
    rmc = next(i for i in plan.design.inputs if i.name == "Rmc")
    assert (rmc.low, rmc.high) == (0.375, 0.625)


def test_groups_and_inputs_of_the_devices(crrt_case):
    include = ("ecmo.speed_rpm", "ecmo.return_fr", "crrt.flow_ml_min", "crrt.scheme")
    design = planned(crrt_case, samples=8, groups=("R", "C", "L", "E"), include=include).design
    assert design.factors == ("R", "C", "L", "E", *include)
    sizes = next(i for i in design.inputs if i.name == "ecmo.return_fr")
    assert isinstance(sizes, Categorical)
    assert sizes.levels == ("15 Fr", "17 Fr", "19 Fr", "21 Fr")


def test_a_group_holds_what_its_unit_measures_and_nothing_by_its_first_letter(case):
    names = ("Rmc", "RV_Pd_kappa", "Csart", "CQao", "Lao", "LV_Pd_alpha", "Emaxlv", "etaB")
    design = planned(case, samples=8, parameters=names, groups=("R", "C", "L", "E")).design
    assert design.groups == ("R", "RV_Pd_kappa", "C", "CQao", "L", "LV_Pd_alpha", "E", "etaB")
    with pytest.raises(InputError, match="group C: none of the parameters varied is one of the compliances"):
        planned(case, samples=8, parameters=("Rmc", "CQao"), groups=("R", "C"))


@pytest.mark.parametrize(
    ("value", "message"), [(-1.0, "P0svn: the perturbation reaches -1.25 to -0.75"), (0.0, "vary")]
)
def test_a_negative_value_is_varied_like_any_other(case, value, message):
    """It is outside of its range, or not; a percentage of it varies it all the same."""
    base = {"P0svn": value}
    with pytest.raises(InputError, match=message):
        varied_inputs(case, base, ("P0svn",))


def test_a_parameter_that_is_solved_with_the_beat_is_not_varied(case):
    """Its perturbation reached "nan to nan"."""
    with pytest.raises(InputError, match="Rmc: is solved with the beat; give it a value in the case"):
        varied_inputs(case, {"Rmc": math.nan}, ("Rmc",))


@pytest.mark.slow
def test_each_scheme_in_a_batch_is_that_scheme_alone(crrt_case):
    from eclsim.orbit.model import model_of
    from eclsim.outputs.results import simulate

    plan = planned(
        crrt_case, parameters=(), include=("crrt.scheme",), samples=8, outputs=("MAP", "crrt_access_pressure")
    )
    unit = (np.arange(9)[:, None] + 0.5) / 9
    result = plan.evaluator(plan.design.settings(unit), 9)
    for k, (access, back) in enumerate(SCHEMES.values()):
        crrt = crrt_case.crrt.model_copy(update={"access_site": access, "return_site": back})
        single = simulate(model_of(crrt_case.model_copy(update={"crrt": crrt})))
        expected = [float(single["MAP"]), float(single["crrt_access_pressure"])]
        np.testing.assert_allclose(result.values[k], expected, rtol=1e-5)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"parameters": ("Rmcc",)}, "did you mean Rmc"),
        ({"include": ("crrt.scheme",)}, r"needs the sections \[ecmo\] and \[crrt\]"),
        ({"groups": ("X",)}, "group X"),
        ({"perturbation_percent": 100.0}, "below 100"),
        ({"outputs": ("MAPP",)}, "did you mean MAP"),
        (
            {"include": ("ecmo.speed_rpm",), "perturbation_percent": 60.0},
            "ecmo.speed_rpm: the perturbation reaches",
        ),
    ],
)
def test_impossible_inputs_are_named(case, options, message):
    with pytest.raises(InputError, match=message):
        planned(case, samples=8, **options)


@pytest.mark.slow
def test_the_paper_s_parameters_lead(case):
    names = ("Rmc", "Emaxlv", "Rpmc", "Emaxrv", "Lpas")
    settings = SobolSettings(parameters=names, samples=64, second_order=False)
    result = sensitivity(case, settings=settings).indices
    assert result.failed == ()
    assert list(result.sums)[:3] == ["Rmc", "Emaxlv", "Rpmc"]
    assert result.sums["Rmc"] > 2.5
    assert result.sums["Lpas"] < 0.01
    assert result.ranking("MPAP")[0] == "Rpmc"
    assert "Lpas" not in result.union()


@pytest.mark.slow
def test_no_state_is_solved_from_beats_that_were_not_found(case):
    from eclsim.orbit.model import model_of

    with pytest.raises(StateError, match=r"at Rmc = .* no steady beat \(not_converged\)"):
        state_values(model_of(case).with_values({"LV_Pd_kappa": 50.0}), "normal")


def test_states_have_their_pressure(case):
    from eclsim.orbit.model import model_of
    from eclsim.outputs.results import simulate

    model = model_of(case)
    values = {state: state_values(model, state) for state in TARGETS}
    for state, target in TARGETS.items():
        assert float(simulate(model.with_values(values[state]))["MAP"]) == pytest.approx(target, abs=1e-3)
    assert values["hypotensive"]["Rmc"] < values["normal"]["Rmc"] < values["hypertensive"]["Rmc"]


def test_a_heart_that_stops_ejecting_is_named_and_its_rows_left_out(tmp_path):
    weak = "\n[parameters]\nEmaxlv = 0.3\nEmaxrv = 0.05\n"
    file = tmp_path / "weak.toml"
    file.write_text(CASE.replace("3425", "3000") + weak)
    plan = planned(read_case(file).case, samples=8, parameters=("Emaxrv", "Rmc"), perturbation_percent=60.0)
    result = plan.block(0)
    stopped = result.status == Status.ONE_OF_MANY
    rows = stopped.reshape(8, -1).any(axis=1)
    assert 2 <= (~rows).sum() < 8
    indices = indices_of_runs(plan.design, plan.evaluator.outputs, result).indices
    assert {run.run for run in indices.failed} == set(np.flatnonzero(result.status))
    assert {run.status for run in indices.failed} == {"one_of_many"}
    assert indices.union() == []
    content = indices.as_object()
    assert any("runs failed (one_of_many)" in sentence for sentence in content["warnings"])
    assert any("nothing is ranked" in sentence for sentence in content["warnings"])
    assert indices.rows_used == (result.status == 0).reshape(8, -1).all(axis=1).sum()
    # What a failed run computed changes nothing: its row is left out of every estimate.
    absurd = replace(result, values=np.where(result.status[:, None] == 0, result.values, 1e6))
    again = indices_of_runs(plan.design, plan.evaluator.outputs, absurd).indices
    np.testing.assert_array_equal(again.estimates.ST, indices.estimates.ST)
    kept = replace(result, status=np.zeros_like(result.status), values=absurd.values)
    assert not np.array_equal(
        indices_of_runs(plan.design, plan.evaluator.outputs, kept).indices.estimates.ST, indices.estimates.ST
    )


@pytest.mark.slow
def test_the_command_writes_json_tables_figures_and_samples(case_file, tmp_path, capsys):
    out, file = tmp_path / "out", tmp_path / "result.json"
    options = ("--samples", 64, "--parameters", "Rmc,Emaxlv", "--outputs", "MAP,CO", "--out", out)
    assert run_command("sensitivity", case_file, *options, "--json", file, "--second-order") == 0
    content = json.loads(file.read_text())
    assert content["samples"] == 64
    assert content["evaluations"] == 64 * 6
    assert content["failed"] == 0
    assert set(content["outputs"]["MAP"]) == {"S1", "S1_conf", "ST", "ST_conf", "S2", "S2_conf"}
    assert set(content["outputs"]["CO"]["ST"]) == {"Rmc", "Emaxlv"}
    assert set(content["selected"]) == {"MAP", "CO"}
    assert set(content["union"]) <= {"Rmc", "Emaxlv"}
    total = sum(content["outputs"][o]["ST"]["Rmc"] for o in ("MAP", "CO"))
    assert content["sum_ST"]["Rmc"] == pytest.approx(total)
    rows = list(csv.DictReader((out / "indices.csv").read_text().splitlines()))
    assert {(r["output"], r["factor"]) for r in rows} == {
        (o, f) for o in ("MAP", "CO") for f in ("Rmc", "Emaxlv")
    }
    rows = list(csv.DictReader((out / "convergence.csv").read_text().splitlines()))
    assert [(r["rows"], r["output"], r["factor"], r["index"]) for r in rows] == [
        (n, o, f, i)
        for n in ("16", "32", "64")
        for o in ("MAP", "CO")
        for f in ("Rmc", "Emaxlv")
        for i in ("S1", "ST")
    ]
    drawn = {"bars", "convergence", "distributions", "pairs", "sums", "total_less_first_order", "total_order"}
    assert {p.stem for p in (out / "figures").glob("*.svg")} >= drawn - {"convergence"}
    shown = capsys.readouterr().out
    assert "marked * for at least one output: Rmc, Emaxlv" in shown
    assert "econd order" in shown
    # What stands is not overwritten, unless asked.
    assert run_command("sensitivity", case_file, *options) == 2
    assert "--resume" in capsys.readouterr().err
    assert run_command("sensitivity", case_file, *options, "--resume", "--no-figures") == 0


@pytest.mark.slow
def test_files_of_a_state_name_it(case_file, tmp_path, capsys):
    """Those of two states could not be told apart but by their folders."""
    out, file = tmp_path / "out", tmp_path / "result.json"
    options = ("--samples", 16, "--parameters", "Rmc", "--outputs", "MAP", "--states", "normal,hypotensive")
    assert run_command("sensitivity", case_file, *options, "--out", out, "--json", file) == 0
    capsys.readouterr()
    states = json.loads(file.read_text())["states"]
    for name in ("normal", "hypotensive"):
        assert json.loads((out / name / "indices.json").read_text())["state"] == states[name]["state"] == name
        assert f"sensitivity, {name} state" in (out / name / "figures/bars.svg").read_text(encoding="utf-8")


@pytest.mark.slow
def test_shards_from_the_command_line_merge_to_the_same_samples(case_file, tmp_path, capsys):
    common = (
        "--samples",
        256,
        "--parameters",
        "Rmc",
        "--outputs",
        "MAP",
        "--no-second-order",
        "--no-figures",
    )
    for shard in ("2/2", "1/2"):
        assert run_command("sensitivity", case_file, *common, "--out", tmp_path / "a", "--shard", shard) == 0
    capsys.readouterr()
    assert run_command("sensitivity", "merge", "--out", tmp_path / "a", "--no-figures") == 0
    assert f"eclsim merge {tmp_path / 'a'}" in " ".join(capsys.readouterr().err.split()).replace("- ", "-")
    assert run_command("sensitivity", case_file, *common, "--out", tmp_path / "b") == 0
    assert (tmp_path / "a/samples.parquet").read_bytes() == (tmp_path / "b/samples.parquet").read_bytes()
    capsys.readouterr()


@pytest.mark.slow
def test_shards_of_a_patient_with_reflexes_and_drugs_merge_across_processes(tmp_path):
    """The inputs held where a function lay in memory: no run of a patient with a reflex could go on."""
    case = tmp_path / "regulated.toml"
    heart = 'id = "R"\nsex = "male"\nage_years = 61\nheart_rate_bpm = 92\n'
    answers = "[regulation]\nbaroreflex = 1.0\n[drugs]\nmilrinone = 0.3\n"
    case.write_text(f"format = 1\n[patient]\n{heart}{answers}")
    command = [sys.executable, "-m", "eclsim", "sensitivity", str(case), "--samples", "128", "--out"]
    command += [str(tmp_path / "out"), "--parameters", "Rmc", "--outputs", "MAP", "--no-second-order"]
    for shard in ("1/2", "2/2"):
        done = subprocess.run([*command, "--no-figures", "--shard", shard], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    assert run_command("merge", tmp_path / "out") == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--samples", 100), "power of two"),
        (("--shard", "3/2", "--out", "x"), "--shard 3/2"),
        (("--resume",), "--out DIR"),
        (("--parameters", "Rmcc,Emaxlvv"), "Emaxlvv"),
        (("--states", "happy"), "hypotensive"),
        (("--states", "normal,hypotensive", "--range", "Rmc=0.3:0.7"), "differ in Rmc alone"),
    ],
)
def test_wrong_options_end_with_status_2(case_file, capsys, monkeypatch, tmp_path, options, message):
    monkeypatch.chdir(tmp_path)
    assert run_command("sensitivity", case_file, *options) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_the_command_says_what_can_be_identified(case_file, tmp_path, capsys):
    out = tmp_path / "out"
    options = ("--parameters", "Rmc,Rsart,Emaxlv,Csart,Lpas", "--out", out)
    assert run_command("identifiability", case_file, *options) == 0
    content = json.loads((out / "identifiability.json").read_text())
    # Both resistances stand in series: nothing tells them apart.
    assert content["orthogonality"]["Rmc"]["Rsart"] < 1e-3
    assert "Rmc" in content["proposed"]
    assert "Rmc" in content["excluded"]["Rsart"]
    assert "too little effect" in content["excluded"]["Lpas"]
    assert (out / "figures/collinearity.png").exists()
    assert "Rsart" in capsys.readouterr().out
    assert run_command("identifiability", case_file, "--uncertainty", "SP=abc") == 2


@pytest.mark.slow
def test_only_what_was_measured_counts(case_file):
    raw_case = read_case(case_file, ["measurements.MAP=80", "measurements.CO=4"]).case
    result = identifiability(raw_case, parameters=("Rmc", "Emaxlv", "Csart"))
    assert result.scaled.outputs == ("MAP", "CO")
    assert len(result.proposal.chosen) <= 2


@pytest.mark.slow
def test_percentages_are_those_of_what_was_measured(case_file, capsys):
    settings = ["measurements.CO=1.4", "measurements.MAP=80"]
    case = read_case(case_file, settings).case
    result = identifiability(case, parameters=("Rmc", "Emaxlv"))
    assert result.uncertainties == {"MAP": 3.0, "CO": pytest.approx(0.14)}
    assert result.simulated["CO"] > 3.0
    assert result.far_off["CO"] == pytest.approx((result.simulated["CO"] - 1.4) / 0.14)
    # The scaled sensitivity is in these uncertainties.
    wide = {"CO": Uncertainty(1.4)}
    wider = identifiability(case, parameters=("Rmc", "Emaxlv"), uncertainties=wide)
    np.testing.assert_allclose(result.scaled.matrix[1], 10.0 * wider.scaled.matrix[1])
    # Nothing measured: of what the model gives.
    free = identifiability(read_case(case_file, []).case, parameters=("Rmc", "Emaxlv"), outputs=("CO",))
    assert free.measured == {}
    assert free.as_object()["warnings"] == list(free.warnings)
    # What is said on the terminal stands in the JSON and the labelled results too.
    kept = result.as_object()
    assert kept["far_off"] == result.far_off
    assert "fit the case first" in kept["warnings"][-1]
    assert result.dataset.attrs["warnings"] == kept["warnings"]
    assert free.uncertainties["CO"] == pytest.approx(0.1 * free.simulated["CO"])
    options = [word for setting in settings for word in ("--set", setting)]
    assert run_command("identifiability", case_file, "--parameters", "Rmc,Emaxlv", *options) == 0
    assert "fit the case first" in capsys.readouterr().out


def test_a_flow_measured_as_0_has_an_uncertainty(case_file):
    case = read_case(case_file, ["measurements.CO=0", "measurements.MAP=80"]).case
    result = identifiability(case, parameters=("Rmc", "Emaxlv"))
    assert result.uncertainties["CO"] == 0.03
    assert np.isfinite(result.scaled.matrix).all()


@pytest.mark.slow
def test_a_patient_without_a_steady_beat_is_not_ranked(tmp_path, capsys):
    file = DATA / "cases" / "va_ecmo_default.toml"
    still = [v for s in ("Emaxlv=0.05", "Emaxrv=0.02", "ecmo.speed_rpm=4500") for v in ("--set", s)]
    assert run_command("identifiability", file, *still, "--out", tmp_path / "out", "--json", "-") == 1
    message = capsys.readouterr()
    result = json.loads(message.out)
    assert result["id"] == "va_ecmo_default"
    assert result["status"] in ("singular", "no_ejection")
    assert result.keys() == {"made_by", "id", "status", "message"}
    assert "parameters cannot be ranked: there are no derivatives" in result["message"]
    assert result["message"] in message.err
    assert json.loads((tmp_path / "out" / "identifiability.json").read_text()) == result
    assert not (tmp_path / "out" / "figures").exists()


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"values": {"Rmcc": 0.5}}, "no parameter 'Rmcc'"),
        ({"until": -1.0}, "until = -1: allowed: above 0"),
        ({"until": math.nan}, "until = nan: allowed: above 0"),
    ],
)
def test_settings_from_python_that_would_be_read_otherwise_are_refused(settings, said):
    """A misspelt start value was left out in silence: the analysis was that of another patient."""
    case = Case(patient=Patient(id="P", sex="female", age_years=50, heart_rate_bpm=70))
    with pytest.raises((InputError, UnknownValueError), match=said):
        sensitivity(case, settings=SobolSettings(**{"samples": 2, **settings}))
