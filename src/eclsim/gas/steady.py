"""The steady gas state: partial pressures at which every exchanger's equations hold at once.

Unknowns are the logarithms of PO2 and PCO2 at the points inside the exchangers, with the pH that belongs to
them: contents are then explicit. What enters an exchanger is a mixture of what leaves the others, so that a
patient with ECMO has about 20 unknowns however many compartments there are. Newton's method, with pH
eliminated point by point and the points of an exchanger cell by cell; derivatives with respect to all
parameters and flows by the implicit function theorem. Samples of mixed blood are solved along the way, each
by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, dtypes

from eclsim import runtime as _runtime  # noqa: F401  (double precision before the first array)
from eclsim.blood.acid_base import excess_of
from eclsim.blood.gases import law_named
from eclsim.blood.types import Blood
from eclsim.components.base import Values
from eclsim.components.exchangers import BLOOD, GasExchanger, Points
from eclsim.gas.elimination import Inside, eliminated, mixed_changes, moved, responses
from eclsim.gas.transport import Mixtures

ITERATIONS = 200
PLAIN_ITERATIONS = 40
"""Of a search that begins with the whole exchange; then it begins anew with little of it."""
LEAST_EXCHANGE, SETTLED = 2.0**-9, 0.1
"""Share of the exchange with which it begins anew; the last step below which that share is raised."""
RAISED = 1.4
"""By how much."""
TOLERANCE = 1e-6
"""Of the last step but one, in the logarithm of a partial pressure; the last one squares it."""
LARGEST_STEP = 1.0
INERTIA = 5.0
"""At the start of a search [L/min]."""
LOWEST, HIGHEST = -14.0, 8.0
"""Of the logarithm of a partial pressure in mmHg."""


class GasState(NamedTuple):
    """The steady gas state of one patient.

    Attributes:
        pressure: logarithm of PO2 and PCO2 at the points of all exchangers, then of the samples, (2, points).
        ph: there, (points,).
        saturation: there [-], (points,).
        content: there [mL/dL], (2, points).
        outlets: contents of what leaves each exchanger [mL/dL], (2, exchangers).
        inlets: contents of what enters each exchanger [mL/dL], (2, exchangers).
        gained: gas that blood gained in each exchanger [mL/min STPD], (2, exchangers).
        steps: iterations of Newton's method.
        error: its last step.
    """

    pressure: Array
    ph: Array
    saturation: Array
    content: Array
    outlets: Array
    inlets: Array
    gained: Array
    steps: Array
    error: Array


class Samples(NamedTuple):
    """Blood whose gases are wanted besides that inside exchangers.

    Attributes:
        shares: of what leaves each exchanger, (samples, exchangers).
        kept: over a step in time, contents from blood that compartments held [mL/dL], (samples, 2).
    """

    shares: Array
    kept: Array | None = None


class _Local(NamedTuple):
    """Blood at all points, and how it changes with the unknowns there, pH eliminated."""

    content: Array  # (2, points)
    slope: Array  # (points,)
    content_by: Array  # (2 contents, 2 pressures, points)
    slope_by: Array  # (2 pressures, points)
    acid: Array  # residual of the acid-base equation over its slope (points,)
    acid_by: Array  # change of pH with the pressures (2, points)


class _Network(NamedTuple):
    """What the equations of all exchangers need besides the unknowns."""

    exchangers: tuple[GasExchanger, ...]
    mixed: Mixtures
    samples: Samples
    values: Values
    law: str

    @property
    def count(self) -> int:
        """Number of points inside exchangers."""
        return sum(e.points for e in self.exchangers)

    @property
    def places(self) -> list[slice]:
        """Points of each exchanger."""
        ends = np.cumsum([0, *(e.points for e in self.exchangers)]).tolist()
        return [slice(*pair) for pair in pairwise(ends)]

    def frozen(self) -> _Network:
        """The same, not differentiated."""
        mixed, samples, values = jax.lax.stop_gradient((self.mixed, self.samples, dict(self.values)))
        return _Network(self.exchangers, mixed, samples, values, self.law)


class _Search(NamedTuple):
    """Where the search for the steady state is."""

    pressure: Array
    ph: Array
    inertia: Array
    share: Array
    missing: Array
    steps: Array
    error: Array
    last: Array


def blood_of(values: Values) -> Blood:
    """What describes the blood of a patient apart from its gases."""
    return Blood(*(values[name] for name in BLOOD))


def solve(
    exchangers: Sequence[GasExchanger],
    mixed: Mixtures,
    values: Values,
    law: str = "severinghaus1979",
    samples: Samples | None = None,
) -> GasState:
    """The steady gas state of one patient; map over patients with `jax.vmap`.

    Args:
        exchangers: in the order of `mixed`.
        mixed: what enters each exchanger.
        values: parameters of the exchangers and of the blood.
        law: of the blood.
        samples: blood whose gases are wanted too.
    """
    samples = Samples(jnp.zeros((0, len(exchangers)))) if samples is None else samples
    network = _Network(tuple(exchangers), mixed, samples, values, law)
    end = _searched(network.exchangers, law, mixed, samples, {k: jnp.asarray(v) for k, v in values.items()})
    content, _, saturation, _ = _properties(law, blood_of(values), end.pressure, end.ph)
    outlets, inlets = _streams(network, content)
    gained = 10.0 * mixed.streams * (outlets - inlets)
    return GasState(end.pressure, end.ph, saturation, content, outlets, inlets, gained, end.steps, end.error)


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _searched(
    exchangers: tuple[GasExchanger, ...], law: str, mixed: Mixtures, samples: Samples, values: Values
) -> _Search:
    """The end of the search; one step more than `TOLERANCE` asks for."""
    network = _Network(exchangers, mixed, samples, values, law)
    acid = partial(_acid_step, law, blood_of(values))

    def unfinished(state: _Search) -> Array:
        return (state.steps < ITERATIONS) & ~state.last

    def improve(state: _Search) -> _Search:
        whole = state.share == 1.0
        last = whole & (state.error <= TOLERANCE)
        move, move_ph, size = _newton_step(network, state.pressure, state.ph, state.inertia, state.share)
        solved = jnp.isfinite(move).all() & jnp.isfinite(move_ph).all()
        move, move_ph = jnp.where(solved, move, 0.0), jnp.where(solved, move_ph, 0.0)
        pressure = jnp.clip(state.pressure + jnp.clip(move, -LARGEST_STEP, LARGEST_STEP), LOWEST, HIGHEST)
        ph = jnp.clip(state.ph + jnp.clip(move_ph, -0.5, 0.5), 4.0, 12.0)
        ph = acid(pressure, ph)
        error = jnp.where(solved, jnp.maximum(jnp.abs(move).max(), jnp.abs(move_ph).max()), jnp.inf)
        # Inertia follows what is missing, so that the last steps are Newton's.
        ratio = jnp.clip(size / state.missing, 0.1, 2.0)
        inertia = 0.5 * state.inertia * ratio
        inertia = jnp.where((size < 1e-4) | (state.inertia < 1e-6) | (error <= TOLERANCE), 0.0, inertia)
        # Without a step to take, as in blood that gains and loses nothing, the search ends where it is.
        steps = jnp.where(solved, state.steps + 1, ITERATIONS)
        share = jnp.where(error < SETTLED, jnp.minimum(RAISED * state.share, 1.0), state.share)
        error = jnp.where(whole, error, jnp.inf)
        reached = _Search(pressure, ph, inertia, share, size, steps, error, last)
        anew = start._replace(share=jnp.array(LEAST_EXCHANGE), steps=steps)
        lost = (steps == PLAIN_ITERATIONS) & ~last
        return jax.tree.map(lambda a, b: jnp.where(lost, a, b), anew, reached)

    points = network.count + samples.shares.shape[0]
    pressure = jnp.log(jnp.stack([jnp.full(points, 60.0), jnp.full(points, 42.0)]))
    far, begun = jnp.array(jnp.inf), jnp.array(0)
    inertia, whole = jnp.array(INERTIA), jnp.array(1.0)
    start = _Search(pressure, jnp.full(points, 7.4), inertia, whole, far, begun, far, jnp.array(False))
    return jax.lax.while_loop(unfinished, improve, start)


@_searched.defjvp
def _derivative(
    exchangers: tuple[GasExchanger, ...],
    law: str,
    arguments: tuple[Mixtures, Samples, Values],
    changes: tuple[Mixtures, Samples, Values],
) -> tuple[_Search, _Search]:
    """By the implicit function theorem: how Newton's step from the solution follows what is given."""
    end = _searched(exchangers, law, *arguments)

    def step(mixed: Mixtures, samples: Samples, values: Values) -> tuple[Array, Array]:
        network = _Network(exchangers, mixed, samples, values, law)
        return _newton_step(network, end.pressure, end.ph, 0.0)[:2]

    _, (by, by_ph) = jax.jvp(step, arguments, changes)
    constant = jax.tree.map(
        lambda x: np.zeros(x.shape, dtypes.float0 if x.dtype.kind in "ib" else x.dtype), end
    )
    return end, constant._replace(pressure=by, ph=by_ph)


