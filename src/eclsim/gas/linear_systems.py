"""Small dense linear systems, solved in the calling thread.

LAPACK's decompositions of a batch (`jnp.linalg.solve` under `vmap`, jaxlib 0.10) run in the same thread pool
in which they wait: two programs at a time can occupy all threads and wait forever.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import Array

from eclsim import runtime as _runtime  # noqa: F401  (double precision before the first array)


@jax.custom_jvp
def solution(matrix: Array, offsets: Array) -> Array:
    """Solve matrix x = offsets for x; NaN or infinite if the matrix is singular.

    Args:
        matrix: shape (n, n).
        offsets: shape (n, columns).

    Returns:
        Shape (n, columns).
    """
    return _solution(matrix, offsets)[0]


def _solution(matrix: Array, offsets: Array) -> tuple[Array, Array]:
    """Solution with one step of iterative refinement, and inverse of the matrix."""
    inverse = _inverse(matrix)
    first = inverse @ offsets
    return first + inverse @ (offsets - matrix @ first), inverse


@solution.defjvp
def _derivative(arguments: tuple[Array, Array], changes: tuple[Array, Array]) -> tuple[Array, Array]:
    result, inverse = _solution(*arguments)
    return result, inverse @ (changes[1] - changes[0] @ result)


def _inverse(matrix: Array) -> Array:
    """Inverse by Gauss-Jordan elimination with the largest pivot of each column."""
    count = matrix.shape[0]
    rows = jnp.arange(count)

    def eliminate(k: Array, table: Array) -> Array:
        pivot = jnp.argmax(jnp.where(rows < k, -1.0, jnp.abs(table[:, k])))
        row = table[pivot] / table[pivot, k]
        swapped = jnp.where((rows == pivot)[:, None], table[k], table)
        reduced = swapped - swapped[:, k][:, None] * row
        return jnp.where((rows == k)[:, None], row, reduced)

    start = jnp.concatenate([matrix, jnp.eye(count)], axis=1)
    return jax.lax.fori_loop(0, count, eliminate, start)[:, count:]
