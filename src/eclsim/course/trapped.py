"""Blood behind valves that stay shut in a course: how much there is follows from the beats before.

A case alone does not determine it (`eclsim.outputs.sealed`), but a course begins at a steady beat that does,
and no blood passes closed valves. From the last known beat, plain beats are computed until no more blood
passes; the steady beat is then searched for with the volumes behind the valves held.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from eclsim.circuit.assembly import assemble
from eclsim.circuit.network import Circuit
from eclsim.orbit.equation import Anchor
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch, SolvedOrbits, inverse_jacobian
from eclsim.outputs.coupling import CoupledAnchor
from eclsim.outputs.sealed import TrappedBlood
from eclsim.outputs.steady_beat import SteadyBeat, steady_beat
from eclsim.parameters.regulation import EXTRA_VOLUME

Parts = tuple[tuple[str, ...], ...]
SAME_ML = 1e-3
"""Difference of a trapped volume below which two beats have the same one [mL]."""
BEATS, MOST_BEATS = 20, 3000
"""Plain beats between two looks at the trapped volumes, and at most."""
STILL_ML = 0.01
"""Change of trapped volumes over `BEATS` beats below which no more blood passes [mL]; halved when a search
finds that it does."""
SETTLED = 0.05
"""Change of any state over `BEATS` beats, relative to its scale, below which the circulation has settled."""
MOMENT_ML = 0.1
"""Change of the blood volume below which a settled state remains settled [mL]."""
HELD_ML = 0.25
"""Largest change of a trapped volume in a search that holds it, as some blood still passes [mL]."""
GULP_ML, BEATS_PER_GULP = 25.0, 4
"""Blood given to the systemic veins at once, so that no valve opens by the surge [mL], and beats after it."""
LARGEST_RATIO, EXTRAPOLATED_SHARE = 0.95, 0.6
"""Largest ratio of what passes in two intervals for which the rest is extrapolated, and the share that is
moved: valves let none of it back."""
SEARCHES = 8


class KnownBlood(NamedTuple):
    """State of a beat of which the case, or the beats before, determine where the blood is.

    Attributes:
        circuit: circuit of the beat.
        state: state at phase 0, shape (states,).
        isolated: parts that closed valves isolated in that steady beat; none if blood passed, or if the beat
            had not settled.
        later: state of a later beat, if the beat in question is between the two.
    """

    circuit: Circuit
    state: np.ndarray
    isolated: Parts = ()
    later: np.ndarray | None = None


def isolated_parts(beat: SteadyBeat, member: int) -> Parts:
    """Groups of compartments that closed valves isolate during a member's beat; none if blood passes."""
    if member in beat.trapped:
        return beat.trapped[member].sealed.parts
    return beat.undetermined[member].parts if member in beat.undetermined else ()


def with_blood_of(
    beat: SteadyBeat,
    member: int,
    before: KnownBlood | None,
    solve: Callable[[Batch, Anchor], SteadyBeat],
    inverses: Mapping[Parts, np.ndarray],
) -> tuple[SteadyBeat, int] | None:
    """Beat that follows from an earlier one, and the place of the member in it; None if it cannot be found.

    Args:
        beat: a batch of steady beats.
        member: member whose beat is one of many.
        before: an earlier beat of the same patient; None if none is known.
        solve: searches for the beat of a batch of one from a start, best with the program of a single member.
        inverses: known inverse Jacobians near the beat that hold the volumes of parts, by these.
    """
    orbits = replace(beat.orbits.take(np.array([member])), width=1)
    if before is None or before.circuit.canonical is not orbits.batch.circuit:
        return None
    parts = beat.undetermined[member].parts
    state, missing = _between(orbits, before)
    same = before.isolated == parts
    if same and _differ_ml(orbits, orbits.states[:, 0], state, parts) < SAME_ML:
        return _determined(beat, member), member
    response = None if beat.response is None else beat.response[[member]]
    search = _Search(orbits, solve, beat.coupled, response)
    state, settled = _with_blood_given(orbits, state, missing), same and abs(missing) < MOMENT_ML
    found = search.beat_from(state, settled, parts, inverses.get(parts))
    return None if found is None else (found, 0)


