"""The steady gas state: partial pressures at which every exchanger's equations hold at once.

Unknowns are the logarithms of PO2 and PCO2 at the points inside the exchangers, with the pH that belongs to
them: contents are then explicit. What enters an exchanger is a mixture of what leaves the others, so that a
patient with ECMO has about 20 unknowns however many compartments there are. Newton's method, with pH
eliminated point by point; derivatives with respect to all parameters and flows by the implicit function
theorem.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from eclsim import runtime as _runtime  # noqa: F401  (double precision before the first array)
from eclsim.blood.acid_base import excess_of
from eclsim.blood.gases import law_named
from eclsim.blood.types import Blood
from eclsim.gas.exchangers import Exchanger, Points
from eclsim.gas.transport import Mixtures

ITERATIONS = 150
TOLERANCE = 1e-10
"""Of the last step, in the logarithm of a partial pressure."""
LARGEST_STEP = 1.0
INERTIA = 5.0
"""At the start of a search [L/min]."""
LOWEST, HIGHEST = -14.0, 8.0
"""Of the logarithm of a partial pressure in mmHg."""

Values = Mapping[str, Array]


class GasState(NamedTuple):
    """The steady gas state of one patient.

    Attributes:
        pressure: logarithm of PO2 and PCO2 at the points of all exchangers, (2, points).
        ph: there, (points,).
        outlets: contents of what leaves each exchanger [mL/dL], (2, exchangers).
        inlets: contents of what enters each exchanger [mL/dL], (2, exchangers).
        gained: gas that blood gained in each exchanger [mL/min STPD], (2, exchangers).
        steps: iterations of Newton's method.
        error: its last step.
    """

    pressure: Array
    ph: Array
    outlets: Array
    inlets: Array
    gained: Array
    steps: Array
    error: Array


class _Local(NamedTuple):
    """Blood at all points, and how it changes with the unknowns there, pH eliminated."""

    content: Array  # (2, points)
    slope: Array  # (points,)
    content_by: Array  # (2 contents, 2 pressures, points)
    slope_by: Array  # (2 pressures, points)
    acid: Array  # residual of the acid-base equation over its slope (points,)
    acid_by: Array  # change of pH with the pressures (2, points)


def blood_of(values: Values) -> Blood:
    """What describes the blood of a patient apart from its gases."""
    return Blood(
        values["gas.haemoglobin_g_dl"],
        values["gas.base_excess_mmol_l"],
        values["gas.temperature_c"],
        values["gas.oxygen_capacity_ml_g"],
    )


def solve(
    exchangers: Sequence[Exchanger], mixed: Mixtures, values: Values, law: str = "severinghaus1979"
) -> GasState:
    """The steady gas state of one patient; map over patients with `jax.vmap`.

    Args:
        exchangers: in the order of `mixed`.
        mixed: what enters each exchanger.
        values: parameters of the exchangers and of the blood.
        law: of the blood.
    """
    frozen = jax.lax.stop_gradient((mixed, dict(values)))
    step = partial(_newton_step, tuple(exchangers), *frozen, law)
    acid = partial(_acid_step, law, blood_of(frozen[1]))

    def unfinished(state: _Search) -> Array:
        return (state.steps < ITERATIONS) & (state.error > TOLERANCE)

    def improve(state: _Search) -> _Search:
        move, move_ph, size = step(state.pressure, state.ph, state.inertia)
        pressure = jnp.clip(state.pressure + jnp.clip(move, -LARGEST_STEP, LARGEST_STEP), LOWEST, HIGHEST)
        ph = jnp.clip(state.ph + jnp.clip(move_ph, -0.5, 0.5), 4.0, 12.0)
        ph = acid(pressure, acid(pressure, ph))
        error = jnp.maximum(jnp.abs(move).max(), jnp.abs(move_ph).max())
        # Inertia follows what is missing, so that the last steps are Newton's.
        ratio = jnp.clip(size / state.missing, 0.1, 2.0)
        inertia = jnp.where((size < 1e-4) | (state.inertia < 1e-6), 0.0, 0.5 * state.inertia * ratio)
        return _Search(pressure, ph, inertia, size, state.steps + 1, error)

    count = sum(e.points for e in exchangers)
    pressure = jnp.log(jnp.stack([jnp.full(count, 60.0), jnp.full(count, 42.0)]))
    far = jnp.array(jnp.inf)
    start = _Search(pressure, jnp.full(count, 7.4), jnp.array(INERTIA), far, jnp.array(0), far)
    end = jax.lax.while_loop(unfinished, improve, start)
    # One more step from the solution carries its derivatives exactly.
    move, move_ph, _ = _newton_step(tuple(exchangers), mixed, values, law, end.pressure, end.ph, 0.0)
    return _state(exchangers, mixed, values, law, end.pressure + move, end.ph + move_ph, end.steps, end.error)


class _Search(NamedTuple):
    """Where the search for the steady state is."""

    pressure: Array
    ph: Array
    inertia: Array
    missing: Array
    steps: Array
    error: Array


def _state(
    exchangers: Sequence[Exchanger],
    mixed: Mixtures,
    values: Values,
    law: str,
    pressure: Array,
    ph: Array,
    steps: Array,
    error: Array,
) -> GasState:
    content, slope, _ = _properties(law, blood_of(values), pressure, ph)
    outlets, inlets = _streams(exchangers, mixed, Points(jnp.exp(pressure), content, slope), values)
    gained = 10.0 * mixed.streams * (outlets - inlets)
    return GasState(pressure, ph, outlets, inlets, gained, steps, error)


def _properties(law: str, blood: Blood, pressure: Array, ph: Array) -> tuple[Array, Array, Array]:
    """Contents (2, points), slope of the saturation curve, residual of the acid-base equation (points,)."""
    chosen = law_named(law)
    po2, pco2 = jnp.exp(pressure[0]), jnp.exp(pressure[1])

    def saturation(at: Array) -> Array:
        return chosen.saturation(at, pco2, ph, blood)

    saturated, slope = jax.jvp(saturation, (po2,), (jnp.ones_like(po2),))
    content = jnp.stack(
        [chosen.oxygen_content(po2, pco2, ph, blood), chosen.carbon_dioxide_content(po2, pco2, ph, blood)]
    )
    return content, slope, jnp.asarray(excess_of(pco2, ph, saturated, blood))


def _local(law: str, blood: Blood, pressure: Array, ph: Array) -> _Local:
    """Properties of blood at all points with their derivatives; every point depends on itself alone."""
    one, none = jnp.ones_like(ph), jnp.zeros_like(ph)

    def along(oxygen: Array, carbon_dioxide: Array, acid: Array) -> tuple[Array, Array, Array]:
        tangent = (jnp.stack([oxygen, carbon_dioxide]), acid)
        return jax.jvp(partial(_properties, law, blood), (pressure, ph), tangent)[1]

    content, slope, residual = _properties(law, blood, pressure, ph)
    by = [along(one, none, none), along(none, one, none)]
    content_ph, slope_ph, residual_ph = along(none, none, one)
    acid_by = jnp.stack([-b[2] / residual_ph for b in by])
    content_by = jnp.stack([b[0] + content_ph * a for b, a in zip(by, acid_by, strict=True)], axis=1)
    slope_by = jnp.stack([b[1] + slope_ph * a for b, a in zip(by, acid_by, strict=True)])
    acid = -residual / residual_ph
    return _Local(content + content_ph * acid, slope + slope_ph * acid, content_by, slope_by, acid, acid_by)


def _streams(
    exchangers: Sequence[Exchanger], mixed: Mixtures, inside: Points, values: Values
) -> tuple[Array, Array]:
    """Contents of what leaves and of what enters each exchanger, both (2, exchangers).

    A lung lets blood past it, so what leaves depends on what enters, and that on what leaves the others:
    linear, and solved here.
    """
    parts = _parts(exchangers, inside)
    none, one = jnp.zeros(2), jnp.ones(2)
    offset = jnp.stack([e.outlet(none, p, values) for e, p in zip(exchangers, parts, strict=True)], axis=1)
    passed = (
        jnp.stack([e.outlet(one, p, values) for e, p in zip(exchangers, parts, strict=True)], axis=1) - offset
    )
    matrix = jnp.eye(len(exchangers)) - passed[0][:, None] * mixed.inlets
    outlets = jnp.linalg.solve(matrix, offset.T).T
    return outlets, (mixed.inlets @ outlets.T).T


def _parts(exchangers: Sequence[Exchanger], inside: Points) -> list[Points]:
    """The points of each exchanger."""
    parts, first = [], 0
    for exchanger in exchangers:
        own = slice(first, first + exchanger.points)
        parts.append(Points(inside.pressure[:, own], inside.content[:, own], inside.slope[own]))
        first += exchanger.points
    return parts


def _missing(exchangers: Sequence[Exchanger], mixed: Mixtures, values: Values, inside: Points) -> Array:
    """What the equations of all exchangers miss [mL/dL of the blood that passes], (2, points)."""
    _, inlets = _streams(exchangers, mixed, inside, values)
    parts = _parts(exchangers, inside)
    return jnp.concatenate(
        [
            e.missing(mixed.streams[k], inlets[:, k], part, values) / (10.0 * mixed.streams[k])
            for k, (e, part) in enumerate(zip(exchangers, parts, strict=True))
        ],
        axis=1,
    )


def _acid_step(law: str, blood: Blood, pressure: Array, ph: Array) -> Array:
    """pH after one step towards the acid-base balance at given pressures."""
    residual, slope = jax.jvp(
        lambda at: _properties(law, blood, pressure, at)[2], (ph,), (jnp.ones_like(ph),)
    )
    return ph - jnp.clip(residual / slope, -0.5, 0.5)


def _newton_step(
    exchangers: tuple[Exchanger, ...],
    mixed: Mixtures,
    values: Values,
    law: str,
    pressure: Array,
    ph: Array,
    inertia: Array | float,
) -> tuple[Array, Array, Array]:
    """Newton's step for the pressures and for pH, and the largest equation not met [mL/min].

    The Jacobian is not differentiated. With inertia [L/min] the contents change as in blood that is stored:
    an implicit step in time, which leads to the steady state from anywhere.
    """
    local = _local(law, blood_of(values), pressure, ph)
    missing = partial(_missing, exchangers, mixed, values)
    inside = Points(jnp.exp(pressure), local.content, local.slope)
    fixed, where = jax.lax.stop_gradient((local, inside))
    jacobian = jax.jacfwd(missing)(where)
    count = pressure.shape[1]
    by = jacobian.pressure * where.pressure
    by = by + jnp.einsum("giaj,abj->gibj", jacobian.content, fixed.content_by)
    by = by + jacobian.slope[:, :, None, :] * fixed.slope_by
    stored = inertia * jnp.einsum("gai,ij->giaj", fixed.content_by, jnp.eye(count))
    matrix = jax.lax.stop_gradient(by + stored).reshape(2 * count, 2 * count)
    value = missing(inside)
    move = -jnp.linalg.solve(matrix, value.reshape(-1)).reshape(2, count)
    return move, local.acid + (fixed.acid_by * move).sum(axis=0), jnp.abs(value).max()
