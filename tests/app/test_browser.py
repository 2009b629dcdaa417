"""The page in Chromium: views, knobs, CRRT lines, a fit, exports, bad values, keyboard, no foreign requests.

ECLSIM_SCREENSHOTS=FOLDER keeps a picture of every view.
"""

from __future__ import annotations

import re
import urllib.parse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from eclsim.app.state import PageState, link_of
from eclsim.app.texts import text
from eclsim.patients.presets import PRESETS
from eclsim.patients.writing import case_text

pytestmark = pytest.mark.slow
LAPTOP, TABLET = {"width": 1280, "height": 800}, {"width": 820, "height": 1180}
WAIT_MS = 60_000


@pytest.fixture
def open_page(browser, served) -> Iterator[Callable[..., Any]]:
    """Opens pages and fails if one asked for anything elsewhere or had an error."""
    contexts, foreign, errors = [], [], []

    def start(preset: str = "paper", viewport: dict = LAPTOP, url: str | None = None):
        context = browser.new_context(viewport=viewport, reduced_motion="reduce", accept_downloads=True)
        contexts.append(context)
        page = context.new_page()
        own = (served.url, "data:", "blob:")
        page.on("request", lambda r: None if r.url.startswith(own) else foreign.append(r.url))
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.set_default_timeout(WAIT_MS)
        page.goto(url or f"{served.url}/#{link_of(PageState(PRESETS[preset].case(), origin=preset))}")
        page.wait_for_function("window.eclsim?.bus.last('beat')")
        return page

    yield start
    for context in contexts:
        context.close()
    assert foreign == []
    assert errors == []


def beat(page) -> dict[str, Any]:
    return page.evaluate("eclsim.bus.last('beat')")


def wait_for(page, condition: str) -> None:
    page.wait_for_function(f"(() => {{ const beat = eclsim.bus.last('beat'); return {condition}; }})()")


def show(page, view: str) -> None:
    page.get_by_role("tab", name=text(view), exact=True).click()


def picture(page, shots: Path | None, name: str) -> None:
    if shots is not None:
        page.wait_for_timeout(700)
        page.screenshot(path=shots / f"{name}.png")


def test_a_knob_moves_everything(open_page, shots):
    page = open_page()
    before = beat(page)["outputs"]
    slider = page.get_by_role("slider", name="Pump speed")
    slider.focus()
    for _ in range(8):
        page.keyboard.press("ArrowRight")
    wait_for(page, "beat.outputs.PF > 3.8")
    after = beat(page)["outputs"]
    assert after["MAP"] > before["MAP"]
    assert f"{after['MAP']:.0f}" in page.locator(".ecl-keys").inner_text()
    assert f"{after['PF']:.2f} L/min" in page.locator(".ecl-schematic").inner_text()
    assert f"{after['PF']:.2f}" in page.locator(".ecl-monitor").inner_text()
    page.wait_for_function("document.querySelector('#knob-ecmo-speed_rpm').value === '3625'")
    picture(page, shots, "monitor")


def test_the_notice_is_always_there(open_page):
    page = open_page("healthy")
    for view in ("monitor", "loops", "identify"):
        show(page, view)
        box = page.get_by_text(text("notice")).bounding_box()
        assert box["y"] + box["height"] <= LAPTOP["height"]


@pytest.mark.parametrize(
    ("typed", "said"),
    [("3,5", "decimal comma"), ("abc", "not a number"), ("9999", "far above"), ("<b>x</b>", "<b>x</b>")],
)
def test_bad_values_are_said_beside_the_knob_and_change_nothing(open_page, shots, typed, said):
    page = open_page()
    field = page.locator("#knob-ecmo-speed_rpm")
    field.fill(typed)
    field.press("Enter")
    alert = page.locator("#knob-ecmo-speed_rpm-error")
    alert.wait_for()
    assert said in alert.inner_text()
    assert field.get_attribute("aria-invalid") == "true"
    assert beat(page)["outputs"]["PF"] == pytest.approx(3.70, abs=0.02)
    if typed == "3,5":
        picture(page, shots, "bad_value")
    field.fill("3000")
    field.press("Enter")
    wait_for(page, "beat.outputs.PF < 3.2")
    assert alert.count() == 0


def test_a_crrt_line_is_dragged_to_another_position(open_page, shots):
    page = open_page()
    before = beat(page)["outputs"]["crrt_access_pressure"]
    handle = page.locator('[data-line="access"] .knob').bounding_box()
    target = page.locator('[data-node="ecmotudp"] rect').bounding_box()
    page.mouse.move(handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2)
    page.mouse.down()
    page.mouse.move(target["x"] + target["width"] / 2, target["y"] + 10, steps=6)
    picture(page, shots, "dragging")
    page.mouse.move(target["x"] + target["width"] / 2, target["y"] + target["height"] / 2, steps=3)
    page.mouse.up()
    wait_for(page, f"beat.outputs.crrt_access_pressure < {before} - 100")
    assert page.get_by_label("Access line at").input_value() == "pre_pump"


