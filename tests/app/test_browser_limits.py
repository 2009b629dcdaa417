"""One set of limits in strip, tiles and schematic; what no patient can have is named where it is seen."""

from __future__ import annotations

import re

import pytest

from collapsing_veins import TWO_BEATS, collapsible
from eclsim.app.knobs import connect, turn
from eclsim.app.state import PageState, link_of
from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from page_in_browser import LAPTOP, PHONE, beat, beat_with, box_at_rest, eventually, expect, picture, show
from page_in_browser import turn as turn_on_page

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser


def link(served, preset: str, turns: dict[str, object]) -> str:
    case = PRESETS[preset].case()
    for key, value in turns.items():
        case = turn(case, key, value)
    return f"{served.url}/#{link_of(PageState(case, origin=preset))}"


@pytest.mark.parametrize("viewport", [LAPTOP, PHONE], ids=["laptop", "phone"])
def test_collapsed_chambers_are_named_in_sight_and_not_under_a_green_light(
    open_page, served, shots, viewport
):
    dry = link(served, "paper", {"ecmo.speed_rpm": 5000, "volume_ml": -200})
    page = open_page(url=dry, viewport=viewport)
    assert beat(page)["possible"] is False
    for view in ("monitor", "outputs"):
        show(page, view)
        box = box_at_rest(page.get_by_text(text("impossible_long")))
        assert box["y"] >= 0
        assert box["y"] + box["height"] <= viewport["height"]
    expect(page.locator(".ecl-limits")).to_contain_text("ejection fraction of the right ventricle")
    status = expect(page.locator(".ecl-status"))
    status.to_have_text(re.compile("^" + re.escape(text("impossible"))))
    status.not_to_have_class(re.compile(r"\bgood\b"))
    for place in ("ra", "rv"):
        expect(page.locator(f'[data-node="{place}"]')).to_have_class(re.compile(r"\bcollapse\b"))
    for key in ("MAP", "PF"):
        expect(page.locator(f'.ecl-keys [data-key="{key}"]')).not_to_contain_text(re.compile(r"\d"))
    expect(page.locator(".ecl-schematic .pressure").first).to_have_css("text-decoration-line", "line-through")
    picture(page, shots, f"impossible_{viewport['width']}")


ARREST = {"parameters.Emaxlv": 0.2, "parameters.Emaxrv": 0.03}
"""A heart that opens no valve: the blood that they trap, and with it all pressures, is not determined."""


@pytest.mark.parametrize("viewport", [LAPTOP, PHONE], ids=["laptop", "phone"])
def test_pressures_that_are_not_determined_are_marked_in_every_view(open_page, served, shots, viewport):
    """They looked like all others, below "Steady beat": another start gave 5 mmHg more."""
    page = open_page(url=link(served, "paper", ARREST), viewport=viewport)
    assert beat(page)["status"] == "one_of_many"
    status = expect(page.locator(".ecl-status"))
    status.to_have_text(re.compile("^" + re.escape(text("undetermined"))))
    status.to_have_class(re.compile(r"\bbroken\b"))
    expect(page.get_by_text(text("undetermined_long"))).to_be_in_viewport()
    expect(page.locator('.ecl-keys [data-key="MAP"] b')).to_have_text(re.compile(r"^≈\d+$"))
    expect(page.locator('.ecl-keys [data-key="PF"] b')).to_have_text(re.compile(r"^\d"))
    expect(page.locator('.ecl-monitor [data-wave="Pao"] .big')).to_have_text(re.compile(r"^≈\d+/\d+$"))
    expect(page.locator('.ecl-monitor [data-wave="Qecmopump"] .big')).to_have_text(re.compile(r"^\d"))
    expect(page.locator('[data-node="sart"] .pressure')).to_contain_text("≈")
    picture(page, shots, f"undetermined_{viewport['width']}")
    page.get_by_role("button", name=text("save")).click()
    show(page, "outputs")
    row = page.locator(".ecl-outputs tr", has=page.get_by_text("MAP", exact=True))
    expect(row.locator(".value")).to_have_text(re.compile("≈"))
    show(page, "compare")
    expect(page.locator(".ecl-compare tr", has_text="MAP").locator("td")).to_have_text([re.compile("≈")] * 2)
    for key, value in {"parameters.Emaxlv": 1.33, "parameters.Emaxrv": 0.2}.items():
        turn_on_page(page, key, str(value))
        beat_with(page, key, value)
    expect(page.get_by_text(text("undetermined_long"))).to_have_count(0)
    expect(page.locator('.ecl-keys [data-key="MAP"] b')).to_have_text(re.compile(r"^\d+$"))


