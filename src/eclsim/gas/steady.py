"""Steady gas state: partial pressures at which the equations of all exchangers hold simultaneously.

Unknowns are the logarithms of PO2 and PCO2 at the points inside the exchangers, and the pH there, with which
contents are explicit. The inflow of an exchanger is a mixture of the outflows of the others, so a patient
with ECMO has about 20 unknowns, independent of the number of compartments. They are solved by Newton's
method, with pH eliminated point by point and the points of an exchanger cell by cell. Derivatives with
respect to all parameters and flows follow from the implicit function theorem. Samples of mixed blood are
solved in the same iterations, each independently.

The gas that blood has gained up to a point is a further unknown, eliminated in every step (Albersmeyer and
Diehl 2010, doi 10.1137/080724885): 1 % of a pressure in blood corresponds to as much gas as a low sweep
brings, and rates evaluated at the gain computed from contents would see the sweep gas used up or returned. If
Newton's method does not converge, the gas state is followed in pseudo-time from the start by implicit steps
as long as the changes of pressures allow.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from eclsim.blood.acid_base import excess_of
from eclsim.blood.gases import law_named
from eclsim.blood.types import Blood
from eclsim.components.base import Values
from eclsim.components.exchangers import BLOOD, GasExchanger, Points
from eclsim.gas.elimination import (
    LinearisedBlood,
    linear_exchanger,
    mixed_changes,
    pressure_changes,
    responses,
)
from eclsim.gas.transport import Mixtures
from eclsim.runtime import not_inlined

ITERATIONS, PLAIN_ITERATIONS = 1800, 40
"""Iterations of a search, and of its first part, after which the search continues in pseudo-time."""
PSEUDO_TIME_STAGES = ((PLAIN_ITERATIONS, 0.3), (160, 0.1), (440, 0.02))
"""Iterations at which a pseudo-time stage begins, and its target change of the logarithms per step."""
SMALL_PRESSURE_MMHG = 2.0
"""Pressure [mmHg] below which a change of its logarithm counts less, as blood holds very little gas there."""
MOST_INERTIA, LEAST_INERTIA, LAST_CHANGE = 1e4, 1e-6, 1e-4
"""Limits of the inertia of pseudo-time steps; below the least, or below the change, steps are Newton's."""
TOLERANCE = 1e-6
"""Largest last-but-one step in the logarithm of a partial pressure; the last step squares it."""
LARGEST_STEP = 1.0
INERTIA = 5.0
"""Inertia at the start of a search [L/min]."""
LOWEST_LOGARITHM, HIGHEST_LOGARITHM = -14.0, 8.0
"""Range of the logarithm of a partial pressure in mmHg."""


class GasState(NamedTuple):
    """Steady gas state of one patient.

    Attributes:
        pressure: logarithm of PO2 and PCO2 at the points of all exchangers, then of the samples, (2, points).
        ph: pH at the same points, (points,).
        saturation: oxygen saturation at the same points [-], (points,).
        content: contents at the same points [mL/dL], (2, points).
        outlets: contents of the outflow of each exchanger [mL/dL], (2, exchangers).
        inlets: contents of the inflow of each exchanger [mL/dL], (2, exchangers).
        gained: gas that blood gained in each exchanger [mL/min STPD], (2, exchangers).
        steps: number of Newton iterations.
        error: size of the last Newton step.
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
    """Blood whose gases are computed in addition to that inside exchangers.

    Attributes:
        shares: share of each exchanger's outflow in each sample, (samples, exchangers).
        kept: in a step in time, contents from blood that compartments held [mL/dL], (samples, 2).
    """

    shares: Array
    kept: Array | None = None


class SearchResult(NamedTuple):
    """Result of a search: the first two and last two entries of a `GasState`."""

    pressure: Array
    ph: Array
    steps: Array
    error: Array


class _LocalBlood(NamedTuple):
    """Blood at all points and its derivatives with respect to the pressures there, with pH eliminated."""

    content: Array  # (2, points)
    standard: Array  # (points,)
    content_by: Array  # (2 contents, 2 pressures, points)
    standard_by: Array  # (2 pressures, points)
    acid: Array  # residual of the acid-base equation over its slope (points,)
    acid_by: Array  # change of pH with the pressures (2, points)


class _Network(NamedTuple):
    """Arguments, other than the unknowns, of the equations of all exchangers."""

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
        """Slice of the points of each exchanger."""
        ends = np.cumsum([0, *(e.points for e in self.exchangers)]).tolist()
        return [slice(*pair) for pair in pairwise(ends)]

    def frozen(self) -> _Network:
        """The same arguments, excluded from differentiation."""
        mixed, samples, values = jax.lax.stop_gradient((self.mixed, self.samples, dict(self.values)))
        return _Network(self.exchangers, mixed, samples, values, self.law)


class _Search(NamedTuple):
    """State of the search for the steady state."""

    pressure: Array
    ph: Array
    gained: Array
    inertia: Array
    residuals: Array
    steps: Array
    error: Array
    last: Array


def blood_of(values: Values) -> Blood:
    """Properties of a patient's blood other than its gases."""
    return Blood(*(values[name] for name in BLOOD))


