"""A server that is silent, gone or started again, in Chromium: numbers and knobs belong together."""

from __future__ import annotations

import re
import signal

import pytest

from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import case_text
from page_in_browser import LAPTOP, beat, expect, knob, open_file, picture, show, turn, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser


@pytest.fixture
def alone(browser, own_server):
    """A page of a server that others do not use."""
    own_server.be_there()
    page = browser.new_page(viewport=LAPTOP, reduced_motion="reduce")
    page.set_default_timeout(60_000)
    page.goto(own_server.url)
    page.wait_for_function("window.eclsim?.bus.last('beat')", timeout=150_000)
    yield page, own_server
    page.close()


def status(page):
    return expect(page.locator(".ecl-status"))


def p01(folder):
    paper = PRESETS["paper"].case()
    person = paper.patient.model_copy(update={"id": "P01"})
    path = folder / "P01.toml"
    plausible = {name: value for name, value in paper.parameters.items() if name != "Edla"}
    path.write_text(case_text(paper.model_copy(update={"patient": person, "parameters": plausible})))
    return path


def test_numbers_never_stand_beside_a_knob_that_they_do_not_belong_to(alone, tmp_path, shots):
    page, server = alone
    open_file(page, p01(tmp_path))
    wait_for(page, "'Pcrrttuin' in beat.waves")
    expect(knob(page, "ecmo.speed_rpm")).to_have_value("3425")
    server.process.send_signal(signal.SIGSTOP)  # a connection that hangs
    turn(page, "ecmo.speed_rpm", "4444")
    page.wait_for_timeout(1500)
    expect(page.locator(".ecl-page.ecl-stale")).to_have_count(1)  # long before it is said that nobody answers
    assert "answer" not in page.locator(".ecl-status").inner_text()
    status(page).to_have_text(text("silent", what="Pump speed 3425 rpm"))
    status(page).to_have_class(re.compile(r"\bbad\b"))
    expect(knob(page, "ecmo.speed_rpm")).to_have_value("3425")
    expect(knob(page, "ecmo.speed_rpm")).to_be_disabled()
    expect(page.locator(".ecl-page.ecl-stale")).to_have_count(1)
    picture(page, shots, "silent")
    expect(page.locator(".ecl-header .q-btn").first).to_have_js_property("inert", True)
    server.process.send_signal(signal.SIGCONT)
    expect(knob(page, "ecmo.speed_rpm")).to_be_enabled()
    expect(page.get_by_text(text("taken_back"))).to_be_visible()
    page.wait_for_timeout(1000)
    expect(knob(page, "ecmo.speed_rpm")).to_have_value("3425")  # what the page took back is not made later
    expect(page.locator(".ecl-stale")).to_have_count(0)
    assert beat(page)["values"]["ecmo.speed_rpm"] == 3425
    page.get_by_role("button", name="Redo").click()
    expect(knob(page, "ecmo.speed_rpm")).to_have_value("4444")
    page.wait_for_function("eclsim.bus.last('beat').values['ecmo.speed_rpm'] === 4444")
    expect(page.locator(".ecl-stale")).to_have_count(0)
    status(page).not_to_contain_text("numbers are for")

    page.keyboard.press("Alt+p")
    page.keyboard.press("Alt+s")
    page.wait_for_function("eclsim.bus.last('saved')?.length === 1 && eclsim.bus.last('pinned')")
    turn(page, "patient.heart_rate_bpm", "99")
    wait_for(page, "Math.abs(beat.period - 60 / 99) < 1e-3")
    show(page, "identify")
    page.locator("#form-measurements-MAP").fill("77")
    page.wait_for_function("eclsim.bus.last('keep')?.of === eclsim.bus.last('state').of")
    server.kill()
    status(page).to_have_text(text("offline", what="P01, changed"))
    status(page).to_have_class(re.compile(r"\bbad\b"))
    expect(knob(page, "patient.heart_rate_bpm")).to_be_disabled()
    picture(page, shots, "offline")

    server.start_again()
    page.get_by_text("Restored from this tab: P01, changed").wait_for(timeout=150_000)
    page.wait_for_function(
        "eclsim.bus.last('saved')?.length === 1 && eclsim.bus.last('pinned')", timeout=150_000
    )
    picture(page, shots, "restored")
    expect(knob(page, "patient.heart_rate_bpm")).to_have_value("99")
    expect(knob(page, "ecmo.speed_rpm")).to_have_value("4444")
    expect(page.locator(".ecl-provenance")).to_contain_text("P01, changed")
    show(page, "identify")
    expect(page.locator("#form-measurements-MAP")).to_have_value("77")
    page.get_by_role("button", name="Undo").click()
    wait_for(page, "Math.abs(beat.period - 0.5) < 1e-3")
    page.get_by_role("button", name="Reset").click()
    wait_for(page, "beat.values['ecmo.speed_rpm'] === 3425")


