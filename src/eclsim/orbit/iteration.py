"""Broyden's method, compiled together with the beat, for one member or several side by side.

The inverse Jacobian is that of the start, updated by a matrix of rank one after every beat ("good Broyden",
Broyden 1965, doi 10.1090/S0025-5718-1965-0198670-6; Kelley 1995, chapter 7). Members side by side are entries
along the last axis of each array and do not affect each other; when a member is finished, the next one takes
its entry.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from eclsim.beat.compilation import compiled
from eclsim.beat.heartbeat import BeatProgram
from eclsim.orbit.equation import OrbitOptions, Volume, largest_allowed_steps

Array = np.ndarray | jax.Array
SMALLEST_UPDATE_SHARE = 1e-6
"""Denominator of an update, step . (inverse change), over step . step, below which none is made."""
SMALLEST_RUNNING_SHARE = 0.8
"""Share of entries that must be running to continue; below it, waiting members replace the finished ones."""


class Iterate(NamedTuple):
    """State of a search between two beats; `inverse` is the inverse Jacobian in scaled states."""

    beats: Array
    running: Array
    converged: Array
    state: Array
    step: Array
    residual: Array
    inverse: Array
    best: Array
    change: Array
    drift: Array
    after: Array


class SearchEnd(NamedTuple):
    """Results of searches; members are the last axis.

    `best` is the state nearest to the orbit, `after` the state after the last beat; `change` (relative to
    max(|state|, 1)) and `drift` (of a volume [mL]) are the changes of `best` over a beat.
    """

    best: np.ndarray
    after: np.ndarray
    converged: np.ndarray
    beats: np.ndarray
    change: np.ndarray
    drift: np.ndarray


@dataclass(frozen=True, eq=False)
class CompiledSearch:
    """Compiled searches, plain beats and recorded beats of one circuit on one grid.

    Args:
        program: beat program.
        width: number of members side by side.
    """

    program: BeatProgram
    width: int

    @property
    def signals(self) -> tuple[str, ...]:
        """Signals that the program records: all at a width of 1, none at larger widths."""
        return self.program.signals if self.width == 1 else ()

    def search(
        self,
        start: np.ndarray,
        inverse: np.ndarray,
        packed: np.ndarray,
        volume: Volume,
        options: OrbitOptions,
    ) -> SearchEnd:
        """Search for the steady beat of every member by Broyden's method only.

        Args:
            start: start states, shape (states, members).
            inverse: inverse Jacobian in scaled states, shape (states, states), or (states, states, members).
            packed: parameters, shape (names, members).
            volume: the blood volume condition.
            options: accuracy and effort.
        """
        rules = (options.tolerance, options.error_tolerance, float(options.quasi_newton_beats), 0.0)
        return self._run(start, inverse, packed, volume.weights, volume.target, np.array(rules))

    def wait(self, states: np.ndarray, packed: np.ndarray, beats: int = 1) -> np.ndarray:
        """States after a number of plain beats, shape (states, members)."""
        n, count = states.shape
        rules = np.array([-1.0, -1.0, float(beats), 1.0])
        return self._run(states, np.zeros((n, n)), packed, np.zeros(n), np.ones(count), rules).after

    def beat(self, state: np.ndarray, packed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """One plain beat of one member at a width of 1: state after it, and `signals` (steps, signals)."""
        n, rules = len(state), np.array([-1.0, -1.0, 1.0, 1.0])
        numbers, series = _single(self.program)(state, np.zeros((n, n)), packed, np.zeros(n), 1.0, rules)
        return np.asarray(numbers)[n : 2 * n], np.asarray(series)

    def record(
        self, states: np.ndarray, packed: np.ndarray, signals: tuple[str, ...]
    ) -> tuple[tuple[str, ...], np.ndarray]:
        """Names of the recorded signals (at least the given ones) and values (steps, signals, members)."""
        count = states.shape[1]
        if self.width == 1:
            series = [self.beat(states[:, k], packed[:, k])[1] for k in range(count)]
            return self.signals, series[0][..., None] if count == 1 else np.stack(series, axis=-1)
        entries = np.arange(-(-count // self.width) * self.width).reshape(-1, self.width) % count
        trace = self.program.trace(signals)
        blocks = [np.asarray(trace(states[:, block], packed[:, block])[1]) for block in entries]
        return signals, np.concatenate(blocks, axis=-1)[..., :count]

    def _run(
        self,
        start: np.ndarray,
        inverse: np.ndarray,
        packed: np.ndarray,
        weights: np.ndarray,
        target: np.ndarray,
        rules: np.ndarray,
    ) -> SearchEnd:
        if self.width > 1:
            return _side_by_side(self, start, inverse, packed, weights, target, rules)
        n, run = len(start), _single(self.program)
        result = np.empty((2 * n + 4, start.shape[1]))
        for k in range(start.shape[1]):
            of_member = inverse if inverse.ndim == 2 else inverse[:, :, k]
            result[:, k] = run(start[:, k], of_member, packed[:, k], weights, target[k], rules)[0]
        converged, beats, change, drift = result[2 * n :]
        return SearchEnd(result[:n], result[n : 2 * n], converged > 0.0, beats.astype(int), change, drift)


@lru_cache(maxsize=64)
def compiled_search(program: BeatProgram, width: int) -> CompiledSearch:
    """The search of a circuit on a grid; compiled on first use and cached."""
    return CompiledSearch(program, width)


def _side_by_side(
    search: CompiledSearch,
    start: np.ndarray,
    inverse: np.ndarray,
    packed: np.ndarray,
    weights: np.ndarray,
    target: np.ndarray,
    rules: np.ndarray,
) -> SearchEnd:
    """Search for all members, `width` at a time; a finished member's entry is given to the next."""
    (n, count), run, width = start.shape, _several(search.program), search.width
    result = SearchEnd(
        np.full((n, count), np.nan), np.full((n, count), np.nan), np.zeros(count, dtype=bool),
        np.zeros(count, dtype=int), np.full(count, np.inf), np.full(count, np.inf),
    )  # fmt: skip
    entries = np.arange(width) % count
    inputs = [array[..., entries] for array in (start, packed, target)]
    inverses: Array = np.repeat(inverse[:, :, None], width, 2) if inverse.ndim == 2 else inverse[..., entries]
    inverses = jax.device_put(inverses) if inverse.ndim == 2 else inverses
    member = np.where(np.arange(width) < count, entries, -1)
    begins, begun = member >= 0, min(width, count)
    now = _idle(n, width)
    while (member >= 0).any():
        now = Iterate(
            *run(*now, begins, *inputs, inverses, weights[:, None], rules, np.array(begun == count))
        )
        ended = np.flatnonzero(~np.asarray(now.running) & (member >= 0))
        for name, values in result._asdict().items():
            values[..., member[ended]] = np.asarray(getattr(now, name))[..., ended]
        member[ended], begins = -1, np.zeros(width, dtype=bool)
        following = np.arange(begun, min(begun + len(ended), count))
        begun, free = begun + len(following), ended[: len(following)]
        member[free], begins[free] = following, True
        for array, values in zip(inputs, (start, packed, target), strict=True):
            array[..., free] = values[..., following]
        if inverse.ndim == 3:
            inverses[..., free] = inverse[..., following]
    return result


