"""Own ranges of the inputs: what they change, what is refused, and where they are stated."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from eclsim.cases.case import Case
from eclsim.cases.reading import read_mapping
from eclsim.cli import main
from eclsim.execution import Distribution, ExecutionError
from eclsim.sensitivity import figures
from eclsim.sensitivity.analysis import SobolSettings, plan_analysis, run_analysis, sensitivity
from eclsim.sensitivity.design import Design, sobol_indices
from eclsim.sensitivity.inputs import Categorical, Continuous, InputError
from eclsim.sensitivity.ranges import own_ranges_text, ranges_text, read_ranges
from eclsim.sensitivity.results import doubts, indices_text, write_results

PATIENT = {
    "id": "P",
    "sex": "female",
    "age_years": 70,
    "height_cm": 165,
    "weight_kg": 60,
    "heart_rate_bpm": 120,
}
ECMO = {"mode": "VA", "pump": "Rotaflow", "speed_rpm": 3425, "oxygenator": "Quadrox-i Adult"}


def case_of(**sections) -> Case:
    return read_mapping({"format": 1, "patient": PATIENT, "ecmo": ECMO, **sections}).case


def planned(case: Case | None = None, **settings):
    return plan_analysis(case or case_of(), SobolSettings(**{"samples": 8, **settings}))


def test_an_own_range_equal_to_the_perturbation_gives_the_same_indices_bit_for_bit():
    common = SobolSettings(
        parameters=("Rmc", "Emaxlv"), samples=8, outputs=("MAP",), second_order=False,
        perturbation_percent=40.0,
    )  # fmt: skip
    own = replace(common, ranges={"Rmc": (0.3, 0.7)})
    one, other = (sensitivity(case_of(), settings=settings) for settings in (common, own))
    np.testing.assert_array_equal(one.runs.values, other.runs.values)
    np.testing.assert_array_equal(one.indices.estimates.S1, other.indices.estimates.S1)
    np.testing.assert_array_equal(one.indices.estimates.ST, other.indices.estimates.ST)


def test_a_log_uniform_input_has_the_exact_indices():
    """y = ln x + z has the variances (ln 100)^2 / 12 and 2^2 / 12."""
    design = Design((Continuous("x", 0.1, 10.0, log=True), Continuous("z", 0.0, 2.0)), 1024)
    settings = design.settings(design.unit())
    assert settings["x"].min() >= 0.1
    assert settings["x"].max() <= 10.0
    y = np.log(settings["x"]) + settings["z"]
    found = sobol_indices(y.reshape(design.samples, -1, 1), 2)
    parts = np.array([math.log(100.0) ** 2, 4.0])
    np.testing.assert_allclose(found.S1[0], parts / parts.sum(), atol=0.01)
    np.testing.assert_allclose(found.ST[0], parts / parts.sum(), atol=0.01)


def test_ranges_are_in_the_units_of_the_inputs_and_the_others_keep_the_perturbation():
    ranges = {"Rmc": (0.6, 1.5), "Emaxlv": (0.4, 4.0, "log"), "ecmo.return_fr": [15, 19]}
    names = {"parameters": ("Rmc", "Emaxlv", "Rpmc"), "include": ("ecmo.return_fr",)}
    plan = planned(ranges=ranges, **names)
    rmc, emaxlv, rpmc, sizes = plan.design.inputs
    assert rmc == Continuous("Rmc", 0.6, 1.5, own=True)
    assert emaxlv == Continuous("Emaxlv", 0.4, 4.0, log=True, own=True)
    assert rpmc == planned(**names).design.inputs[2]
    assert isinstance(sizes, Categorical)
    assert sizes.levels == ("15 Fr", "17 Fr", "19 Fr")
    assert ranges_text(plan.design.inputs) == (
        "uniform within ±25 % of the central values; Rmc 0.6 to 1.5 mmHg s/mL; "
        "Emaxlv 0.4 to 4 mmHg/mL, uniform in its logarithm; ecmo.return_fr 15 Fr, 17 Fr, 19 Fr"
    )
    assert plan.warnings == (
        "the range of Rmc, 0.6 to 1.5 mmHg s/mL, does not contain the value of the case, 0.5",
    )
    assert Design.described(plan.design.description(), 8) == plan.design


def test_a_range_that_is_cut_is_named_once_and_not_as_a_warning_about_the_beat():
    case = case_of(gas={}, ecmo=ECMO | {"sweep_l_min": 3, "fdo2": 0.9})
    plan = planned(case, parameters=("Rmc",), include=("ecmo.fdo2",))
    (cut,) = plan.warnings
    assert cut.startswith(
        "the range of ecmo.fdo2 is cut at what is allowed: 0.65 to 1 in place of 0.65 to 1.15"
    )
    own = planned(case, parameters=("Rmc",), include=("ecmo.fdo2",), ranges={"ecmo.fdo2": (0.8, 1.0)})
    assert own.warnings == ()


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ({"Rmcc": (0.5, 1.5)}, "range of Rmcc: no parameter of this case; did you mean Rmc"),
        ({"Csart": (0.5, 1.5)}, "range of Csart: not among the inputs; add it to --parameters or --include"),
        ({"Rmc": (1.5, 0.5)}, "range of Rmc: 1.5 to 0.5; allowed: two numbers, the first of them smaller"),
        ({"Rmc": (0.5, math.nan)}, "range of Rmc: 0.5 to nan; allowed"),
        ({"Rmc": (0.5, 100.0)}, r"range of Rmc: 0.5 to 100; allowed: 0.02 to 8"),
        ({"Rmc": (0.0, 1.0, "log")}, "range of Rmc: 0 to 1, uniform in its logarithm; allowed: above 0"),
        ({"Rmc": (0.1, 1.0, "lin")}, 'range of Rmc = "lin" as third entry'),
        ({"ecmo.return_fr": (15.0, 16.0)}, "fewer than two sizes from 15 to 16 Fr; sizes sold: 15, 17"),
        ({"ecmo.return_fr": (15.0, 19.0, "log")}, "leave out log"),
    ],
)
def test_impossible_ranges_are_named(ranges, message):
    with pytest.raises(InputError, match=message):
        planned(parameters=("Rmc",), include=("ecmo.return_fr",), ranges=ranges)


def test_a_choice_of_positions_has_no_range():
    crrt = {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy"}
    with pytest.raises(InputError, match=r"range of crrt.scheme: it is a choice of positions"):
        planned(
            case_of(crrt=crrt), parameters=("Rmc",), include=("crrt.scheme",), ranges={"crrt.scheme": (0, 3)}
        )


@pytest.mark.parametrize("ranges", ["Rmc=0.5:1.5", {"Rmc": 0.5}, {"Rmc": "ab"}, {"Rmc": ("a", "b")}])
def test_ranges_of_another_kind_are_no_ranges(ranges):
    with pytest.raises(TypeError, match="range"):
        SobolSettings(ranges=ranges)


def test_options_of_the_command_are_ranges():
    assert read_ranges(["Rmc=0.5:1.5", "Emaxlv=0.4:4:log, ecmo.return_fr=15:19"]) == {
        "Rmc": (0.5, 1.5), "Emaxlv": (0.4, 4.0, "log"), "ecmo.return_fr": (15.0, 19.0),
    }  # fmt: skip
    with pytest.raises(InputError, match=r"--range Rmc=1:2: Rmc is given twice") as error:
        read_ranges(["Rmc=0.5:1.5", "Rmc=1:2", "Rmc=0.5", "=1:2", "A=1:2:3", "B=a:b", "C=1:2:log:log"])
    assert len(error.value.mistakes) == 6


def test_wrong_ranges_of_the_command_end_with_status_2(tmp_path, capsys):
    file = tmp_path / "case.toml"
    file.write_text("format = 1\n[patient]\nid = 'P'\nsex = 'female'\nage_years = 70\nheart_rate_bpm = 90\n")
    for option, message in (
        ("Rmc", "NAME=LOW:HIGH"),
        ("Rmcc=1:2", "did you mean Rmc"),
        ("Rmc=2:1", "smaller"),
    ):
        with pytest.raises(SystemExit) as stop:
            main(["sensitivity", str(file), "--range", option])
        assert stop.value.code == 2
        assert message in " ".join(capsys.readouterr().err.split())


def run(plan, folder, **distribution):
    with Distribution(**distribution).running() as executor:
        return run_analysis(plan, folder, executor)


def with_range(plan, *own):
    inputs = (Continuous(plan.design.inputs[0].name, *own, own=True), *plan.design.inputs[1:])
    return replace(plan, design=replace(plan.design, inputs=inputs, samples=256))


def test_runs_with_other_ranges_are_not_continued(tmp_path, plan):
    run(with_range(plan, -1.0, 1.0), tmp_path)
    for other in (with_range(plan, -1.0, 2.0), plan):
        with pytest.raises(ExecutionError, match=r"design\.inputs"):
            run(other, tmp_path, resume=True)
    assert run(with_range(plan, -1.0, 1.0), tmp_path, resume=True).indices.evaluations == 256 * 8


def test_every_file_and_figure_states_the_ranges(tmp_path, plan, monkeypatch):
    result = run(with_range(plan, -1.0, 1.0), tmp_path)
    write_results(tmp_path, result)
    content = json.loads((tmp_path / "indices.json").read_text())["inputs"]
    assert content["x1"] == {"distribution": "uniform", "low": -1.0, "high": 1.0, "unit": ""}
    (first, *_) = csv.DictReader((tmp_path / "inputs.csv").read_text().splitlines())
    assert (first["input"], first["low"], first["high"]) == ("x1", "-1.0", "1.0")
    assert result.dataset.attrs["inputs"][0] == "x1 −1 to 1"  # a minus sign
    assert "x1 −1 to 1" in indices_text(result.indices)
    drawn = []
    monkeypatch.setattr(figures, "_save", lambda drawings, folder, above, title: drawn.extend(above))
    figures.write_sensitivity_figures(result, tmp_path)
    assert any(line.startswith("Inputs: x1") for line in drawn)


def test_figures_of_the_common_perturbation_have_no_line_about_ranges():
    assert own_ranges_text(planned().design.inputs) == ""
    assert ranges_text(planned().design.inputs) == "uniform within ±25 % of the central values"


def test_warnings_about_ranges_are_not_placed_at_the_central_values(plan, tmp_path):
    cut, beat = "the range of Rmc is cut at what is allowed", "MAP is low"
    result = run(replace(with_range(plan, -1.0, 1.0), warnings=(cut, beat)), tmp_path)
    assert doubts(result.indices)[:2] == [cut, f"at the central values: {beat}"]
