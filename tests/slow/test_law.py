"""The form of a slow law, by the smallest one: a drug that decays."""

import numpy as np
import pytest

from eclsim.slow import SlowLaw, SlowState


class Decay(SlowLaw):
    states = (SlowState("drug.amount", "ug", 1.0),)
    reads = ()

    def start(self, settings, beat):
        return {"drug.amount": settings["drug.start"]}

    def in_effect(self, states, settings):
        return {"drugs.noradrenaline": states["drug.amount"]}

    def rates(self, states, settings, beat, inflows):
        return {"drug.amount": -states["drug.amount"] / 60.0}


def test_a_law_is_of_all_members_at_once():
    law, settings = Decay(), {"drug.start": np.array([1.0, 2.0])}
    states = law.start(settings, {})
    np.testing.assert_allclose(law.rates(states, settings, {}, {})["drug.amount"], [-1 / 60, -2 / 60])
    assert law.in_effect(states, settings).keys() == {"drugs.noradrenaline"}


def test_a_law_states_everything():
    class Nothing(SlowLaw):
        pass

    with pytest.raises(TypeError, match="abstract"):
        Nothing()


@pytest.mark.parametrize(
    ("name", "unit", "words"),
    [
        ("fluid.plasma_ml", "mL", "plasma volume"),
        ("fluid.interstitial_protein_g", "g", "interstitial protein"),
        ("solutes.bicarbonate_outside_mmol", "mmol", "bicarbonate outside cells"),
        ("drugs.noradrenaline_in_effect", "ug/kg/min", "noradrenaline in effect"),
        ("fluid.capillary_pressure_at_start_mmHg", "mmHg", "capillary pressure at start"),
    ],
)
def test_a_state_has_a_name_in_words(name, unit, words):
    assert SlowState(name, unit, 1.0).words == words