def test_a_second_steady_beat_stands_above_the_numbers_and_ends_with_its_state(open_page, served, shots):
    """`eclsim simulate` named it; the page showed one of the two as the only one."""
    page = open_page(url=f"{served.url}/#{link_of(PageState(collapsible(TWO_BEATS), origin='file'))}")
    limits = page.locator(".ecl-limits")
    expect(limits.locator("p.verdict")).to_contain_text("One of two steady beats")
    expect(limits.locator("p.verdict")).to_contain_text("PF 2.7")
    expect(limits.locator("p.warning").first).to_be_in_viewport()
    expect(limits.locator("details")).to_contain_text("this patient has two steady beats")
    expect(page.locator(".ecl-status")).to_have_text(re.compile("^" + re.escape(text("one_of_two"))))
    expect(page.locator('.ecl-keys [data-key="PF"]')).to_contain_text("†")
    picture(page, shots, "one_of_two")
    turn_on_page(page, "ecmo.speed_rpm", "1500")
    beat_with(page, "ecmo.speed_rpm", 1500)
    expect(limits).not_to_contain_text(re.compile("two steady beats"))
    expect(page.locator('.ecl-keys [data-key="PF"]')).not_to_contain_text("†")


def test_the_output_of_the_left_ventricle_has_a_tile_only_where_it_is_another(open_page, served):
    """Any caution on CO, such as that on the balloon, showed the same number twice."""
    page = open_page("lvad")
    expect(page.locator('.ecl-keys [data-key="LVO"]')).to_be_visible()
    case = connect(PRESETS["cardiogenic-shock"].case(), "iabp")
    page.goto(f"{served.url}/#{link_of(PageState(case, origin='cardiogenic-shock'))}")
    expect(page.locator('.ecl-keys [data-key="CO"]')).to_contain_text("†")
    expect(page.locator('.ecl-keys [data-key="LVO"]')).to_have_count(0)


def test_cautions_about_numbers_without_a_tile_have_a_heading(open_page, served):
    """ "How to read" stood there and nothing behind it."""
    case = connect(PRESETS["vv-ecmo"].case(), "renox")
    page = open_page(url=f"{served.url}/#{link_of(PageState(case, origin='vv-ecmo'))}")
    expect(page.locator(".ecl-limits summary")).to_contain_text(text("cautions_further"))
    housing = page.locator('.ecl-schematic [data-device="renox"]')
    outputs = beat(page)["outputs"]
    shown = [outputs["renox_effluent_ml_h"], outputs["renox_effluent_pressure"]]
    expect(housing.locator(".name")).to_have_text("RenOx: effluent")
    expect(housing.locator(".readings")).to_have_text("{:.0f} mL/h, {:.0f} mmHg".format(*shown))


def test_a_new_alarm_is_in_sight_although_the_list_was_scrolled_down(open_page):
    page = open_page("cardiogenic-shock")
    limits = page.locator(".ecl-limits")
    limits.evaluate("list => list.scrollTo(0, 999)")
    turn_on_page(page, "patient.heart_rate_bpm", "104")
    assert limits.evaluate("list => list.scrollTop") > 0, "the same limits: the reader goes on"
    turn_on_page(page, "parameters.Emaxlv", "0.3")
    expect(limits.locator("p.alarm").first).to_be_in_viewport()
    assert limits.evaluate("list => list.scrollTop") == 0


def test_before_there_are_numbers_nothing_is_said_of_their_limits(contexts, served):
    """A green "break no limit" stood on the page until the first beat came, or for good where none did."""
    page = contexts(viewport=LAPTOP).new_page()
    page.route_web_socket("**", lambda silent: None)
    page.route("**/_nicegui_ws/**", lambda route: route.abort())
    page.goto(link(served, "paper", {}))
    expect(page.locator(".ecl-limits")).to_be_attached()
    expect(page.locator(".ecl-limits")).not_to_contain_text(text("no_alarms"))
    assert not page.evaluate("window.eclsim?.bus.last('beat')")
    page.close()


def test_flow_backwards_through_the_pump_is_an_alarm_everywhere(open_page, served, shots):
    page = open_page(url=link(served, "paper", {"ecmo.speed_rpm": 0}))
    assert beat(page)["outputs"]["PF"] < 0
    expect(page.locator(".ecl-limits")).to_contain_text("backwards")
    expect(page.locator('.ecl-keys [data-key="PF"]')).to_have_class("alarm")
    expect(page.locator(".ecl-schematic .flow.alarm")).to_have_text(re.compile(r"^\s*▲"))
    expect(page.locator(".ecl-status")).to_have_class(re.compile(r"\bbroken\b"))
    expect(page.locator(".ecl-status")).to_contain_text(re.compile(r"ECMO \u2212\d\.\d\d L/min, too low"))
    picture(page, shots, "backflow")


