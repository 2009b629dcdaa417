"""The timeline under the monitor: events by clicking, jump, play, and the page at that minute."""

from __future__ import annotations

import pytest

from eclsim.app.course import with_event
from eclsim.app.state import PageState, link_of
from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import read_mapping
from page_in_browser import beat, eventually, expect, knob, picture, show, turn, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser
COURSE = "eclsim.bus.last('course')?.of === eclsim.bus.last('state').of"

AT_THIRTY = """async () => {
  eclsim.bus.publish('beat', { ...eclsim.bus.last('beat'), minute: 30 });
  for (let step = 0; step < 5; step++) await null;
  return document.querySelector('.ecl-timeline .shown').textContent; }"""
"""What the page shows of such a beat, read before the server, which answers a new course, sends another."""


def test_an_event_is_set_where_somebody_clicked_and_the_page_follows(open_page, shots):
    page = open_page("healthy")
    page.get_by_role("button", name=text("timeline_open")).click()
    page.wait_for_function(COURSE)
    chart = page.locator(".ecl-timeline svg").first
    chart.scroll_into_view_if_needed()
    box = chart.bounding_box()
    page.mouse.click(box["x"] + 0.25 * box["width"], box["y"] + 10)
    wait_for(page, "beat.minute > 80 && beat.minute < 100")
    before = beat(page)["outputs"]["MAP"]
    page.locator(".ecl-timeline .new select").select_option("bleed_ml")
    page.locator(".ecl-timeline .new input").first.fill("800")
    page.locator(".ecl-timeline .new button").click()
    expect(page.locator(".ecl-timeline ol")).to_contain_text(f"{text('give_bleed_ml')} 800 mL")
    page.wait_for_function(COURSE)
    remarks = page.locator(".ecl-timeline .remarks")
    assert remarks.bounding_box()["height"] < 40  # folded: remarks on lost blood are long
    remarks.locator("summary").click()
    expect(remarks.locator("p").first).to_contain_text("of blood that is lost")
    assert remarks.bounding_box()["height"] < 140
    remarks.locator("summary").click()
    expect(page.locator(".ecl-timeline .counts")).to_contain_text(f"! {text('kind_warning')} ")
    box = chart.bounding_box()
    page.mouse.click(box["x"] + 0.6 * box["width"], box["y"] + 10)
    wait_for(page, f"beat.minute > 200 && beat.outputs.MAP < {before} - 3")
    expect(page.locator(".ecl-keys")).to_contain_text(f"{beat(page)['outputs']['MAP']:.0f}")
    picture(page, shots, "timeline")
    expect(page.locator(".ecl-knobs .later")).to_contain_text("03:")
    turn(page, "patient.heart_rate_bpm", "80")
    page.wait_for_function(COURSE)
    wait_for(page, "beat.minute > 200 && Math.abs(beat.period - 0.75) < 1e-3")
    page.get_by_role("button", name=text("timeline_remove")).click()
    expect(page.locator(".ecl-timeline ol")).to_have_count(0)
    page.get_by_role("button", name=text("timeline_close")).click()
    wait_for(page, "beat.minute === 0")


def test_the_minute_that_is_shown_is_that_of_the_numbers(open_page):
    """Where a moment takes long, or fails, the page still shows the one before."""
    page = open_page("healthy")
    page.get_by_role("button", name=text("timeline_open")).click()
    page.wait_for_function(COURSE)
    shown = page.locator(".ecl-timeline .shown")
    expect(shown).to_contain_text(text("timeline_at", time="00:00"))
    assert text("timeline_at", time="00:30") in page.evaluate(AT_THIRTY)


def test_a_double_click_adds_or_removes_one_event(open_page):
    page = open_page("healthy")
    page.get_by_role("button", name=text("timeline_open")).click()
    events = page.locator(".ecl-timeline ol li")
    page.locator(".ecl-timeline .new button").dblclick()
    expect(events).to_have_count(1)
    page.wait_for_function(COURSE)
    expect(events).to_have_count(1)
    page.locator(".ecl-timeline .new button").click(delay=20)
    expect(events).to_have_count(2)
    page.get_by_role("button", name=text("timeline_remove")).first.dblclick()
    expect(events).to_have_count(1)
    page.wait_for_function(COURSE)
    expect(events).to_have_count(1)


