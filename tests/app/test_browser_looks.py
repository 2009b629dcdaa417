"""Whether the page can be read: letters, labels, curves, units, a dark preference, names for screen readers.

The last is checked by axe-core where it is there: from the Python package axe_playwright_python, or the file
that ECLSIM_AXE names.
"""

from __future__ import annotations

import json
import os
import re
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import pytest

from eclsim._version import __version__
from eclsim.app.knobs import connect
from eclsim.app.state import PageState, link_of
from eclsim.app.texts import text
from eclsim.cases import read_mapping
from eclsim.cases.presets import PRESETS
from page_in_browser import LAPTOP, PHONE, choose, eventually, expect, picture, show, turn, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser

SMALLEST_LETTER_PX = 11.0
FAULTS_OF_THE_SCHEMATIC = """(smallest) => {
  const svg = document.querySelector('.ecl-schematic svg');
  const scale = svg.getScreenCTM().a;
  const faults = [];
  const box = (e, shrink = 0) => {
    const { left, right, top, bottom } = e.getBoundingClientRect();
    const by = shrink * (bottom - top);
    return { left: left + 1, right: right - 1, top: top + by, bottom: bottom - by };
  };
  const meet = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
  const within = (a, b) => a.left >= b.left && a.right <= b.right && a.top >= b.top && a.bottom <= b.bottom;
  const texts = [...svg.querySelectorAll('text')].filter((t) => t.textContent.trim());
  for (const t of [...texts, ...svg.querySelectorAll('tspan')]) {
    const size = parseFloat(getComputedStyle(t).fontSize) * scale;
    if (size < smallest - 1e-6) faults.push(`${t.textContent}: ${size.toFixed(1)} px`);
  }
  const boxes = [...svg.querySelectorAll('.box')].map((g) => [g, box(g.querySelector('rect'))]);
  for (const [g, frame] of boxes)
    for (const t of g.querySelectorAll('text'))
      if (!within(box(t, 0.15), frame)) faults.push(`${t.textContent}: not in its box`);
  const labels = texts.filter((t) => !t.closest('.box, .handle')).map((t) => [t, box(t, 0.2)]);
  const onScreen = svg.getScreenCTM();
  const pieces = [...svg.querySelectorAll('polyline.wire')].flatMap((line) => {
    const ends = [...line.points].map((point) => point.matrixTransform(onScreen));
    return ends.slice(1).map((b, k) => ({
      left: Math.min(ends[k].x, b.x), right: Math.max(ends[k].x, b.x),
      top: Math.min(ends[k].y, b.y), bottom: Math.max(ends[k].y, b.y),
    }));
  });
  for (const [t, own] of labels) {
    for (const rect of svg.querySelectorAll('.frame rect')) {
      const frame = box(rect);
      if (meet(own, frame) && !within(own, frame)) faults.push(`${t.textContent}: struck through by a frame`);
    }
    for (const [g, frame] of boxes) {
      if (meet(own, frame)) faults.push(`${t.textContent}: over the box ${g.textContent}`);
    }
    if (pieces.some((piece) => meet(own, piece))) faults.push(`${t.textContent}: struck through by a line`);
    for (const [other, its] of labels) {
      if (other !== t && meet(own, its)) faults.push(`${t.textContent}: over ${other.textContent}`);
    }
  }
  const pane = document.querySelector('.ecl-schematic .sheet').getBoundingClientRect();
  const drawn = [...svg.querySelectorAll('.frame rect')].map((r) => r.getBoundingClientRect());
  const [top, bottom] = [Math.min(...drawn.map((r) => r.top)), Math.max(...drawn.map((r) => r.bottom))];
  const filled = (bottom - top) / pane.height;
  return { faults, filled };
}"""
CONNECTED = [
    ("paper", ()), ("paper", ("lvad",)), ("healthy", ()), ("healthy", ("crrt",)), ("lvad", ()),
    ("vv-ecmo", ()), ("healthy", ("two pumps",)),
]  # fmt: skip
"""Further circuits are looked at in the two tests below."""
TWO_PUMPS = {
    "left": {"pump": "HM3", "speed_rpm": 4900, "inlet_site": "lv", "outlet_site": "ao"},
    "right": {"pump": "HVAD", "speed_rpm": 1900, "inlet_site": "ra", "outlet_site": "pas"},
}


