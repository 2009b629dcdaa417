"""Effect of a filter on the patient: a solute that tissues keep up and a filter takes from the blood.

Blood leaves every capillary bed with the concentration of the tissues, 1, and the filter with what it has
not cleared. The mixtures of the circuit say what reaches the filter: blood of the tissues, and blood that has
just passed the filter (recirculation, by the access line or by way of heart and lungs). What the filter
removes, over the concentration in the tissues, is the effective clearance: its own clearance times the
concentration before it.

What is added at the filter and stays in the tissues (citrate, which they burn) reaches them with the same
share of what one pass lets out: with the share R of the blood before the filter that comes from it, and 1 - k
of a solute left behind it, (1 - k) (1 - R) / (1 - R (1 - k)).
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
"""Connections through the capillary beds of the body, where a circuit has them."""


def effective_shares(circuit: Circuit, filtered: str) -> FlowFunction:
    """Effective over own clearances of the filter on a connection of a circuit.

    At the end of the numbers stand clearances [mL/min], then the flows of water that carry the solutes to the
    filter; each clearance gives the share of it that is for the patient.
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
    """Positions of the connections that set concentrations: capillary beds, then the filter."""
    names = [c.name for c in circuit.connections]
    return [names.index(name) for name in (*CAPILLARIES, filtered) if name in names]


def _before_filter(mixed: Mixtures, cleared: Array) -> Array:
    """Concentration before the filter over that of the tissues; `cleared` of what enters stays in it."""
    tissue, again = mixed.inlets[-1, :-1].sum(), mixed.inlets[-1, -1]
    return tissue / (1.0 - again * (1.0 - cleared))