def test_a_crrt_line_is_moved_with_the_keyboard_and_chosen_from_the_list(open_page):
    page = open_page()
    handle = page.locator('[data-line="return"]')
    handle.focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_function("document.querySelector('#knob-crrt-return_site').value === 'post_oxy'")
    page.get_by_label("Return line at").select_option("pre_rc")
    page.wait_for_function("eclsim.bus.last('drawing').lines.some((l) => l.site === 'ecmoreturn' && l.moves)")


def test_undo_redo_reset_and_pin(open_page, shots):
    page = open_page()
    page.keyboard.press("Alt+p")
    page.wait_for_function("eclsim.bus.last('pinned')")
    page.locator("#knob-patient-heart_rate_bpm").fill("80")
    page.locator("#knob-patient-heart_rate_bpm").press("Enter")
    wait_for(page, "Math.abs(beat.period - 0.75) < 1e-3")
    page.locator("h2").first.click()
    page.keyboard.press("Control+z")
    wait_for(page, "Math.abs(beat.period - 0.5) < 1e-3")
    page.get_by_role("button", name="Redo").click()
    wait_for(page, "Math.abs(beat.period - 0.75) < 1e-3")
    picture(page, shots, "monitor_pinned")
    page.get_by_role("button", name="Reset").click()
    wait_for(page, "Math.abs(beat.period - 0.5) < 1e-3")
    page.get_by_role("button", name="Pin").click()
    page.wait_for_function("eclsim.bus.last('pinned') === null")


@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_opens(open_page, shots, preset):
    page = open_page(preset)
    found = beat(page)
    assert found["converged"]
    assert page.locator(".ecl-schematic .box").count() == (
        10 + 6 * (preset in ("paper", "vv-ecmo")) + 4 * (preset == "paper")
    )
    picture(page, shots, f"preset_{preset}")


def test_loops_ramp_schemes_and_outputs_are_drawn(open_page, shots):
    page = open_page()
    page.get_by_role("button", name="Pin").click()
    page.locator("#knob-ecmo-speed_rpm").fill("2800")
    page.locator("#knob-ecmo-speed_rpm").press("Enter")
    wait_for(page, "beat.outputs.PF < 3")
    show(page, "loops")
    page.locator(".ecl-chart .scatterlayer .trace").first.wait_for()
    assert page.locator(".ecl-chart:visible .scatterlayer .trace").count() == 4
    picture(page, shots, "loops")
    show(page, "ramp")
    page.wait_for_function("eclsim.bus.last('ramp')?.speeds.length >= 15")
    page.locator(".ecl-chart:visible .scatterlayer .trace").first.wait_for()
    flow = page.evaluate("eclsim.bus.last('ramp').outputs.PF")
    assert flow == sorted(flow)
    picture(page, shots, "ramp")
    show(page, "schemes")
    page.wait_for_function("eclsim.bus.last('schemes')?.cells.length === 9")
    assert page.locator(".ecl-schemes button").count() == 9
    picture(page, shots, "schemes")
    page.locator(".ecl-schemes button").nth(2).click()
    page.wait_for_function("document.querySelector('#knob-crrt-return_site').value === 'pre_pump'")
    assert page.locator('.ecl-schemes button[aria-pressed="true"]').inner_text().startswith("c")
    show(page, "outputs")
    page.get_by_label("Filter").fill("arterial")
    rows = page.locator(".ecl-outputs tbody tr")
    rows.first.wait_for()
    assert 0 < rows.count() < 10
    picture(page, shots, "outputs")


def test_the_speed_ramp_says_what_it_needs(open_page):
    page = open_page("healthy")
    show(page, "ramp")
    page.get_by_text(text("ramp_none")).wait_for()
    show(page, "schemes")
    page.get_by_text(text("schemes_none")).wait_for()