def solve(
    exchangers: Sequence[GasExchanger],
    mixed: Mixtures,
    values: Values,
    law: str = "severinghaus1979",
    samples: Samples | None = None,
    known: SearchResult | None = None,
) -> GasState:
    """Solve for the steady gas state of one patient; map over patients with `jax.vmap`.

    Args:
        exchangers: laws of the exchangers, in the order of `mixed`.
        mixed: composition of the blood that enters each exchanger.
        values: values of the parameters of the exchangers and of the blood.
        law: name of the law of the blood.
        samples: further blood whose gases are computed.
        known: result of a search with the same arguments; only derivatives are then computed.
    """
    samples = Samples(jnp.zeros((0, len(exchangers)))) if samples is None else samples
    network = _Network(tuple(exchangers), mixed, samples, values, law)
    solution = _searched(network.frozen()) if known is None else known
    given = mixed, samples, {name: jnp.asarray(value) for name, value in values.items()}
    pressure, ph = _implicit_function(network.exchangers, law, (solution.pressure, solution.ph), *given)
    content, _, saturation, _ = _properties(law, blood_of(values), pressure, ph)
    outlets, inlets = _streams(network, content)
    gained = 10.0 * mixed.streams * (outlets - inlets)
    return GasState(
        pressure, ph, saturation, content, outlets, inlets, gained, solution.steps, solution.error
    )


def _searched(network: _Network) -> SearchResult:
    """Run the search, with one more step after `TOLERANCE` is reached."""
    samples = network.samples
    acid = partial(_acid_step, network.law, blood_of(network.values))

    def unfinished(state: _Search) -> Array:
        return (state.steps < ITERATIONS) & ~state.last

    def improve(state: _Search) -> _Search:
        last = state.error <= TOLERANCE
        move, move_ph, size, gained = _newton_step(
            network, state.pressure, state.ph, state.inertia, state.gained
        )
        solved = jnp.isfinite(move).all() & jnp.isfinite(move_ph).all()
        move, move_ph = jnp.where(solved, move, 0.0), jnp.where(solved, move_ph, 0.0)
        pressure = jnp.clip(
            state.pressure + jnp.clip(move, -LARGEST_STEP, LARGEST_STEP), LOWEST_LOGARITHM, HIGHEST_LOGARITHM
        )
        ph = jnp.clip(state.ph + jnp.clip(move_ph, -0.5, 0.5), 4.0, 12.0)
        ph = acid(pressure, ph)
        error = jnp.where(solved, jnp.maximum(jnp.abs(move).max(), jnp.abs(move_ph).max()), jnp.inf)
        po2_or_pco2 = jnp.exp(state.pressure)
        change = jnp.abs(pressure - state.pressure) * po2_or_pco2 / (po2_or_pco2 + SMALL_PRESSURE_MMHG)
        inertia = _next_inertia(state, size, error, jnp.maximum(change.max(), jnp.abs(move_ph).max()))
        # If the step is not finite, as in blood that gains and loses no gas, the search stops.
        plain = state.steps < PLAIN_ITERATIONS
        steps = jnp.where(solved, state.steps + 1, jnp.where(plain, PLAIN_ITERATIONS, ITERATIONS))
        gained = jnp.where(solved, gained, state.gained)
        reached = _Search(pressure, ph, gained, inertia, size, steps, error, last & solved)
        anew = ~reached.last & jnp.isin(steps, jnp.array([begin for begin, _ in PSEUDO_TIME_STAGES]))
        return jax.tree.map(lambda a, b: jnp.where(anew, a, b), start._replace(steps=steps), reached)

    points = network.count + samples.shares.shape[0]
    pressure = jnp.log(jnp.stack([jnp.full(points, 60.0), jnp.full(points, 42.0)]))
    gained, far = jnp.zeros((2, network.count)), jnp.array(jnp.inf)
    start = _Search(
        pressure, jnp.full(points, 7.4), gained, jnp.array(INERTIA), far, jnp.array(0), far, jnp.array(False)
    )
    end = jax.lax.while_loop(unfinished, improve, start)
    return SearchResult(end.pressure, end.ph, end.steps, end.error)