def _properties(law: str, blood: Blood, pressure: Array, ph: Array) -> tuple[Array, Array, Array, Array]:
    """Contents (2, points), slope of the saturation curve, saturation, residual of the acid-base equation."""
    chosen = law_named(law)
    po2, pco2 = jnp.exp(pressure[0]), jnp.exp(pressure[1])

    def saturation(at: Array) -> Array:
        return chosen.saturation(at, pco2, ph, blood)

    saturated, slope = jax.jvp(saturation, (po2,), (jnp.ones_like(po2),))
    content = jnp.stack(
        [chosen.oxygen_content(po2, pco2, ph, blood), chosen.carbon_dioxide_content(po2, pco2, ph, blood)]
    )
    return content, slope, saturated, jnp.asarray(excess_of(pco2, ph, saturated, blood))


def _local(law: str, blood: Blood, pressure: Array, ph: Array) -> _Local:
    """Properties of blood at all points with their derivatives; every point depends on itself alone.

    The derivatives are not differentiated: at the solution they are multiplied by a residual that is zero.
    """
    content, slope, _, residual = _properties(law, blood, pressure, ph)
    _, along = jax.linearize(partial(_properties, law, jax.lax.stop_gradient(blood)), pressure, ph)
    directions = jnp.broadcast_to(jnp.eye(3)[:, :, None], (3, 3, ph.shape[0]))
    content_by, slope_by, _, residual_by = jax.vmap(lambda d: along(d[:2], d[2]))(directions)
    acid_by, acid = -residual_by[:2] / residual_by[2], -residual / residual_by[2]
    return _Local(
        content + content_by[2] * acid,
        slope + slope_by[2] * acid,
        jnp.swapaxes(content_by[:2] + content_by[2] * acid_by[:, None], 0, 1),
        slope_by[:2] + slope_by[2] * acid_by,
        acid,
        acid_by,
    )