@pytest.mark.parametrize(("preset", "devices"), CONNECTED)
def test_the_schematic_can_be_read(open_page, served, shots, preset, devices):
    case = PRESETS[preset].case()
    for device in devices:
        two = device == "two pumps"
        case = read_mapping(case.as_mapping() | {"lvad": TWO_PUMPS}).case if two else connect(case, device)
    page = open_page(url=f"{served.url}/#{link_of(PageState(case))}")
    page.locator(".ecl-schematic .box").first.wait_for()
    picture(page, shots, "_".join(("schematic", preset, *devices)))
    schematic_is_readable(page)


def schematic_is_readable(page):
    if (larger := page.get_by_role("button", name=text("schematic_larger"))).count():
        larger.click()

    def readable() -> None:
        result = page.evaluate(FAULTS_OF_THE_SCHEMATIC, SMALLEST_LETTER_PX)
        assert result["faults"] == []
        assert result["filled"] > 0.65

    eventually(readable)


IS_WHOLE = """() => {
  const pane = document.querySelector('.ecl-schematic .sheet').getBoundingClientRect();
  const frames = [...document.querySelectorAll('.ecl-schematic .frame rect')];
  return frames.map((r) => r.getBoundingClientRect()).every((r) => r.top >= pane.top &&
    r.bottom <= pane.bottom && r.left >= pane.left && r.right <= pane.right);
}"""


def test_a_circuit_is_shown_as_a_whole_while_it_can_be_read_and_larger_where_asked(open_page, served, shots):
    case = connect(connect(PRESETS["paper"].case(), "gas"), "physiology")
    page = open_page(url=f"{served.url}/#{link_of(PageState(case))}")
    page.get_by_role("button", name=text("schematic_larger")).wait_for()
    eventually(lambda: page.evaluate(IS_WHOLE) or pytest.fail("a part of the circuit is out of sight"))
    faults = page.evaluate(FAULTS_OF_THE_SCHEMATIC, 8.5)
    assert faults["faults"] == []
    picture(page, shots, "circuit_whole")
    schematic_is_readable(page)


def test_a_line_to_a_balloon_can_be_read_and_has_no_flow(open_page, served):
    """Its mean is 0 in every steady beat, whatever the balloon does."""
    case = connect(PRESETS["healthy"].case(), "iabp")
    page = open_page(url=f"{served.url}/#{link_of(PageState(case))}")
    page.locator(".ecl-schematic .box").first.wait_for()
    words = page.locator(".ecl-schematic svg").text_content()
    assert "IABP" in words
    assert "0.00" not in words
    schematic_is_readable(page)


def ramp_of_the_paper(open_page, width):
    page = open_page("paper", viewport={"width": width, "height": 900})
    show(page, "ramp")
    page.wait_for_function("eclsim.bus.last('ramp')?.speeds.length >= 15")
    return page


def names_of_limits_lie_on_no_curve(page, without_room):
    page.locator(".ecl-chart:visible .annotation-text").nth(3).wait_for()
    struck = """() => {
      const chart = [...document.querySelectorAll('.ecl-chart')].find((e) => e.clientHeight && e.data);
      const names = [...chart.querySelectorAll('.annotation-text')].slice(1)
        .map((e) => [e, e.getBoundingClientRect()]);
      const found = [];
      for (const line of chart.querySelectorAll('.xy3 path.js-line')) {
        const onScreen = line.getScreenCTM();
        for (let at = 0; at <= line.getTotalLength(); at += 1) {
          const { x, y } = line.getPointAtLength(at).matrixTransform(onScreen);
          for (const [e, r] of names)
            if (x > r.left + 1 && x < r.right - 1 && y > r.top + 3 && y < r.bottom - 3)
              found.push(e.textContent);
        }
      }
      return [names.length, [...new Set(found)]];
    }"""

    def free() -> None:
        count, found = page.evaluate(struck)
        assert count >= 4
        assert len(found) <= without_room, found

    eventually(free)


@pytest.mark.parametrize(("width", "without_room"), [(1920, 0), (390, 1)])
def test_names_of_limits_lie_on_no_curve_of_the_ramp(open_page, width, without_room, shots):
    """On a phone one of them may have no free place."""
    page = ramp_of_the_paper(open_page, width)
    names_of_limits_lie_on_no_curve(page, without_room)
    picture(page, shots, f"ramp_names_{width}")