@dataclass(frozen=True)
class _Search:
    """Search for a patient's beat with known volumes behind the valves.

    Attributes:
        orbits: an orbit of the patient.
        solve: see `with_blood_of`.
        coupled: parameters that are solved for with the gases.
        response: their inverse Jacobian; None if there are none.
    """

    orbits: SolvedOrbits
    solve: Callable[[Batch, Anchor], SteadyBeat]
    coupled: tuple[str, ...]
    response: np.ndarray | None

    def beat_from(
        self, state: np.ndarray, is_settled: bool, parts: Parts, inverse: np.ndarray | None
    ) -> SteadyBeat | None:
        """The beat in which a state settles; None if it is not found.

        Args:
            state: the state.
            is_settled: whether it is expected to have settled already.
            parts: parts that are isolated as far as is known.
            inverse: inverse Jacobian that holds their volumes; None if it is not known.
        """
        for tries in range(SEARCHES):
            if inverse is None or len(inverse) != len(state) or tries == SEARCHES // 2:
                inverse = inverse_jacobian(replace(self.orbits, states=state[:, None]), 0, parts)
            if tries or not is_settled:
                settled = _settled(self.orbits, state, parts, inverse, STILL_ML * 0.5**tries)
                if settled is None:
                    return None
                state = settled
            found, holds = self._held(state, state, parts, inverse)
            if not holds and found.status[0] == Status.ONE_OF_MANY and isolated_parts(found, 0) == parts:
                change = _volumes(self.orbits, state, parts) - _volumes(found.orbits, _state(found), parts)
                near = _state(found) + _response(self.orbits, parts, inverse) @ change
                found, holds = self._held(near, state, parts, inverse)
            if holds:
                return found if found.determined[0] else _determined(found, 0)
            if found.status[0] == Status.ONE_OF_MANY and isolated_parts(found, 0) != parts:
                parts, inverse = isolated_parts(found, 0), None
        return None

    def _held(
        self, start: np.ndarray, like: np.ndarray, parts: Parts, inverse: np.ndarray
    ) -> tuple[SteadyBeat, bool]:
        """Beat found from a start, and whether its isolated parts, if any, hold as much as in a state."""
        batch, here = self.orbits.batch, (start[:, None], inverse[..., None])
        anchor = Anchor(*here)
        if self.response is not None:
            place = np.log(np.array([batch.values[name] for name in self.coupled]))
            anchor = CoupledAnchor(*here, self.coupled, place, self.response)
        unset = dict.fromkeys(self.coupled, np.full(1, np.nan))
        found = self.solve(replace(batch, values={**batch.values, **unset}), anchor)
        if found.status[0] != Status.ONE_OF_MANY:
            return found, bool(found.determined[0])
        same = isolated_parts(found, 0) == parts
        return found, same and _differ_ml(self.orbits, _state(found), like, parts) < HELD_ML


def _state(beat: SteadyBeat) -> np.ndarray:
    return beat.orbits.states[:, 0]


def beat_with_blood_of(beat: SteadyBeat, before: KnownBlood) -> SteadyBeat:
    """A recorded beat of one patient; where valves stay shut, with the blood behind them as it was before."""
    if beat.status[0] != Status.ONE_OF_MANY:
        return beat

    def solve(batch: Batch, start: Anchor) -> SteadyBeat:
        return steady_beat(batch, beat.names, waveforms=None, keep=None, start=start)

    found = with_blood_of(beat, 0, before, solve, {})
    return beat if found is None else found[0]


