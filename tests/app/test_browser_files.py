"""Files, links, tabs and layout of the page in Chromium."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from eclsim.app.files import LARGEST_CASE_TEXT
from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import case_text
from page_in_browser import (
    LAPTOP,
    TABLET,
    beat,
    expect,
    knob,
    picture,
    show,
    turn,
    wait_for,
)

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser


@pytest.mark.parametrize(
    ("kind", "ending", "holds"),
    [("case", ".toml", b"speed_rpm"), ("outputs", ".csv", b"MAP [mmHg]"), ("study", ".html", b"<svg")],
)
def test_files_are_exported(open_page, kind, ending, holds):
    page = open_page()
    page.get_by_role("button", name="Export").click()
    with page.expect_download(timeout=120_000) as started:
        page.get_by_text(text(f"export_{kind}"), exact=True).click()
    assert started.value.suggested_filename.endswith(ending)
    assert holds in Path(started.value.path()).read_bytes()


def test_files_are_opened_and_bad_ones_refused(open_page, tmp_path, shots):
    page = open_page("healthy")
    page.get_by_role("button", name="Open case").click()
    page.get_by_text(f"A case file (TOML, up to {LARGEST_CASE_TEXT})").wait_for()
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(case_text(PRESETS["lvad"].case()).replace("80", "-80"))
    page.locator(".ecl-upload input[type=file]").set_input_files(wrong)
    page.get_by_text("wrong.toml:").first.wait_for()
    picture(page, shots, "open_refused")
    assert beat(page)["period"] == pytest.approx(60 / 70, abs=1e-4)
    marked = tmp_path / "right.toml"
    marked.write_text(case_text(PRESETS["lvad"].case()).replace('"LVAD"', '"<img src=x onerror=alert(1)>"'))
    page.locator(".ecl-upload input[type=file]").set_input_files(marked)
    wait_for(page, "'Qlvadpump' in beat.waves")
    page.get_by_text("<img src=x onerror=alert(1)>").first.wait_for()
    assert page.locator("img[src=x]").count() == 0


def test_nothing_changes_behind_a_dialog(open_page):
    page = open_page()
    turn(page, "ecmo.speed_rpm", "2750")
    wait_for(page, "beat.outputs.PF < 3")
    page.get_by_role("button", name=text("help"), exact=True).click()
    page.get_by_text(text("help_model")).wait_for()
    page.keyboard.press("Control+z")
    page.keyboard.press("Escape")
    page.get_by_text(text("help_model")).wait_for(state="hidden")
    assert page.evaluate("eclsim.bus.last('state').values['ecmo.speed_rpm']") == 2750
    page.locator(".q-dialog__inner").wait_for(state="detached")
    page.keyboard.press("Control+z")
    page.wait_for_function("eclsim.bus.last('state').values['ecmo.speed_rpm'] === 3425")


def test_a_link_restores_the_state_and_leaves_no_trace_in_the_address(open_page, served):
    page = open_page()
    turn(page, "ecmo.speed_rpm", "2750")
    wait_for(page, "beat.outputs.PF < 3")
    page.evaluate("void (navigator.clipboard.writeText = async (link) => { window.copied = link; })")
    page.get_by_role("button", name="Copy link").click()
    page.get_by_text(text("link_copied")).wait_for()
    link = page.evaluate("window.copied")
    other = open_page(url=link)
    wait_for(other, "beat.outputs.PF < 3")
    expect(knob(other, "ecmo.speed_rpm")).to_have_value("2750")
    other.wait_for_function("location.hash === ''")


def test_where_the_clipboard_is_closed_the_link_is_shown(open_page, served):
    page = open_page("healthy")
    page.evaluate("void (navigator.clipboard.writeText = () => Promise.reject())")
    page.get_by_role("button", name="Copy link").click()
    shown = page.locator(".ecl-link textarea")
    expect(shown).to_have_value(re.compile("^" + re.escape(f"{served.url}/#")))


def test_a_tab_that_is_loaded_again_goes_on_where_it_was(open_page):
    page = open_page()
    turn(page, "ecmo.speed_rpm", "2650")
    wait_for(page, "beat.outputs.PF < 2.8")
    page.reload()
    page.wait_for_function("window.eclsim?.bus.last('beat')?.outputs.PF < 2.8")
    expect(knob(page, "ecmo.speed_rpm")).to_have_value("2650")


def test_a_damaged_link_is_refused_and_the_page_works(open_page, served):
    page = open_page(url=f"{served.url}/#nonsense")
    page.get_by_text("the link is").wait_for()
    assert beat(page)["converged"]


def test_two_tabs_do_not_share_a_patient(open_page):
    first, second = open_page("paper"), open_page("lvad")
    turn(first, "patient.heart_rate_bpm", "99")
    wait_for(first, "Math.abs(beat.period - 60 / 99) < 1e-3")
    second.wait_for_timeout(500)
    assert beat(second)["period"] == pytest.approx(0.75)


def test_devices_are_connected_with_the_keyboard(open_page):
    page = open_page("healthy")
    switch = page.get_by_role("switch", name="Connect ECMO")
    switch.focus()
    page.keyboard.press("Space")
    wait_for(page, "beat.outputs.PF > 2")
    page.get_by_role("switch", name="Connect CRRT").click()
    wait_for(page, "'Pcrrttuin' in beat.waves")


@pytest.mark.parametrize("viewport", [LAPTOP, TABLET], ids=["laptop", "tablet"])
def test_nothing_is_wider_than_the_screen(open_page, shots, viewport):
    page = open_page(viewport=viewport)
    for view in ("monitor", "loops", "ramp", "schemes", "outputs", "identify", "compare"):
        show(page, view)
        wide = "(width) => document.documentElement.scrollWidth <= width"
        page.wait_for_function(wide, arg=viewport["width"])
    show(page, "monitor")
    picture(page, shots, "tablet" if viewport is TABLET else "laptop")


def test_everything_that_can_be_used_has_a_name(open_page):
    page = open_page()
    nameless = page.evaluate(
        """() => [...document.querySelectorAll('button, input, select, [role=tab], [role=slider]')]
        .filter((e) => e.offsetParent !== null && !e.ariaLabel && !e.textContent.trim() && !e.labels?.length)
        .map((e) => e.outerHTML.slice(0, 120))"""
    )
    assert nameless == []


def test_every_page_has_one_language_and_a_title(open_page):
    page = open_page("healthy")
    expect(page).to_have_title(text("title"))
    expect(page.locator("html")).to_have_attribute("lang", re.compile("^en"))