def test_a_circuit_that_does_not_fit_its_pane_says_so(open_page, served, shots):
    case = connect(connect(PRESETS["paper"].case(), "lvad"), "iabp")
    page = open_page(url=f"{served.url}/#{link_of(PageState(connect(case, 'physiology')))}")
    below = page.locator(".ecl-schematic .below")
    expect(below).to_contain_text(text("schematic_below"))
    picture(page, shots, "circuit_below")
    page.locator(".ecl-schematic .sheet").evaluate("sheet => sheet.scrollTo(sheet.scrollWidth, 1e4)")
    expect(below).to_have_count(0)
    page.locator(".ecl-schematic .sheet").evaluate("sheet => sheet.scrollTo(0, 0)")
    expect(below).to_have_count(1)
    page.get_by_role("button", name=text("schematic_whole")).click()
    expect(below).to_have_count(0)
    assert page.evaluate(IS_WHOLE)
    choose(page, PRESETS["healthy"].name)
    page.wait_for_function("!('Qecpump' in eclsim.bus.last('beat').means)")
    expect(below).to_have_count(0)


def test_curves_of_the_ramp_differ_in_colour_and_dash_and_limits_have_names_beside_them(open_page, shots):
    page = ramp_of_the_paper(open_page, 1280)
    expect(page.locator(".ecl-chart:visible .scatterlayer .trace")).to_have_count(9)
    chart = "[...document.querySelectorAll('.ecl-chart')].find((e) => e.clientHeight && e.data)"
    strokes = page.evaluate(
        f"{chart}.data.filter((t) => t.showlegend !== false).map((t) => [t.line.color, t.line.dash])"
    )
    assert len(strokes) == 9
    assert len({colour for colour, _ in strokes}) == len({dash for _, dash in strokes}) == len(strokes)
    lines = page.evaluate(f"{chart}.layout.shapes.filter((s) => s.yref === 'y3').map((s) => s.y0)")
    labelled = page.evaluate(f"{chart}.layout.annotations.filter((a) => a.yref === 'y3').map((a) => a.y)")
    assert sorted(lines) == sorted(labelled)
    assert 350 in lines
    names_of_limits_lie_on_no_curve(page, without_room=0)
    picture(page, shots, "ramp_labelled")


def test_charts_keep_their_size_while_nobody_touches_them(open_page, shots):
    """In three windows at once, which are watched together."""
    pages = {w: open_page("paper", viewport={"width": w, "height": 768}) for w in (1024, 820, 1280)}
    for page in pages.values():
        page.keyboard.press("Alt+s")
    for view in ("ramp", "loops", "compare"):
        charts = {}
        for width, page in pages.items():
            show(page, view)
            charts[width] = page.locator(".ecl-chart:visible")
            charts[width].locator(".scatterlayer .trace").first.wait_for()
        page.wait_for_timeout(700)
        before = {width: chart.bounding_box() for width, chart in charts.items()}
        page.wait_for_timeout(1500)
        assert {width: chart.bounding_box() for width, chart in charts.items()} == before
        for width, page in pages.items():
            height = before[width]["height"]
            assert 220 < height < 700, width
            drawn = charts[width].locator(".main-svg").first.bounding_box()
            assert abs(drawn["height"] - height) < 4, width
            picture(page, shots, f"chart_{view}_{width}")


def test_on_a_phone_nothing_overflows_and_schemes_have_units(open_page, shots):
    page = open_page("paper", viewport=PHONE)
    knobs, circuit = (page.locator(f".ecl-{part}").bounding_box() for part in ("left", "middle"))
    assert circuit["y"] < knobs["y"], "the circuit is not below all knobs"
    show(page, "schemes")
    page.wait_for_function("eclsim.bus.last('schemes')?.cells.length === 9")
    page.locator(".ecl-schemes button").first.wait_for()
    expect(page.locator(".ecl-schemes .values").first).to_have_text(re.compile("(mmHg.*){3}"))

    def nothing_overflows() -> None:
        wide = page.evaluate(
            """() => [...document.querySelectorAll('.ecl-schemes button')].flatMap((b) =>
            [...b.querySelectorAll('span')].filter((s) => s.getBoundingClientRect().right >
            b.getBoundingClientRect().right).map((s) => s.textContent))"""
        )
        assert wide == []
        assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]

    eventually(nothing_overflows)
    picture(page, shots, "schemes_phone")


