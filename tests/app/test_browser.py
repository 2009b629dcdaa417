"""Knobs, CRRT lines, undo and names of the page in Chromium. ECLSIM_SCREENSHOTS=FOLDER keeps pictures."""

from __future__ import annotations

import pytest

from eclsim.app.knobs import connect
from eclsim.app.knobs import turn as turn_knob
from eclsim.app.state import PageState, link_of
from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from page_in_browser import (
    LAPTOP,
    beat,
    beat_with,
    box_at_rest,
    expect,
    knob,
    picture,
    show,
    turn,
    wait_for,
)

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser


def test_a_knob_moves_everything(open_page, shots):
    page = open_page()
    before = beat(page)["outputs"]
    slider = page.get_by_role("slider", name="Pump speed")
    slider.focus()
    for _ in range(8):
        page.keyboard.press("ArrowRight")
    expect(knob(page, "ecmo.speed_rpm")).to_have_value("3625")
    after = beat_with(page, "ecmo.speed_rpm", 3625)["outputs"]
    assert after["PF"] > 3.8
    assert after["MAP"] > before["MAP"]
    expect(page.locator(".ecl-keys")).to_contain_text(f"{after['MAP']:.0f}")
    expect(page.locator(".ecl-schematic")).to_contain_text(f"{after['PF']:.2f}")
    expect(page.locator(".ecl-monitor")).to_contain_text(f"{after['PF']:.2f}")
    picture(page, shots, "monitor")


def test_the_notice_is_always_there(open_page):
    page = open_page("healthy")
    for view in ("monitor", "loops", "identify"):
        show(page, view)
        box = box_at_rest(page.get_by_text(text("notice")))
        assert box["y"] + box["height"] <= LAPTOP["height"]


def test_bad_values_are_said_beside_the_knob_and_change_nothing(open_page, shots):
    page = open_page()
    field = page.locator("#knob-ecmo-speed_rpm")
    alert = page.locator("#knob-ecmo-speed_rpm-error")
    for typed, message in (
        ("3,425", "3.425 or 3425"), ("abc", "not a number"), ("9999", "far above"), ("<b>x</b>", "<b>x</b>"),
    ):  # fmt: skip
        turn(page, "ecmo.speed_rpm", typed)
        expect(alert).to_contain_text(message)
        expect(field).to_have_attribute("aria-invalid", "true")
        assert beat(page)["outputs"]["PF"] == pytest.approx(3.70, abs=0.02)
        if typed == "3,425":
            picture(page, shots, "bad_value")
        turn(page, "ecmo.speed_rpm", "3000")
        wait_for(page, "beat.outputs.PF < 3.2")
        expect(alert).to_have_count(0)
        turn(page, "ecmo.speed_rpm", "3425")
        wait_for(page, "beat.outputs.PF > 3.6")
    turn(page, "parameters.Rmc", "1,1")
    expect(knob(page, "parameters.Rmc")).to_have_value("1.1")


def test_escape_restores_the_value_in_use_and_sends_nothing(open_page):
    """What was typed stayed in the field after Escape, and the next Tab applied it."""
    page = open_page("healthy")
    field = knob(page, "patient.heart_rate_bpm")
    used = field.input_value()
    page.evaluate("globalThis.turns = 0; eclsim.bus.on('turned', () => (turns += 1))")
    before = page.evaluate("turns")
    field.click()
    page.keyboard.type("155")
    expect(field).to_have_value("155")
    page.keyboard.press("Escape")
    expect(field).to_have_value(used)
    page.keyboard.press("Tab")
    expect(field).to_have_value(used)
    assert page.evaluate("turns") == before
    field.click()
    page.keyboard.type("90")
    page.keyboard.press("Enter")
    page.keyboard.press("Escape")  # it was sent already
    beat_with(page, "patient.heart_rate_bpm", 90)
    expect(field).to_have_value("90")