@lru_cache(maxsize=64)
def _idle(n: int, width: int) -> Iterate:
    """Entries without a running search."""
    return jax.device_put(_begin(np.zeros((n, width)), np.zeros(width, dtype=bool), np.zeros((n, n, width))))


def _begin(state: Array, running: Array, inverse: Array) -> Iterate:
    """Iterates of members before their first beat."""
    zero, infinite = jnp.zeros_like(state), jnp.full(state.shape[1:], jnp.inf)
    beats, none = jnp.zeros(state.shape[1:], dtype=int), jnp.zeros(state.shape[1:], dtype=bool)
    return Iterate(
        beats, running, none, jnp.asarray(state), zero, zero, jnp.asarray(inverse),
        zero * jnp.nan, infinite, infinite, zero,
    )  # fmt: skip


@lru_cache(maxsize=64)
def _single(program: BeatProgram) -> Callable[..., tuple[Array, Array]]:
    """Compiled search of one member: array of (best, after, converged, beats, change, drift), and signals."""
    primary = program.primary

    def run(
        state: Array, inverse: Array, packed: Array, weights: Array, target: Array, rules: Array
    ) -> tuple[Array, Array]:
        def beat(carry: tuple[Iterate, Array, Array]) -> tuple[Iterate, Array, Array]:
            now = carry[0]
            return *_iterated(program, primary, now, packed, weights, target, rules), now.state

        nothing = jnp.zeros((program.grid.n_steps, len(primary)))
        begin = _begin(state, jnp.asarray(True), inverse), nothing, state
        end, recorded, before = jax.lax.while_loop(lambda carry: carry[0].running, beat, begin)
        numbers = [end.converged.astype(float), end.beats.astype(float), end.change, end.drift]
        signals = program.derived(recorded, before, packed, program.signals)
        return jnp.concatenate([end.best, end.after, jnp.stack(numbers)]), signals

    return compiled(run, ("search", program))


