"""Steady beats of patients who respond to the gases of their own blood: beat and gases solved together.

A circuit represents responses to gases by a few parameters p (`SOLVED_BY`), each of which equals an output
o(p) in the steady beat: the PO2 that chemoreceptors sense is that of the arteries. Parameters that are NaN
are solved for, by Broyden's method on log o(p) - log p, for every member separately. Derivatives follow from

    dp/dx = (1 - do/dp)^-1 do/dx
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

import numpy as np

from eclsim.circuit.network import Circuit
from eclsim.orbit.equation import Anchor, OrbitOptions
from eclsim.orbit.steady import Batch, SolvedOrbits, inverses_near
from eclsim.outputs.derivatives import Linearisation
from eclsim.outputs.regulation import SOLVED_BY
from eclsim.parameters.regulation import PARAMETERS

ITERATIONS = 30
HALVINGS = 5
LARGEST_STEP = 0.7
"""Largest step in the logarithm of a parameter."""
ACCURACY = 10.0
"""Largest difference of the logarithms, relative to the tolerance of the beats."""
SMALLEST = 1e-6
Start = Mapping[str, float] | Anchor | None


def solved_for(circuit: Circuit) -> tuple[str, ...]:
    """Parameters of a circuit that equal outputs of its steady beat."""
    read = circuit.parameter_names()
    return tuple(name for name in SOLVED_BY if name in read)


def open_parameters(batch: Batch) -> tuple[str, ...]:
    """Parameters that must be solved for, because they are NaN in some member."""
    return tuple(name for name in solved_for(batch.circuit) if np.isnan(batch.values[name]).any())


def with_resting_values(values: Start) -> Start:
    """Start values of a search, with the parameters to solve for as in a patient at rest."""
    if values is None or isinstance(values, Anchor):
        return values
    unset = [name for name in SOLVED_BY if name in values and np.isnan(values[name]).any()]
    return {**values, **{name: PARAMETERS[name].value for name in unset}}


class Measured(Protocol):
    """Interface of measured steady beats of a batch (`eclsim.outputs.steady_beat.SteadyBeat`)."""

    @property
    def orbits(self) -> SolvedOrbits:
        """States, and how each was solved."""
        ...

    def output(self, name: str) -> np.ndarray:
        """An output of every member; NaN without a steady beat or gas state."""
        ...


@dataclass(frozen=True)
class CoupledAnchor(Anchor):
    """Start of a search for each patient, including the parameters solved for with the gases.

    Args:
        names: names of these parameters.
        place: logarithms of these parameters, shape (parameters, patients).
        response: inverse Jacobian of the residual of these parameters, shape (patients, parameters,
            parameters).
    """

    names: tuple[str, ...]
    place: np.ndarray
    response: np.ndarray


Beat = TypeVar("Beat", bound=Measured)


@dataclass(frozen=True)
class Coupled(Generic[Beat]):
    """Solution of a batch with the parameters solved for.

    Args:
        orbits: orbits with these parameters.
        settled: whether each member has converged.
        response: inverse Jacobian of the residual, shape (members, parameters, parameters).
        beat: measured beats of these orbits if the last round had all members; else None.
    """

    orbits: SolvedOrbits
    settled: np.ndarray
    response: np.ndarray
    beat: Beat | None


def settle(
    batch: Batch,
    names: tuple[str, ...],
    measure: Callable[[Batch, Start], Beat],
    options: OrbitOptions,
    start: Start = None,
) -> Coupled[Beat]:
    """Solve for the parameters of all members.

    Args:
        batch: batch with NaN where a parameter is to be solved for.
        names: names of the parameters.
        measure: solves beats from a start and measures the outputs that the parameters equal; a member's
            result does not depend on others.
        options: options with which it solves them.
        start: start of the searches for beats and, if it is a `CoupledAnchor`, for the parameters.
    """
    size, count = len(names), batch.count
    if isinstance(start, CoupledAnchor) and start.names == names:
        place, response = start.place.copy(), start.response.copy()
    else:
        place = np.log(np.array([[PARAMETERS[name].value] for name in names]) * np.ones(count))
        response = np.broadcast_to(-np.eye(size), (count, size, size)).copy()
    search = _Search(batch, names, measure, options, start, place)
    enough = max(ACCURACY * options.error_tolerance, SMALLEST)
    for _ in range(ITERATIONS):
        open_ = np.isfinite(search.residual).all(axis=0) & ~_settled(search.residual, enough)
        members = np.flatnonzero(open_)
        if not len(members):
            break
        newton = -np.einsum("mij,jm->im", response[members], search.residual[:, members])
        step, change = search.move(members, np.clip(newton, -LARGEST_STEP, LARGEST_STEP))
        _broyden_update(response, members, step, change)
    return Coupled(search.solved(), _settled(search.residual, enough), response, search.beat)


class _Search(Generic[Beat]):
    """Iteration of several members towards the parameters; each beat starts from the previous one.

    Args:
        batch, names, measure, options, start: see `settle`.
        place: logarithms of the parameters, shape (parameters, members).

    Attributes:
        residual: log o(p) - log p, shape (parameters, members).
        orbits: orbits of the last iteration.
        beat: beats of the last round, if all members were in it; else None.
    """

    def __init__(
        self,
        batch: Batch,
        names: tuple[str, ...],
        measure: Callable[[Batch, Start], Beat],
        options: OrbitOptions,
        start: Start,
        place: np.ndarray,
    ):
        self.batch, self.names, self.measure = batch, names, measure
        self.options, self.start, self.place = options, start, place
        beat, self.residual = self._residual_at(self._batch_at(place), start)
        self.beat: Beat | None = beat
        self.orbits = replace(beat.orbits, resolution=np.array(beat.orbits.resolution))
        self._open = np.arange(0)
        self._inverses: np.ndarray | None = None

    def move(self, members: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Move members by a step, which is halved if it ends without a steady beat or gas state.

        Returns:
            The steps made and the changes of the residual, both of shape (parameters, members).
        """
        step, change = step.copy(), np.full_like(step, np.nan)
        place, residual, begin = self.place[:, members], self.residual[:, members], self._begin(members)
        trying = np.arange(len(members))
        for _ in range(1 + HALVINGS):
            tried = members[trying]
            batch = self._batch_at(place[:, trying] + step[:, trying], tried)
            beat, after = self._residual_at(batch, begin.take(trying))
            self.beat = beat if len(tried) == self.batch.count else None
            self._store(tried, beat.orbits, place[:, trying] + step[:, trying], after)
            change[:, trying] = after - residual[:, trying]
            trying = trying[~np.isfinite(after).all(axis=0)]
            if not len(trying):
                break
            step[:, trying] *= 0.5
        return step, change

    def solved(self) -> SolvedOrbits:
        """Return the last orbits, with the parameters solved for in their batch."""
        return replace(self.orbits, batch=self._batch_at(self.place))

    def _batch_at(self, place: np.ndarray, members: np.ndarray | None = None) -> Batch:
        """Return a batch of some or all members with the given logarithms of the parameters."""
        part = self.batch if members is None else self.batch.take(members)
        return replace(part, values={**part.values, **dict(zip(self.names, np.exp(place), strict=True))})

    def _residual_at(self, batch: Batch, start: Start) -> tuple[Beat, np.ndarray]:
        place = np.log(np.array([batch.values[name] for name in self.names]))
        beat = self.measure(batch, start)
        with np.errstate(invalid="ignore", divide="ignore"):
            return beat, np.log([beat.output(SOLVED_BY[name]) for name in self.names]) - place

    def _begin(self, members: np.ndarray) -> Anchor:
        """Starts of the next searches of some members, from their last beats."""
        states = self.orbits.states[:, members]
        if isinstance(self.start, Anchor):
            given = self.start.take(members).inverse
            return Anchor(states, given if given.ndim == 3 else np.repeat(given[..., None], len(members), 2))
        if self._inverses is None:
            near = self.solved().take(members)
            self._open, self._inverses = members, inverses_near(near, self.start, self.options)
        return Anchor(states, self._inverses[..., np.searchsorted(self._open, members)])

    def _store(
        self, members: np.ndarray, orbits: SolvedOrbits, place: np.ndarray, residual: np.ndarray
    ) -> None:
        beats = self.orbits.beats[members] + orbits.beats
        self.orbits.put(members, orbits)
        self.orbits.beats[members], self.orbits.resolution[members] = beats, orbits.resolution
        self.place[:, members], self.residual[:, members] = place, residual


