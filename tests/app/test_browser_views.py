"""Every view of the page in Chromium. ECLSIM_SCREENSHOTS=FOLDER keeps a picture of each."""

from __future__ import annotations

import pytest

from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from page_in_browser import beat, picture, show, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser


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
    page.locator("#form-patient-id").fill("P01")
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
    page.get_by_text(text("fit_cancelled")).wait_for(timeout=20_000)
    fit.click()
    page.locator(".ecl-identify .found").wait_for(timeout=480_000)
    picture(page, shots, "identify_found")
    assert page.locator(".ecl-identify .found").get_by_text("identifiable").first.is_visible()
    find = page.get_by_role("button", name=text("posterior_find"))
    find.click()
    page.get_by_role("progressbar", name=text("posterior_find")).wait_for()
    page.get_by_role("button", name="Cancel").click()
    page.get_by_text(text("fit_cancelled")).wait_for(timeout=30_000)
    find.click()
    page.locator(".ecl-identify .found .trust").wait_for(timeout=480_000)
    page.locator(".ecl-identify .found").scroll_into_view_if_needed()
    picture(page, shots, "identify_posterior")
    page.get_by_role("button", name=text("fit_use")).click()
    wait_for(page, "Math.abs(beat.outputs.SP - 83) < 4")
    show(page, "monitor")
    page.wait_for_function("eclsim.bus.last('bands')?.of === eclsim.bus.last('beat').of")
    assert page.get_by_role("group", name=text("bands_label")).is_visible()


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