def _determined(beat: SteadyBeat, member: int) -> SteadyBeat:
    """The same beats, with a member whose trapped blood is known."""
    sealed = beat.undetermined[member]
    volumes = _volumes(beat.orbits, beat.orbits.states[:, member], sealed.parts)
    status = beat.status.copy()
    status[member] = Status.CONVERGED
    others = {k: other for k, other in beat.undetermined.items() if k != member}
    known = TrappedBlood(sealed, tuple(volumes.tolist()))
    return replace(beat, status=status, undetermined=others, trapped={**beat.trapped, member: known})


def _volumes(orbits: SolvedOrbits, state: np.ndarray, parts: Parts) -> np.ndarray:
    """Stressed volume of each part [mL]."""
    layout = assemble(orbits.batch.circuit).layout
    return np.array([state[np.isin(layout.names, [f"V{name}" for name in part])].sum() for part in parts])


def _differ_ml(orbits: SolvedOrbits, state: np.ndarray, other: np.ndarray, parts: Parts) -> float:
    change = _volumes(orbits, state, parts) - _volumes(orbits, other, parts)
    return float(np.abs(change).max())


def _between(orbits: SolvedOrbits, known: KnownBlood) -> tuple[np.ndarray, float]:
    """Known state, or that between two with the blood volume of the batch, and what it lacks of this [mL]."""
    volume, state = orbits.batch.volume(), known.state
    missing = float(volume.target[0] - volume.weights @ state)
    if known.later is None or len(known.later) != len(state):
        return state, missing
    change = known.later - state
    gained = float(volume.weights @ change)
    share = min(max(missing / gained, 0.0), 1.0) if gained else 0.0
    return state + share * change, missing - share * gained


def _with_blood_given(orbits: SolvedOrbits, state: np.ndarray, missing: float) -> np.ndarray:
    """A state after blood is given [mL], which systemic veins take up as in a patient."""
    assembly, values = assemble(orbits.batch.circuit), orbits.batch.member(0)
    given = {**values, EXTRA_VOLUME: values.get(EXTRA_VOLUME, 0.0) + 1.0}
    door = np.zeros(len(state))
    door[assembly.layout.volumes.where] = assembly.start_changes(values, given)
    door = door if door.any() else assembly.layout.spread
    gulps = int(np.ceil(abs(missing) / GULP_ML))
    for _ in range(gulps):
        state = orbits.wait(np.array([0]), (state + door * missing / gulps)[:, None], BEATS_PER_GULP)[:, 0]
    return state


def _settled(
    orbits: SolvedOrbits, state: np.ndarray, parts: Parts, inverse: np.ndarray, still_ml: float
) -> np.ndarray | None:
    """State at which less than `still_ml` passes in `BEATS`; None if blood goes on entering or leaving parts.

    Plain beats lead there. What still passes after two looks is extrapolated as a geometric series.
    """
    moved, scales = None, assemble(orbits.batch.circuit).layout.scales
    for _ in range(MOST_BEATS // BEATS):
        before, state = state, orbits.wait(np.array([0]), state[:, None], BEATS)[:, 0]
        if not np.isfinite(state).all():
            return None
        last, moved = moved, _volumes(orbits, state, parts) - _volumes(orbits, before, parts)
        change = np.abs(state - before) / scales
        if np.abs(moved).max() < still_ml and change.max() < SETTLED * still_ml / STILL_ML:
            return state
        ratio = float(last @ moved / (last @ last)) if last is not None and last.any() else 0.0
        if 0.0 < ratio < LARGEST_RATIO:
            further = EXTRAPOLATED_SHARE * ratio / (1.0 - ratio) * moved
            state = state + _response(orbits, parts, inverse) @ further
            moved = None
    return None


def _response(orbits: SolvedOrbits, parts: Parts, inverse: np.ndarray) -> np.ndarray:
    """Change of the steady state with the volume held in each part, shape (states, parts)."""
    layout = assemble(orbits.batch.circuit).layout
    shares = np.array([np.isin(layout.names, [f"V{name}" for name in part]) for part in parts], dtype=float)
    shares = (shares / shares.sum(axis=1, keepdims=True)).T / layout.scales[:, None]
    return layout.scales[:, None] * (inverse @ shares)