def test_minutes_are_recorded_beat_by_beat(open_page, shots):
    page = open_page("paper")
    page.get_by_role("button", name=text("timeline_open")).click()
    page.get_by_label(text("timeline_length")).select_option("2")
    page.wait_for_function(f"{COURSE} && eclsim.bus.last('course').minutes === 2")
    page.get_by_label(text("timeline_record")).check()
    page.locator(".ecl-timeline .chart").press("End")
    for _ in range(18):
        page.locator(".ecl-timeline .chart").press("PageDown")
    wait_for(page, "beat.transient && beat.minute > 0.9 && beat.minute < 1.1")
    turn(page, "ecmo.speed_rpm", "0")
    expect(page.locator(".ecl-timeline ol")).to_contain_text("Pump speed 0 rpm")
    page.wait_for_function(COURSE)
    page.locator(".ecl-timeline .chart").press("End")
    wait_for(page, "beat.minute > 1.9 && beat.outputs.PF < 0")
    expect(page.locator(".ecl-knobs .later")).to_have_count(0)
    lane = page.locator(".ecl-timeline .lane").nth(2)
    expect(lane.locator("b")).to_have_text(f"−{-beat(page)['outputs']['PF']:.2f}")
    expect(knob(page, "ecmo.speed_rpm")).to_have_value("0")
    picture(page, shots, "timeline_beats")
    page.locator(".ecl-timeline .chart").press("Home")
    wait_for(page, "beat.minute === 0 && !beat.transient && beat.outputs.PF > 1")
    expect(knob(page, "ecmo.speed_rpm")).not_to_have_value("0")


def opened_with_a_bleeding(open_page, served, bleed_ml, over_min, button="timeline_open_event"):
    """A healthy adult who bleeds at 00:30, from a link, with the timeline open at 3600 times real time."""
    case = with_event(
        PRESETS["healthy"].case(), {"at_min": 30, "give": {"bleed_ml": bleed_ml}, "over_min": over_min}
    )
    page = open_page(url=f"{served.url}/#{link_of(PageState(case))}")
    page.get_by_role("button", name=text(button)).click()
    page.wait_for_function(COURSE)
    page.get_by_label(text("timeline_speed")).select_option("3600")
    return page


def test_a_link_with_events_is_played(open_page, served):
    page = opened_with_a_bleeding(open_page, served, 500, 10, "timeline_open")
    expect(page.locator(".ecl-timeline ol")).to_contain_text(f"{text('give_bleed_ml')} 500 mL")
    page.locator(".ecl-timeline .play").click()
    wait_for(page, "beat.minute > 30")
    page.locator(".ecl-timeline .play").click()
    page.locator(".ecl-timeline .new input").first.fill("90000")
    page.locator(".ecl-timeline .new button").click()
    expect(page.locator(".ecl-timeline .refused")).to_contain_text("20000")


def test_play_stops_where_an_alarm_is_seen_and_goes_on(open_page, served):
    page = opened_with_a_bleeding(open_page, served, 1200, 20)
    play = page.locator(".ecl-timeline .play")
    play.click()
    expect(page.locator(".ecl-timeline .refused")).to_contain_text("below 55 mmHg. Press Play")
    expect(play).to_have_text(text("timeline_play"))
    wait_for(page, "beat.minute > 30 && beat.minute < 60 && beat.levels.MAP === 'alarm'")
    play.click()
    expect(page.locator(".ecl-timeline .refused")).to_have_count(0)
    wait_for(page, "beat.minute > 60")


