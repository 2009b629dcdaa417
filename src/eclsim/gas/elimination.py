"""Newton's equations of the gas state, solved exchanger by exchanger.

The state inside an exchanger depends on the others only through the blood that enters. The cells of an
exchanger are eliminated one after the other, which gives the change of its outflow with its inflow. These
relations of all exchangers form a small system with two unknowns per exchanger.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from eclsim.components.base import Values
from eclsim.components.exchangers import GasExchanger, Points
from eclsim.gas.linear_systems import solution
from eclsim.runtime import not_inlined


class LinearisedBlood(NamedTuple):
    """Blood at the points of an exchanger, with derivatives by the logarithms of both pressures.

    Attributes:
        at: blood at the points.
        content_by: derivatives of the contents, (2 contents, 2 pressures, points).
        standard_by: derivatives of the PO2 under standard conditions, (2 pressures, points).
        ph_by: derivatives of the pH, (2 pressures, points).
    """

    at: Points
    content_by: Array
    standard_by: Array
    ph_by: Array


class LinearExchanger(NamedTuple):
    """Linear equations of an exchanger, with each cell solved in terms of its inflow.

    Attributes:
        blocks: coefficients of each point of a cell in the equation of each point, (2, 2, cells) each.
        by_inlet: derivatives of the pressures with respect to the inlet contents, (2, 2, cells) per point.
        by_gained: the same with respect to the gas gained before the cell.
        flow: exchanging blood flow, in mL/min of gas per mL/dL.
        ends: derivatives of the contents with respect to the pressures at the last points, (2, 2, cells).
        reached: derivatives of the contents at the cells' ends with respect to the inlet contents, (2, 2)
            each.
        outlet_by: derivatives of the outlet contents with respect to the inlet contents, (2, 2).
    """

    blocks: Sequence[Sequence[Array]]
    by_inlet: Sequence[Array]
    by_gained: Sequence[Array]
    flow: Array
    ends: Array
    reached: Sequence[Array]
    outlet_by: Array


def linear_exchanger(
    law: GasExchanger, flow: Array, inside: LinearisedBlood, values: Values, inertia: Array | float
) -> LinearExchanger:
    """Equations of one exchanger, linearised about a state.

    Args:
        law: law of the exchanger.
        flow: blood flow [L/min].
        inside: state of the blood inside.
        values: all parameters.
        inertia: pseudo-time term: contents change as in stored blood, as a share of the flow.
    """
    (cells, weights), share = law.collocation, jnp.asarray(law.exchanging(values))
    points, exchanging = len(weights), 10.0 * flow * share
    by_gained, by_pressure = not_inlined(partial(_rates_by, law))(flow, inside, dict(values))
    content_by = _by_cell(inside.content_by, cells)
    through = _by_cell(exchanging * _product(by_gained, inside.content_by) + by_pressure, cells)
    diagonal = (exchanging + inertia * 10.0 * flow) * content_by
    blocks = [
        [
            (diagonal[..., j] if j == k else 0.0) - weights[j, k] / cells * through[..., k]
            for k in range(points)
        ]
        for j in range(points)
    ]
    identity = jnp.broadcast_to(jnp.eye(2)[:, :, None], (2, 2, cells))
    gained_by = _by_cell(by_gained, cells)
    entering = [
        exchanging * (identity - sum(weights[j, k] / cells * gained_by[..., k] for k in range(points)))
        for j in range(points)
    ]
    solved = _solved_by_block(blocks, [jnp.concatenate([n, identity], axis=1) for n in entering])
    by_inlet, before = [x[:, :2] for x in solved], [x[:, 2:] for x in solved]
    ends, reached = content_by[..., -1], [jnp.eye(2)]
    for c in range(cells):
        gained = exchanging * (reached[-1] - jnp.eye(2))
        change = by_inlet[-1][..., c] + _product(before[-1][..., c], gained)
        reached.append(_product(ends[..., c], change))
    outlet_by = (1.0 - share) * jnp.eye(2) + share * reached[-1]
    return LinearExchanger(blocks, by_inlet, before, exchanging, ends, reached, outlet_by)


def responses(equations: LinearExchanger, residuals: Array) -> tuple[list[Array], Array]:
    """Changes of pressures and of the last content that cancel the residuals at a fixed inflow.

    Args:
        equations: equations of one exchanger.
        residuals: residuals of its equations, (2, points).

    Returns:
        Changes of the logarithms of the pressures at each point of the cells, (2, cells), and of the contents
        at the end, (2,).
    """
    cells, count = equations.ends.shape[-1], len(equations.blocks)
    residuals_by_cell = _by_cell(-residuals, cells)
    moves = [
        x[:, 0]
        for x in _solved_by_block(equations.blocks, [residuals_by_cell[:, None, :, k] for k in range(count)])
    ]
    reached, before = jnp.zeros(2), []
    for c in range(cells):
        before.append(equations.flow * reached)
        change = moves[-1][:, c] + _product(equations.by_gained[-1][..., c], before[-1])
        reached = _product(equations.ends[..., c], change)
    carried = jnp.stack(before, axis=-1)
    return [m + _product(g, carried) for m, g in zip(moves, equations.by_gained, strict=True)], reached


def pressure_changes(equations: LinearExchanger, moves: Sequence[Array], entering: Array) -> Array:
    """Changes of the logarithms of the pressures, (2, points).

    Args:
        equations: equations of one exchanger.
        moves: changes of pressures returned by `responses`.
        entering: changes of the inlet contents, (2,).
    """
    gained = jnp.stack(
        [equations.flow * (_product(by, entering) - entering) for by in equations.reached[:-1]],
        axis=-1,
    )
    parts = [
        move + _product(inlet, entering[:, None]) + _product(before, gained)
        for move, inlet, before in zip(moves, equations.by_inlet, equations.by_gained, strict=True)
    ]
    return jnp.stack(parts, axis=-1).reshape(2, -1)


def mixed_changes(shares: Array, outlets_by: Array, offsets: Array) -> Array:
    """Changes of the outlet contents if each inlet is a mixture of all outlets, (2, exchangers).

    Args:
        shares: share of each exchanger's outflow in each inflow, (exchangers, exchangers).
        outlets_by: derivatives of outlet with respect to inlet contents, (2, 2, exchangers).
        offsets: changes of the outlet contents at fixed inlet contents, (2, exchangers).
    """
    count = shares.shape[0]
    matrix = jnp.eye(2 * count) - jnp.einsum("abe,ek->aebk", outlets_by, shares).reshape(2 * count, -1)
    return solution(matrix, offsets.reshape(-1, 1)).reshape(2, count)


def _rates_by(law: GasExchanger, flow: Array, inside: LinearisedBlood, values: Values) -> tuple[Array, Array]:
    """Derivatives of the rates by gained gas and by logarithms of pressures, both (2, 2, points)."""
    at = inside.at

    def rates(gained: Array, move: Array) -> Array:
        standard = at.standard + (inside.standard_by * move).sum(axis=0)
        ph = at.ph + (inside.ph_by * move).sum(axis=0)
        return law.rates(flow, Points(gained, at.pressure * (1.0 + move), standard, ph), values)

    _, along = jax.linearize(rates, at.gained, jnp.zeros_like(at.gained))
    directions = np.broadcast_to(np.eye(4)[:, :, None], (4, 4, law.points))
    by = jnp.swapaxes(jax.vmap(lambda d: along(d[:2], d[2:]))(directions), 0, 1)
    return by[:, :2], by[:, 2:]


def _by_cell(table: Array, cells: int) -> Array:
    """Reshape (..., points) to (..., cells, points of a cell)."""
    return table.reshape(*table.shape[:-1], cells, -1)


def _product(a: Array, b: Array) -> Array:
    """Product of matrices (2, 2, ...) with matrices (2, 2, ...) or vectors (2, ...) of each point."""
    return jnp.stack([a[0, 0] * b[0] + a[0, 1] * b[1], a[1, 0] * b[0] + a[1, 1] * b[1]])


def _solution_2x2(a: Array, b: Array) -> Array:
    """Solution x of a x = b, (2, columns, ...), with matrices (2, 2, ...)."""
    determinant = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    return jnp.stack([a[1, 1] * b[0] - a[0, 1] * b[1], a[0, 0] * b[1] - a[1, 0] * b[0]]) / determinant


def _block_elimination(blocks: Sequence[Sequence[Array]], rights: Sequence[Array]) -> list[Array]:
    """Gaussian elimination by blocks (2, 2, cells), for right-hand sides (2, columns, cells).

    Diagonal blocks are invertible: with rising pressure, rates fall and contents rise.
    """
    if len(blocks) == 1:
        return [_solution_2x2(blocks[0][0], rights[0])]
    (first, *row), *rows = blocks
    along, right = [_solution_2x2(first, b) for b in row], _solution_2x2(first, rights[0])
    reduced = [[b - _product(o[0], a) for a, b in zip(along, o[1:], strict=True)] for o in rows]
    behind = _block_elimination(
        reduced, [r - _product(o[0], right) for o, r in zip(rows, rights[1:], strict=True)]
    )
    return [right - sum(_product(a, x) for a, x in zip(along, behind, strict=True)), *behind]


_solved_by_block = not_inlined(_block_elimination)