SIDEWAYS = """() => [...document.querySelectorAll('.ecl-views, .ecl-views *')]
    .filter((e) => e.clientWidth && /auto|scroll/.test(getComputedStyle(e).overflowX))
    .filter((e) => e.scrollWidth > e.clientWidth).map((e) => e.className)"""


def test_on_a_phone_no_table_scrolls_sideways(open_page, served, shots):
    case = connect(PRESETS["paper"].case(), "gas")
    page = open_page(url=f"{served.url}/#{link_of(PageState(case))}", viewport=PHONE)
    for key in "pssssss":
        page.keyboard.press(f"Alt+{key}")
    page.wait_for_function("eclsim.bus.last('saved')?.length === 6")
    for view, table in (("gases", ".ecl-gases"), ("outputs", ".ecl-outputs"), ("compare", ".ecl-compare")):
        show(page, view)
        expect(page.locator(f"{table} tbody tr").nth(5)).to_be_visible()
        page.wait_for_function(f"({SIDEWAYS})().length === 0")
        picture(page, shots, f"{view}_narrow")
    lines = "e => e.getBoundingClientRect().height / parseFloat(getComputedStyle(e).fontSize)"
    show(page, "outputs")
    unit = page.locator(".ecl-outputs tr", has_text="SP systolic").locator("small.under")
    expect(unit).to_have_text("mmHg")
    assert unit.evaluate(lines) < 2, "a unit stands in one line"
    show(page, "compare")
    cells = page.locator(".ecl-compare tr", has_text="MAP").locator("td")
    whose = cells.evaluate_all("all => all.map((td) => getComputedStyle(td, '::before').content)")
    assert whose == [f'"{name}"' for name in ("Now", "pinned", *"123456")]


MEASURED = """() => {
  const beat = eclsim.bus.last('beat');
  const measured = { SP: 118, DP: 62, CO: 6.5, PF: 4.4, MPAP: 32, right_atrial_pressure: 11 };
  eclsim.bus.publish('beat', { ...beat, measured, measured_before: false }); }"""
CUT = "all => all.filter((one) => one.scrollWidth > one.clientWidth).map((one) => one.textContent)"


def test_a_measured_value_is_whole_in_its_tile(open_page, shots):
    """Of 118/62 mmHg the tile showed 118/6."""
    page = open_page("vv-ecmo")
    page.evaluate(MEASURED)
    expect(page.locator('.ecl-keys [data-key="MAP"]')).to_contain_text("118/62")
    picture(page, shots, "measured_tiles")
    assert page.locator(".ecl-keys .more em").evaluate_all(CUT) == []


def test_saved_states_have_names_and_the_table_scrolls(open_page, shots):
    page = open_page("paper")
    for number in range(1, 5):
        page.keyboard.press("Alt+s")
        page.wait_for_function(f"eclsim.bus.last('saved')?.length === {number}")
    show(page, "compare")
    name = page.get_by_label(text("compare_name").format(number=1))
    name.fill("before the CRRT")
    name.press("Enter")
    turn(page, "ecmo.speed_rpm", "2500")
    wait_for(page, "beat.outputs.PF < 2.7")
    expect(name).to_have_value("before the CRRT")
    expect(page.get_by_label(text("compare_name").format(number=2))).to_have_value("2")
    table = page.locator(".ecl-compare .ecl-table")
    expect(table).to_have_css("overflow-x", "auto")
    last = page.get_by_role("button", name=f"{text('compare_remove')} 4")
    last.scroll_into_view_if_needed()

    def reached() -> None:
        edge, end = table.bounding_box(), last.bounding_box()
        assert end["x"] + end["width"] <= edge["x"] + edge["width"]

    eventually(reached)
    picture(page, shots, "compare_named")


def test_a_dark_preference_is_followed(open_page, shots):
    page = open_page("paper", color_scheme="dark")
    brightness = """(selector) => getComputedStyle(document.querySelector(selector)).backgroundColor
      .match(/[0-9]+/g).slice(0, 3).reduce((sum, v) => sum + Number(v), 0) / 3"""

    def dark() -> None:
        for selector in ("body", ".ecl-header", ".ecl-limits", ".ecl-middle", ".ecl-knobs section"):
            assert page.evaluate(brightness, selector) < 60

    page.locator(".ecl-knobs section").first.wait_for()
    eventually(dark)
    show(page, "loops")
    page.locator(".ecl-chart:visible .scatterlayer .trace").first.wait_for()
    chart = "[...document.querySelectorAll('.ecl-chart')].find((e) => e.clientHeight && e.data)"
    assert page.evaluate(f"{chart}.layout.paper_bgcolor") == "#1b232b"
    picture(page, shots, "dark")