def test_play_ends_where_another_patient_is_opened(open_page, served):
    """It went on with the new patient, in the middle of a course whose beginning nobody had seen."""
    page = opened_with_a_bleeding(open_page, served, 500, 10)
    play = page.locator(".ecl-timeline .play")
    play.click()
    wait_for(page, "beat.minute > 10")
    raw = PRESETS["healthy"].case().as_mapping()
    raw["patient"]["heart_rate_bpm"] = 91
    link = link_of(PageState(read_mapping(raw).case, origin="file"))
    page.evaluate(f"location.hash = '{link}'")
    wait_for(page, "beat.values['patient.heart_rate_bpm'] === 91 && beat.minute === 0")
    expect(play).to_have_text(text("timeline_play"))
    expect(page.locator(".ecl-timeline .chart")).to_have_attribute("aria-valuenow", "0")


def test_play_waits_for_the_course_of_the_knobs(open_page, served):
    """It went on in the course before a change, stopped at its alarm, and failed without a course."""
    page = opened_with_a_bleeding(open_page, served, 1200, 20)
    play, cursor = page.locator(".ecl-timeline .play"), page.locator(".ecl-timeline .chart")
    page.evaluate("eclsim.bus.publish('course_busy', '')")
    play.click()
    page.wait_for_timeout(1200)
    expect(play).to_have_text(text("timeline_pause"))
    expect(cursor).to_have_attribute("aria-valuenow", "0")
    page.evaluate("eclsim.bus.publish('course', eclsim.bus.last('course'))")
    expect(page.locator(".ecl-timeline .refused")).to_contain_text("below 55 mmHg. Press Play")
    again = "eclsim.bus.publish('course', eclsim.bus.last('course'))"  # as after a new connection
    page.evaluate(again)
    expect(page.locator(".ecl-timeline .refused")).to_contain_text("below 55 mmHg. Press Play")
    play.click()
    page.evaluate("eclsim.bus.publish('course', { refused: 'none' })")
    expect(play).to_have_text(text("timeline_play"))


def test_an_amount_that_may_be_misread_is_asked_about(open_page, shots):
    page = open_page("paper")
    page.get_by_role("button", name=text("timeline_open")).click()
    page.wait_for_function(COURSE)
    form, refused = page.locator(".ecl-timeline .new"), page.locator(".ecl-timeline .refused")

    def add(what, amount, minutes="0"):
        form.locator("select").select_option(what)
        form.locator("input").first.fill(amount)
        form.locator("input").nth(1).fill(minutes)
        form.locator("button").click()

    for what, amount, minutes, said in (
        ("bleed_ml", "1,000", "15", "1,000 may mean 1.000 or 1000"),
        ("ecmo.speed_rpm", "3,425", "0", "3,425 may mean 3.425 or 3425"),
        ("ecmo.speed_rpm", "", "0", text("timeline_no_amount")),
        ("ecmo.speed_rpm", "2000", "", text("timeline_no_minutes")),
        ("ecmo.speed_rpm", "3 000", "0", "write them without spaces"),
    ):
        add(what, amount, minutes)
        expect(refused).to_contain_text(said)
    assert refused.evaluate("one => one.nextElementSibling.matches('.new')")  # not under the waveforms
    picture(page, shots, "timeline_refused")
    expect(page.locator(".ecl-timeline ol li")).to_have_count(0)
    add("ecmo.speed_rpm", "3425,5", "7,5")
    expect(page.locator(".ecl-timeline ol")).to_contain_text(f"3425.5 rpm, {text('timeline_over')} 7.5")
    expect(refused).to_have_count(0)
    add("ecmo.speed_rpm", "")
    expect(refused).to_have_text(text("timeline_no_amount"))
    page.wait_for_function(COURSE)
    page.wait_for_timeout(500)
    expect(refused).to_have_text(text("timeline_no_amount"))


def test_an_alarm_is_seen_over_its_warning(open_page, served, shots):
    slower = {"at_min": 60, "set": {"ecmo.speed_rpm": 1000}, "ramp_min": 120}
    case = with_event(PRESETS["paper"].case(), slower)
    page = open_page(url=f"{served.url}/#{link_of(PageState(case))}")
    page.get_by_role("button", name=text("timeline_open")).click()
    page.wait_for_function(COURSE)
    lane = page.locator(".ecl-timeline .lane svg").first
    lane.scroll_into_view_if_needed()
    box = lane.bounding_box()
    at = [box["x"] + 0.7 * box["width"], box["y"] + 2]
    kinds = "rects => rects.map(rect => rect.className.baseVal)"
    assert lane.locator("rect").evaluate_all(kinds) == ["warning", "alarm"]
    assert page.evaluate("([x, y]) => document.elementFromPoint(x, y).className.baseVal", at) == "alarm"
    picture(page, shots, "timeline_alarm")