def test_a_warning_of_the_case_and_the_sum_of_its_volumes_stand_beside_the_knobs(open_page, served, shots):
    case = turn_knob(connect(PRESETS["healthy"].case(), "fluid"), "fluid.extra_volume_ml", 848)
    page = open_page(url=f"{served.url}/#{link_of(PageState(case, origin='file'))}")
    remarks = page.locator(".ecl-knobs [role=note]")
    expect(remarks).to_have_text(["Fluid balance adds 848 mL: 834 mL in all"])  # the preset has 14 mL less
    turn(page, "patient.heart_rate_bpm", "200")
    expect(remarks.first).to_contain_text("faster than a sinus node")
    picture(page, shots, "remarks")
    turn(page, "patient.heart_rate_bpm", "90")
    expect(remarks).to_have_count(1)


def test_a_crrt_line_is_dragged_to_another_position(open_page, shots):
    page = open_page()
    before = beat(page)["outputs"]["crrt_access_pressure"]
    handle = box_at_rest(page.locator('[data-line="crrt.access_site"] .knob'))
    target = box_at_rest(page.locator('[data-node="ecmotudp"] rect'))
    page.mouse.move(handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2)
    page.mouse.down()
    page.mouse.move(target["x"] + target["width"] / 2, target["y"] + 10, steps=6)
    picture(page, shots, "dragging")
    page.mouse.move(target["x"] + target["width"] / 2, target["y"] + target["height"] / 2, steps=3)
    page.mouse.up()
    wait_for(page, f"beat.outputs.crrt_access_pressure < {before} - 100")
    expect(page.get_by_label("Access line at", exact=True)).to_have_value("pre_pump")


def test_a_crrt_line_is_moved_with_the_keyboard_and_chosen_from_the_list(open_page):
    page = open_page()
    handle = page.locator('[data-line="crrt.return_site"]')
    handle.focus()
    page.keyboard.press("ArrowRight")
    expect(knob(page, "crrt.return_site")).to_have_value("post_oxy")
    page.get_by_label("Return line at", exact=True).select_option("pre_rc")
    page.wait_for_function("eclsim.bus.last('drawing').lines.some((l) => l.site === 'ecmoreturn' && l.moves)")


def test_undo_in_the_field_of_a_knob_is_that_of_the_patient_once_it_is_entered(open_page):
    """The browser put the old number back into the field, beside the beat of the new one."""
    page = open_page()
    field = knob(page, "ecmo.speed_rpm")
    field.click()
    page.keyboard.type("2750")
    page.keyboard.press("Enter")
    page.wait_for_function("eclsim.bus.last('beat').values['ecmo.speed_rpm'] === 2750")
    page.keyboard.press("Control+z")
    page.wait_for_function("eclsim.bus.last('beat').values['ecmo.speed_rpm'] === 3425")
    expect(field).to_have_value("3425")
    page.keyboard.type("9")
    page.keyboard.press("Control+z")
    expect(field).not_to_have_value("9")
    assert page.evaluate("eclsim.bus.last('state').values['ecmo.speed_rpm']") == 3425


def test_undo_redo_reset_and_pin(open_page, shots):
    page = open_page()
    page.keyboard.press("Alt+p")
    page.wait_for_function("eclsim.bus.last('pinned')")
    turn(page, "patient.heart_rate_bpm", "80")
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


def test_a_turn_writes_into_no_other_knob(open_page):
    page = open_page()
    page.evaluate(
        """() => {
          window.written = [];
          const note = (of) => of.forEach(({ target }) => {
            const knob = target.closest?.('.ecl-knob, .ecl-pick')?.querySelector('[id]')?.id;
            if (knob) window.written.push(knob);
          });
          new MutationObserver(note).observe(document.querySelector('.ecl-knobs'),
            { subtree: true, attributes: true, childList: true });
        }"""
    )
    turn(page, "ecmo.speed_rpm", "3000")
    beat_with(page, "ecmo.speed_rpm", 3000)
    page.wait_for_timeout(300)
    assert set(page.evaluate("written")) <= {"knob-ecmo-speed_rpm", "knob-policy"}


def test_a_choice_refused_twice_goes_back_twice(open_page):
    page = open_page()
    where = knob(page, "crrt.access_site")
    before = where.input_value()
    for _ in range(2):
        page.evaluate("eclsim.bus.publish('connected', true)")
        where.evaluate("(list) => { list.add(new Option('nowhere', 'nowhere')); }")
        where.select_option("nowhere")
        expect(page.locator(".ecl-pick.bad")).to_have_count(1)
        expect(where).to_have_value(before)
