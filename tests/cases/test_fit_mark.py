"""A fitted case file says how good its fit is, and every reader hears of a fit that is doubtful or poor."""

import pytest

import eclsim
from eclsim.cases.fit_mark import LEVELS, FitMark, read_mark, with_mark
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import case_text, read_case
from eclsim.identification.settings import FitSettings, case_to_fit
from eclsim.sensitivity.analysis import SobolSettings
from eclsim.sensitivity.results import write_results

PLAIN = case_text(PRESETS["paper"].case())


def marked(level: str) -> str:
    return with_mark(PLAIN, level, "A HEADLINE:\nin two lines")


@pytest.mark.parametrize("level", LEVELS)
def test_what_is_written_is_read(level):
    assert read_mark(marked(level)) == FitMark(level, is_changed=False)
    assert "# A HEADLINE: in two lines" in marked(level).splitlines()
    assert marked(level).endswith(PLAIN)


def test_the_mark_is_in_plain_words_and_files_in_the_earlier_ones_are_read():
    """The first line of a fitted case was "doubtful fit (of what has the mark daeaafab)"."""
    plain = marked("doubtful")
    assert plain.startswith("# eclsim identify: doubtful fit (checksum of the fitted case: ")
    earlier = plain.replace("checksum of the fitted case:", "of what has the mark")
    assert read_mark(earlier) == FitMark("doubtful", is_changed=False)


def test_a_file_without_a_mark_or_with_one_elsewhere_has_none():
    first, _, rest = marked("good").partition("\n")
    assert read_mark(PLAIN) is None
    assert read_mark(f"{PLAIN}\n{first}\n") is None
    assert read_mark(f"{first.replace('good', 'splendid')}\n{rest}") is None


@pytest.mark.parametrize(
    ("before", "after", "is_changed"),
    [
        ("speed_rpm = 3425", "speed_rpm = 3000", True),
        ("Emaxlv = ", "Emaxlv = 1", True),
        ("heart_rate_bpm = 120", "heart_rate_bpm = 90", True),
        ('id = "', 'id = "Mrs ', False),
        ("format = 1", "# a remark\nformat =  1", False),
        ("[parameters]", "[[events]]\nat_min = 1\ngive = { crystalloid_ml = 500 }\n[parameters]", False),
    ],
)
def test_the_verdict_is_on_what_was_fitted(before, after, is_changed):
    assert PLAIN.count(before) == 1
    mark = read_mark(marked("good").replace(before, after))
    assert mark is not None
    assert mark == FitMark("good", is_changed)
    assert ("changed since" in mark.sentence) == is_changed


@pytest.mark.parametrize(
    ("level", "word"), [("good", ""), ("doubtful", "DOUBTFUL"), ("poor", "not to be used")]
)
def test_every_command_that_reads_it_hears_of_a_doubt(tmp_path, level, word):
    path = tmp_path / "P01.toml"
    path.write_text(marked(level), encoding="utf-8")
    reading = read_case(path)
    doubts = [str(mistake) for mistake in reading.warnings if "fit" in str(mistake)]
    assert reading.case.fit_mark == FitMark(level, is_changed=False)
    assert len(doubts) == (level != "good")
    assert word in "".join(doubts)
    assert reading.case.model_copy(update={"fit_mark": None}) == PRESETS["paper"].case()


def mentions(warnings) -> bool:
    return any("a POOR fit of eclsim identify" in str(sentence) for sentence in warnings)


@pytest.mark.slow
@pytest.mark.parametrize("source", ["path", "case"])
def test_every_result_of_it_says_so(tmp_path, source):
    """A path given in Python, or `read_case(path).case`, gave numbers of a poor fit without a word."""
    path = tmp_path / "P01.toml"
    path.write_text(marked("poor"), encoding="utf-8")
    case = path if source == "path" else read_case(path).case
    few = SobolSettings(samples=2, parameters=("Rmc",), outputs=("MAP",), second_order=False)
    found = eclsim.sensitivity(case, settings=few)
    at_goal = eclsim.reach(case, "MAP > 20", vary="Rmc=0.8..0.81")
    steps = eclsim.plan_weaning(case, [3000.0])
    results = [
        eclsim.simulate(case).attrs["warnings"],
        eclsim.simulate_many(case, {"Rmc": [0.9]}, ["MAP"]).attrs["warnings"],
        eclsim.derivatives(case, ["MAP"], ["Rmc"]).attrs["warnings"],
        eclsim.course(case, minutes=1.0, outputs=["MAP"]).attrs["warnings"],
        found.indices.as_object()["warnings"],
        at_goal.as_object()["warnings"],
        steps[0].warnings,
    ]
    assert list(map(mentions, results)) == [True] * len(results)
    write_results(tmp_path, found)
    assert "a POOR fit" in (tmp_path / "indices.csv").read_text()


def test_a_case_that_is_fitted_anew_has_no_verdict_yet(tmp_path):
    path = tmp_path / "P01.toml"
    path.write_text(marked("poor"), encoding="utf-8")
    assert case_to_fit(read_case(path).case, FitSettings()).doubts == ()