def _streams(network: _Network, content: Array) -> tuple[Array, Array]:
    """Contents of what leaves and of what enters each exchanger, both (2, exchangers).

    A lung lets blood past it, so what leaves depends on what enters, and that on what leaves the others:
    linear, and solved here.
    """
    shares = jnp.stack([jnp.asarray(e.exchanging(network.values)) for e in network.exchangers])
    last = content[:, np.array([place.stop - 1 for place in network.places])]
    matrix = jnp.eye(len(shares)) - (1.0 - shares)[:, None] * network.mixed.inlets
    from_held = 0.0 if network.mixed.kept is None else network.mixed.kept[2].T
    outlets = _small_solved(matrix, (shares * last + (1.0 - shares) * from_held).T).T
    return outlets, (network.mixed.inlets @ outlets.T).T + from_held


def _small_solved(matrix: Array, right: Array) -> Array:
    """Gauss' elimination without pivots: rows of `matrix` are 1 less shares that sum to less than 1."""
    rows = [jnp.concatenate(pair) for pair in zip(matrix, right, strict=True)]
    for k in range(len(rows)):
        rows[k] = rows[k] / rows[k][k]
        rows = [row if j == k else row - row[k] * rows[k] for j, row in enumerate(rows)]
    return jnp.stack([row[len(rows) :] for row in rows])