def test_a_timeline_goes_on_after_a_restart_and_says_so(alone):
    """It was closed without a word, and the page showed 00:00."""
    page, server = alone
    page.get_by_role("button", name=text("timeline_open")).click()
    page.locator(".ecl-timeline .new select").select_option("bleed_ml")
    page.locator(".ecl-timeline .new button").click()
    page.wait_for_function("eclsim.bus.last('course')?.of === eclsim.bus.last('state').of")
    chart = page.get_by_role("slider", name=text("timeline_cursor"))
    for _ in range(3):
        chart.press("PageUp")
    wait_for(page, "beat.minute === 30")
    page.get_by_label(text("timeline_record")).check()
    page.wait_for_function("eclsim.bus.last('keep')?.of === eclsim.bus.last('state').of")
    mean = beat(page)["outputs"]["MAP"]
    server.kill()
    status(page).to_contain_text("Not connected")
    server.start_again()
    expect(page.locator(".ecl-timeline [role=status]").nth(1)).to_have_text(
        text("timeline_again", time="00:30"), timeout=150_000
    )
    wait_for(page, f"beat.minute === 30 && Math.abs(beat.outputs.MAP - {mean}) < 0.1")
    page.evaluate("eclsim.bus.publish('beat', { ...eclsim.bus.last('beat'), minute: 0 })")
    ahead = text("timeline_ahead", shown="00:00", time="00:30")
    expect(page.locator(".ecl-timeline [role=status]").nth(1)).to_have_text(ahead)  # not yet as it was
    page.evaluate("eclsim.bus.publish('beat', { ...eclsim.bus.last('beat'), minute: 30 })")
    expect(page.get_by_text(text("timeline_again", time="00:30"))).to_be_visible()
    expect(page.locator(".ecl-timeline ol")).to_contain_text(text("give_bleed_ml"))
    expect(page.get_by_label(text("timeline_record"))).to_be_checked()
    turn(page, "patient.heart_rate_bpm", "88")
    expect(page.locator(".ecl-timeline ol li")).to_have_count(2)  # an event of that minute, as before
    page.get_by_role("button", name=text("timeline_start")).click()
    expect(page.get_by_text(text("timeline_again", time="00:30"))).to_have_count(0)
    page.get_by_role("button", name=text("timeline_close")).click()
    show(page, "outputs")
    page.reload()
    expect(page.get_by_role("tab", name=text("outputs"), exact=True)).to_have_attribute(
        "aria-selected", "true"
    )
    expect(page.locator(".ecl-timeline .new")).to_have_count(0)


def test_a_session_that_cannot_be_restored_is_called_lost(open_page):
    page = open_page("lvad")
    page.wait_for_function("eclsim.bus.last('keep')")
    page.evaluate("sessionStorage.setItem('eclsim-tab', JSON.stringify({ tab: 'damaged', of: '' }))")
    page.reload()
    expect(page.get_by_text("The session of this tab was lost")).to_contain_text("Healthy adult")
    expect(page.locator(".ecl-provenance")).to_contain_text("Healthy adult")


BEHIND = "eclsim.bus.publish('state', { ...eclsim.bus.last('state'), of: 'turned' })"
"""A knob was turned, and its beat is long in coming."""


def test_what_is_not_yet_of_the_knobs_says_so_in_words(open_page):
    """Pale numbers stood under a green "Steady beat"; a course of before was not even pale."""
    page = open_page("healthy")
    page.get_by_role("button", name=text("timeline_open")).click()
    page.locator(".ecl-timeline .chart").wait_for(timeout=150_000)
    expect(page.locator(".ecl-timeline .chart.old")).to_have_count(0)
    page.evaluate(BEHIND)
    status(page).to_have_text(text("computing"))
    status(page).to_have_class(re.compile(r"\bbusy\b"))
    expect(page.locator(".ecl-timeline .chart.old")).to_have_count(1)
    expect(page.locator(".ecl-timeline .shown")).to_have_text(text("study_old"))
    page.evaluate("eclsim.bus.publish('failed', 'it failed')")
    status(page).to_have_text("it failed")
    page.wait_for_timeout(1000)
    status(page).to_have_text("it failed")
    turn(page, "patient.heart_rate_bpm", "88")
    status(page).to_contain_text(text("ready"))
    expect(page.locator(".ecl-timeline .chart.old")).to_have_count(0)


def test_a_server_that_hangs_while_it_computes_is_said_to_hang(alone):
    """It had taken the turn, so that nothing waited for an answer: "Computing" stood for good."""
    page, server = alone
    page.evaluate(BEHIND)
    status(page).to_have_text(text("computing"))
    page.wait_for_timeout(7000)
    status(page).to_have_text(text("computing"))  # it is there, and slow
    server.process.send_signal(signal.SIGSTOP)
    status(page).to_have_text(text("silent", what="Healthy adult"))
    expect(knob(page, "patient.heart_rate_bpm")).to_be_disabled()
    server.process.send_signal(signal.SIGCONT)
    expect(knob(page, "patient.heart_rate_bpm")).to_be_enabled()
    page.evaluate("eclsim.bus.publish('fit_progress', { share: 0.1, seconds: 1, text: 'fitting' })")
    server.process.send_signal(signal.SIGSTOP)
    status(page).to_have_class(re.compile(r"\bbad\b"))
    server.process.send_signal(signal.SIGCONT)


