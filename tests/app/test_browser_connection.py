"""A server that is silent, gone or started again, in Chromium: numbers and knobs belong together."""

from __future__ import annotations

import signal
import urllib.parse

import pytest

from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from eclsim.cases.writing import case_text
from page_in_browser import LAPTOP, open_file, picture, show, turn, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser
SPEED = "document.querySelector('#knob-ecmo-speed_rpm')"


@pytest.fixture
def alone(browser, serving):
    """A page of a server of its own."""
    served = serving()
    page = browser.new_page(viewport=LAPTOP)
    page.set_default_timeout(60_000)
    page.goto(served.url)
    page.wait_for_function("window.eclsim?.bus.last('beat')", timeout=150_000)
    yield page, served
    page.close()


def status(page) -> str:
    return page.locator(".ecl-status").inner_text()


def p01(folder):
    paper = PRESETS["paper"].case()
    person = paper.patient.model_copy(update={"id": "P01"})
    path = folder / "P01.toml"
    plausible = {name: value for name, value in paper.parameters.items() if name != "Edla"}
    path.write_text(case_text(paper.model_copy(update={"patient": person, "parameters": plausible})))
    return path


def test_numbers_never_stand_beside_a_knob_that_they_do_not_belong_to(alone, serving, tmp_path, shots):
    page, served = alone
    open_file(page, p01(tmp_path))
    wait_for(page, "'Pcrrttuin' in beat.waves")
    page.wait_for_function(f"{SPEED}.value === '3425'")
    served.process.send_signal(signal.SIGSTOP)  # a connection that hangs
    turn(page, "ecmo.speed_rpm", "4444")
    page.locator(".ecl-status.bad").wait_for()
    assert status(page) == text("silent", what="Pump speed 3425 rpm")
    assert page.locator("#knob-ecmo-speed_rpm").input_value() == "3425"
    assert page.locator("#knob-ecmo-speed_rpm").is_disabled()
    assert page.locator(".ecl-page.ecl-stale").count() == 1
    picture(page, shots, "silent")
    served.process.send_signal(signal.SIGCONT)
    page.wait_for_function(f"{SPEED}.value === '4444' && !{SPEED}.disabled")
    page.wait_for_function("eclsim.bus.last('beat').values['ecmo.speed_rpm'] === 4444")
    page.wait_for_function("!document.querySelector('.ecl-stale')")
    assert "numbers are of" not in status(page)

    page.keyboard.press("Alt+p")
    page.keyboard.press("Alt+s")
    page.wait_for_function("eclsim.bus.last('saved')?.length === 1 && eclsim.bus.last('pinned')")
    turn(page, "patient.heart_rate_bpm", "99")
    wait_for(page, "Math.abs(beat.period - 60 / 99) < 1e-3")
    show(page, "identify")
    page.locator("#form-measurements-MAP").fill("77")
    page.wait_for_timeout(1000)
    served.process.kill()
    served.process.wait(20)
    page.locator(".ecl-status.bad").wait_for()
    assert status(page) == text("offline", what="P01, changed")
    assert page.locator("#knob-patient-heart_rate_bpm").is_disabled()
    picture(page, shots, "offline")

    serving(port=urllib.parse.urlsplit(served.url).port)
    page.get_by_text("Restored from this tab: P01, changed").wait_for(timeout=150_000)
    page.wait_for_function(
        "eclsim.bus.last('saved')?.length === 1 && eclsim.bus.last('pinned')", timeout=150_000
    )
    picture(page, shots, "restored")
    assert page.locator("#knob-patient-heart_rate_bpm").input_value() == "99"
    assert page.locator("#knob-ecmo-speed_rpm").input_value() == "4444"
    assert "P01, changed" in page.locator(".ecl-whose").inner_text()
    show(page, "identify")
    page.wait_for_function("document.querySelector('#form-measurements-MAP')?.value === '77'")
    page.get_by_role("button", name="Undo").click()
    wait_for(page, "Math.abs(beat.period - 0.5) < 1e-3")
    page.get_by_role("button", name="Reset").click()
    wait_for(page, "beat.values['ecmo.speed_rpm'] === 3425")


def test_a_session_that_cannot_be_restored_is_called_lost(open_page):
    page = open_page("lvad")
    page.wait_for_function("eclsim.bus.last('keep')")
    page.evaluate("sessionStorage.setItem('eclsim-tab', JSON.stringify({ tab: 'damaged', of: '' }))")
    page.reload()
    page.get_by_text("The session of this tab is lost").wait_for()
    assert "Healthy adult" in page.get_by_text("The session of this tab is lost").inner_text()
    assert "Healthy adult" in page.locator(".ecl-whose").inner_text()
