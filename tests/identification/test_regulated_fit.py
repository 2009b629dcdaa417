"""The reflex's gain and a drug's sensitivity as free parameters of a fit and inputs of an analysis."""

import math
from pathlib import Path

import numpy as np
import pytest

from eclsim.cases import read_case
from eclsim.cases.reading import read_mapping
from eclsim.devices.registry import parameters
from eclsim.identification.density import Prior
from eclsim.identification.files import write_fitted_case
from eclsim.identification.fit import fit
from eclsim.identification.multi_start import MultiStart
from eclsim.identification.objective import Box
from eclsim.identification.settings import FitSettings, checked_fit
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate
from eclsim.parameters.regulation import GAIN, NORADRENALINE_SPREAD, sensitivity
from eclsim.sensitivity.inputs import varied_inputs

SENSITIVITY = sensitivity("noradrenaline")
TRUTH = {GAIN: 0.4, SENSITIVITY: 1.7}
MEASURED = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO")


def case(gain=1.0, factor=1.0, **more):
    """A failing heart on noradrenaline, in a patient whose reflex knows 80 mmHg."""
    return read_mapping({
        "format": 1, "patient": {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75},
        "regulation": {"baroreflex": gain, "set_point_mmHg": 80}, "parameters": {"Emaxlv": 0.6},
        "drugs": {"noradrenaline": 0.25, "noradrenaline_sensitivity": factor},
    } | more).case  # fmt: skip


@pytest.fixture(scope="module")
def twin():
    beat = simulate(case(TRUTH[GAIN], TRUTH[SENSITIVITY]))
    return case(measurements={name: float(beat[name]) for name in MEASURED})


@pytest.mark.slow
def test_a_twin_gives_back_gain_and_sensitivity_to_their_sections(twin, tmp_path: Path):
    """Exact measurements tell them apart; the fit says that uncertain ones of a single state do not."""
    quick = MultiStart(2, 0.5, round_size=1, rediscoveries=1)
    result = fit(twin, settings=FitSettings((GAIN, SENSITIVITY), multi_start=quick))
    for name, value in TRUTH.items():
        assert result.parameters[name].value == pytest.approx(value, rel=1e-3), name
    assert "sensitivity" in result.parameters[GAIN].reason
    written = read_case(write_fitted_case(tmp_path, result)).case
    assert written.regulation.baroreflex == pytest.approx(TRUTH[GAIN], rel=1e-3)
    assert written.drugs.noradrenaline_sensitivity == pytest.approx(TRUTH[SENSITIVITY], rel=1e-3)


def test_the_prior_of_a_sensitivity_is_what_was_published():
    usual = parameters()[SENSITIVITY].bounds
    prior = Prior.within(Box.of({SENSITIVITY: usual}), "log-normal")
    one = prior.values_of(np.array([[0.0], [1.0]]))[:, 0]
    assert one[0] == pytest.approx(1.0)
    # Cut at two standard deviations, which narrows the rest a little.
    assert 0.8 * NORADRENALINE_SPREAD < math.log(one[1]) <= NORADRENALINE_SPREAD


def test_both_are_inputs_of_an_analysis_within_what_is_allowed():
    own = case()
    result = varied_inputs(own, model_of(own).values, (GAIN, SENSITIVITY)).inputs
    assert [(one.low, one.high) for one in result] == [(0.75, 1.2), (0.75, 1.25)]


@pytest.mark.slow
def test_an_open_set_point_is_the_measured_pressure():
    """A patient who is measured at rest: fitted with the reflex or without, it is the same patient."""
    opened = case(regulation={"baroreflex": 1.0}, measurements={"MAP": 70, "CO": 4})
    quick = MultiStart(2, 0.5, round_size=1, rediscoveries=1)
    settings = FitSettings(("Rmc", "Emaxlv"), multi_start=quick)
    result, plain = (
        fit(c, settings=settings) for c in (opened, opened.model_copy(update={"regulation": None}))
    )
    assert result.case.regulation.set_point_mmHg == 70
    for name, parameter in result.parameters.items():
        assert parameter.value == pytest.approx(plain.parameters[name].value, rel=1e-6), name
    assert simulate(model_of(result.case))["MAP"] == pytest.approx(70, abs=1e-4)


def test_an_open_set_point_is_said(twin):
    for measured, told in (({"MAP": 70}, "notes"), ({"CO": 4}, "warnings")):
        opened = case(regulation={"baroreflex": 1.0}, measurements=measured)
        (message,) = [
            w for w in getattr(checked_fit(opened, FitSettings((GAIN,))), told) if "set_point" in w.key
        ]
        assert "left open" in str(message)
    several = checked_fit(
        case(regulation={"baroreflex": 1.0}, measurements={"MAP": 70}), FitSettings((), shared=(GAIN,))
    )
    assert [w for w in several.warnings if "set_point" in w.key]
    assert not any("set_point" in w.key for w in checked_fit(twin, FitSettings((GAIN,))).warnings)


@pytest.mark.slow
def test_a_set_point_that_nobody_measured_is_a_doubt_of_the_fit():
    blind = case(regulation={"baroreflex": 1.0}, measurements={"CO": 4})
    quick = MultiStart(2, 0.5, round_size=1, rediscoveries=1)
    result = fit(blind, settings=FitSettings(("Rmc",), multi_start=quick))
    assert any("set_point_mmHg is the start value" in r.sentence for r in result.verdict.doubts)