def _next_inertia(state: _Search, size: Array, error: Array, change: Array) -> Array:
    """Inertia of the next step, from this step's residual `size`, its error and its change."""
    # The inertia decreases with the residual, so that the last steps are Newton's.
    inertia = 0.5 * state.inertia * jnp.clip(size / state.residuals, 0.1, 2.0)
    ended = (size < 1e-4) | (state.inertia < LEAST_INERTIA) | (error <= TOLERANCE)
    for begin, aim in PSEUDO_TIME_STAGES:
        marching = state.steps >= begin
        followed = jnp.minimum(state.inertia * jnp.clip(change / aim, 0.2, 4.0), MOST_INERTIA)
        inertia = jnp.where(marching, followed, inertia)
        ended = jnp.where(marching, (followed < LEAST_INERTIA) | (error < LAST_CHANGE), ended)
    return jnp.where(ended, 0.0, inertia)


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _implicit_function(
    exchangers: tuple[GasExchanger, ...],
    law: str,
    solution: tuple[Array, Array],
    mixed: Mixtures,
    samples: Samples,
    values: Values,
) -> tuple[Array, Array]:
    """Pressures and pH of a solution as functions of the arguments (implicit function theorem)."""
    return solution


@_implicit_function.defjvp
def _derivative(
    exchangers: tuple[GasExchanger, ...],
    law: str,
    arguments: tuple[tuple[Array, Array], Mixtures, Samples, Values],
    changes: tuple[tuple[Array, Array], Mixtures, Samples, Values],
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Derivative by the implicit function theorem: that of Newton's step at the solution."""
    solution, *given = arguments

    def step(mixed: Mixtures, samples: Samples, values: Values) -> tuple[Array, Array]:
        return _newton_step(_Network(exchangers, mixed, samples, values, law), *solution, 0.0)[:2]

    return solution, jax.jvp(step, tuple(given), changes[1:])[1]


def _properties(law: str, blood: Blood, pressure: Array, ph: Array) -> tuple[Array, Array, Array, Array]:
    """Contents (2, points), PO2 under standard conditions, saturation, acid-base residual."""
    po2, pco2 = jnp.exp(pressure[0]), jnp.exp(pressure[1])
    held = law_named(law).held(po2, pco2, ph, blood)
    content = jnp.stack([held.oxygen, held.carbon_dioxide])
    residual = excess_of(pco2, ph, held.saturation, blood)
    return content, held.standard_pressure, held.saturation, jnp.asarray(residual)


def _local(law: str, blood: Blood, pressure: Array, ph: Array) -> _LocalBlood:
    """Properties of blood at all points and their derivatives; each point depends only on itself.

    Derivatives are not differentiated again: at the solution they are multiplied by a residual of zero.
    """
    content, standard, _, residual = _properties(law, blood, pressure, ph)
    _, along = jax.linearize(partial(_properties, law, jax.lax.stop_gradient(blood)), pressure, ph)
    directions = jnp.broadcast_to(jnp.eye(3)[:, :, None], (3, 3, ph.shape[0]))
    content_by, standard_by, _, residual_by = jax.vmap(lambda d: along(d[:2], d[2]))(directions)
    acid_by, acid = -residual_by[:2] / residual_by[2], -residual / residual_by[2]
    return _LocalBlood(
        content + content_by[2] * acid,
        standard + standard_by[2] * acid,
        jnp.swapaxes(content_by[:2] + content_by[2] * acid_by[:, None], 0, 1),
        standard_by[:2] + standard_by[2] * acid_by,
        acid,
        acid_by,
    )


def _streams(network: _Network, content: Array) -> tuple[Array, Array]:
    """Contents of the outflow and of the inflow of each exchanger, both (2, exchangers).

    With a shunt, a lung's outflow depends on its inflow, and that on the outflows of the others. This linear
    system is solved here.
    """
    shares = jnp.stack([jnp.asarray(e.exchanging(network.values)) for e in network.exchangers])
    last = content[:, np.array([place.stop - 1 for place in network.places])]
    matrix = jnp.eye(len(shares)) - (1.0 - shares)[:, None] * network.mixed.inlets
    from_held = 0.0 if network.mixed.kept is None else network.mixed.kept[2].T
    outlets = _small_solved(matrix, (shares * last + (1.0 - shares) * from_held).T).T
    return outlets, (network.mixed.inlets @ outlets.T).T + from_held


def _small_solved(matrix: Array, right: Array) -> Array:
    """Solve without pivots: `matrix` is the identity minus shares, which sum to less than 1 per row."""
    rows = [jnp.concatenate(pair) for pair in zip(matrix, right, strict=True)]
    for k in range(len(rows)):
        rows[k] = rows[k] / rows[k][k]
        rows = [row if j == k else row - row[k] * rows[k] for j, row in enumerate(rows)]
    return jnp.stack([row[len(rows) :] for row in rows])


def _residuals(
    network: _Network, pressure: Array, content: Array, standard: Array, ph: Array, expected: Array | None
) -> tuple[list[Points], Array, Array]:
    """Blood inside every exchanger, gas gained according to its contents, and residuals of all equations.

    Gas and residuals are in [mL/min STPD], (2, points). Rates are evaluated at the `expected` gained gas and
    extrapolated linearly to the gas actually gained; without `expected` they are evaluated there directly.
    """
    inlets, points, gains, missed = _streams(network, content)[1], [], [], []
    for k, (e, place) in enumerate(zip(network.exchangers, network.places, strict=True)):
        stream, (cells, weights) = network.mixed.streams[k], e.collocation
        exchanging = 10.0 * stream * jnp.asarray(e.exchanging(network.values))
        gained = exchanging * (content[:, place] - inlets[:, k, None])
        at = Points(gained, jnp.exp(pressure[:, place]), standard[place], ph[place])
        if expected is None:
            rates = e.rates(stream, at, network.values)
        else:
            at = at._replace(gained=expected[:, place])
            there, along = jax.jvp(
                lambda g, e=e, q=stream, at=at: e.rates(q, at._replace(gained=g), network.values),
                (at.gained,), (gained - at.gained,),
            )  # fmt: skip
            rates = there + along
        points.append(at)
        gains.append(gained)
        reached, rates = gained.reshape(2, cells, -1), rates.reshape(2, cells, -1)
        entered = jnp.pad(reached[:, :-1, -1:], ((0, 0), (1, 0), (0, 0)))
        within = sum(rates[..., i, None] * weights[:, i] for i in range(len(weights))) / cells
        missed.append((reached - entered - within).reshape(2, -1))
    return points, jnp.concatenate(gains, axis=1), jnp.concatenate(missed, axis=1)


def _acid_step(law: str, blood: Blood, pressure: Array, ph: Array) -> Array:
    """pH after one step towards the acid-base balance at given pressures."""
    po2, pco2 = jnp.exp(pressure)
    saturation = law_named(law).saturation

    def missing(at: Array) -> Array:
        return jnp.asarray(excess_of(pco2, at, saturation(po2, pco2, at, blood), blood))

    residual, slope = jax.jvp(missing, (ph,), (jnp.ones_like(ph),))
    return ph - jnp.clip(residual / slope, -0.5, 0.5)


def _newton_step(
    network: _Network, pressure: Array, ph: Array, inertia: Array | float, expected: Array | None = None
) -> tuple[Array, Array, Array, Array]:
    """Newton's step for pressures and pH, the largest residual [mL/dL], and the gas gained after the step.

    The linear equations are not differentiated. With inertia the contents change as in stored blood: an
    implicit step in pseudo-time.
    """
    count = network.count
    local = not_inlined(partial(_local, network.law))(blood_of(network.values), pressure, ph)
    points, gained, value = _residuals(
        network, pressure, local.content, local.standard, ph + local.acid, expected
    )
    steady = network.frozen()
    fixed, at = jax.lax.stop_gradient((local, points))
    equations = [
        linear_exchanger(
            e, steady.mixed.streams[k],
            LinearisedBlood(
                at[k], fixed.content_by[..., place], fixed.standard_by[:, place], fixed.acid_by[:, place]
            ),
            steady.values, inertia,
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
    move = [
        pressure_changes(e, m, entering[:, k])
        for k, (e, (m, _)) in enumerate(zip(equations, parts, strict=True))
    ]
    passing = np.repeat(np.arange(len(equations)), [e.points for e in network.exchangers])
    flows = 10.0 * network.mixed.streams[passing] * shares[passing]
    inside = (fixed.content_by[..., :count] * jnp.concatenate(move, axis=1)).sum(axis=1)
    gained = gained + flows * (inside - entering[:, passing])
    outlets = _streams(network, local.content)[0] + changes
    (a, b), (c, d) = fixed.content_by[:, :, count:]
    from_held = 0.0 if network.samples.kept is None else network.samples.kept.T
    oxygen, carbon_dioxide = outlets @ network.samples.shares.T + from_held - local.content[:, count:]
    sampled = jnp.stack([d * oxygen - b * carbon_dioxide, a * carbon_dioxide - c * oxygen]) / (a * d - b * c)
    move = jnp.concatenate([*move, sampled], axis=1)
    size = jnp.abs(value / (10.0 * network.mixed.streams[passing])).max()
    return move, local.acid + (fixed.acid_by * move).sum(axis=0), size, gained