PALE_LETTERS = """() => {
  const bright = (colour) => {
    const [r, g, b, opacity = 1] = colour.match(/[0-9.]+/g).map(Number);
    return opacity > 0.5 && (r + g + b) / 3 > 150;
  };
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const found = [];
  while (texts.nextNode()) {
    const { parentElement: element, textContent } = texts.currentNode;
    const own = textContent.trim();
    const isDrawn = own && element.checkVisibility({ visibilityProperty: true });
    if (isDrawn && !element.closest('svg, .numbers, .q-notifications, i[style]')
        && bright(getComputedStyle(element).color)) found.push(own);
  }
  return found;
}"""
"""Nearly white texts, as on the dark screen, but those on coloured ground and the inverted monitor."""


@pytest.mark.parametrize("view", ["outputs", "gases", "loops", "identify", "compare"])
def test_a_dark_screen_is_printed_in_dark_letters(open_page, served, shots, view):
    """Tables were white on white paper."""
    case = connect(PRESETS["paper"].case(), "gas")
    page = open_page(url=f"{served.url}/#{link_of(PageState(case))}", color_scheme="dark")
    if view == "compare":
        page.keyboard.press("Alt+s")
        page.wait_for_function("eclsim.bus.last('saved')?.length === 1")
    show(page, view)
    shown = {"loops": ".ecl-chart", "identify": ".ecl-identify"}.get(view, f".ecl-{view} td")
    page.locator(f"{shown}:visible").first.wait_for()
    page.emulate_media(media="print", color_scheme="dark")
    eventually(lambda: page.evaluate(PALE_LETTERS) == [] or pytest.fail(str(page.evaluate(PALE_LETTERS)[:9])))
    assert page.evaluate("getComputedStyle(document.documentElement).colorScheme") == "light"
    picture(page, shots, f"paper_from_dark_{view}")


def axe() -> Path:
    """The script of axe-core."""
    named = os.environ.get("ECLSIM_AXE")
    if named:
        return Path(named)
    package = find_spec("axe_playwright_python")
    if package is None or package.origin is None:
        pytest.skip("axe-core is not there: install axe_playwright_python, or name axe.min.js in ECLSIM_AXE")
    return next(Path(package.origin).parent.rglob("axe.min.js"))


DRAWN = {
    "monitor": ".ecl-monitor .trace", "loops": ".ecl-chart .scatterlayer .trace",
    "ramp": ".ecl-chart .scatterlayer .trace", "schemes": ".ecl-schemes button", "outputs": ".ecl-outputs td",
    "identify": ".ecl-identify input", "compare": ".ecl-compare td",
}  # fmt: skip
"""What is seen of each view when it is there."""
RULES = {
    "light": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"],
    "dark": ["color-contrast", "link-in-text-block"],
}
"""All rules; in the dark, where nothing but colours is different, those of colours."""


@pytest.mark.parametrize("scheme", RULES)
def test_axe_finds_nothing(open_page, scheme):
    script = axe()
    page = open_page("paper", color_scheme=scheme)
    page.keyboard.press("Alt+s")
    page.wait_for_function("eclsim.bus.last('saved')?.length === 1")
    page.add_script_tag(path=script)
    options = {"runOnly": RULES[scheme], "rules": {"region": {"enabled": False}}}
    ask = f"axe.run({{ exclude: [['.q-loading-bar']] }}, {json.dumps(options)})"
    message = (
        f"async () => (await {ask}).violations.map((v) => `${{v.id}}: ${{v.nodes.map((n) => n.target)}}`)"
    )
    still = "!document.querySelector('[class*=-enter-active], [class*=-leave-active]')"

    def nothing() -> None:
        page.wait_for_function(still)  # what fades in or out has no contrast of its own
        assert page.evaluate(message) == []

    for view, drawn in DRAWN.items():
        show(page, view)
        page.locator(f"{drawn}:visible").first.wait_for()
        eventually(nothing)
    for name in ("export", "open", "help"):
        page.get_by_role("button", name=text(name), exact=True).click()
        opened = page.locator(".q-menu, .q-dialog__inner").first
        opened.wait_for()
        eventually(nothing)
        page.keyboard.press("Escape")
        expect(opened).to_be_hidden()


