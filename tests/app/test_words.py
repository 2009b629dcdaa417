"""All words stand in one place; none is missing, none is left over."""

import re
from pathlib import Path

import pytest

import eclsim.app
from eclsim.app.files import KINDS
from eclsim.app.page import VIEWS
from eclsim.app.texts import ENGLISH, beside_field, in_page_words, text, with_minus
from eclsim.course.gases import NOT_FOLLOWED
from eclsim.identification.fitted_parameters import FittedParameter, nothing_identifiable
from eclsim.identification.verdict import single_start
from eclsim.inputs.mistakes import Mistake
from eclsim.orbit.status import Status

HERE = Path(eclsim.app.__file__).parent
SCRIPTS = "\n".join(p.read_text(encoding="utf-8") for p in HERE.rglob("*.js"))
MODULES = "\n".join(p.read_text(encoding="utf-8") for p in HERE.glob("*.py"))
PREFIXES = (
    "group_", "key_", "frame_", "export_", "legend_", "provenance_", "badge_", "verdict_", "box_",
    "wire_", "kind_", "scheme_", "gases_", "sample_", "exchange_", "give_", "lane_", "short_",
)  # fmt: skip
SUFFIXES = ("_hint", "_long")


def test_scripts_use_words_that_exist():
    used = set(re.findall(r"\btexts\.(\w+)", SCRIPTS))
    assert used <= set(ENGLISH)


def test_modules_use_words_that_exist():
    used = set(re.findall(r"\btext\(\s*\"([\w.]+)\"", MODULES))
    assert used <= set(ENGLISH)
    assert set(VIEWS) <= set(ENGLISH)
    assert {f"export_{kind}" for kind in KINDS} <= set(ENGLISH)


@pytest.mark.slow
def test_no_words_are_left_over():
    everything = SCRIPTS + MODULES
    composed = lambda key: key.startswith(PREFIXES) or key.endswith(SUFFIXES) or "." in key  # noqa: E731
    left = [key for key in ENGLISH if not composed(key) and not re.search(rf"\b{key}\b", everything)]
    assert left == []


def test_scripts_hold_no_sentence_of_their_own():
    """Anything with two words in quotes or between tags belongs into the texts."""
    shown = re.findall(r">\s*([A-Z][a-z]+ [a-z]+[^<{]*)<", SCRIPTS)
    assert shown == []


def test_nothing_is_fetched_from_elsewhere():
    styles = "\n".join(p.read_text(encoding="utf-8") for p in HERE.rglob("*.css"))
    addresses = re.findall(r"(?:https?:)?//[\w.-]+\.\w+/", SCRIPTS + styles)
    assert addresses == []


def test_a_minus_stands_before_numbers_and_no_hyphen_is_one():
    assert with_minus("-5.4 mmHg (-57 % at worst)") == "\u22125.4 mmHg (\u221257 % at worst)"
    for plain in ("Table S-4", "doi 10.3389/a-909990", "V-A, mid-1990s", "5-95 %", "(10)-12", "a - 3"):
        assert with_minus(plain) == plain


def test_refusals_and_reasons_of_a_verdict_have_a_minus_as_well():
    mistake = Mistake("ecmo.speed_rpm", "outside the allowed range", "-900", "-300 to 100 mmHg")
    assert beside_field(mistake).count("\u2212") == 2
    assert "-" not in beside_field(mistake)
    reason = in_page_words("MPAP is off by -3.4 standard uncertainties (--weights uncertainty)")
    assert "\u22123.4" in reason
    assert "--" not in reason


@pytest.mark.parametrize("status", Status)
def test_no_outcome_of_a_search_advises_what_only_the_command_line_can_do(status):
    shown = in_page_words(status.message)
    assert shown.split(":")[0] == status.message.split(":")[0]
    assert not any(words in shown for words in ("--", "`", "an option of"))


def test_the_page_names_its_own_way_to_steady_beats():
    """An option of `eclsim course` was called one of eclsim identify."""
    shown = in_page_words(NOT_FOLLOWED)
    assert "identify" not in shown
    assert "steady beats alone (those of a timeline of an hour or more)" in shown


def test_the_page_names_the_command_for_what_its_fit_cannot_do():
    """It advised to free fewer parameters, which no form offers."""
    (single,) = single_start(1, 20)
    shown = in_page_words(single.sentence)
    assert "another seed (export the case: eclsim identify CASE.toml --seed 1)" in shown
    assert "eclsim identify CASE.toml --parameters Emaxlv,Rmc) if the values change" in shown
    assert "free fewer" not in shown
    assert in_page_words(shown) == shown  # a stored verdict is read again
    nothing = nothing_identifiable({"Rmc": FittedParameter(1.0, 0.5, 2.0, False, False, "")})[0]
    assert "eclsim identify CASE.toml --parameters" in in_page_words(nothing.sentence)


def test_advice_with_several_options_is_in_the_words_of_the_page():
    weighed = in_page_words("x (--weights uncertainty), y --bounds, z (--other thing), --plain")
    assert "--" not in weighed
    assert weighed.count(text("fit_option_elsewhere").strip("()")) == 2
