"""Blood marked on its way: effective clearance of a filter with recirculation, and origin of arterial blood.

Blood leaves every capillary bed with the solute's concentration in the tissues, which is set to 1, and leaves
the filter with what is not cleared. The blood that reaches the filter is a mixture of blood from the tissues
and blood that has just passed the filter (recirculation, through the access line or through heart and lungs).
The effective clearance is the amount removed divided by the concentration in the tissues: the filter's own
clearance times the concentration before it.

The same ratio of effective to own clearance holds for a substance that is added at the filter and metabolised
in the tissues (citrate): it is the share of what one pass leaves that reaches the tissues. With the share R
of the blood before the filter that comes from the filter, and the share 1 - k of the solute that one pass
leaves, the tissues receive (1 - k) (1 - R) / (1 - R (1 - k)) of the amount added.

On V-A ECMO the heart fills the aorta from its root and the pump from its cannula; the streams meet at the
mixing point. Blood is marked where it passes the mitral valve and where a device returns it to an artery; the
balances of `eclsim.gas.transport` give the share of each in every compartment. Mixing inside a compartment is
complete, so the number of aortic compartments limits the resolution of the mixing point.
"""

from __future__ import annotations

from functools import lru_cache

import jax.numpy as jnp
import numpy as np
from jax import Array

from eclsim.circuit.network import Circuit, sites_of
from eclsim.components.base import names_in, value_of
from eclsim.gas.network import PATIENT, FlowFunction, drainages, flows_of, switches, transport_of
from eclsim.gas.transport import Mixtures, mixtures

CAPILLARIES = ("sart", "upper", "lower")
"""Connections through the capillary beds of the body that a circuit may have."""


def effective_shares(circuit: Circuit, filtered: str) -> FlowFunction:
    """Ratios of effective to own clearance of the filter on a connection of a circuit.

    The last arguments are clearances [mL/min], then the flows of water that carry the solutes to the filter
    [mL/min]; the results are the ratios, one per clearance.
    """
    return _effective_shares(transport_of(circuit, exchanges=False), filtered)


@lru_cache(maxsize=64)
def _effective_shares(circuit: Circuit, filtered: str) -> FlowFunction:
    names = tuple(c.name for c in circuit.connections)
    mixing = [n for d in drainages(circuit) for n in names_in(d.mixing)]
    parameters = tuple(dict.fromkeys((*mixing, *switches(circuit))))

    def compute(numbers: Array) -> Array:
        count, last = len(names), 2 * len(names) + len(parameters)
        values = dict(zip(parameters, numbers[2 * count : last], strict=True))
        flows = flows_of(circuit, numbers[:count], numbers[count : 2 * count], values)
        drawn = [(d, jnp.asarray(value_of(values, d.mixing))) for d in drainages(circuit)]
        clearances, water = numbers[last:].reshape(2, -1)
        return _before_filter(mixtures(flows, sources(circuit, filtered), drawn), clearances / water)

    return FlowFunction(names, parameters, compute, ("effective", circuit, filtered))


def sources(circuit: Circuit, filtered: str) -> list[int]:
    """Indices of the connections that set concentrations: capillary beds, then the filter."""
    names = [c.name for c in circuit.connections]
    return [names.index(name) for name in (*CAPILLARIES, filtered) if name in names]


def _before_filter(mixed: Mixtures, cleared: Array) -> Array:
    """Concentration before the filter relative to the tissues; `cleared` is the share removed in one pass."""
    tissue, again = mixed.inlets[-1, :-1].sum(), mixed.inlets[-1, -1]
    return tissue / (1.0 - again * (1.0 - cleared))


# --- origin of arterial blood ---------------------------------------------------------------------

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
