"""Every view of the page in Chromium. ECLSIM_SCREENSHOTS=FOLDER keeps a picture of each."""

from __future__ import annotations

import re

import pytest

from eclsim.app import knobs
from eclsim.app.course import with_event
from eclsim.app.state import PageState, key_of, link_of
from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from page_in_browser import beat, expect, knob, picture, show, turn, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser


@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_opens(open_page, shots, preset):
    page = open_page(preset)
    result = beat(page)
    assert result["converged"]
    boxes = 10 + 6 * (preset in ("paper", "vv-ecmo")) + 4 * (preset == "paper")
    expect(page.locator(".ecl-schematic .box")).to_have_count(boxes)
    picture(page, shots, f"preset_{preset}")


def test_loops_ramp_schemes_and_outputs_are_drawn(open_page, shots):
    page = open_page()
    page.get_by_role("button", name="Pin").click()
    page.wait_for_function("eclsim.bus.last('pinned')")
    turn(page, "ecmo.speed_rpm", "2800")
    wait_for(page, "beat.outputs.PF < 3")
    show(page, "loops")
    expect(page.locator(".ecl-chart:visible .scatterlayer .trace")).to_have_count(4)
    picture(page, shots, "loops")
    show(page, "ramp")
    page.wait_for_function("eclsim.bus.last('ramp')?.speeds.length >= 15")
    page.locator(".ecl-chart:visible .scatterlayer .trace").first.wait_for()
    flow = page.evaluate("eclsim.bus.last('ramp').outputs.PF")
    assert flow == sorted(flow)
    picture(page, shots, "ramp")
    show(page, "schemes")
    page.wait_for_function("eclsim.bus.last('schemes')?.cells.length === 9")
    expect(page.locator(".ecl-schemes button")).to_have_count(9)
    picture(page, shots, "schemes")
    page.locator(".ecl-schemes button").nth(2).click()
    expect(knob(page, "crrt.return_site")).to_have_value("pre_pump")
    expect(page.locator('.ecl-schemes button[aria-pressed="true"]')).to_have_text(re.compile("^c "))
    show(page, "outputs")
    page.get_by_label("Filter").fill("arterial")
    rows = page.locator(".ecl-outputs tbody tr")
    expect(rows.nth(9)).to_have_count(0)
    expect(rows.first).to_contain_text("arterial")
    picture(page, shots, "outputs")


def test_the_speed_ramp_says_what_it_needs(open_page):
    page = open_page("healthy")
    show(page, "ramp")
    page.get_by_text(text("ramp_none")).wait_for()
    show(page, "schemes")
    page.get_by_text(text("schemes_none")).wait_for()


def test_a_ramp_that_failed_is_no_missing_pump(open_page):
    page = open_page()
    for view in ("ramp", "schemes"):
        show(page, view)
        page.wait_for_function(f"eclsim.bus.last('{view}')?.of")
        page.evaluate(f"eclsim.bus.publish('{view}', {{ of: '', failed: 'it failed' }})")
        expect(page.locator(".q-tab-panel:visible [role=alert]")).to_have_text("it failed")
        expect(page.get_by_text(text(f"{view}_none"))).to_have_count(0)


def test_the_form_asks_for_what_can_be_measured_here(open_page):
    page = open_page("healthy")
    show(page, "identify")
    flow, pressure = (page.locator(f"#form-measurements-{name}") for name in ("PF", "crrt_return_pressure"))
    expect(page.locator("#form-measurements-CVP")).to_be_visible()
    expect(flow).to_have_count(0)
    expect(pressure).to_have_count(0)
    page.get_by_role("switch", name="Connect ECMO").click()
    expect(flow).to_be_visible()
    expect(pressure).to_have_count(0)
    flow.fill("3.4")
    page.get_by_role("switch", name="Connect ECMO").click()
    wait_for(page, "!('PF' in beat.outputs)")
    expect(flow).to_have_value("3.4")  # what was typed is not hidden


