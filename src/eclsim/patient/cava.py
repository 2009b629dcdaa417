"""Veins that collapse: the thoracic vena cava between the systemic veins and the right atrium.

    svn ----> tvc --[ R(V) ]--> ra          svc, ivc ----> tsvc, tivc --[ R(V) ]--> ra
    (veins)   (thoracic vena cava)          (in regions)

It takes its compliance and its resistance from the published veins, so that a vein filled to the published
4 mmHg has with it the compliance, the blood above zero pressure and the resistance that it has without it.
Below, it collapses, and the right heart empties, whose published laws go on to volumes below zero. Devices
that are connected to the veins draw from the vena cava, through its resistance.

Sources of the values: `eclsim.parameters.physiology`.
"""

from __future__ import annotations

from dataclasses import replace

from eclsim.circuit.network import Circuit, Compartment, Connection
from eclsim.components import (
    CollapsibleChamber,
    CollapsibleVein,
    Complement,
    ElasticVessel,
    Resistance,
    Scaled,
)
from eclsim.components.base import Key
from eclsim.parameters.physiology import CAVAL_BLOOD, CAVAL_SHARE
from eclsim.patient.sites import DRAINED

PUBLISHED_MMHG = 4.0
"""Start pressure of the published veins, at which the vena cava has the resistance of its parameter."""
_RESISTANCE = "caval_resistance_share"
_RIGHT_HEART = ("ra", "rv")


def with_collapsible_veins(circuit: Circuit) -> Circuit:
    """A patient whose veins next to the heart collapse and whose right heart holds no less than nothing."""
    veins = {c.name: c for c in circuit.compartments if c.name in DRAINED}
    stores, paths = list[Compartment](), list[Connection]()
    for store in circuit.compartments:
        if store.name in veins:
            stores += _divided(store, circuit.connection(store.name))
        else:
            stores.append(_emptied(store) if store.name in _RIGHT_HEART else store)
    for path in circuit.connections:
        paths += _through(path) if path.name in veins else [path]
    return replace(circuit, compartments=tuple(stores), connections=tuple(paths))


def _times(total: Key, share: Key) -> Scaled:
    """A share of a key that may be a share itself."""
    return replace(total, by=(*total.by, share)) if isinstance(total, Scaled) else Scaled(total, (share,))


def _divided(vein: Compartment, path: Connection) -> tuple[Compartment, Compartment]:
    """The veins without the vena cava, and the vena cava."""
    law, inlet = vein.component, path.component
    assert isinstance(law, ElasticVessel)
    assert isinstance(inlet, Resistance)
    assert vein.total_fraction is not None
    rest = replace(
        vein,
        component=replace(law, compliance=_times(law.compliance, Complement(CAVAL_SHARE))),
        total_fraction=_times(vein.total_fraction, Complement(CAVAL_BLOOD)),
    )
    regions = law.compliance.by if isinstance(law.compliance, Scaled) else ()
    cava = CollapsibleVein(
        _times(law.compliance, CAVAL_SHARE), Scaled("caval_rest_volume_ml", regions), "caval_collapse_mmHg",
        _times(inlet.ohmic, _RESISTANCE), PUBLISHED_MMHG,
    )  # fmt: skip
    return rest, Compartment(DRAINED[vein.name], cava, start=vein.start)


def _through(path: Connection) -> tuple[Connection, Connection]:
    """From the veins into the vena cava, and from there to where the veins led."""
    assert isinstance(path.component, Resistance)
    inlet = Resistance(_times(path.component.ohmic, Complement(_RESISTANCE)))
    cava = DRAINED[path.name]
    return replace(path, component=inlet, target=cava), Connection(cava, Resistance(0.0), cava, path.target)


def _emptied(chamber: Compartment) -> Compartment:
    return replace(chamber, component=CollapsibleChamber(chamber.component, "chamber_emptying_ml"))
