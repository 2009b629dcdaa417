"""Numbers of other states: what no patient has is marked wherever it stands, what differs is named."""

from __future__ import annotations

import re

import pytest

from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from page_in_browser import PHONE, beat_with, choose, expect, picture, show, turn

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser
DIGIT = re.compile(r"\d")


def test_an_impossible_beat_is_marked_in_every_view(open_page, shots):
    page = open_page("paper")
    turn(page, "ecmo.speed_rpm", "6000")
    assert not beat_with(page, "ecmo.speed_rpm", 6000)["possible"]
    page.get_by_role("button", name=text("save")).click()
    page.get_by_role("button", name=text("pin")).click()
    expect(page.locator(".ecl-keys")).not_to_contain_text("Δ")
    show(page, "ramp")
    expect(page.locator(".ecl-fill .ecl-caution")).to_contain_text(re.compile(r"Impossible at .*6000 rpm"))
    picture(page, shots, "impossible_ramp")
    show(page, "schemes")
    cell = page.locator(".ecl-schemes button", has_text=re.compile("^g"))
    expect(cell.locator(".values")).to_have_text(text("impossible_column"))
    picture(page, shots, "impossible_schemes")
    page.keyboard.press("Alt+r")
    assert beat_with(page, "ecmo.speed_rpm", 3425)["possible"]
    show(page, "compare")
    heads = page.locator(".ecl-compare thead th")
    expect(heads.nth(1)).not_to_contain_text(text("impossible_column"))
    for k in (2, 3):
        expect(heads.nth(k)).to_contain_text(text("impossible_column"))
    row = page.locator(".ecl-compare tr.output").first
    expect(row.locator("td").nth(0).locator("s")).to_have_count(0)
    for k in (1, 2):
        expect(row.locator("td").nth(k).locator("s")).to_have_text(DIGIT)
    expect(page.locator(".ecl-compare .js-line")).to_have_count(2)
    picture(page, shots, "impossible_compare")
    expect(page.locator('.ecl-keys [data-key="MAP"]')).to_contain_text("Δ ✕")
    show(page, "monitor")
    expect(page.locator(".ecl-monitor .trace .pinned").first).to_have_text(f"{text('pinned')} ✕ –")
    picture(page, shots, "impossible_pinned")
    for view in ("loops", "outputs"):
        show(page, view)
        expect(page.locator(f".ecl-{view} > [role=status]")).to_have_text(text("impossible_pinned"))
        picture(page, shots, f"impossible_{view}")
    show(page, "ramp")
    expect(page.locator(".ecl-fill .ecl-caution")).to_have_count(0)


NO_BEAT = """() => {
  const beat = eclsim.bus.last('beat');
  const none = (numbers) => Object.fromEntries(Object.keys(numbers).map((name) => [name, null]));
  const waves = Object.fromEntries(Object.entries(beat.waves).map(([n, wave]) => [n, wave.map(() => null)]));
  const numbers = { means: none(beat.means), outputs: none(beat.outputs), waves };
  eclsim.bus.publish('beat', { ...beat, ...numbers, converged: false, message: 'none' }); }"""


def test_without_a_beat_no_number_is_shown_as_if_it_were_one(open_page, shots):
    """Flows of the circuit and of the monitor were 0.00, changes from a pinned beat minus its values."""
    page = open_page("paper")
    page.keyboard.press("Alt+p")
    expect(page.locator('.ecl-keys [data-key="MAP"]')).to_contain_text("Δ 0")
    page.evaluate(NO_BEAT)
    for numbers in (".ecl-keys dd", ".ecl-schematic .flow", ".ecl-monitor .big"):
        expect(page.locator(numbers).first).to_contain_text("–")
        assert not any(map(DIGIT.search, page.locator(numbers).all_text_contents())), numbers
    picture(page, shots, "no_beat")
    page.set_viewport_size(PHONE)
    page.evaluate("eclsim.bus.publish('beat', { ...eclsim.bus.last('beat'), message: 'why '.repeat(40) })")
    expect(page.locator(".ecl-status .message")).to_contain_text("why why")
    assert page.locator(".ecl-header").bounding_box()["height"] < 0.3 * PHONE["height"]


def test_all_that_states_differ_in_has_a_row_with_device_and_unit(open_page, shots):
    page = open_page("paper")
    page.keyboard.press("Alt+s")
    page.locator("#knob-policy").select_option("patient_held")
    page.wait_for_function("eclsim.bus.last('state').policy === 'patient_held'")
    page.wait_for_function("eclsim.bus.last('beat').of === eclsim.bus.last('state').of")
    page.keyboard.press("Alt+s")
    page.wait_for_function("eclsim.bus.last('saved')?.length === 2")
    choose(page, PRESETS["lvad"].name)
    page.wait_for_function("'Qlvadpump' in eclsim.bus.last('beat').waves")
    show(page, "compare")
    rows = page.locator(".ecl-compare tbody tr")

    def row(words: str):
        return rows.filter(has=page.locator("th", has_text=words)).first

    expect(row(text("policy")).locator("td")).to_have_text(
        [text("as_published"), text("as_published"), text("patient_held")]
    )
    expect(row("ECMO Pump speed")).to_contain_text("rpm")
    expect(row("LVAD Pump speed").locator("td")).to_have_text(["4900", "–", "–"])
    expect(row("CRRT Blood flow")).to_contain_text("mL/min")
    expect(row("CRRT Access line")).to_contain_text("oxygenator")
    expect(row("PF").locator("td").nth(1)).to_have_text("3.70")
    picture(page, shots, "compare_devices")
    page.keyboard.press("Alt+3")
    expect(page.locator(".ecl-fill .ecl-chart.ecl-old")).to_have_count(0)
