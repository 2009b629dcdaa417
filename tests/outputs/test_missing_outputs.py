"""An output that a case lacks is refused with what the case needs, before anything is computed."""

import pytest

import eclsim
from eclsim.cases.presets import PRESETS
from eclsim.orbit.model import model_of
from eclsim.outputs.registry import UnknownOutputError
from model_catalogue import model

CASE = PRESETS["healthy"].case()
LACKING = [
    ("PF", r"'PF' is no output of this case; it needs \[ecmo\] in the case file"),
    ("clearance_urea", r"needs \[crrt\]"),
    ("ecmo.a.PF", r"needs \[ecmo\.a\]"),
    ("SaO2", r"needs \[gas\]"),
    ("reflex_use", r"needs \[regulation\] baroreflex"),
    ("MPA", r"'MPA' is not an output; did you mean MPAP\?; `eclsim outputs` lists all$"),
    ("crrt_recirculated_flow", "'crrt_recirculated_flow' is computed by simulate only"),
]


@pytest.mark.parametrize(("name", "why"), LACKING)
def test_it_is_refused_everywhere(name: str, why: str):
    """It was a KeyError 'Qecmopump', an AssertionError, or, without gases, a saturation of 100 %."""
    with pytest.raises(UnknownOutputError, match=why):
        eclsim.simulate_many(CASE, {"Rmc": [0.6]}, [name])
    with pytest.raises(UnknownOutputError, match=why):
        eclsim.derivatives(CASE, [name], ["Rmc"])
    with pytest.raises(UnknownOutputError, match=why):
        eclsim.course(CASE, minutes=5, outputs=[name])
    with pytest.raises(UnknownOutputError, match=why):
        eclsim.steady_beat(eclsim.Batch.of(model_of(CASE)), [name])


def test_gases_of_a_model_without_their_values_are_refused():
    with pytest.raises(UnknownOutputError, match=r"'SaO2' is no output of this case; it needs \[gas\]"):
        eclsim.simulate_many(model("V-A"), {}, ["SaO2"])
