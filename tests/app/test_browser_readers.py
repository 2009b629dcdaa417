"""The page for who reads it otherwise: on a phone, in large letters, by ear, by keyboard, without motion."""

from __future__ import annotations

import pytest

from eclsim.app.texts import text
from page_in_browser import LAPTOP, PHONE, TABLET, eventually, expect, knob, picture, show, turn, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser

LARGER = """(factor) => {
  const all = [...document.querySelectorAll('body *')].filter((one) => !one.closest('svg'));
  const sizes = all.map((one) => parseFloat(getComputedStyle(one).fontSize));
  all.forEach((one, k) => (one.style.fontSize = `${factor * sizes[k]}px`));
}"""
"""As a browser does that makes letters larger, and nothing else."""
CUT = """() => {
  const wide = (one) => one.scrollWidth > one.clientWidth + 1;
  const beyond = (one) => one.getBoundingClientRect().right > one.closest('.ecl-keys > div')
    .getBoundingClientRect().right + 1;
  return [...[...document.querySelectorAll('.ecl-knob input[type=text]')].filter(wide).map((e) => e.value),
    ...[...document.querySelectorAll('.ecl-keys b')].filter(beyond).map((e) => e.textContent)];
}"""
"""Numbers of knobs and tiles of which a part is out of sight."""


@pytest.mark.parametrize("viewport", [PHONE, TABLET], ids=["phone", "tablet"])
def test_key_figures_and_alarms_stay_in_sight_while_a_knob_is_turned(open_page, viewport, shots):
    page = open_page("paper", viewport=viewport)
    strip = page.locator(".ecl-strip")
    expect(strip).to_have_count(0)
    page.evaluate("scrollTo(0, document.documentElement.scrollHeight)")
    expect(strip).to_be_visible()
    speed = knob(page, "ecmo.speed_rpm")
    speed.scroll_into_view_if_needed()
    turn(page, "ecmo.speed_rpm", "900")
    wait_for(page, "beat.outputs.PF < 0")
    if viewport == PHONE:
        expect(page.locator(".ecl-keys")).not_to_be_in_viewport()
        expect(strip.locator(".alarm").first).to_contain_text("▲")
        expect(strip.locator("p")).to_contain_text("Arterial")
        expect(strip.locator("span", has_text="Wedge")).to_contain_text("† Wedge")
        covered, field = strip.bounding_box(), speed.bounding_box()
        assert covered["y"] + covered["height"] <= field["y"], "the strip lies over the knob"
        assert covered["height"] < 0.2 * viewport["height"]
    picture(page, shots, f"strip_{viewport['width']}")
    page.evaluate("scrollTo(0, 0)")
    expect(strip).to_have_count(0)


def test_a_menu_goes_with_the_arrow_keys(open_page):
    page = open_page("healthy")
    page.get_by_role("button", name=text("export")).press("Enter")
    items = page.get_by_role("menuitem")
    expect(page.get_by_role("menu")).to_be_focused()
    for key, focused in (("ArrowDown", 0), ("ArrowDown", 1), ("End", -1), ("ArrowDown", 0), ("ArrowUp", -1)):
        page.keyboard.press(key)
        expect(items.nth(focused)).to_be_focused()
    page.keyboard.press("Escape")
    expect(items).to_have_count(0)
    expect(page.get_by_role("button", name=text("export"))).to_be_focused()


@pytest.mark.parametrize("viewport", [LAPTOP, TABLET, PHONE], ids=["laptop", "tablet", "phone"])
def test_no_number_is_cut_off_in_larger_letters(open_page, viewport, shots):
    """At 200 % "0.1079" stood there as "0.10" and a flow of 3.70 as 3.7 in half a tile."""
    page = open_page("paper", viewport=viewport)
    page.locator(".ecl-knob").first.wait_for()
    page.evaluate(LARGER, 2)
    eventually(lambda: page.evaluate(CUT) == [] or pytest.fail(str(page.evaluate(CUT))))
    picture(page, shots, f"letters_{viewport['width']}")


def test_names_of_measurements_can_be_read_on_a_phone(open_page):
    """They were one letter wide."""
    page = open_page("paper", viewport=PHONE)
    show(page, "identify")
    labels = page.locator(".ecl-identify .fields label")
    labels.first.wait_for()

    def wide() -> None:
        assert all(label.bounding_box()["height"] < 60 for label in labels.all())

    eventually(wide)


def test_a_screen_reader_hears_an_outcome_once(open_page):
    """Status, list of limits and provenance spoke with every beat of a turn."""
    page = open_page("paper")
    live = page.locator(".ecl-outcome [role=status]")
    expect(live).to_contain_text(text("ready"))
    page.evaluate(
        """() => { window.heard = []; for (const one of document.querySelectorAll(
          '[role=status], [role=alert], [aria-live=polite]'))
          new MutationObserver(() => window.heard.push(one.textContent)).observe(one,
            { childList: true, characterData: true, subtree: true }); }"""
    )
    slider = page.get_by_role("slider", name="Pump speed")
    slider.focus()
    for _ in range(12):
        page.keyboard.press("ArrowLeft")
        page.wait_for_timeout(60)
    turn(page, "ecmo.speed_rpm", "900")
    expect(live).to_contain_text("mean arterial pressure")
    expect(live).to_contain_text(text("limit_broken"))
    page.wait_for_timeout(1500)
    heard = page.evaluate("window.heard")
    assert len(heard) <= 2, heard


def test_nothing_moves_for_who_wants_no_motion(open_page):
    page = open_page("paper")  # windows of these tests ask for reduced motion
    page.evaluate("eclsim.bus.publish('busy', 'wait')")
    dot = page.locator(".ecl-status .dot")
    expect(dot).to_have_css("animation-duration", "0s")
    expect(page.get_by_role("button", name=text("sweep_pause"))).to_have_attribute("aria-pressed", "true")


def test_where_the_keyboard_is_can_be_seen(open_page):
    page = open_page("paper")
    seen = """() => { const one = document.activeElement; const field = one.closest('.q-field');
      return [one.getAttribute('aria-label') || one.id || one.textContent.slice(0, 30),
        ['outlineStyle', 'boxShadow'].some((line) => getComputedStyle(one)[line] !== 'none')
        || !!field?.classList.contains('q-field--focused')
        || !!one.closest('svg')]; }"""
    hidden = []
    for _ in range(60):
        page.keyboard.press("Tab")
        name, visible = page.evaluate(seen)
        if not visible and name.strip():
            hidden.append(name)
    assert [name for name in hidden if not name.startswith("Skip")] == []
