"""The page of a fit: verdict first, nothing from outside, nothing unescaped, gaps said."""

import copy
import re

import pytest

from eclsim.identification.files import fits_object
from eclsim.identification.report import cohort_page, fit_page, fits_text, write_fit_page
from eclsim.identification.settings import FitSettings
from eclsim.paper.crrt import paper_case
from system_browser import system_browser

SVG = '<svg xmlns="http://www.w3.org/2000/svg" width="400pt"><text id="t">{}</text></svg>'


def words(html: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", html))


def content(*points: dict) -> dict:
    return fits_object(points, FitSettings(volume_policy="patient_held").as_object())


def test_the_verdict_comes_first_then_measured_against_fitted(fitted_point):
    html = fit_page(content(fitted_point), paper_case(), {})
    shown = words(html)
    order = [
        "DOUBTFUL FIT, although no measurement is missed by more than 1.5", "right ventricle of 17 mL",
        "no test of the model", "70 ± 3", "69.88", "Rmc: ", "0.7 to 0.9", "0.69 to 0.91",
        "Edla: too little effect", "Edla and Rmc move together (correlation -0.95)",
        "78 to 218", "implausible",
        "3 of 12 refined starts agree", "circuits are primed (patient_held)", "A research model",
    ]  # fmt: skip
    places = [shown.index(word) for word in order]
    assert places == sorted(places)
    assert "+0.0" in shown
    assert "-0.0" not in shown
    assert "not measured" in shown
    assert 'class="box warn"' in html
    assert "<script" not in html


def test_brackets_are_explained_where_there_are_some(fitted_point):
    """The terminal explained them, the page had an output in brackets and no word about it."""
    point = copy.deepcopy(fitted_point)
    assert "in brackets:" not in words(fit_page(content(point), paper_case(), {}))
    name = next(iter(point["outputs"]))
    point["outputs"][name] |= {"lower": 1.0, "upper": 90.0, "determined": False}
    shown = words(fit_page(content(point), paper_case(), {}))
    assert f"({point['outputs'][name]['simulated']:.4g}" in shown
    assert "in brackets: the measurements do not determine it" in shown


def test_the_table_of_a_cohort_explains_stars_only_where_it_has_some(fitted_point):
    points = [copy.deepcopy(fitted_point) | {"id": name} for name in ("P01", "P02")]
    for point in points:
        for cell in point["parameters"].values():
            cell["at_bound"] = False
    assert "*" not in fits_text(content(*points))
    points[1]["parameters"]["Rmc"]["at_bound"] = True
    assert "* at a bound" in fits_text(content(*points))


def test_a_cohort_says_which_parameter_its_missed_measurements_ask_to_free(fitted_point):
    """Two fits were poor because CVP was measured and the blood held; the terminal named a missed SP only."""
    points = [copy.deepcopy(fitted_point) | {"id": name} for name in ("P01", "P02")]
    assert "do not vary" not in fits_text(content(*points))
    sentence = "CVP tells how much blood there is, which this fit does not vary: free {} as well (--free)"
    asked = {"aspect": "agreement with the measurements", "level": "doubtful", "subject": ""}
    points[1]["verdict"]["reasons"].append(asked | {"sentence": sentence.format("fluid.extra_volume_ml")})
    assert (
        "in 1 of 2 fits a measurement is missed that tells how much blood there is, which they do not vary: "
        "free fluid.extra_volume_ml as well (--free)"
    ) in fits_text(content(*points))


def test_fits_by_the_policy_of_each_case_say_so(fitted_point):
    every = fits_object([fitted_point], FitSettings().as_object())
    assert every["settings"]["blood_volume_policy"] is None
    assert "Blood volume: that of each case." in words(cohort_page(every, {}))


def test_the_page_of_a_cohort_says_where_a_shared_parameter_is_not_the_same(fitted_point):
    """With and without ECMO a patient had two compliances under --shared, without a word."""
    points = [copy.deepcopy(fitted_point) | {"id": f"{p}/{k}", "patient_id": p} for p in "AB" for k in (1, 2)]
    points[1]["parameters"]["Rmc"]["value"] = 0.5
    shared = fits_object(points, FitSettings(shared=("Rmc",)).as_object())
    assert "Rmc differs among the points of A: points of the same circuit" in words(cohort_page(shared, {}))
    assert "differs among" not in words(cohort_page(content(*points), {}))


def test_a_good_fit_is_no_warning_and_a_poor_one_reads_no_parameter(fitted_point):
    good = copy.deepcopy(fitted_point)
    good["verdict"] |= {"level": "good", "reasons": []}
    assert 'class="box"' in fit_page(content(good), paper_case(), {})
    poor = copy.deepcopy(fitted_point)
    poor["verdict"]["level"] = "poor"
    assert "one of many that fit as well" in fit_page(content(good), paper_case(), {})
    assert "one of many that fit as well" not in fit_page(content(poor), paper_case(), {})


def test_predictions_that_are_not_trusted_say_so(fitted_point):
    interval = {"median": 70.0, "lower": 65.0, "upper": 75.0}
    posterior = {
        "kind": "weighted draws", "prior": "log-uniform", "verdict": "NOT TO BE TRUSTED",
        "doubts": ["few draws count"],
        "parameters": {"Rmc": {"median": 0.8, "lower": 0.71, "upper": 0.88}},
        "predictions": [
            {
                "settings": "ecmo.speed_rpm=4000", "outputs": {"MAP": interval}, "without_steady_beat": 0.031,
                "doubts": ["few draws count", "the pump is fast"],
            }
        ],
    }  # fmt: skip
    shown = words(fit_page({**content(fitted_point), "posterior": posterior}, paper_case(), {}))
    for expected in (
        "NOT TO BE TRUSTED", "intervals: weighted draws, prior", "65 to 75", "0.71 to 0.88",
        "3.1 % of the draws", "the pump is fast",
    ):  # fmt: skip
        assert expected in shown
    assert shown.count("few draws count") == 1
    trusted = {**posterior, "verdict": "", "doubts": []}
    page = fit_page({**content(fitted_point), "posterior": trusted}, paper_case(), {})
    assert re.search("NOT TO BE TRUSTED.*the pump is fast.*65 to 75", words(page))


def test_a_point_without_a_steady_beat_has_a_row(fitted_point):
    lost = copy.deepcopy(fitted_point)
    lost["id"], lost["status"], lost["implied"], lost["cost"] = "P02", "no_steady_beat", {}, None
    reason = {"aspect": "search", "level": "poor", "about": "", "sentence": "no steady heartbeat"}
    lost["verdict"] = {"level": "poor", "goodness": None, "reasons": [reason]}
    lost["outputs"] = {"MAP": {"measured": 70.0, "simulated": None}}
    for parameter in lost["parameters"].values():
        parameter |= {"value": None, "lower": None, "upper": None, "profile": None, "identifiable": False}
    shown = words(cohort_page(content(fitted_point, lost), {}))
    assert "0 good, 1 doubtful, 1 poor." in shown
    assert "P02 poor no steady heartbeat" in shown
    assert "nothing was fitted" in words(fit_page(content(lost), paper_case(), {}))


@pytest.fixture(scope="module")
def browser():
    yield from system_browser()


def test_the_page_asks_nothing_of_the_network_and_fits_on_a4(browser, fitted_point, tmp_path):
    drawings = tmp_path / "figures"
    drawings.mkdir()
    (drawings / "residuals.svg").write_text(SVG.format("drawn"), encoding="utf-8")
    path = write_fit_page(tmp_path, content(fitted_point), drawings, paper_case())
    page = browser.new_page(viewport={"width": 680, "height": 1000})
    requests, said = [], []
    page.on("request", lambda request: requests.append(request.url))
    page.on("console", lambda message: said.append(message.text))
    page.goto(path.as_uri())
    assert requests == [path.as_uri()]
    assert said == []
    assert page.evaluate("document.documentElement.scrollWidth") <= 680
    assert page.locator("svg text").text_content() == "drawn"
    page.close()