def test_no_tile_is_red_while_the_strip_says_that_no_limit_is_broken(open_page, served):
    page = open_page("healthy")

    def strip_and_tiles_agree(turned: bool) -> None:
        marked = page.locator(".ecl-keys > :is(.warning, .alarm, .collapse)").count()
        marked += page.locator(".ecl-schematic .box:is(.warning, .alarm, .collapse)").count()
        quiet = page.get_by_text(text("no_alarms")).is_visible()
        assert quiet == (marked == 0)
        assert turned == (marked > 0)

    eventually(lambda: strip_and_tiles_agree(False))
    for turns in (
        {"parameters.Rmc": 2.0},
        {"parameters.Emaxlv": 0.3},
        {"parameters.Emaxlv": 6.0, "parameters.Rmc": 3.0},
    ):
        page.goto(link(served, "healthy", turns))  # into the open page: its address differs in the link alone
        for key, value in turns.items():
            beat_with(page, key, value)
        eventually(lambda: strip_and_tiles_agree(True))


def test_what_the_model_does_not_show_on_va_stands_with_the_numbers(open_page, shots):
    page = open_page("paper")
    read = re.compile("do not read distension")
    expect(page.locator('.ecl-keys [data-key="PCWP"]')).to_have_attribute("title", read)
    show(page, "loops")
    expect(page.locator(".ecl-caution")).to_contain_text("left ventricle")
    picture(page, shots, "loops_caution")
    show(page, "outputs")
    row = page.locator(".ecl-outputs tr", has=page.get_by_text("EDVLV", exact=True))
    expect(row.locator(".caution")).to_have_attribute("title", read)
    drainage = page.locator(".ecl-outputs tr", has_text="lowest pressure in the ECMO drainage cannula")
    expect(drainage).to_be_visible()
    expect(drainage).not_to_contain_text(text("above_range"))
    expect(row.locator("em")).to_have_text(text("below_range"))  # outside the adult range, no alarm
    expect(row).not_to_contain_text("▲")


@pytest.mark.parametrize("viewport", [LAPTOP, PHONE], ids=["laptop", "phone"])
def test_a_pump_that_sucks_the_heart_dry_is_named_and_no_impossible_number_shown(
    open_page, served, shots, viewport
):
    case = connect(PRESETS["paper"].case(), "lvad")
    page = open_page(url=f"{served.url}/#{link_of(PageState(case, origin='paper'))}", viewport=viewport)
    assert beat(page)["outputs"]["ejection_fraction_lv"] < 0
    expect(page.locator(".ecl-limits")).to_contain_text("the LVAD drains more than flows in")
    tile = page.locator('.ecl-keys [data-key="EF"]')
    expect(tile).to_contain_text("–")
    expect(tile).not_to_contain_text(re.compile(r"\d"))
    page.locator(".ecl-monitor .trace").first.wait_for()

    def nothing_overlaps() -> None:
        overlapping = page.evaluate(
            "[...document.querySelectorAll('.ecl-monitor .trace')]"
            ".filter((l) => l.scrollHeight > l.clientHeight + 1 || l.scrollWidth > l.clientWidth + 1)"
            ".map((l) => [l.dataset.wave, l.scrollHeight, l.clientHeight])"
        )
        assert overlapping == []

    eventually(nothing_overlaps)
    picture(page, shots, f"sucked_dry_{viewport['width']}")


WIDTHS = {
    "laptop": LAPTOP, "tablet": {"width": 768, "height": 1024}, "phone": PHONE,
    "zoomed": {"width": 640, "height": 400},
}  # fmt: skip
CUT = """() => {
  const message = document.querySelector('.ecl-status .message');
  const { right } = message.getBoundingClientRect();
  return message.scrollHeight > message.clientHeight + 1 || right > innerWidth;
}"""


@pytest.mark.parametrize("window", WIDTHS)
def test_the_header_names_a_broken_limit_with_its_number_in_every_window(open_page, served, shots, window):
    """ "pulmonary capillary wedge pressure 28.3 mmHg is abov…" or "broken: pulmonary…" stood there."""
    failing = link(served, "cardiogenic-shock", {"parameters.Emaxlv": 0.4, "volume_ml": 600})
    page = open_page(url=failing, viewport=WIDTHS[window])
    message = page.locator(".ecl-status .message")
    expect(message).to_contain_text(re.compile(r": Arterial \d+ mmHg, too low$"))
    picture(page, shots, f"header_limit_{window}")
    eventually(lambda: page.evaluate(CUT) and pytest.fail(f"cut: {message.inner_text()}"))
    expect(message).to_have_attribute("title", re.compile("mean arterial pressure .* is below 55"))
    expect(page.locator(".ecl-outcome [role=status]")).to_contain_text("mean arterial pressure")


def test_what_is_to_be_done_is_said_with_the_labels_of_the_knobs(open_page, served):
    """ "raise Emaxlv or Emaxrv" and "How to read PCWP" stood beside "LV contractility" and "Wedge"."""
    page = open_page(url=link(served, "paper", ARREST))
    limits = page.locator(".ecl-limits")
    expect(limits).to_contain_text("raise LV contractility or RV contractility")
    expect(limits).not_to_contain_text(re.compile("Emax[lr]v"))
    expect(limits.locator("summary")).to_contain_text(text("key_PCWP"))
    expect(limits.locator("summary")).not_to_contain_text(re.compile("PCWP|E[DS]VLV"))
