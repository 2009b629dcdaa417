"""What the monitor draws: a steady beat looks steady, on scales that do not follow the pulse pressure."""

from __future__ import annotations

import pytest

from eclsim.app.knobs import turn
from eclsim.app.state import PageState, link_of
from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from page_in_browser import LAPTOP, beat, eventually, expect, picture, show

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser

TOP_OF_EVERY_BEAT = """() => {
  const canvas = document.querySelector('.ecl-monitor canvas');
  const traces = [...document.querySelectorAll('.ecl-monitor .trace')];
  const [low, high] = traces[0].dataset.scale.split(',').map(Number);
  const ratio = canvas.width / canvas.getBoundingClientRect().width;
  const tall = canvas.height / ratio / traces.length;
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, Math.floor(tall * ratio));
  const left = 40, width = canvas.width / ratio - left;
  const period = eclsim.bus.last('beat').period;
  const edge = (x) => {  // the upper edge of the red line in a column, to a fraction of a pixel
    let covered = 0;
    for (let y = 0; y < Math.floor(tall * ratio); y++) {
      const [r, , b, a] = data.slice(4 * (y * canvas.width + x), 4 * (y * canvas.width + x) + 4);
      if (r < 200 || b > 160) { covered = 0; continue; }
      covered += a / 255;
      if (a > 250) return (y + 1 - covered) / ratio;
    }
    return Infinity;
  };
  const tops = [];
  for (let k = 0; (k + 1) * period <= 6; k++) {
    const at = (t) => Math.round((left + (t / 6) * width) * ratio);
    const [from, to] = [at(k * period), at((k + 1) * period)];
    let top = Infinity;
    for (let x = from; x < to; x++) top = Math.min(top, edge(x));
    tops.push(top);
  }
  const expected = (v) => tall - 7 - ((v - low) / (high - low)) * (tall - 16);
  return { tops, scale: [low, high], systolic: expected(eclsim.bus.last('beat').outputs.SP) };
}"""


def link(served, preset: str, **turns: object) -> str:
    case = PRESETS[preset].case()
    for key, value in turns.items():
        case = turn(case, key.replace("__", "."), value)
    return f"{served.url}/#{link_of(PageState(case))}"


@pytest.mark.parametrize(("viewport", "ratio"), [(LAPTOP, 1), ({"width": 640, "height": 800}, 2)])
def test_every_beat_of_a_steady_beat_has_the_same_peak(open_page, served, shots, viewport, ratio):
    fast = link(served, "healthy", patient__heart_rate_bpm=200)
    page = open_page(url=fast, viewport=viewport, device_scale_factor=ratio)

    def peaks_are_level() -> list[float]:
        result = page.evaluate(TOP_OF_EVERY_BEAT)
        assert len(result["tops"]) >= 19
        assert max(result["tops"]) - min(result["tops"]) < 1.0
        assert min(result["tops"]) == pytest.approx(result["systolic"] - 0.9, abs=1.0)  # half a line above
        return result["scale"]

    fixed = eventually(peaks_are_level)
    button = page.get_by_role("button", name=text("autoscale"))
    button.click()
    expect(button).to_have_attribute("aria-pressed", "true")
    stretched = eventually(peaks_are_level)
    assert stretched != fixed
    picture(page, shots, f"fast_heart_{ratio}")


def test_the_scale_follows_the_level_not_the_pulse_pressure(open_page, served):
    def pressure(page):
        return expect(page.locator('.ecl-monitor [data-wave="Pao"]'))

    weak = open_page(url=link(served, "paper", parameters__Emaxlv=0.5))
    result = beat(weak)["outputs"]
    assert result["SP"] - result["DP"] < 5.0
    pressure(weak).to_have_attribute("data-scale", "0,150")
    weak.get_by_role("button", name=text("autoscale")).click()
    pressure(weak).not_to_have_attribute("data-scale", "0,150")
    expect(weak.get_by_role("button", name=text("autoscale"))).to_have_attribute("aria-pressed", "true")
    strong = open_page("healthy")
    result = beat(strong)["outputs"]
    assert result["SP"] - result["DP"] > 30.0
    pressure(strong).to_have_attribute("data-scale", "0,150")


def test_a_monitor_that_is_not_seen_or_paused_asks_for_no_frames(contexts, served):
    """In every other view it asked for 60 a second and drew none: 4 % of a processor for each tab."""
    page = contexts(viewport=LAPTOP).new_page()
    page.add_init_script(
        "window.frames_asked = 0; const ask = requestAnimationFrame;"
        "window.requestAnimationFrame = (draw) => { window.frames_asked += 1; return ask(draw); };"
    )
    page.goto(served.url)
    page.wait_for_function("window.eclsim?.bus.last('beat')")
    sweep = page.get_by_role("button", name=text("sweep_pause"))

    def frames() -> int:
        page.wait_for_timeout(500)
        before = page.evaluate("frames_asked")
        page.wait_for_timeout(500)
        return page.evaluate("frames_asked") - before

    assert frames() == 0, "paused, as the reader prefers"
    sweep.click()
    assert frames() > 3
    show(page, "outputs")
    assert frames() == 0
    show(page, "monitor")
    assert frames() > 3
    page.close()
