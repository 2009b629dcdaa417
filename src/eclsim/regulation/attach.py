"""Adds published reflexes to a circuit: controllers, and veins whose unstressed volume can change."""

from __future__ import annotations

from dataclasses import replace

from eclsim.circuit.network import Circuit, Compartment, Control, StartPressure, mean_of
from eclsim.components import Complement, ElasticVessel
from eclsim.components.base import Key, Scaled, names_in
from eclsim.parameters.physiology import CAVAL_SHARE
from eclsim.parameters.regulation import EXTRA_VOLUME, REGULATION, UNSTRESSED
from eclsim.regulation.heldt import HELDT_2004, HELDT_2010
from eclsim.regulation.reflex import Reflex, ReflexModel, TransmuralReflex
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