def _missing(
    network: _Network, pressure: Array, content: Array, slope: Array, ph: Array, share: Array | float
) -> tuple[list[Points], Array]:
    """Blood inside every exchanger, and what the equations of all miss [mL/min STPD], (2, points)."""
    inlets, points, missed = _streams(network, content)[1], [], []
    for k, (e, place) in enumerate(zip(network.exchangers, network.places, strict=True)):
        stream, (cells, weights) = network.mixed.streams[k], e.collocation
        exchanging = 10.0 * stream * jnp.asarray(e.exchanging(network.values))
        gained = exchanging * (content[:, place] - inlets[:, k, None])
        points.append(Points(gained, jnp.exp(pressure[:, place]), slope[place], ph[place]))
        reached = gained.reshape(2, cells, -1)
        before = jnp.pad(reached[:, :-1, -1:], ((0, 0), (1, 0), (0, 0)))
        rates = e.rates(stream, points[-1], network.values).reshape(2, cells, -1)
        within = sum(rates[..., i, None] * weights[:, i] for i in range(len(weights))) / cells
        missed.append((reached - before - share * within).reshape(2, -1))
    return points, jnp.concatenate(missed, axis=1)


def _acid_step(law: str, blood: Blood, pressure: Array, ph: Array) -> Array:
    """pH after one step towards the acid-base balance at given pressures."""
    residual, slope = jax.jvp(
        lambda at: _properties(law, blood, pressure, at)[3], (ph,), (jnp.ones_like(ph),)
    )
    return ph - jnp.clip(residual / slope, -0.5, 0.5)


def _newton_step(
    network: _Network, pressure: Array, ph: Array, inertia: Array | float, share: Array | float = 1.0
) -> tuple[Array, Array, Array]:
    """Newton's step for the pressures and for pH, and the largest equation not met [mL/dL].

    The linear equations are not differentiated. With inertia the contents change as in blood that is
    stored: an implicit step in time. A share of the exchange makes steps small where all of it uses up a gas.
    """
    count = network.count
    local = _local(network.law, blood_of(network.values), pressure, ph)
    points, value = _missing(network, pressure, local.content, local.slope, ph + local.acid, share)
    steady = network.frozen()
    fixed, at = jax.lax.stop_gradient((local, points))
    equations = [
        eliminated(
            e, steady.mixed.streams[k],
            Inside(at[k], fixed.content_by[..., place], fixed.slope_by[:, place], fixed.acid_by[:, place]),
            steady.values, inertia, share,
        )
        for k, (e, place) in enumerate(zip(network.exchangers, network.places, strict=True))
    ]  # fmt: skip
    parts = [responses(e, value[:, place]) for e, place in zip(equations, network.places, strict=True)]
    shares = jnp.stack([jnp.asarray(e.exchanging(steady.values)) for e in network.exchangers])
    changes = mixed_changes(
        steady.mixed.inlets,
        jnp.stack([e.outlet_by for e in equations], axis=-1),
        shares * jnp.stack([reached for _, reached in parts], axis=-1),
    )
    entering = changes @ steady.mixed.inlets.T
    move = [moved(e, m, entering[:, k]) for k, (e, (m, _)) in enumerate(zip(equations, parts, strict=True))]
    outlets = _streams(network, local.content)[0] + changes
    (a, b), (c, d) = fixed.content_by[:, :, count:]
    from_held = 0.0 if network.samples.kept is None else network.samples.kept.T
    oxygen, carbon_dioxide = outlets @ network.samples.shares.T + from_held - local.content[:, count:]
    sampled = jnp.stack([d * oxygen - b * carbon_dioxide, a * carbon_dioxide - c * oxygen]) / (a * d - b * c)
    move = jnp.concatenate([*move, sampled], axis=1)
    passing = np.repeat(np.arange(len(equations)), [e.points for e in network.exchangers])
    size = jnp.abs(value / (10.0 * network.mixed.streams[passing])).max()
    return move, local.acid + (fixed.acid_by * move).sum(axis=0), size