@lru_cache(maxsize=64)
def _several(program: BeatProgram) -> Callable[..., tuple[Array, ...]]:
    """Compiled search of several members, which stops when enough of them are finished.

    The last argument is true if no further member waits; the search then runs until all are finished.
    """

    def run(*arguments: Array) -> tuple[Array, ...]:
        before, others = Iterate(*arguments[: len(Iterate._fields)]), arguments[len(Iterate._fields) :]
        begins, start, packed, target, inverse, weights, rules, last = others
        fresh = _begin(start, jnp.ones_like(begins), inverse)
        small = [name for name in Iterate._fields if name not in ("inverse", "step", "residual")]

        def chosen(choose: Array, new: Iterate, old: Iterate) -> Iterate:
            return new._replace(**{n: jnp.where(choose, getattr(new, n), getattr(old, n)) for n in small})

        def beat(now: Iterate) -> Iterate:
            new, _ = _iterated(program, (), now, packed, weights, target, rules)
            return chosen(now.running, new, now)

        def continues(now: Iterate) -> Array:
            return jnp.any(now.running) & (last | (jnp.mean(now.running) > SMALLEST_RUNNING_SHARE))

        last_beat = {"step": before.step, "residual": before.residual}
        learnt = jnp.where(begins, fresh.inverse, before.inverse)
        begin = chosen(begins, fresh._replace(**last_beat), before)._replace(inverse=learnt)
        return tuple(jax.lax.while_loop(continues, beat, begin))

    return compiled(run, ("searches", program))


def _iterated(
    program: BeatProgram,
    signals: tuple[str, ...],
    now: Iterate,
    packed: Array,
    weights: Array,
    target: Array,
    rules: Array,
) -> tuple[Iterate, Array]:
    """Compute one beat and, from its residual, the next state; also return the signals of that beat.

    `rules` holds tolerance, error tolerance, largest number of beats, and 1 for plain beats.
    """
    sides = (slice(None), *(None,) * (now.state.ndim - 1))
    layout = program.assembly.layout
    scale, shares, largest = layout.scales[sides], layout.spread[sides], layout.largest_steps[sides]
    after, recorded = program.run(now.state, packed, signals)
    moved = now.state - after
    excess = jnp.sum(weights * now.state, axis=0) - target
    size, distance = jnp.maximum(jnp.abs(now.state), layout.smallest_sizes[sides]), jnp.abs(moved)
    change = jnp.maximum(jnp.max(distance / size, axis=0), jnp.abs(excess) / jnp.maximum(target, 1.0))
    finite = jnp.isfinite(change)
    residual = jnp.where(finite, (moved + shares * excess) / scale, 0.0)
    inverse, step = _broyden_update(now, residual)
    moves = step * scale
    error = jnp.max(jnp.abs(moves) / size, axis=0)
    converged = finite & (change <= rules[0]) & (error <= rules[1])
    better = converged | (finite & (change < now.change))
    share = 1.0 / jnp.maximum(
        jnp.max(jnp.abs(moves) / largest_allowed_steps(now.state, largest), axis=0), 1.0
    )
    plain = rules[3] > 0.0
    end = jnp.max(distance[layout.volumes.where], axis=0)
    return Iterate(
        beats=now.beats + 1,
        running=(finite | plain) & ~converged & (now.beats + 1 < rules[2]),
        converged=converged,
        state=jnp.where(plain, after, now.state + moves * share),
        step=step * share,
        residual=residual,
        inverse=inverse,
        best=jnp.where(better, jnp.where(converged, now.state + moves, now.state), now.best),
        change=jnp.where(better, change, now.change),
        drift=jnp.where(better, end, now.drift),
        after=after,
    ), recorded


def _broyden_update(now: Iterate, residual: Array) -> tuple[Array, Array]:
    """Updated inverse, which maps the observed change of the residual to its step, and the next step."""
    change = residual - now.residual

    def products(k: Array, sums: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        image, row, move = sums
        column = now.inverse[:, k]
        return image + column * change[k], row + now.inverse[k] * now.step[k], move + column * residual[k]

    image, row, move = jax.lax.fori_loop(0, len(change), products, (jnp.zeros_like(change),) * 3)
    size = jnp.sum(row * change, axis=0)
    usable = (jnp.abs(size) > SMALLEST_UPDATE_SHARE * jnp.sum(now.step * now.step, axis=0)) & (now.beats > 0)
    column = jnp.where(usable, (now.step - image) / jnp.where(usable, size, 1.0), 0.0)
    inverse = now.inverse + column[:, None] * row
    return inverse, -(move + column * jnp.sum(row * residual, axis=0))
