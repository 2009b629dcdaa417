"""Origin of arterial blood: from the left heart, or from a pump that returns to arteries.

On V-A ECMO the heart fills the aorta from its root and the pump from its cannula; the streams meet at the
mixing point. Blood is marked where it passes the mitral valve and where a device returns it to an artery; the
balances of `eclsim.gas.transport` give the share of each in every compartment. Mixing inside a compartment is
complete, so the number of aortic compartments limits the resolution of the mixing point.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from jax import Array

from eclsim.circuit.network import Circuit, sites_of
from eclsim.gas.network import PATIENT, FlowFunction, flows_of, switches, transport_of
from eclsim.gas.transport import mixtures

MITRAL = "la"
"""Connection through which all native blood flows (mitral valve)."""
ARTERIES = ("ao", "arch", "descending", "upper", "lower")
"""Arteries of a patient with regional circulation."""


def native_shares(circuit: Circuit) -> FlowFunction:
    """Share of native blood in each of `ARTERIES`, in a circuit with regions."""
    return _native_shares(transport_of(circuit, exchanges=False))


@lru_cache(maxsize=64)
def _native_shares(circuit: Circuit) -> FlowFunction:
    names = tuple(c.name for c in circuit.connections)
    stores = [c.name for c in circuit.compartments]
    parameters, sources = switches(circuit), [names.index(MITRAL), *_arterial_returns(circuit)]
    places = np.array([stores.index(name) for name in ARTERIES])

    def compute(numbers: Array) -> Array:
        count = len(names)
        values = dict(zip(parameters, numbers[2 * count :], strict=True))
        flows = flows_of(circuit, numbers[:count], numbers[count : 2 * count], values)
        shares = mixtures(flows, sources).compartments[places]
        return shares[:, 0] / shares.sum(axis=1)

    return FlowFunction(names, parameters, compute, ("origin", circuit))


def _arterial_returns(circuit: Circuit) -> list[int]:
    """Indices of the connections by which a device returns blood to an artery."""
    groups = {c.name: c.group for c in circuit.compartments}
    return [
        k
        for k, c in enumerate(circuit.connections)
        if all(groups[site] != PATIENT for site in sites_of(c.source))
        if any(site in ARTERIES for site in sites_of(c.target))
    ]