@pytest.mark.parametrize("view", ["ramp", "schemes"])
def test_a_study_of_a_state_before_says_so_in_words(open_page, view):
    page = open_page("paper")
    show(page, view)
    page.wait_for_function(f"eclsim.bus.last('{view}')?.of === eclsim.bus.last('state').of")
    old = page.locator(".q-tab-panel:visible .ecl-renewed")
    expect(old).to_have_count(0)
    page.evaluate(BEHIND)
    expect(old).to_have_text(text("study_old"))
    expect(old).to_be_visible()


def test_a_fit_that_is_lost_with_its_page_is_called_lost(open_page):
    page = open_page("paper")
    show(page, "identify")
    page.locator("#form-patient-id").fill("P7")
    page.locator("#form-measurements-MAP").fill("77")
    page.get_by_role("button", name=text("fit"), exact=True).click()
    page.get_by_role("progressbar").wait_for()
    page.wait_for_function("eclsim.bus.last('keep')")
    page.reload()
    page.wait_for_function("window.eclsim?.bus.last('beat')")
    show(page, "identify")
    expect(page.locator(".ecl-identify .message")).to_have_text(text("fit_lost"))
    expect(page.locator("#form-measurements-MAP")).to_have_value("77")


PASSWORD = "correct horse battery"


def sign_in(page):
    page.get_by_label("Password").fill(PASSWORD)
    page.keyboard.press("Enter")
    page.wait_for_function("window.eclsim?.bus.last('beat')", timeout=150_000)


def test_with_a_password(browser, with_password):
    page = browser.new_page()
    assert page.request.get(with_password.url + "/_nicegui/anything").status == 401
    page.goto(with_password.url)
    page.get_by_label("Password").fill("wrong password")
    page.get_by_role("button").click()
    page.get_by_role("alert").wait_for()
    sign_in(page)
    (cookie,) = page.context.cookies()
    assert cookie["httpOnly"]
    page.close()


def test_a_page_whose_sign_in_ended_says_how_to_go_on(browser, with_password):
    """It said "Not connected" for good."""
    page = browser.new_page(viewport=LAPTOP, reduced_motion="reduce")
    page.set_default_timeout(60_000)
    page.goto(with_password.url)
    sign_in(page)
    turn(page, "patient.heart_rate_bpm", "99")
    wait_for(page, "Math.abs(beat.period - 60 / 99) < 1e-3")
    page.wait_for_function("eclsim.bus.last('keep')?.of === eclsim.bus.last('state').of")
    with_password.kill()
    status(page).to_have_text(text("offline", what="Healthy adult, changed"))
    with_password.start_again()
    status(page).to_have_text(text("signed_out", what="Healthy adult, changed"))
    page.reload()
    sign_in(page)
    expect(knob(page, "patient.heart_rate_bpm")).to_have_value("99")
    page.close()


def test_who_signs_out_leaves_nothing_in_the_tab_and_other_tabs_are_cut_off(browser, with_password):
    context = browser.new_context(viewport=LAPTOP, reduced_motion="reduce")
    page, other = context.new_page(), context.new_page()
    page.goto(with_password.url)
    sign_in(page)
    other.goto(with_password.url)
    other.wait_for_function("window.eclsim?.bus.last('beat')", timeout=150_000)
    turn(page, "patient.heart_rate_bpm", "99")
    page.wait_for_function("eclsim.bus.last('keep')?.of === eclsim.bus.last('state').of")
    page.get_by_role("button", name="Sign out").click()
    page.get_by_label("Password").wait_for()
    kept = page.evaluate("Object.keys(sessionStorage).filter((name) => name.startsWith('eclsim-'))")
    assert kept == []
    assert context.cookies() == []
    status(other).to_have_text(text("signed_out", what="Healthy adult"), timeout=60_000)
    context.close()


def test_charts_that_could_not_be_loaded_once_come_with_the_next_beat(browser, open_page, served):
    names = open_page("healthy").evaluate(
        "JSON.parse(document.querySelector('script[type=importmap]').textContent).imports"
    )
    refused = []

    def once(route) -> None:
        if refused:
            route.continue_()
        else:
            refused.append(route.request.url)
            route.abort()

    other = browser.new_page(viewport=LAPTOP, reduced_motion="reduce")
    other.route("**" + names["nicegui-plotly"], once)
    other.goto(served.url)
    other.wait_for_function("window.eclsim?.bus.last('beat')", timeout=150_000)
    show(other, "loops")
    turn(other, "patient.heart_rate_bpm", "71")
    expect(other.locator(".ecl-fill .main-svg, .ecl-chart .main-svg").first).to_be_visible()
    assert len(refused) == 1
    other.close()
