"""What a turned knob makes of a case is said beside it, as on opening the file of the case."""

import asyncio

import pytest

from eclsim.app.course import with_event
from eclsim.app.knobs import VOLUME, connect, knobs_of, turn
from eclsim.app.remarks import beside_knob, remarks_of
from eclsim.app.session import Session
from eclsim.app.state import PageState
from eclsim.app.texts import beside_field
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import read_mapping
from eclsim.inputs.mistakes import CaseError

GIVEN = "fluid.extra_volume_ml"


def with_avalon(**settings):
    raw = PRESETS["vv-ecmo"].case().as_mapping()
    raw["ecmo"] |= {
        "drainage_cannula": "avalon_drainage", "return_cannula": "avalon_return", "drainage_fr": 27.0,
        "return_fr": 27.0,
    } | settings  # fmt: skip
    return read_mapping(raw).case


def said(case):
    return remarks_of(case, knobs_of(case))


def test_lumens_of_two_sizes_are_remarked_beside_the_knob_as_in_the_file():
    """Lumens of 27 and 31 Fr were accepted without a word."""
    assert said(with_avalon()) == {}
    unequal = with_avalon(drainage_fr=31.0)
    (warning,) = read_mapping(unequal.as_mapping()).warnings
    assert said(unequal) == {"ecmo.return_fr": [("warning", beside_field(warning))]}
    assert "both lumens" in beside_field(warning)


def test_a_warning_on_what_no_knob_sets_stands_with_its_device():
    (said_of_device,) = said(with_avalon(return_cannula="arterial", return_fr=19.0))["ecmo"]
    assert "not lumens of one cannula" in said_of_device[1]


def test_the_page_gets_the_remarks_with_the_state():
    messages = []

    async def turned():
        page = Session(None, PageState(with_avalon()), lambda *message: messages.append(message))  # type: ignore[arg-type]
        page.closed = True  # no beat is computed
        assert page.turn("patient.heart_rate_bpm", 200.0)
        return [data for topic, data in messages if topic == "state"][-1]["remarks"]

    ((kind, words),) = asyncio.run(turned())["patient.heart_rate_bpm"]
    assert kind == "warning"
    assert "faster than a sinus node" in words


@pytest.mark.parametrize(
    ("start", "given", "words"),
    [
        (0.0, 848.0, "Fluid balance adds 848 mL: 848 mL in all"),
        (150.0, -400.0, "Fluid balance adds \u2212400 mL: \u2212250 mL in all"),
        (150.0, 0.0, None),
    ],
)
def test_both_knobs_of_blood_volume_are_summed(start, given, words):
    """ "Extra blood volume 0 mL" stood above 848 mL that a fit had found and that stood far below."""
    case = turn(turn(connect(PRESETS["healthy"].case(), "fluid"), GIVEN, given), VOLUME, start)
    assert said(case).get(VOLUME) == (words and [("note", words)])
    assert said(PRESETS["healthy"].case()) == {}


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (("ao", "ra"), "right atrium: drains an artery into a vein: a shunt"),
        (("post_pump", "post_pump"), "post pump: the same as “Access line at”: the filter cleans blood"),
    ],
)
def test_sites_and_pickers_are_named_as_on_the_page(lines, words):
    """Beside a list of "right atrium" and others stood "ra" in quotes, and access_site."""
    case = PRESETS["paper"].case()
    for key, site in zip(("access_site", "return_site"), lines, strict=True):
        case = turn(case, f"crrt.{key}", site)
    said_there = " ".join(words for _, words in said(case)["crrt.return_site"])
    assert words in said_there
    assert not any(sign in said_there for sign in '"_')


def test_lines_the_wrong_way_round_are_advised_with_the_labels_of_their_pickers():
    case = turn(PRESETS["vv-ecmo"].case(), "ecmo.drainage_site", "la")
    ((_, words),) = said(case)["ecmo.return_site"]
    assert "did you mean “Drained from” = right atrium and “Returned to” = left atrium" in words


@pytest.mark.parametrize(("kind", "opposite"), [("bleed_ml", "Blood"), ("blood_ml", "Bleeding")])
def test_a_negative_amount_is_advised_with_the_words_of_the_menu(kind, opposite):
    case = PRESETS["healthy"].case()
    with pytest.raises(CaseError) as refused:
        with_event(case, {"at_min": 10, "give": {kind: -300}, "over_min": 15})
    (mistake,) = refused.value.mistakes
    assert beside_knob(mistake, case).endswith(f"did you mean “{opposite}” = 300?")
