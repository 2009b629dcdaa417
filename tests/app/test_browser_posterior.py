"""Bands of a posterior, sites of ECMO and the pinned state in Chromium. ECLSIM_SCREENSHOTS keeps pictures."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from page_in_browser import beat, expect, knob, picture, show, turn, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser
CURRENT = "eclsim.bus.last('{topic}')?.count && eclsim.bus.last('{topic}').of === eclsim.bus.last('beat').of"


def wait_for_bands(page, topic: str = "bands") -> None:
    page.wait_for_function(CURRENT.format(topic=topic))


@pytest.fixture
def posterior(tmp_path):
    """A file as `eclsim identify --posterior` writes it, around the paper's patient."""
    case, random = PRESETS["paper"].case(), np.random.default_rng(1)
    names = ("Rmc", "Rpmc", "Emaxlv", "Emaxrv", "Csart")
    draws = {
        n: (("chain", "draw"), case.parameters[n] * np.exp(random.normal(0.0, 0.1, (2, 100)))) for n in names
    }
    attributes = {"sampler": "nuts", "trusted": 0, "doubts": "R-hat of Rmc is 1.20"}
    path = tmp_path / "posterior.nc"
    xr.Dataset(draws, attrs=attributes).to_netcdf(path, group="posterior", engine="h5netcdf")
    return path


def test_a_posterior_is_opened_and_gives_bands_in_the_views(open_page, posterior, shots):
    page = open_page()
    page.get_by_role("button", name="Open case").click()
    page.locator(".ecl-upload input[type=file]").set_input_files(posterior)
    page.get_by_text(text("posterior_opened")).wait_for()
    wait_for_bands(page)
    strip = page.get_by_role("group", name=text("bands_label"))
    expect(strip).to_contain_text("R-hat of Rmc is 1.20")
    low, high = page.evaluate("eclsim.bus.last('bands').outputs.MAP")
    assert low < beat(page)["outputs"]["MAP"] < high
    expect(page.locator(".ecl-monitor .band").nth(4)).to_be_attached()
    picture(page, shots, "bands_monitor")
    turn(page, "ecmo.speed_rpm", "3000")
    wait_for(page, "beat.outputs.PF < 3.2")
    wait_for_bands(page)
    assert page.evaluate("eclsim.bus.last('bands').outputs.PF")[1] < 3.3
    show(page, "loops")
    page.locator(".ecl-chart:visible .scatterlayer .trace").nth(3).wait_for()
    picture(page, shots, "bands_loops")
    show(page, "outputs")
    page.locator(".ecl-outputs .band").first.wait_for()
    picture(page, shots, "bands_outputs")
    show(page, "ramp")
    wait_for_bands(page, "ramp_bands")
    picture(page, shots, "bands_ramp")
    show(page, "compare")  # it has no bands
    expect(strip).to_have_count(0)
    show(page, "outputs")
    page.get_by_role("button", name=text("bands_hide")).click()
    page.locator(".ecl-outputs .band").first.wait_for(state="detached")
    page.get_by_role("button", name=text("bands_show")).click()
    page.locator(".ecl-outputs .band").first.wait_for()


def test_another_patient_has_no_bands_and_undo_brings_them_back(open_page, posterior):
    page = open_page()
    page.get_by_role("button", name="Open case").click()
    page.locator(".ecl-upload input[type=file]").set_input_files(posterior)
    wait_for_bands(page)
    page.get_by_label("Patient").first.click()
    page.get_by_text(PRESETS["healthy"].name, exact=True).click()
    page.get_by_role("group", name=text("bands_label")).wait_for(state="detached")
    page.get_by_role("button", name="Undo").click()
    page.get_by_role("group", name=text("bands_label")).wait_for()
    wait_for_bands(page)


def test_a_file_that_is_no_posterior_is_refused(open_page, tmp_path, shots):
    page = open_page("healthy")
    page.get_by_role("button", name="Open case").click()
    wrong = tmp_path / "posterior.nc"
    wrong.write_bytes(b"nonsense")
    page.locator(".ecl-upload input[type=file]").set_input_files(wrong)
    page.get_by_text(text("posterior_damaged")).first.wait_for()
    picture(page, shots, "posterior_refused")
    assert beat(page)["period"] == pytest.approx(60 / 70, abs=1e-4)


def test_ecmo_is_drawn_between_the_sites_that_are_chosen(open_page, shots):
    page = open_page()
    page.get_by_label("Drained from", exact=True).select_option("part")
    page.get_by_label("Returned to", exact=True).select_option("la")
    page.wait_for_function(
        "eclsim.bus.last('drawing').lines.some((l) => l.name === 'ecmoreturn' && l.site === 'la')"
    )
    wait_for(page, "beat.converged && Math.abs(beat.means.Qecmodrain - beat.means.Qecmoreturn) < 1")
    expect(knob(page, "ecmo.mode")).to_have_value("other_mode")
    picture(page, shots, "sites")
    page.get_by_label("Mode", exact=True).select_option("VV")
    expect(knob(page, "ecmo.return_site")).to_have_value("ra")


def test_the_pinned_state_stands_beside_the_one_that_is_shown(open_page, shots):
    page = open_page()
    page.keyboard.press("Alt+p")
    page.wait_for_function("eclsim.bus.last('pinned')")
    turn(page, "parameters.Rmc", "1.1")
    wait_for(page, "beat.outputs.MAP > 75")
    show(page, "compare")
    heads = page.locator(".ecl-compare thead th")
    expect(heads).to_have_text([text("output"), text("compare_now"), text("pinned")])
    expect(page.locator(".ecl-compare tr.knob td").first).to_have_text("1.1")
    picture(page, shots, "compare_pinned")
    show(page, "ramp")
    page.wait_for_function("eclsim.bus.last('ramp_pinned')?.of === eclsim.bus.last('pinned').of")
    picture(page, shots, "ramp_pinned")
    expect(page.locator(".ecl-bands")).to_have_count(0)
