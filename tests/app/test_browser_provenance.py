"""Where the numbers come from, in Chromium: patients do not mix, and nothing old passes for new."""

from __future__ import annotations

import re

import pytest

from eclsim.app import knobs
from eclsim.app.state import PageState, link_of
from eclsim.app.texts import text
from eclsim.cases.case import Measurements
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import case_text
from eclsim.identification.verdict import FitVerdict, Goodness, agreement, headline
from page_in_browser import PHONE, beat, choose, eventually, expect, open_file, picture, show, turn, wait_for
from small_cohort import cohort

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser
PAPER = PRESETS["paper"].case()


def patient(folder, name: str, pressure: float, **parameters: float):
    """A case file of a patient with a measured mean pressure."""
    person = PAPER.patient.model_copy(update={"id": name})
    measured = Measurements(MAP=pressure, MPAP=15.0)
    case = PAPER.model_copy(update={"patient": person, "measurements": measured, "parameters": parameters})
    path = folder / f"{name}.toml"
    path.write_text(case_text(case))
    return path


def provenance(page):
    return expect(page.locator(".ecl-provenance"))


def test_the_form_follows_the_patient_and_what_was_typed_stays_with_it(open_page, tmp_path, shots):
    page = open_page()
    show(page, "identify")
    field = page.locator("#form-measurements-MAP")
    page.get_by_text("simulated 70").first.wait_for()
    expect(field).to_have_value("")  # what the model gives is no measurement
    picture(page, shots, "identify_preset")
    open_file(page, patient(tmp_path, "P01", 71))
    expect(field).to_have_value("71")
    expect(page.locator("#form-patient-id")).to_have_value("P01")
    provenance(page).to_contain_text("Not fitted")
    provenance(page).to_contain_text("P01")
    picture(page, shots, "unfitted")
    field.fill("72.5")
    open_file(page, patient(tmp_path, "P02", 88))
    expect(field).to_have_value("88")
    expect(page.locator("#form-patient-id")).to_have_value("P02")
    expect(page.locator(".ecl-page")).not_to_contain_text("P01", use_inner_text=True)
    page.get_by_role("button", name="Undo").click()
    expect(field).to_have_value("72.5")
    page.reload()
    page.wait_for_function("window.eclsim?.bus.last('beat')")
    show(page, "identify")
    expect(field).to_have_value("72.5")
    page.get_by_text(text("fit_typed_kept")).wait_for()
    open_file(page, tmp_path / "P01.toml")  # opened anew: as the file has it
    expect(field).to_have_value("71")
    expect(page.get_by_text(text("fit_typed_kept"))).to_have_count(0)


