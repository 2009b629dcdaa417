"""The form of a slow law, by the smallest one: a drug that decays."""

from collections import defaultdict

import numpy as np
import pytest

from eclsim.drugs.published import InfusedDoses
from eclsim.fluid.law import STATES, FluidLaw
from eclsim.fluid.solutes import CarbonDioxideLaw, SolutesLaw
from eclsim.outputs.registry import all_outputs
from eclsim.regulation.oxygen import HypoxicVasoconstriction
from eclsim.slow import SlowLaw, SlowState


class Decay(SlowLaw):
    states = (SlowState("drug.amount", "ug", "amount of the drug", 1.0),)
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


def test_every_state_has_its_own_name_in_words():
    """They were made of keys: "tissue pco2"."""
    tissues = CarbonDioxideLaw((("tissue", 1.0), ("upper_tissue", 0.3)))
    laws = (InfusedDoses(), HypoxicVasoconstriction(), SolutesLaw(), tissues)
    words = {state.name: state.words for state in (*STATES, *(s for law in laws for s in law.states))}
    assert len(set(words.values())) == len(words)
    assert words["drugs.noradrenaline_in_effect"] == "noradrenaline in effect"
    assert words["solutes.bicarbonate_outside_mmol"] == "bicarbonate outside cells"
    assert words["solutes.tissue_pco2_mmHg"] == "PCO2 of the tissues, at 37 C"
    in_blood = words["solutes.upper_tissue_blood_pco2_mmHg"]
    assert in_blood == "PCO2 in the blood of the tissues of the upper body, at 37 C"


@pytest.mark.parametrize("law", [CarbonDioxideLaw((("tissue", 1.0),)), SolutesLaw(), FluidLaw()])
def test_no_law_shows_a_quantity_under_the_name_of_an_output(law):
    """The PCO2 of the stores was shown as `tissue_PCO2`, which is that of the blood behind them."""
    anything = defaultdict(lambda: np.ones(1))
    shown = {quantity.name for quantity in law.derived_quantities(anything, anything)}
    assert not shown & all_outputs().keys()
