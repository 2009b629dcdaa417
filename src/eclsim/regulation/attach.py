"""Adds published reflexes to a circuit: controllers, and veins whose unstressed volume can change.

The last controller sets how far the heart rate follows reflexes and drugs: wholly, in part, or not at all in
a paced heart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

from eclsim.circuit.network import HEART_RATE, Circuit, Compartment, Control, StartPressure, mean_of
from eclsim.components import Complement, ElasticVessel
from eclsim.components.base import Key, Number, Scaled, Values, names_in, value_of
from eclsim.parameters.physiology import CAVAL_SHARE
from eclsim.parameters.regulation import EXTRA_VOLUME, HEART_RATE_RESPONSE, REGULATION, UNSTRESSED
from eclsim.regulation.heldt import HELDT_2004, HELDT_2010
from eclsim.regulation.reflex import InstantController, Reflex, ReflexModel, TransmuralReflex
from eclsim.regulation.ursino1998 import URSINO_1998

REFLEXES: dict[str, ReflexModel] = {model.name: model for model in (URSINO_1998, HELDT_2004, HELDT_2010)}
"""Published reflexes by name."""
RIGHT_ATRIUM = "ra"
SYSTEMIC_VEINS = "Csvn"
"""Compliance of the systemic veins, which take up all blood that is given, removed or shifted."""


def with_volume_offset(circuit: Circuit) -> Circuit:
    """The circuit with systemic veins that have an unstressed volume and can be given blood.

    P = (V - Vu) / C, where V is the published stressed volume at Vu = 0. Blood given (`EXTRA_VOLUME`) changes
    the sum of all V. A change of Vu does not: it shifts blood between stressed and unstressed volume.
    """
    return replace(circuit, compartments=tuple(map(_with_offset, circuit.compartments)))


def _with_offset(compartment: Compartment) -> Compartment:
    law, start = compartment.component, compartment.start
    if not (isinstance(law, ElasticVessel) and SYSTEMIC_VEINS in names_in(law.compliance)):
        return compartment
    assert isinstance(start, StartPressure)

    def key_of(total: str) -> Key:
        if not isinstance(law.compliance, Scaled):
            return total
        # The vena cava has part of the compliance but receives none of the blood given.
        shares = tuple(share for share in law.compliance.by if share != Complement(CAVAL_SHARE))
        return replace(law.compliance, of=total, by=shares) if shares else total

    return replace(
        compartment,
        component=replace(law, unstressed=key_of(UNSTRESSED)),
        start=replace(start, given=key_of(EXTRA_VOLUME), unstressed=key_of(UNSTRESSED)),
    )


def with_reflex(circuit: Circuit, model: ReflexModel) -> Circuit:
    """Add a published reflex to a circuit with volume offset.

    If a pericardium encloses the right atrium, the reflex reads the atrium's transmural pressure.
    """
    outside = next((s.name for s in circuit.surroundings if RIGHT_ATRIUM in s.members), None)
    law, reads = Reflex(model), model.reads
    if outside is not None and len(reads) > 1:
        law, reads = TransmuralReflex(model), (*reads, mean_of(f"P{outside}"))
    control = Control(REGULATION, law, reads, model.acts_on)
    return circuit + Circuit(controllers=(control,))


# --- heart rate -----------------------------------------------------------------------------------

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
