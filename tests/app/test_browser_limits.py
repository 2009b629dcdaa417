"""One set of limits in strip, tiles and schematic; what no patient can have is named where it is seen."""

from __future__ import annotations

import pytest

from eclsim.app.knobs import connect, turn
from eclsim.app.state import PageState, link_of
from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from page_in_browser import LAPTOP, beat, picture, show

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser

PHONE = {"width": 390, "height": 844}


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
        box = page.get_by_text(text("impossible_long")).bounding_box()
        assert box["y"] >= 0
        assert box["y"] + box["height"] <= viewport["height"]
    assert "ejection fraction of the right ventricle" in page.locator(".ecl-limits").inner_text()
    status = page.locator(".ecl-status")
    assert status.inner_text().startswith(text("impossible"))
    assert "good" not in status.get_attribute("class")
    for place in ("ra", "rv"):
        assert "collapse" in page.locator(f'[data-node="{place}"]').get_attribute("class")
    picture(page, shots, f"impossible_{viewport['width']}")


def test_flow_backwards_through_the_pump_is_an_alarm_everywhere(open_page, served, shots):
    page = open_page(url=link(served, "paper", {"ecmo.speed_rpm": 0}))
    assert beat(page)["outputs"]["PF"] < 0
    assert "backwards" in page.locator(".ecl-limits").inner_text()
    assert page.locator('.ecl-keys [data-key="PF"]').get_attribute("class") == "alarm"
    assert page.locator(".ecl-schematic .flow.alarm").text_content().strip().startswith("▲")
    assert "broken" in page.locator(".ecl-status").get_attribute("class")
    assert "ECMO pump flow" in page.locator(".ecl-status").inner_text()
    picture(page, shots, "backflow")


@pytest.mark.parametrize(
    ("preset", "turns"),
    [
        ("healthy", {"parameters.Rmc": 2.0}),
        ("healthy", {"parameters.Emaxlv": 0.3}),
        ("healthy", {"parameters.Emaxlv": 6.0, "parameters.Rmc": 3.0}),
        ("healthy", {}),
    ],
)
def test_no_tile_is_red_while_the_strip_says_that_no_limit_is_broken(open_page, served, preset, turns):
    page = open_page(url=link(served, preset, turns))
    marked = page.locator(".ecl-keys > :is(.warning, .alarm, .collapse)").count()
    marked += page.locator(".ecl-schematic .box:is(.warning, .alarm, .collapse)").count()
    quiet = page.get_by_text(text("no_alarms")).is_visible()
    assert quiet == (marked == 0)
    assert bool(turns) == (marked > 0)


def test_what_the_model_does_not_show_on_va_stands_with_the_numbers(open_page, shots):
    page = open_page("paper")
    assert "do not read distension" in page.locator('.ecl-keys [data-key="PCWP"]').get_attribute("title")
    show(page, "loops")
    page.locator(".ecl-caution").wait_for()
    assert "left ventricle" in page.locator(".ecl-caution").inner_text()
    picture(page, shots, "loops_caution")
    show(page, "outputs")
    row = page.locator(".ecl-outputs tr", has=page.get_by_text("EDVLV", exact=True))
    assert "do not read distension" in row.locator(".caution").get_attribute("title")
    drainage = page.locator(".ecl-outputs tr", has_text="lowest pressure in the ECMO drainage cannula")
    assert text("above") not in drainage.inner_text()


@pytest.mark.parametrize("viewport", [LAPTOP, PHONE], ids=["laptop", "phone"])
def test_a_pump_that_sucks_the_heart_dry_is_named_and_no_impossible_number_shown(
    open_page, served, shots, viewport
):
    case = connect(PRESETS["paper"].case(), "lvad")
    page = open_page(url=f"{served.url}/#{link_of(PageState(case, origin='paper'))}", viewport=viewport)
    assert beat(page)["outputs"]["ejection_fraction_lv"] < 0
    assert "the LVAD drains more than flows in" in page.locator(".ecl-limits").inner_text()
    tile = page.locator('.ecl-keys [data-key="EF"]').inner_text()
    assert not any(sign.isdigit() for sign in tile), tile
    overlapping = page.evaluate(
        "[...document.querySelectorAll('.ecl-monitor .lane')]"
        ".filter((l) => l.scrollHeight > l.clientHeight + 1 || l.scrollWidth > l.clientWidth + 1)"
        ".map((l) => [l.dataset.wave, l.scrollHeight, l.clientHeight])"
    )
    assert overlapping == []
    picture(page, shots, f"sucked_dry_{viewport['width']}")