def test_the_cursor_stays_within_a_course_that_stopped(open_page, served, shots):
    acid = {"solutes": {"bicarbonate_mmol_l": 24, "acid_generation_mmol_h": 500}}
    case = read_mapping(PRESETS["healthy"].case().as_mapping() | acid).case
    page = open_page(url=f"{served.url}/#{link_of(PageState(case))}")
    page.get_by_role("button", name=text("timeline_open")).click()
    page.wait_for_function(COURSE)
    expect(page.locator(".ecl-timeline .refused")).to_contain_text("stopped at 01:48")
    box = page.locator(".ecl-timeline svg").first.bounding_box()
    page.mouse.click(box["x"] + 0.8 * box["width"], box["y"] + 10)
    wait_for(page, "beat.minute > 100 && beat.minute < 109")
    expect(page.locator(".ecl-timeline .shown")).to_contain_text(text("timeline_ended"))
    expect(page.locator(".ecl-timeline .shown")).to_contain_text("01:48")
    expect(page.locator(".ecl-knobs .later")).to_contain_text("01:48")
    picture(page, shots, "timeline_stopped")
    page.locator(".ecl-timeline .play").click()
    wait_for(page, "beat.minute > 0 && beat.minute < 60")


def test_what_is_pinned_saved_and_compared_at_a_later_minute_is_of_that_minute(open_page, served, shots):
    case = with_event(PRESETS["paper"].case(), {"at_min": 60, "set": {"ecmo.speed_rpm": 2000}})
    page = open_page(url=f"{served.url}/#{link_of(PageState(case))}")
    page.get_by_role("button", name=text("timeline_open")).click()
    page.wait_for_function(COURSE)
    box = page.locator(".ecl-timeline svg").first.bounding_box()
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 10)
    wait_for(page, "beat.minute > 170")
    slow = beat(page)["outputs"]["MAP"]
    page.keyboard.press("Alt+p")
    page.keyboard.press("Alt+s")
    page.wait_for_function("eclsim.bus.last('saved')?.length === 1")
    expect(page.locator('.ecl-keys [data-key="MAP"]')).to_contain_text("Δ 0")
    for view in ("ramp", "schemes"):
        show(page, view)
        expect(page.locator(".q-tab-panel:visible .ecl-caution")).to_contain_text(["00:00", "03:0"])
        picture(page, shots, f"later_{view}")
    show(page, "compare")
    table = page.locator(".ecl-compare table")
    for k in range(3):
        expect(table.locator("tr").nth(1).locator("td").nth(k)).to_contain_text("at 03:0")
        expect(table.locator("tr", has_text="MAP").locator("td").nth(k)).to_have_text(f"{slow:.1f}")
    picture(page, shots, "later_compare")
    page.get_by_role("tab", name=text("monitor"), exact=True).click()
    page.get_by_role("button", name=text("timeline_close")).click()
    wait_for(page, f"beat.minute === 0 && beat.outputs.MAP > {slow} + 5")
    show(page, "compare")
    rows = table.locator("tr.knob", has_text="rpm").locator("td")
    expect(rows).to_have_text(["3425", "2000", "2000"])
    page.get_by_role("button", name=f"{text('compare_show')} 1").click()
    wait_for(page, f"beat.minute > 170 && Math.abs(beat.outputs.MAP - {slow}) < 0.01")
    page.reload()
    page.wait_for_function("eclsim.bus.last('pinned') && eclsim.bus.last('saved')?.length === 1")
    kept = page.evaluate("[eclsim.bus.last('pinned'), eclsim.bus.last('saved')[0]].map((b) => b.outputs.MAP)")
    assert kept == pytest.approx([slow, slow], abs=0.01)


