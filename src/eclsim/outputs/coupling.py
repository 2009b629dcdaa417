"""Beats whose patients answer to the gases of their own blood: beat and gases solved together.

What answers to gases enters a circuit as a few parameters p (`SOLVED_BY`), each of which equals an output
o(p) in the steady beat: the PO2 that chemoreceptors sense is that of the arteries. Where they are NaN they
are solved for, by Broyden's method on log o(p) - log p, every member by itself. Derivatives follow from

    dp/dx = (1 - do/dp)^-1 do/dx
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

import numpy as np

from eclsim.circuit.network import Circuit
from eclsim.orbit.equation import Anchor
from eclsim.orbit.steady import Batch, SolvedOrbits
from eclsim.outputs.derivatives import Linearisation
from eclsim.outputs.regulation import SOLVED_BY
from eclsim.parameters.regulation import PARAMETERS

ITERATIONS = 30
HALVINGS = 5
LARGEST_STEP = 0.7
"""In the logarithm of a parameter."""
ACCURACY = 10.0
"""Largest difference of logarithms, in tolerances of the beats that it is computed from."""
SMALLEST = 1e-6
Start = Mapping[str, float] | Anchor | None


def solved_for(circuit: Circuit) -> tuple[str, ...]:
    """Parameters of a circuit that equal outputs."""
    read = circuit.parameter_names()
    return tuple(name for name in SOLVED_BY if name in read)


def open_parameters(batch: Batch) -> tuple[str, ...]:
    """Those that are to be solved for: NaN in some member."""
    return tuple(name for name in solved_for(batch.circuit) if np.isnan(batch.values[name]).any())


def with_neutral(values: Start) -> Start:
    """Values at which a search may begin: what is to be solved for as in a patient at rest."""
    if values is None or isinstance(values, Anchor):
        return values
    unset = [name for name in SOLVED_BY if name in values and np.isnan(values[name]).any()]
    return {**values, **{name: PARAMETERS[name].value for name in unset}}


class Measured(Protocol):
    """Steady beats of a batch, measured (`eclsim.outputs.steady_beat.SteadyBeat`)."""

    @property
    def orbits(self) -> SolvedOrbits:
        """States, and how each was solved."""
        ...

    def output(self, name: str) -> np.ndarray:
        """An output of every member, NaN where there is no steady beat or gas state."""
        ...


Beat = TypeVar("Beat", bound=Measured)


@dataclass(frozen=True)
class CoupledAnchor(Anchor):
    """Where a search starts for each patient, what is solved for with the gases included.

    Args:
        names: of the parameters that are solved for.
        place: their logarithms, shape (parameters, patients).
        response: inverse Jacobian of what they miss, shape (patients, parameters, parameters).
    """

    names: tuple[str, ...]
    place: np.ndarray
    response: np.ndarray


@dataclass(frozen=True)
class Coupled(Generic[Beat]):
    """Beats of a batch with what was solved for.

    Args:
        beat: with these parameters.
        settled: which members have them.
        response: inverse Jacobian of what they miss, shape (members, parameters, parameters).
    """

    beat: Beat
    settled: np.ndarray
    response: np.ndarray


def settle(
    batch: Batch,
    names: tuple[str, ...],
    measure: Callable[[Batch, Start], Beat],
    tolerance: float,
    start: Start = None,
) -> Coupled[Beat]:
    """Solve for the parameters of all members.

    Args:
        batch: with NaN where a parameter is to be solved for.
        names: of the parameters.
        measure: solves beats from a start and measures the outputs that the parameters equal.
        tolerance: relative accuracy of the beats.
        start: where the searches for beats begin, and of a `CoupledAnchor` that for the parameters.
    """
    size, count = len(names), batch.count
    if isinstance(start, CoupledAnchor) and start.names == names:
        place, inverse = start.place.copy(), start.response.copy()
    else:
        place = np.log(np.array([[PARAMETERS[name].value] for name in names]) * np.ones(count))
        inverse = np.broadcast_to(-np.eye(size), (count, size, size)).copy()

    def missing_at(place: np.ndarray, begin: Start) -> tuple[Beat, np.ndarray]:
        """Beats, and log o(p) - log p (parameters, members)."""
        values = {**batch.values, **dict(zip(names, np.exp(place), strict=True))}
        beat = measure(replace(batch, values=values), begin)
        with np.errstate(invalid="ignore", divide="ignore"):
            return beat, np.log([beat.output(SOLVED_BY[name]) for name in names]) - place

    beat, missing = missing_at(place, start)
    enough, step = max(ACCURACY * tolerance, SMALLEST), np.zeros((size, count))
    for _ in range(ITERATIONS):
        known = np.isfinite(missing).all(axis=0)
        if not (known & ~_settled(missing, enough)).any():
            break
        newton = -np.einsum("mij,jm->im", inverse, np.where(known, missing, 0.0))
        step = np.where(_settled(missing, enough), 0.0, np.clip(newton, -LARGEST_STEP, LARGEST_STEP))
        begin = _on_from(start, beat)
        beat, after = missing_at(place + step, begin)
        for _ in range(HALVINGS):
            # A step to where there is no steady beat or gas state is halved.
            failed = known & ~np.isfinite(after).all(axis=0)
            if not failed.any():
                break
            step = np.where(failed, 0.5 * step, step)
            beat, after = missing_at(place + step, begin)
        _learn(inverse, np.asarray(known & np.isfinite(after).all(axis=0)), step, after - missing)
        place, missing = place + step, after
    return Coupled(beat, _settled(missing, enough), inverse)


def _on_from(start: Start, beat: Measured) -> Start:
    """The next searches begin at the last beats, where it is known how they go on."""
    if not isinstance(start, Anchor):
        return start
    states = beat.orbits.states
    known = np.isfinite(states).all(axis=0)
    return Anchor(np.where(known, states, start.states(states.shape[1])), start.inverse)


def _settled(missing: np.ndarray, enough: float) -> np.ndarray:
    """Which members miss next to nothing."""
    return np.abs(np.where(np.isfinite(missing), missing, np.inf)).max(axis=0) <= enough


def _learn(inverse: np.ndarray, members: np.ndarray, step: np.ndarray, change: np.ndarray) -> None:
    """Broyden's update of some members' inverse Jacobians."""
    for m in np.flatnonzero(members):
        h, s, y = inverse[m], step[:, m], change[:, m]
        divisor = s @ h @ y
        if abs(divisor) > 1e-12 * float(s @ s) and np.isfinite(divisor):
            inverse[m] = h + np.outer(s - h @ y, s @ h) / divisor


def total(linear: Linearisation, outputs: int, parameters: int) -> Linearisation:
    """Derivatives with what is solved for following along.

    Args:
        linear: of the outputs and then of those that the parameters solved for equal, with respect to the
            parameters and then to these.
        outputs: how many outputs come first.
        parameters: how many parameters come first.
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
