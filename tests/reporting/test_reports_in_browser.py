"""The reports in a real browser: they ask nothing of the network, fit on A4 and can be read there."""

import re
from collections.abc import Iterator

import pytest

from eclsim.crrt_study.files import write_study
from eclsim.paper.comparison import printed_number, statement
from eclsim.paper.crrt import CrrtComparison, UnprintedValues, table_rows
from eclsim.paper.report import write_reproduction
from eclsim.paper.reproduction import Reproduction, items_of
from system_browser import system_browser

A4_TEXT_WIDTH_PX = 680  # 180 mm
SMALLEST_TEXT_PX = 6.0


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    yield from system_browser()


@pytest.fixture(scope="module")
def reproduction(hostile_study, tmp_path_factory):
    """A comparison of one part, with rows of every verdict."""
    unstated = UnprintedValues(3247.0, 118.0, 0.4, 6.1)
    number = printed_number("3.3, 3425 rpm", "arterial pressure", "mmHg", 70.3, 71.0, decimals=1,
                            explained=70.3, reason="<blood>")  # fmt: skip
    rows = (
        number,
        printed_number("4, Wu A (g)", "access", "mmHg", 175.0, 119.0, reason="others", other_data=True),
        statement("3.3", "it grows", False, "it does not"),
        statement("4", "it holds", True),
    )
    part = CrrtComparison(rows, unstated, hostile_study, hostile_study)
    result = Reproduction(part, None, None, None, tuple(table_rows()))
    folder = tmp_path_factory.mktemp("paper") / "out"
    written = write_reproduction(result, folder)
    assert {path.name for path in written} == {
        "index.html", "reproduction.csv", "reproduction.json",
        *(name for item in items_of(()) for name in item.files),
    }  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def pages(hostile_study, reproduction, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "study"
    write_study(hostile_study, folder)
    return {"study": folder / "report.html", "reproduction": reproduction / "index.html"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["study", "reproduction"])
def test_a_report_asks_for_itself_alone_and_prints_on_a4(browser, pages, name):
    page = browser.new_page(viewport={"width": A4_TEXT_WIDTH_PX, "height": 1000})
    requests, said = [], []
    page.on("request", lambda request: requests.append(request.url))
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    address = pages[name].as_uri()
    page.goto(address)
    page.emulate_media(media="print")
    assert requests == [address]
    assert said == []
    assert page.evaluate("document.documentElement.scrollWidth") <= A4_TEXT_WIDTH_PX
    heights = page.evaluate(
        "[...document.querySelectorAll('svg text')].map(e => e.getBoundingClientRect())"
        ".filter(r => r.width > r.height).map(r => r.height)"
    )
    assert len(heights) > 100
    assert min(heights) >= SMALLEST_TEXT_PX
    printed = page.pdf(format="A4", prefer_css_page_size=True)
    sizes = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", printed)
    assert len(sizes) >= 3
    assert all((round(float(w)), round(float(h))) == (595, 842) for w, h in sizes)
    page.close()


@pytest.mark.slow
def test_links_of_the_comparison_lead_somewhere(pages):
    folder = pages["reproduction"].parent
    source = pages["reproduction"].read_text(encoding="utf-8")
    links = re.findall(r'<a href="([^"]+)"', source)
    assert len(links) > 2 * len(items_of(()))
    for link in links:
        if link.startswith("#"):
            assert f'id="{link[1:]}"' in source
        else:
            assert (folder / link).is_file()


@pytest.mark.slow
def test_the_comparison_shows_bad_rows_with_their_reasons(pages):
    source = pages["reproduction"].read_text(encoding="utf-8")
    assert "differs: it does not" in source
    assert "explained: &lt;blood&gt;" in source
    assert "other data: others" in source
    assert "1 of 4 printed numbers and statements come out as printed" in source