def test_a_fit_runs_with_progress_and_is_used(open_page, shots):
    page = open_page()
    show(page, "identify")
    page.locator("#form-measurements-SP").wait_for()
    page.locator("#form-patient-id").fill("P01")
    page.locator("#form-measurements-SP").fill("70")
    page.locator("#form-measurements-DP").fill("83")
    page.get_by_text("below diastolic").wait_for()
    fit = page.get_by_role("button", name="Fit", exact=True)
    expect(fit).to_be_disabled()
    picture(page, shots, "identify_bad")
    measured = {"SP": "83", "DP": "76", "MAP": "80", "MPAP": "11", "PCWP": "", "CO": "1.4", "PF": "3.5"}
    for name, value in measured.items():
        page.locator(f"#form-measurements-{name}").fill(value)
    fit.click()  # once it is enabled
    page.get_by_role("progressbar").wait_for()
    picture(page, shots, "identify_running")
    page.get_by_role("button", name="Cancel").click()
    page.get_by_text(text("fit_cancelled")).wait_for()
    fit.click()
    page.locator(".ecl-identify .result").wait_for(timeout=480_000)
    picture(page, shots, "identify_found")
    expect(page.locator(".ecl-identify .result").get_by_text("identifiable").first).to_be_visible()
    outputs = page.locator(".ecl-identify .result table").first
    assert [outputs.locator(f'tr:has(b:text-is("{name}")) small').inner_text() for name in ("SP", "CO")] == [
        "mmHg",
        "L/min",
    ]
    find = page.get_by_role("button", name=text("posterior_find"))
    find.click()
    page.get_by_role("progressbar", name=text("posterior_find")).wait_for()
    page.get_by_role("button", name="Cancel").click()
    page.get_by_text(text("fit_cancelled")).wait_for()
    find.click()
    page.locator(".ecl-identify .result .trust").wait_for(timeout=480_000)
    page.locator(".ecl-identify .result").scroll_into_view_if_needed()
    picture(page, shots, "identify_posterior")
    page.get_by_role("button", name=text("fit_use")).click()
    wait_for(page, "Math.abs(beat.outputs.SP - 83) < 4")
    show(page, "monitor")
    page.wait_for_function("eclsim.bus.last('bands')?.of === eclsim.bus.last('beat').of")
    expect(page.get_by_role("group", name=text("bands_label"))).to_be_visible()


def test_events_that_last_longer_and_knobs_turned_a_little_are_differences(open_page, served):
    case = PRESETS["paper"].case()
    states = [
        PageState(with_event(case, {"at_min": 0.5, "give": {"crystalloid_ml": 500}, "over_min": over}))
        for over in (5, 60)
    ]
    states.append(states[0].with_case(knobs.turn(states[0].case, "ecmo.speed_rpm", 3425.4)))
    page = open_page()
    for k, state in enumerate(states):
        page.evaluate(f"location.hash = '{link_of(state)}'")
        page.wait_for_function(f"eclsim.bus.last('beat').of === '{key_of(state)}'")
        page.keyboard.press("Alt+s")
        page.wait_for_function(f"eclsim.bus.last('saved')?.length === {k + 1}")
    show(page, "compare")
    rows = page.locator(".ecl-compare tr.knob")
    expect(rows.filter(has_text=text("timeline_events")).locator("td")).to_contain_text(
        ["00:00:30 Crystalloid 500 mL over 5 min", "over 5 min", "over 60 min", "over 5 min"]
    )
    expect(rows.filter(has_text="rpm").locator("td")).to_have_text(["3425.4", "3425", "3425", "3425.4"])


def test_states_are_compared(open_page, shots):
    page = open_page()
    page.keyboard.press("Alt+s")
    page.wait_for_function("eclsim.bus.last('saved')?.length === 1")
    turn(page, "ecmo.speed_rpm", "2500")
    wait_for(page, "beat.outputs.PF < 2.7")
    page.get_by_role("button", name="Save state").click()
    show(page, "compare")
    expect(page.locator(".ecl-compare tr.knob td")).to_have_text(["2500", "3425", "2500"])
    expect(page.locator(".ecl-compare tr.knob th")).to_contain_text(["ECMO Pump speed"])
    picture(page, shots, "compare")
    page.get_by_role("button", name="Show 1").click()
    wait_for(page, "beat.outputs.PF > 3.5")
    page.get_by_role("button", name="Remove 1").click()
    page.wait_for_function("eclsim.bus.last('saved').length === 1")