def _settled(residual: np.ndarray, enough: float) -> np.ndarray:
    """Whether the residual of each member is small enough."""
    return np.abs(np.where(np.isfinite(residual), residual, np.inf)).max(axis=0) <= enough


def _broyden_update(inverse: np.ndarray, members: np.ndarray, step: np.ndarray, change: np.ndarray) -> None:
    """Update the inverse Jacobians of members by Broyden's formula, where changes are finite."""
    for k, m in enumerate(members):
        h, s, y = inverse[m], step[:, k], change[:, k]
        divisor = s @ h @ y
        if abs(divisor) > 1e-12 * float(s @ s) and np.isfinite(divisor):
            inverse[m] = h + np.outer(s - h @ y, s @ h) / divisor


def total_derivatives(linear: Linearisation, outputs: int, parameters: int) -> Linearisation:
    """Total derivatives, in which the parameters solved for change with the other parameters.

    Args:
        linear: derivatives of the outputs, followed by those that the solved parameters equal, with respect
            to the parameters, followed by the solved ones.
        outputs: number of outputs at the beginning.
        parameters: number of parameters at the beginning.
    """
    slopes = linear.slopes
    square = slopes[outputs:, parameters:]
    following = np.linalg.solve(np.eye(len(square)) - square, slopes[outputs:, :parameters])
    return replace(
        linear,
        values=linear.values[:outputs],
        values_on_orbit=linear.values_on_orbit[:outputs],
        slopes=slopes[:outputs, :parameters] + slopes[:outputs, parameters:] @ following,
        orbit=linear.orbit.combined(parameters, following),
    )
