"""Reflexes with the cardiopulmonary pathways of another model: an experiment on missing pathways."""

from __future__ import annotations

from dataclasses import replace

from eclsim.orbit.model import Model
from eclsim.regulation.attach import with_reflex
from eclsim.regulation.heldt import HELDT_2010
from eclsim.regulation.reflex import Effector, ReflexModel

CARDIOPULMONARY = "cardiopulmonary"


def joined(own: ReflexModel, other: ReflexModel = HELDT_2010) -> ReflexModel:
    """Replace the cardiopulmonary pathways of a reflex, if any, by those of another one.

    The relative response of resistance per mmHg is that of all vascular beds of the other model together.
    """
    kept = [not pathway.name.endswith(CARDIOPULMONARY) for pathway in own.pathways]
    added = [k for k, pathway in enumerate(other.pathways) if pathway.name.endswith(CARDIOPULMONARY)]
    beds = other.effector("Rmc")
    conductance = sum(1.0 / reference for reference in beds.reference)
    shares = [
        sum(gains[k] / reference**2 for reference, gains in zip(beds.reference, beds.gains, strict=True))
        / conductance
        for k in added
    ]

    def with_both(effector: Effector) -> Effector:
        resistance = effector.parameter == "Rmc"
        gains = tuple(
            (*(g * keep for g, keep in zip(bed, kept, strict=True)),
             *(share * reference * resistance for share in shares))
            for reference, bed in zip(effector.reference, effector.gains, strict=True)
        )  # fmt: skip
        return replace(effector, gains=gains, least=beds.least if resistance else effector.least)

    blood = own.blood_volume_ml / other.blood_volume_ml
    return replace(
        own,
        reads=other.reads,
        pathways=(*own.pathways, *(other.pathways[k]._replace(name=f"other_{k}") for k in added)),
        drives=lambda d: [*own.drives(d[: len(own.reads)]), *(other.drives(d)[k] for k in added)],
        effectors=tuple(map(with_both, own.effectors)),
        venous_gains_ml=(
            *(gain * keep for gain, keep in zip(own.venous_gains_ml, kept, strict=True)),
            *(blood * other.venous_gains_ml[k] for k in added),
        ),
    )


def with_cardiopulmonary(patient: Model, own: ReflexModel) -> Model:
    """Replace the reflex `heldt2010` of a patient by another one joined with its cardiopulmonary pathways."""
    return replace(patient, circuit=with_reflex(replace(patient.circuit, controllers=()), joined(own)))
