"""How blood carries what is dissolved in it: balances of well mixed compartments with the beat's mean flows.

Every compartment mixes what flows into it. With the means over a beat of the forward and the backward flow of
each connection, the steady balance of a content c is

    sum over what arrives (flow x content it carries) = sum over what leaves (flow x content drawn),

linear in the contents of the compartments. Exchangers change what their connection carries, so the blood of
every compartment is a mixture of what leaves the exchangers, with shares that follow from the flows alone.
One solution serves oxygen, carbon dioxide, a tracer and any solute.

In time, compartments hold blood: an implicit step of length h from contents c to c' is the same balance with

    c' V' / h = what arrives - what leaves + c V / h,

in which what a compartment held flows in as V / h and what it comes to hold flows out as V' / h.
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
"""Exchange along every connection in both directions, so that standing blood has a content too."""


@dataclass(frozen=True)
class Drainage:
    """A connection that may draw the blood of the veins before it has mixed with that of its compartment.

    Args:
        connection: position of the connection.
        returns: positions of connections that bring blood to the compartment and are no veins.
        mixing: parameter or number: 1 = the compartment's blood is drawn, 0 = that of the veins. Where
            drains ask for more venous blood than arrives, the rest is the compartment's.
    """

    connection: int
    returns: tuple[int, ...]
    mixing: Key


class Flows(NamedTuple):
    """Compartments joined by flows.

    Attributes:
        leaves: which compartment each connection begins at, (compartments, connections).
        enters: which it ends at, likewise.
        forward: mean over the beat of the forward flow of each connection [L/min], (connections,).
        backward: of its backward flow, positive, likewise.
    """

    leaves: Array
    enters: Array
    forward: Array
    backward: Array

    @property
    def numbers(self) -> ModuleType:
        """The library that computes with them: NumPy with its own arrays, where no derivative is needed."""
        return np if all(isinstance(part, np.ndarray) for part in self) else jnp


class HeldBlood(NamedTuple):
    """Blood that compartments hold over a step in time.

    Attributes:
        before: volume at its beginning over its length [L/min], (compartments,).
        after: volume at its end over its length, likewise.
        contents: at its beginning [mL/dL], (compartments, species).
    """

    before: Array
    after: Array
    contents: Array


def _solved(numbers: ModuleType, matrix: Array, offsets: Array) -> Array:
    return numbers.linalg.solve(matrix, offsets) if numbers is np else solution(matrix, offsets)


def balanced(flows: Flows, held: HeldBlood | None = None) -> Flows:
    """The nearest flows that leave every compartment as much as they enter it, to rounding.

    A beat that is periodic to 1e-9 fills or empties its compartments a little; gas would be made from that.
    Over a step in time they fill each compartment by what it comes to hold.
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
    """Composition of blood, as shares of the blood that leaves each exchanger.

    Attributes:
        compartments: shares in each compartment, (compartments, exchangers); rows sum to 1.
        drawn: shares in what each connection draws forward, (connections, exchangers).
        inlets: shares in what enters each exchanger, (exchangers, exchangers).
        streams: flow through each exchanger [L/min], (exchangers,).
        kept: over a step in time, what the first three have besides, from blood that compartments held
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
    """Solve the balances for blood of content 1 behind each exchanger.

    An exchanger acts on the larger one of its connection's two streams; the other passes unchanged.

    Args:
        flows: balanced.
        exchangers: positions of the connections they sit on, each once.
        drainages: with the value of each one's mixing.
        held: what compartments hold over a step in time; left out, the steady balances.
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
    behind = enters.T  # what a backward stream carries off is the blood of its connection's target

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
    """A drain's mixing, with no more blood of the veins than arrives at the compartment of all its drains."""
    xp = flows.numbers
    wanted = sum(
        ((source @ flows.leaves[:, one.connection]) * (1.0 - m) * flows.forward[one.connection])
        for one, m in drainages
    )
    share = arriving / xp.maximum(wanted, 1e-12)
    return xp.asarray(xp.where(share >= 1.0, mixing, 1.0 - (1.0 - mixing) * share))
