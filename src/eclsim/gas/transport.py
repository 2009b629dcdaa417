"""Transport of solutes in blood: balances of well-mixed compartments with the beat's mean flows.

Every compartment mixes its inflows. With the means over a beat of the forward and the backward flow of each
connection, the steady balance of a content c is

    sum over inflows (flow x content carried) = sum over outflows (flow x content drawn),

which is linear in the contents of the compartments. Exchangers change the content that their connection
carries, so the blood of every compartment is a mixture of the outflows of exchangers, with shares that depend
only on the flows. The same shares serve oxygen, carbon dioxide, a tracer and any solute.

In time, compartments hold blood: an implicit step of length h from contents c to c' is the same balance with

    c' V' / h = inflows - outflows + c V / h,

in which the former volume V of a compartment is an inflow V / h and the new volume V' an outflow V' / h.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from eclsim.components.base import Key
from eclsim.gas.linear_systems import solution

DIFFUSION_L_MIN = 1e-9
"""Exchange flow in both directions along every connection; defines the content of stagnant blood."""


@dataclass(frozen=True)
class Drainage:
    """A connection that may draw venous blood before it has mixed with that of the compartment.

    Args:
        connection: index of the connection.
        returns: indices of connections that bring blood to the compartment and are not veins.
        mixing: parameter or number: 1 to draw the compartment's blood, 0 to draw venous blood. If the drains
            need more venous blood than arrives, the rest is the compartment's.
    """

    connection: int
    returns: tuple[int, ...]
    mixing: Key


class Flows(NamedTuple):
    """Compartments joined by flows.

    Attributes:
        leaves: 1 for the compartment at which each connection begins, (compartments, connections).
        enters: 1 for the compartment at which each connection ends, (compartments, connections).
        forward: mean forward flow of each connection over the beat [L/min], (connections,).
        backward: mean backward flow of each connection over the beat [L/min], positive, (connections,).
    """

    leaves: Array
    enters: Array
    forward: Array
    backward: Array

    @property
    def numbers(self) -> ModuleType:
        """Array library for these flows: NumPy for NumPy arrays (no derivatives needed), otherwise JAX."""
        return np if all(isinstance(part, np.ndarray) for part in self) else jnp


class HeldBlood(NamedTuple):
    """Blood that compartments hold over a step in time.

    Attributes:
        before: volumes at the beginning divided by the step's length [L/min], (compartments,).
        after: volumes at the end divided by the step's length [L/min], (compartments,).
        contents: contents at the beginning [mL/dL], (compartments, species).
    """

    before: Array
    after: Array
    contents: Array


def _solved(numbers: ModuleType, matrix: Array, offsets: Array) -> Array:
    return numbers.linalg.solve(matrix, offsets) if numbers is np else solution(matrix, offsets)


def balanced(flows: Flows, held: HeldBlood | None = None) -> Flows:
    """The nearest flows for which inflow and outflow of every compartment are equal to rounding.

    A beat that is periodic to 1e-9 still fills or empties its compartments slightly, which would create gas.
    In a step in time the net inflow of each compartment equals its change of volume.
    """
    xp = flows.numbers
    change = flows.enters - flows.leaves
    net = flows.forward - flows.backward
    laplacian = change @ change.T + 1.0 / change.shape[0]
    excess = change @ net if held is None else change @ net - (held.after - held.before)
    extra = -change.T @ _solved(xp, laplacian, excess[:, None])[:, 0]
    forward = flows.forward + xp.maximum(extra, 0.0) + DIFFUSION_L_MIN
    backward = flows.backward + xp.maximum(-extra, 0.0) + DIFFUSION_L_MIN
    return flows._replace(forward=forward, backward=backward)


class Mixtures(NamedTuple):
    """Composition of blood, as shares of the outflow of each exchanger.

    Attributes:
        compartments: shares in each compartment, (compartments, exchangers); rows sum to 1.
        drawn: shares in the blood that each connection draws forward, (connections, exchangers).
        inlets: shares in the inflow of each exchanger, (exchangers, exchangers).
        streams: flow through each exchanger [L/min], (exchangers,).
        kept: in a step in time, the additional contents of the first three from blood that compartments held
            [mL/dL], each (..., species); shares then sum to less than 1.
    """

    compartments: Array
    drawn: Array
    inlets: Array
    streams: Array
    kept: tuple[Array, Array, Array] | None = None


def mixtures(
    flows: Flows,
    exchangers: Sequence[int],
    drainages: Sequence[tuple[Drainage, Array]] = (),
    held: HeldBlood | None = None,
) -> Mixtures:
    """Solve the balances for unit content in the outflow of each exchanger.

    An exchanger acts on the larger of its connection's two streams; the other stream passes unchanged.

    Args:
        flows: balanced flows.
        exchangers: indices of the connections with an exchanger, each once.
        drainages: drainages, each with the value of its mixing.
        held: blood held by compartments over a step in time; None for the steady balances.
    """
    leaves, enters, forward, backward = flows
    xp = flows.numbers
    at = np.asarray(exchangers, dtype=int)
    sent = np.zeros((forward.shape[0], len(at)))
    sent[at, np.arange(len(at))] = 1.0
    ahead = forward >= backward
    acts = sent.sum(axis=1)
    forward_acts, backward_acts = xp.where(ahead, acts, 0.0), xp.where(ahead, 0.0, acts)
    arriving = (forward * forward_acts)[:, None] * sent, (backward * backward_acts)[:, None] * sent
    drawn, drawn_sent = _drawn_blood(flows, forward_acts, backward_acts, arriving, drainages)
    behind = enters.T  # a backward stream carries the blood of its connection's target

    change = enters - leaves
    taken_forward, taken_backward = enters * (forward * forward_acts), leaves * (backward * backward_acts)
    pull = change * forward - taken_forward
    matrix = pull @ drawn - (change * backward + taken_backward) @ behind
    offsets = pull @ drawn_sent + enters @ arriving[0] + leaves @ arriving[1]
    streams = xp.maximum(forward, backward)[at]
    if held is not None:
        count = offsets.shape[1]
        matrix = matrix - xp.diag(held.after)
        offsets = xp.concatenate([offsets, held.before[:, None] * held.contents], axis=1)
        drawn_sent = xp.concatenate([drawn_sent, xp.zeros((len(drawn_sent), held.contents.shape[1]))], axis=1)
    compartments = _solved(xp, matrix, -offsets)
    all_drawn = drawn @ compartments + drawn_sent
    inlets = xp.where(ahead[:, None], all_drawn, behind @ compartments)[at]
    if held is None:
        return Mixtures(compartments, all_drawn, inlets, streams)
    from_held = compartments[:, count:], all_drawn[:, count:], inlets[:, count:]
    return Mixtures(compartments[:, :count], all_drawn[:, :count], inlets[:, :count], streams, from_held)


def _drawn_blood(
    flows: Flows,
    forward_acts: Array,
    backward_acts: Array,
    arriving: tuple[Array, Array],
    drainages: Sequence[tuple[Drainage, Array]],
) -> tuple[Array, Array]:
    """Origin of the forward flow through every connection, as shares of compartments and exchangers."""
    leaves, enters, forward, backward = flows
    xp = flows.numbers
    drawn, drawn_sent = xp.asarray(leaves.T), xp.zeros_like(arriving[0])
    for drainage, mixing in drainages:
        source = leaves[:, drainage.connection]
        veins = np.ones(forward.shape[0])
        veins[[drainage.connection, *drainage.returns]] = 0.0
        to, back = (source @ enters) * veins, (source @ leaves) * veins
        total = to @ forward + back @ backward
        from_sources = (to * forward * (1.0 - forward_acts)) @ leaves.T
        from_targets = (back * backward * (1.0 - backward_acts)) @ enters.T
        from_exchangers = to @ arriving[0] + back @ arriving[1]
        j = drainage.connection
        mixing = _allowed_mixing(mixing, total, flows, drainages, source)
        drawn = drawn.at[j].set(
            mixing * leaves[:, j] + (1.0 - mixing) * (from_sources + from_targets) / total
        )
        drawn_sent = drawn_sent.at[j].set((1.0 - mixing) * from_exchangers / total)
    return drawn, drawn_sent


def _allowed_mixing(
    mixing: Array, arriving: Array, flows: Flows, drainages: Sequence[tuple[Drainage, Array]], source: Array
) -> Array:
    """A drain's mixing, limited so that all drains draw no more venous blood than arrives."""
    xp = flows.numbers
    wanted = sum(
        ((source @ flows.leaves[:, one.connection]) * (1.0 - m) * flows.forward[one.connection])
        for one, m in drainages
    )
    share = arriving / xp.maximum(wanted, 1e-12)
    return xp.asarray(xp.where(share >= 1.0, mixing, 1.0 - (1.0 - mixing) * share))