def test_a_fit_runs_with_progress_and_is_used(open_page, shots):
    page = open_page()
    show(page, "identify")
    page.locator("#form-measurements-SP").wait_for()
    page.wait_for_function("document.querySelector('#form-measurements-SP').value !== ''")
    page.locator("#form-measurements-SP").fill("70")
    page.locator("#form-measurements-DP").fill("83")
    page.get_by_text("below diastolic").wait_for()
    fit = page.get_by_role("button", name="Fit", exact=True)
    assert fit.is_disabled()
    picture(page, shots, "identify_bad")
    measured = {"SP": "83", "DP": "76", "MAP": "80", "MPAP": "11", "PCWP": "", "CO": "1.4", "PF": "3.5"}
    for name, value in measured.items():
        page.locator(f"#form-measurements-{name}").fill(value)
    page.wait_for_function(
        "![...document.querySelectorAll('button')].find((b) => b.textContent === 'Fit')?.disabled"
    )
    fit.click()
    page.get_by_role("progressbar").wait_for()
    picture(page, shots, "identify_running")
    page.get_by_role("button", name="Cancel").click()
    page.get_by_text(text("fit_cancelled")).wait_for(timeout=3000)
    fit.click()
    page.locator(".ecl-identify .found").wait_for(timeout=120_000)
    picture(page, shots, "identify_found")
    assert page.locator(".ecl-identify .found").get_by_text("identifiable").first.is_visible()
    page.get_by_role("button", name=text("fit_use")).click()
    wait_for(page, "Math.abs(beat.outputs.SP - 83) < 4")


def test_states_are_compared(open_page, shots):
    page = open_page()
    page.keyboard.press("Alt+s")
    page.get_by_text(text("state_saved")).first.wait_for()
    page.locator("#knob-ecmo-speed_rpm").fill("2500")
    page.locator("#knob-ecmo-speed_rpm").press("Enter")
    wait_for(page, "beat.outputs.PF < 2.7")
    page.get_by_role("button", name="Save state").click()
    show(page, "compare")
    page.locator(".ecl-compare table").wait_for()
    assert page.locator(".ecl-compare tr.knob").inner_text().split("\t")[1:] == ["2500", "3425", "2500"]
    picture(page, shots, "compare")
    page.get_by_role("button", name="Show 1").click()
    wait_for(page, "beat.outputs.PF > 3.5")
    page.get_by_role("button", name="Remove 1").click()
    page.wait_for_function("eclsim.bus.last('saved').length === 1")


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
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(case_text(PRESETS["lvad"].case()).replace("80", "-80"))
    page.locator(".ecl-upload input[type=file]").set_input_files(wrong)
    page.get_by_text("wrong.toml:").first.wait_for()
    picture(page, shots, "open_refused")
    assert beat(page)["period"] == pytest.approx(60 / 70, abs=1e-4)
    page.get_by_role("button", name="Close").click()
    page.get_by_role("button", name="Open case").click()
    marked = tmp_path / "right.toml"
    marked.write_text(case_text(PRESETS["lvad"].case()).replace('"LVAD"', '"<img src=x onerror=alert(1)>"'))
    page.locator(".ecl-upload input[type=file]").set_input_files(marked)
    wait_for(page, "'Qlvadpump' in beat.waves")
    assert page.get_by_text("<img src=x onerror=alert(1)>").count() >= 1
    assert page.locator("img[src=x]").count() == 0


def test_a_link_restores_the_state_and_leaves_no_trace_in_the_address(open_page, served):
    page = open_page()
    page.locator("#knob-ecmo-speed_rpm").fill("2750")
    page.locator("#knob-ecmo-speed_rpm").press("Enter")
    wait_for(page, "beat.outputs.PF < 3")
    page.evaluate("navigator.clipboard.writeText = async (link) => { window.copied = link; }")
    page.get_by_role("button", name="Copy link").click()
    page.get_by_text(text("link_copied")).wait_for()
    link = page.evaluate("window.copied")
    other = open_page(url=link)
    wait_for(other, "beat.outputs.PF < 3")
    assert other.locator("#knob-ecmo-speed_rpm").input_value() == "2750"
    assert urllib.parse.urlsplit(other.url).fragment == ""


def test_where_the_clipboard_is_closed_the_link_is_shown(open_page, served):
    page = open_page("healthy")
    page.evaluate("navigator.clipboard.writeText = () => Promise.reject()")
    page.get_by_role("button", name="Copy link").click()
    shown = page.locator(".ecl-link textarea")
    shown.wait_for()
    assert shown.input_value().startswith(f"{served.url}/#")


def test_a_damaged_link_is_refused_and_the_page_works(open_page, served):
    page = open_page(url=f"{served.url}/#nonsense")
    page.get_by_text("the link is").wait_for()
    assert beat(page)["converged"]


def test_two_tabs_do_not_share_a_patient(open_page):
    first, second = open_page("paper"), open_page("lvad")
    first.locator("#knob-patient-heart_rate_bpm").fill("99")
    first.locator("#knob-patient-heart_rate_bpm").press("Enter")
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
        assert page.evaluate("document.documentElement.scrollWidth") <= viewport["width"], view
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
    assert page.title() == text("title")
    assert re.match("en", page.locator("html").get_attribute("lang"))