def test_measured_and_simulated_stand_side_by_side(open_page, tmp_path, shots):
    page = open_page()
    open_file(page, patient(tmp_path, "P03", 99))
    page.get_by_text(f"{text('key_measured')} 99").wait_for()
    expect(page.locator(".q-notification")).to_be_visible()
    page.get_by_role("button", name=text("open")).click(timeout=4000)  # the message over it takes no click
    expect(page.get_by_role("dialog")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog")).to_be_hidden()
    show(page, "outputs")
    heads = page.locator(".ecl-outputs thead th")
    expect(heads.nth(1)).to_have_text(text("value"))
    expect(heads.nth(2)).to_have_text(text("output_measured"))
    row = page.locator(".ecl-outputs tr", has_text="MAP").first
    expect(row.locator("td").nth(1)).to_have_text("99.0")
    unit = row.get_by_text("mmHg", exact=True).filter(visible=True)
    expect(unit).to_have_count(1)  # it stood behind the value and beside it
    picture(page, shots, "measured")
    turn(page, "ecmo.speed_rpm", "3800")
    tile = page.locator(".ecl-keys [data-key=MAP]")
    expect(tile).to_have_attribute("title", re.compile(text("key_measured_before", values="99")))
    expect(page.get_by_text(f"{text('key_measured')} 99")).to_have_count(0)  # it was, at another speed
    expect(heads.nth(2)).to_have_text(text("output_measured_before"))
    picture(page, shots, "measured_before")
    page.evaluate("eclsim.bus.publish('beat', { ...eclsim.bus.last('beat'), minute: 30 })")
    expect(heads.nth(2)).not_to_have_text(text("output_measured"))  # later in a course: not measured then
    expect(page.get_by_text(f"{text('key_measured')} 99")).to_have_count(0)


def test_a_turned_preset_is_called_changed_and_opens_again(open_page, shots):
    page = open_page("healthy")
    provenance(page).to_contain_text("Healthy adult")
    provenance(page).not_to_contain_text("Changed")
    turn(page, "patient.heart_rate_bpm", "84")
    wait_for(page, "Math.abs(beat.period - 60 / 84) < 1e-3")
    provenance(page).to_contain_text("Healthy adult, changed")
    provenance(page).to_contain_text("Heart rate")
    picture(page, shots, "changed")
    choose(page, PRESETS["healthy"].name)
    wait_for(page, "Math.abs(beat.period - 60 / 70) < 1e-3")
    provenance(page).not_to_contain_text("changed")


def test_undo_then_reset_stays_with_the_patient(open_page):
    page = open_page("healthy")
    turn(page, "patient.heart_rate_bpm", "84")
    wait_for(page, "Math.abs(beat.period - 60 / 84) < 1e-3")
    choose(page, PRESETS["lvad"].name)
    wait_for(page, "'Qlvadpump' in beat.waves")
    page.get_by_role("button", name="Undo").click()
    wait_for(page, "!('Qlvadpump' in beat.waves)")
    page.get_by_role("button", name="Reset").click()
    wait_for(page, "Math.abs(beat.period - 60 / 70) < 1e-3")
    provenance(page).to_contain_text("Healthy adult A made-up preset: no patient was measured.")


def test_a_link_pasted_into_an_open_page_is_opened_and_a_damaged_one_changes_nothing(open_page):
    page, other = open_page("healthy"), open_page("lvad")
    link = other.evaluate("eclsim.bus.last('state').link")
    page.evaluate("(link) => { location.hash = link; }", link)
    wait_for(page, "'Qlvadpump' in beat.waves")
    page.wait_for_function("location.hash === ''")
    page.evaluate("() => { location.hash = 'nonsense'; }")
    page.get_by_text("the link is").wait_for()
    expect(page.get_by_text("Still shown")).to_contain_text("LVAD")
    assert "Qlvadpump" in beat(page)["waves"]
    page.get_by_role("button", name="Undo").click()
    wait_for(page, "!('Qlvadpump' in beat.waves)")


def test_a_long_name_hides_no_doubt_and_compare_names_a_poor_fit(open_page, served, shots):
    """The name filled the line, and what was to be known of the numbers was below its edge; Compare had a
    poor fit beside others without a mark."""
    case = PRESETS["paper"].case()
    person = case.patient.model_copy(update={"id": "W" * 64})
    case = case.model_copy(update={"patient": person})
    state = PageState(case, origin="fit", verdict="poor", source=f"{'L' * 80}, data point {'Q' * 64}")
    other = state.with_case(knobs.turn(case, "patient.heart_rate_bpm", 99))
    page = open_page(url=f"{served.url}/#{link_of(other)}")
    line = page.locator(".ecl-provenance")
    expect(line).to_contain_text("Changed by hand")
    assert line.evaluate("(e) => e.scrollHeight <= e.clientHeight + 1"), "all of it in sight"
    page.keyboard.press("Alt+s")
    choose(page, "Healthy adult")
    show(page, "compare")
    cells = page.locator(".ecl-compare td.name")
    expect(cells).to_have_count(2)
    expect(cells.nth(0)).to_contain_text(text("badge_preset"))
    expect(cells.nth(1)).to_contain_text(text("badge_doubt_changed", doubt=text("badge_fit_poor")))
    for cell in cells.all():
        assert cell.evaluate("(e) => e.scrollWidth <= e.clientWidth + 1")
    picture(page, shots, "long_names")


def test_the_skip_link_moves_to_the_knobs_and_leaves_address_and_patient(open_page):
    page = open_page("lvad")
    page.locator(".ecl-skip").focus()
    page.keyboard.press("Enter")
    expect(page.locator(":focus")).to_have_attribute("aria-label", text("knobs"))
    assert page.evaluate("location.hash") == ""
    page.reload()
    page.wait_for_function("window.eclsim?.bus.last('beat')")
    assert "Qlvadpump" in beat(page)["waves"]


def fit_of(page, off: float) -> dict:
    """A fit as the server tells it, with MAP so many standard uncertainties beside the measurement."""
    scale = {"MAP": 5.5}
    values = {"MAP": 80.0 + off * scale["MAP"]}
    goodness = Goodness({"MAP": off}, off**2, 1.0, None)
    verdict = FitVerdict(goodness, tuple(agreement({"MAP": 80.0}, values, goodness, "relative"))).as_object()
    parameter = {
        "value": 0.5,
        "lower": 0.4,
        "upper": 0.6,
        "identifiable": True,
        "reason": "",
        "bounds": [0.1, 4],
    }
    return {
        "subject": page.evaluate("eclsim.bus.last('form').subject"),
        "fit": {
            "of": "Fit of P01", "message": "optimum found", "seconds": 9, "usable": True, "link": "",
            "verdict": verdict, "headline": headline(verdict), "parameters": {"Rmc": parameter},
            "outputs": {"MAP": {"measured": 80.0, "simulated": values["MAP"]}},
            "starts_agreeing": 2, "starts_refined": 3, "explored": 252,
        },
    }  # fmt: skip


def test_a_fit_that_is_wrong_has_no_tick_and_says_why(open_page, shots):
    page = open_page()
    show(page, "identify")
    page.wait_for_function("eclsim.bus.last('form')")
    result = page.locator(".ecl-identify .result")
    for off, ticks, level in ((0.4, 1, "good"), (3.0, 0, "doubtful"), (4.1, 0, "poor")):
        page.evaluate("(data) => eclsim.bus.publish('fit_ended', data)", fit_of(page, off))
        page.locator(f".judgement.{level}").wait_for()

        def has_ticks(ticks=ticks) -> None:
            assert result.inner_text().count("\u2713") == ticks

        eventually(has_ticks)
        picture(page, shots, f"fit_{level}")
    expect(result).to_contain_text("POOR FIT, not to be used")
    expect(result).to_contain_text("by 2 of 3 starts, the best of 252 sets of values")
    expect(result).to_contain_text(re.compile(r"MAP 102\.[56] fitted against 80 measured"))
    expect(page.get_by_role("button", name=text("fit_use"))).to_have_count(0)
    expect(page.get_by_role("button", name=text("fit_use_poor"))).to_be_visible()


def test_outputs_of_a_fit_that_nothing_determines_are_shaded_and_named(open_page, shots):
    """A cardiac output that nothing determines stood there like a measured one."""
    page = open_page()
    show(page, "identify")
    page.wait_for_function("eclsim.bus.last('form')")
    data = fit_of(page, 0.4)
    data["fit"]["outputs"]["MAP"] |= {"lower": 77.2, "upper": 87.1, "determined": True}
    open_one = {"measured": None, "simulated": 1.34, "lower": 0.0, "upper": 15.1, "determined": False}
    data["fit"]["outputs"]["CO"] = open_one
    page.evaluate("(data) => eclsim.bus.publish('fit_ended', data)", data)
    shaded = page.locator(".ecl-identify .result table").first.locator("tr.vague")
    expect(shaded).to_have_count(1)
    expect(shaded).to_contain_text("CO")
    expect(shaded).to_contain_text("0 \u2013 15.1")
    expect(page.locator(".ecl-identify .result")).to_contain_text(text("fit_undetermined", names="CO"))
    picture(page, shots, "fit_undetermined")


def test_a_row_of_a_cohort_says_which_one_it_is_and_that_it_is_not_fitted(open_page, tmp_path, shots):
    page = open_page("healthy")
    page.get_by_role("button", name=text("open")).click()
    table = tmp_path / "ward.csv"
    table.write_bytes(cohort({"CO": "", "SP": "100"}, {"measurement": "2", "CO": "", "SP": "110"}))
    page.locator(".ecl-upload input[type=file]").set_input_files(table)
    page.get_by_label(text("open_rows")).click()
    page.get_by_text("P01/2", exact=True).click()
    page.get_by_role("button", name=text("open_use"), exact=True).click()
    wait_for(page, "beat.outputs.PF > 0")
    provenance(page).to_contain_text("NOT FITTED")
    provenance(page).to_contain_text("ward.csv, data point P01/2")
    page.get_by_text(f"{text('key_measured')} 75").wait_for()
    picture(page, shots, "cohort_row")


def test_the_shadow_of_a_poor_fit_is_called_one(open_page, served):
    state = PageState(PRESETS["paper"].case(), origin="fit", source="measured_on_monday.toml", verdict="poor")
    page = open_page(url=f"{served.url}/#{link_of(state)}")
    page.get_by_role("button", name=text("pin"), exact=True).click()
    expect(page.locator(".ecl-monitor .kept")).to_contain_text(f"({text('badge_fit_poor')})")
    page.get_by_role("button", name=text("pin"), exact=True).click()
    expect(page.locator(".ecl-monitor .kept")).to_have_count(0)


def test_on_a_phone_all_that_is_known_of_a_fit_is_in_sight(open_page, served):
    state = PageState(PRESETS["paper"].case(), origin="fit", source="measured_on_monday.toml", verdict="poor")
    turned = state.with_case(knobs.turn(state.case, "parameters.Emaxlv", 2.0))
    page = open_page(url=f"{served.url}/#{link_of(turned)}", viewport=PHONE)
    provenance(page).to_contain_text("POOR")
    heights = page.evaluate(
        "(({ scrollHeight, clientHeight }) => [scrollHeight, clientHeight])"
        "(document.querySelector('.ecl-provenance'))"
    )
    assert heights[0] <= heights[1]
