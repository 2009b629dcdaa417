"""The warning of a grid that is too coarse, against a grid that is four times finer."""

import pytest

from eclsim.orbit.model import Model
from eclsim.outputs.results import simulate
from eclsim.patient.circulation import Anatomy, circulation

MAIN = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO", "stroke_work_lv")


@pytest.mark.parametrize(
    ("anatomy", "changed", "warned"),
    [
        (Anatomy(regional=True), {"heart_rate_bpm": 60.0}, False),
        (Anatomy(), {"heart_rate_bpm": 60.0, "Cao": 0.01}, False),
        (Anatomy(), {"heart_rate_bpm": 60.0, "Cao": 0.0001}, True),
    ],
)
def test_a_grid_is_called_too_coarse_where_outputs_are_wrong(anatomy, changed, warned):
    """Every patient with regions and a slow heart was warned of, whose outputs were right to 0.01 %."""
    model = Model.published(circulation(anatomy)).with_values(changed)
    usual, fine = simulate(model), simulate(model, resolution=32)
    worst = max(abs(float(usual[name]) / float(fine[name]) - 1.0) for name in MAIN)
    assert any("the step in time is too coarse" in text for text in usual.attrs["warnings"]) == warned
    assert (worst > 1e-3) == warned