@pytest.mark.parametrize("viewport", [LAPTOP, PHONE], ids=["laptop", "phone"])
def test_whatever_is_pressed_is_large_enough(open_page, viewport):
    page = open_page("paper", viewport=viewport)
    small = """() => {
      const all = 'button, select, summary, input:not(.q-select__focus-target), [role=tab], [role=slider]';
      const measured = [...document.querySelectorAll(all)].map((e) => [e, e.getBoundingClientRect()]);
      return measured.filter(([, r]) => r.width && r.height && Math.min(r.width, r.height) < 24)
        .map(([e, r]) => `${e.outerHTML.slice(0, 80)}: ${r.width} x ${r.height}`);
    }"""
    page.locator(".ecl-knob").first.wait_for()

    def large() -> None:
        assert page.evaluate(small) == []

    eventually(large)


def test_titles_of_the_ramp_lie_beside_each_other(open_page, served):
    """With gases the panels are low: "Pressure [mmHg]" ran into "Flow [L/min]"."""
    case = connect(PRESETS["paper"].case(), "gas")
    page = open_page(url=f"{served.url}/#{link_of(PageState(case))}")
    show(page, "ramp")
    page.wait_for_function("eclsim.bus.last('ramp')?.speeds.length >= 15")

    def apart() -> None:
        titles = page.locator(
            ".ecl-fill .g-ytitle text, .ecl-fill .g-y2title text, .ecl-fill .g-y3title text"
        )
        boxes = sorted((one.bounding_box() for one in titles.all()), key=lambda box: box["y"])
        assert len(boxes) == 3
        for above, below in pairwise(boxes):
            assert above["y"] + above["height"] < below["y"]

    eventually(apart)


def test_on_paper_all_knobs_limits_and_doubts_are_there(open_page, served):
    """The panel of knobs was cut off at the height of a screen, the list of limits after two of them."""
    case = connect(connect(PRESETS["paper"].case(), "gas"), "lvad")
    page = open_page(url=f"{served.url}/#{link_of(PageState(case))}", viewport={"width": 794, "height": 1123})
    page.emulate_media(media="print")

    def whole() -> None:
        cut = page.evaluate(
            """() => ['.ecl-left', '.ecl-provenance', '.ecl-limits'].filter((name) => {
            const { scrollHeight, clientHeight } = document.querySelector(name);
            return scrollHeight > clientHeight + 1; })"""
        )
        assert cut == []

    eventually(whole)
    expect(page.locator(".ecl-limits .further")).to_be_hidden()
    assert page.evaluate("getComputedStyle(document.querySelector('.ecl-notice')).position") == "static"
    doubt = page.locator(".ecl-limits details p").first
    assert doubt.bounding_box()["height"] > 10
    expect(page.locator(".ecl-printed")).to_contain_text(f"eclsim {__version__} · simulated")
    for pressed in (
        ".ecl-header .q-btn",
        ".ecl-tabs",
        ".ecl-switch",
        ".ecl-monitor button",
        ".ecl-knobs [type=range]",
    ):
        for one in page.locator(pressed).all():
            expect(one).to_be_hidden()
    expect(page.locator(".group-lvad")).to_be_visible()
    expect(page.locator(".group-iabp")).to_be_hidden()  # what is off has no numbers
    order = [
        page.locator(name).bounding_box()["y"]
        for name in (".ecl-notice", ".ecl-keys", ".ecl-left", ".ecl-middle")
    ]
    assert order == sorted(order), "numbers before settings"
    shape = page.evaluate(
        """() => { const canvas = document.querySelector('.ecl-monitor canvas');
        const box = canvas.getBoundingClientRect();
        return [canvas.width / canvas.height, box.width / box.height]; }"""
    )
    assert shape[0] == pytest.approx(shape[1], rel=0.02), "traces as they were drawn, not stretched"
    page.keyboard.press("Alt+2")
    expect(page.locator(".ecl-loops .main-svg").first).to_have_attribute("width", "680")
    page.emulate_media(media="screen")
    expect(page.locator(".ecl-loops .main-svg").first).not_to_have_attribute("width", "680")
