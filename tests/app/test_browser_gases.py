"""Blood gases in the browser: switched on, coloured in the circuit, and no numbers where there are none."""

from __future__ import annotations

import pytest

from eclsim.app.knobs import connect
from eclsim.app.state import FitRemark, PageState, link_of
from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from page_in_browser import PHONE, beat, expect, picture, show, turn, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser


def test_gases_are_switched_on_shown_and_turned(open_page, shots):
    page = open_page()
    show(page, "gases")
    expect(page.locator(".ecl-gases")).to_contain_text(text("gases_off"))
    page.get_by_role("button", name=text("gases_on")).click()
    wait_for(page, "beat.gas && Object.keys(beat.gas.places).length > 0")
    gas, outputs = beat(page)["gas"], beat(page)["outputs"]
    row = page.locator('.ecl-gases [data-place="sart"]')
    expect(row).to_contain_text(f"{outputs['SaO2']:.1f}")
    saturation = f"{gas['places']['ecmotuor']['values']['SO2']:.0f} %"
    expect(page.locator('[data-node="ecmotuor"] .saturation')).to_have_text(saturation)
    expect(page.locator(".ecl-schematic figcaption")).to_contain_text(text("legend_saturation"))
    picture(page, shots, "gases")
    turn(page, "ecmo.sweep_l_min", "1")
    wait_for(page, f"beat.outputs.PaCO2 > {outputs['PaCO2']} + 5")
    turn(page, "gas.shunt_fraction", "1")
    turn(page, "ecmo.sweep_l_min", "0")
    wait_for(page, "beat.gas && Object.keys(beat.gas.places).length === 0")
    expect(page.locator(".ecl-gases .none")).to_contain_text("no steady gas state")
    expect(page.locator(".ecl-schematic .saturation")).to_have_count(0)


def test_two_circulations_stand_side_by_side(open_page, served, shots):
    case = connect(connect(PRESETS["paper"].case(), "gas"), "physiology")
    raw = case.as_mapping()
    raw["ecmo"] |= {"drainage_site": "ivc", "return_site": "lower"}
    raw["ecmo"].pop("mode", None)
    link = link_of(PageState(type(case).model_validate(raw)))
    page = open_page(url=f"{served.url}/#{link}", viewport=PHONE)
    show(page, "gases")
    result = beat(page)["outputs"]
    assert result["SaO2_lower"] > result["SaO2"] + 2.0
    dual = page.locator(".ecl-gases .dual")
    for name in ("SaO2", "SaO2_lower"):
        expect(dual).to_contain_text(f"{result[name]:.1f}")
    picture(page, shots, "gases_phone")


def test_a_number_to_be_read_with_care_says_so_in_the_table_and_in_the_circuit(open_page, served, shots):
    """The tile had a dagger; the same saturation stood bare in the table and in its box."""
    why = "SaO2 is not determined by the measurements"
    state = PageState(
        connect(PRESETS["paper"].case(), "gas"), origin="fit", verdict="doubtful",
        remarks=(FitRemark(why, ("SaO2",)),),
    )  # fmt: skip
    page = open_page(url=f"{served.url}/#{link_of(state)}")
    show(page, "gases")
    row = page.locator('.ecl-gases [data-place="sart"]')
    care = row.get_by_role("img", name=why)
    expect(care).to_have_count(1)
    expect(row.locator("td").first).to_have_text(f"† {beat(page)['outputs']['SaO2']:.1f}")
    expect(page.locator('[data-node="sart"] .saturation')).to_contain_text("†")
    expect(page.locator('[data-node="sart"] title')).to_contain_text(why)
    expect(page.locator('[data-node="ao"] .saturation')).not_to_contain_text("†")
    picture(page, shots, "gases_with_care")
