"""How far the heart rate follows reflexes and drugs: wholly, in part, or not at all in a paced heart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from eclsim.circuit.network import HEART_RATE, Circuit, Control
from eclsim.components.base import Key, Number, Values, value_of
from eclsim.parameters.regulation import HEART_RATE_RESPONSE
from eclsim.regulation.reflex import InstantController

SINUS_NODE = "sinus_node"


class HeartRateConstants(NamedTuple):
    """The patient's own heart rate [bpm], and the share by which it responds."""

    own_bpm: Number
    response: Number


@dataclass(frozen=True)
class HeartRateResponse(InstantController[HeartRateConstants]):
    """Controller that takes back part of what the controllers before it did to the heart rate.

    rate = own + response (changed - own)

    It comes after reflexes and drugs.

    Args:
        response: 1 for a healthy sinus node, 0 for a paced heart.
        own: the patient's own heart rate [bpm].
    """

    response: Key = HEART_RATE_RESPONSE
    own: Key = HEART_RATE
    not_negative: ClassVar = ("response",)

    def constants(self, values: Values) -> HeartRateConstants:
        """Own rate and share."""
        return HeartRateConstants(value_of(values, self.own), value_of(values, self.response))

    def in_effect(
        self, states: Sequence[Number], values: Sequence[Number], constants: HeartRateConstants
    ) -> Sequence[Number]:
        """The heart rate between the patient's own and that of reflexes and drugs."""
        (changed,) = values
        return [constants.own_bpm + constants.response * (changed - constants.own_bpm)]


def with_heart_rate_response(circuit: Circuit) -> Circuit:
    """Add the controller to a circuit whose reflexes or drugs change the heart rate."""
    return circuit + Circuit(controllers=(Control(SINUS_NODE, HeartRateResponse(), (), (HEART_RATE,)),))
