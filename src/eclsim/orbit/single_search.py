"""The search for one patient's steady beat as one compiled program.

The same iteration as in `eclsim.orbit.search`, beat by beat; there it is written for many patients side by
side, here the loop around the beat is compiled as well, which takes a third less time for one.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from eclsim.beat.compilation import compiled
from eclsim.beat.heartbeat import BeatProgram
from eclsim.orbit.broyden import WORTH_LEARNING
from eclsim.orbit.equation import Anchor, OrbitOptions, OrbitProblem, Orbits, allowed_moves
from eclsim.orbit.status import Status

TERMS = OrbitOptions.quasi_newton_beats
"""Rank-one terms that a program has room for."""


class _Carry(NamedTuple):
    """What goes from beat to beat; `left` and `right` are the terms of the inverse, shape (terms, states)."""

    beat: Any
    going: Any
    done: Any
    state: Any
    step: Any
    residual: Any
    left: Any
    right: Any
    best: Any
    change: Any
    drift: Any


def solve_alone(problem: OrbitProblem, anchor: Anchor, options: OrbitOptions) -> Orbits:
    """Steady state of the one patient of a problem, by Broyden's method alone."""
    n = len(anchor.state)
    state, inverse = anchor.state.reshape(n), anchor.inverse.reshape(n, n)
    effort = np.array([options.tolerance, options.error_tolerance, min(options.quasi_newton_beats, TERMS)])
    volume = problem.volume
    run = _program(problem.program)
    found = np.array(run(state, inverse, problem.packed[:, 0], volume.weights, volume.target[0], effort))
    done, beats, change, drift = found[n:]
    status = Status.CONVERGED if done else Status.NOT_CONVERGED
    return Orbits(
        found[:n, None], np.array([status]), np.array([int(beats)]), np.array([change]), np.array([drift])
    )


@lru_cache(maxsize=64)
def _program(program: BeatProgram) -> Any:
    """Compiled search: (state, done, beats, change, drift) in one array."""
    layout = program.assembly.layout
    scale, shares = layout.scales, layout.spread
    least, largest = layout.smallest_sizes, layout.largest_steps

    def run(state: Any, inverse: Any, packed: Any, weights: Any, target: Any, effort: Any) -> Any:
        def times(terms: _Carry, vector: Any) -> Any:
            return _product(inverse, vector) + _product(terms.left.T, _product(terms.right, vector))

        def learnt(now: _Carry, change: Any) -> _Carry:
            """The carry with one more term: the inverse maps the change of the residual to the step."""
            image = times(now, change)
            right = _product(inverse.T, now.step) + _product(now.right.T, _product(now.left, now.step))
            size = jnp.sum(right * change)
            usable = (jnp.abs(size) > WORTH_LEARNING * jnp.sum(now.step * now.step)) & (now.beat > 0)
            left = jnp.where(usable, (now.step - image) / jnp.where(usable, size, 1.0), 0.0)
            here = (jnp.arange(TERMS) == now.beat - 1)[:, None]
            terms = (jnp.where(here, new, old) for new, old in ((left, now.left), (right, now.right)))
            return now._replace(**dict(zip(("left", "right"), terms, strict=True)))

        def beat(now: _Carry) -> _Carry:
            moved = now.state - program.run(now.state, packed)[0]
            excess = jnp.sum(weights * now.state) - target
            size, distance = jnp.maximum(jnp.abs(now.state), least), jnp.abs(moved)
            change = jnp.maximum(jnp.max(distance / size), jnp.abs(excess) / jnp.maximum(target, 1.0))
            finite = jnp.isfinite(change)
            residual = jnp.where(finite, (moved + shares * excess) / scale, 0.0)
            now = learnt(now, residual - now.residual)
            step = -times(now, residual)
            moves = step * scale
            error = jnp.max(jnp.abs(moves) / size)
            done = finite & (change <= effort[0]) & (error <= effort[1])
            best = done | (finite & (change < now.change))
            kept = jnp.where(done, now.state + moves, now.state)
            share = 1.0 / jnp.maximum(jnp.max(jnp.abs(moves) / allowed_moves(now.state, largest)), 1.0)
            return now._replace(
                beat=now.beat + 1,
                going=finite & ~done & (now.beat + 1 < effort[2]),
                done=done,
                state=now.state + moves * share,
                step=step * share,
                residual=residual,
                best=jnp.where(best, kept, now.best),
                change=jnp.where(best, change, now.change),
                drift=jnp.where(best, jnp.max(distance[layout.volumes.where]), now.drift),
            )

        none = jnp.zeros((TERMS, len(scale)))
        infinite, no = jnp.asarray(jnp.inf), jnp.asarray(False)
        zero = jnp.zeros_like(state)
        first = _Carry(
            jnp.asarray(0), ~no, no, state, zero, zero, none, none, zero * jnp.nan, infinite, infinite
        )
        last = jax.lax.while_loop(lambda now: now.going, beat, first)
        numbers = [last.done.astype(float), last.beat.astype(float), last.change, last.drift]
        return jnp.concatenate([last.best, jnp.stack(numbers)])

    return compiled(run, ("search", program))


def _product(matrix: Any, vector: Any) -> Any:
    """Matrix times vector, without the library call that `@` becomes."""
    return jnp.sum(matrix * vector, axis=1)
