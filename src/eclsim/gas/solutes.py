"""Effective clearance of a filter for the patient, with recirculation taken into account.

Blood leaves every capillary bed with the solute's concentration in the tissues, which is set to 1, and leaves
the filter with what is not cleared. The blood that reaches the filter is a mixture of blood from the tissues
and blood that has just passed the filter (recirculation, through the access line or through heart and lungs).
The effective clearance is the amount removed divided by the concentration in the tissues: the filter's own
clearance times the concentration before it.

The same ratio of effective to own clearance holds for a substance that is added at the filter and metabolised
in the tissues (citrate): it is the share of what one pass leaves that reaches the tissues. With the share R
of the blood before the filter that comes from the filter, and the share 1 - k of the solute that one pass
leaves, the tissues receive (1 - k) (1 - R) / (1 - R (1 - k)) of the amount added.
"""

from __future__ import annotations

from functools import lru_cache

import jax.numpy as jnp
from jax import Array

from eclsim.circuit.network import Circuit
from eclsim.components.base import names_in, value_of
from eclsim.gas.network import FlowFunction, drainages, flows_of, switches, transport_of
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