WINDOWS = {"low": (1280, 800), "high": (1280, 1400), "tablet": (768, 1024)}
IN_SIGHT = """() => {
  const box = (name) => document.querySelector(name)?.getBoundingClientRect();
  const [screen, form, notice] = ['.ecl-monitor .screen', '.ecl-timeline .new', '.ecl-notice'].map(box);
  const above = ['.ecl-header', '.ecl-strip'].map((name) => box(name)?.bottom ?? 0);
  const edge = Math.max(...above, innerWidth > 1210 ? box('.ecl-views').top : 0);
  const faults = [];
  if (screen.top < edge - 1) faults.push(`waveforms at ${screen.top}, hidden above ${edge}`);
  if (screen.height < 150) faults.push(`waveforms ${screen.height} px high`);
  if (form.top < screen.bottom) faults.push(`event at ${form.top}, under waveforms until ${screen.bottom}`);
  if (form.bottom > notice.top + 1) faults.push(`event until ${form.bottom}, below ${notice.top}`);
  return faults;
}"""
"""What of waveforms and the form of an event is out of sight or covered."""


@pytest.mark.parametrize("window", WINDOWS)
def test_an_event_is_chosen_with_the_waveforms_in_sight(open_page, shots, window):
    """On a laptop the open timeline pushed them out of the panel."""
    width, height = WINDOWS[window]
    page = open_page("cardiogenic-shock", viewport={"width": width, "height": height})
    page.get_by_role("button", name=text("timeline_open")).click()
    page.wait_for_function(COURSE)
    page.locator(".ecl-timeline .new").evaluate("form => form.scrollIntoView({ block: 'end' })")
    picture(page, shots, f"timeline_in_sight_{window}")
    eventually(lambda: page.evaluate(IN_SIGHT) == [] or pytest.fail(str(page.evaluate(IN_SIGHT))))


COVERED = """() => {
  const focused = document.activeElement, { left, right, top, bottom } = focused.getBoundingClientRect();
  const shown = [0.1, 0.5, 0.9].map((share) => {
    const at = document.elementFromPoint((left + right) / 2, top + share * (bottom - top));
    return !!at && (focused.contains(at) || at.contains(focused));
  });
  return shown.every(Boolean) ? '' : `${focused.className || focused.tagName} at ${top} to ${bottom}`;
}"""
"""What has the focus, if a part of it is covered or out of the window."""


@pytest.mark.parametrize("window", [(390, 844), (700, 475), (1280, 720), (1400, 950)], ids=str)
def test_what_has_the_focus_in_the_open_timeline_is_not_covered(open_page, shots, window):
    """On a phone the waveforms lay over the chart and over the form of events."""
    page = open_page("paper", viewport=dict(zip(("width", "height"), window, strict=True)))
    page.get_by_role("button", name=text("timeline_open")).click()
    page.wait_for_function(COURSE)
    timeline = page.locator(".ecl-timeline")
    assert page.evaluate(COVERED) == ""  # the button that opened it
    for key, last in (("Tab", ".new button"), ("Shift+Tab", ".toggle")):
        while not timeline.locator(last).evaluate("one => one === document.activeElement"):
            page.keyboard.press(key)
            eventually(lambda: page.evaluate(COVERED) == "" or pytest.fail(page.evaluate(COVERED)))
            if page.locator(".ecl-timeline .chart:focus").count():
                picture(page, shots, f"timeline_focus_{window[0]}_{key.lower()}")


def test_a_length_that_is_already_chosen_is_not_waited_for(open_page):
    """No course came, and "computing the course" stayed for ever."""
    page = open_page("healthy")
    page.get_by_role("button", name=text("timeline_open")).click()
    page.wait_for_function(COURSE)
    page.get_by_label(text("timeline_length")).dispatch_event("change")
    expect(page.locator(".ecl-timeline .shown")).to_have_text(text("timeline_at", time="00:00"))
    page.wait_for_timeout(300)
    expect(page.locator(".ecl-timeline .shown")).to_have_text(text("timeline_at", time="00:00"))
