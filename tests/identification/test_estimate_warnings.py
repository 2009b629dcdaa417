"""Warnings about a followed patient agree with the estimate that stands beside them."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from eclsim.cases.case import Case, Patient
from eclsim.identification.density import PosteriorDensity, Prior
from eclsim.identification.estimate_warnings import _Drawn, estimate_warnings
from eclsim.identification.objective import Box
from eclsim.identification.points import Interval
from eclsim.orbit.model import model_of
from eclsim.outputs.limits import limits_of

NO_BEAT = cast("Any", None)
CONGESTION = next(limit for limit in limits_of("right_atrial_pressure") if limit.kind == "warning")


def drawn(cvp: Interval, **measured: float) -> _Drawn:
    return _Drawn(NO_BEAT, (), 0, {"CVP": cvp}, measured)


def test_a_warning_has_the_number_of_the_estimate_and_what_was_measured():
    """It had 18.4 mmHg, of the median of each parameter, where the estimate was 16.3 and 11 was measured."""
    known = drawn(Interval(12.8, 16.3, 20.0), CVP=11.0)
    probability = known.probability(CONGESTION)
    assert probability == pytest.approx(0.975, abs=0.005)
    assert known.sentence(CONGESTION, probability) == (
        "mean right atrial pressure 16.3 mmHg (90 %: 12.8 to 20) is above 12 mmHg (probability 98 %): "
        "congestion of liver and kidneys (usual target 8 to 12 mmHg); but measured: CVP 11 mmHg"
    )
    agreed = drawn(Interval(12.8, 16.3, 20.0), CVP=18.0).sentence(CONGESTION, 0.7)
    assert agreed.endswith("; measured: CVP 18 mmHg")
    assert "measured" not in drawn(Interval(12.8, 16.3, 20.0), MAP=60.0).sentence(CONGESTION, 0.7)


def test_an_estimate_near_the_limit_is_told_from_it():
    """ "mean arterial pressure 65 mmHg is below 65 mmHg" contradicts itself."""
    (target,) = (one for one in limits_of("MAP") if one.value == 65.0)
    known = _Drawn(NO_BEAT, (), 0, {"MAP": Interval(61.6, 64.987, 68.3)}, {})
    assert "64.99 mmHg (90 %: 61.6 to 68.3) is below 65 mmHg" in known.sentence(target, 0.5)


def test_an_estimate_within_the_limit_may_be_beyond_it():
    known = drawn(Interval(8.0, 11.0, 14.0))
    probability = known.probability(CONGESTION)
    assert probability == pytest.approx(0.29, abs=0.01)
    assert "may be above 12 mmHg (probability 29 %)" in known.sentence(CONGESTION, probability)


@pytest.mark.slow
def test_limits_are_compared_with_the_draws():
    """Half of the draws have a low pressure, and the median is none of either half."""
    patient = Patient(id="T", sex="female", age_years=60, heart_rate_bpm=80)
    model = model_of(Case(patient=patient))
    prior = Prior.within(Box.of({"Rmc": (0.8, 0.05, 3.0), "Emaxlv": (1.5, 0.1, 5.0)}), "log-uniform")
    density = PosteriorDensity(model, {}, {}, prior, model.policy)
    low, high = np.array([-0.9, 0.0]), np.array([0.6, 0.0])
    everywhere = estimate_warnings(density, np.repeat(low[None], 16, axis=0), {}, {})
    assert any("mean arterial pressure" in text and "above 99 %" in text for text in everywhere)
    halves = np.concatenate([np.repeat(low[None], 7, 0), np.repeat(high[None], 9, 0)])
    mixed = estimate_warnings(density, halves, {}, {})
    alarm, warning = mixed
    assert "may be below 55 mmHg (probability 44 %)" in alarm
    assert "is below 65 mmHg (probability above 99 %)" in warning


def test_an_interval_that_alone_reaches_beyond_a_limit_gives_no_warning():
    """An alarm of a saturation of 74.5 (52.8 to 96.3) %, to first order, where no draw had less than 80 %."""
    beat = cast("Any", SimpleNamespace(output=lambda name: np.full(8, 10.0)))
    wide = Interval(5.0, 16.0, 27.0)
    assert _Drawn(beat, tuple(range(8)), 0, {"CVP": wide}, {}).probability(CONGESTION) == 0.0
    assert _Drawn(NO_BEAT, (), 0, {"CVP": wide}, {}).probability(CONGESTION) > 0.7
