"""Time grid of one beat in phase, shared by all patients of a batch, and the resolution that a patient needs.

Systole and the opening of the atrioventricular valves happen in the first six tenths of the beat, the atrial
kick in the last tenth; the grid is fine there and coarse in diastasis. Resolution r has 400 r steps: 240 r on
0..0.45, 60 r on 0.45..0.6, 30 r on 0.6..0.9 and 70 r on 0.9..1. The published break points of the activation
curves are grid points.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache, reduce

import numpy as np

from eclsim.circuit.assembly import Assembly, End
from eclsim.circuit.network import HEART_RATE
from eclsim.components.base import Path, Storage, Values

STEPS_PER_BLOCK = 10
SEGMENTS = ((0.45, 24), (0.6, 6), (0.9, 3), (1.0, 7))
"""End of each segment and its number of blocks at resolution 1."""
LARGEST_ANGLE = 0.7
"""Largest step times angular frequency; outputs are then within 0.1 % of converged ones (docs, Numerics)."""
WARNED_ANGLE = 1.25
"""The same at which the main outputs may be wrong by more than 0.1 %: with 1.05 by at most 0.06 %, with 2.4
by 1 % (vessels behind a valve with a hundredth and a thousandth of their compliance)."""
RESOLUTIONS = (1, 2, 3, 4, 6, 8)
FINEST = 32
"""Finest resolution that a user may set: a beat of 12,800 steps."""
REFINED_FOR_SWITCHING_TIMES = 4
"""Factor by which the grid is refined for derivatives by a switching time. An output's error repeats with
every grid point that the switching passes: too small to matter, but as steep as half of the output's own
slope. On a refined grid the slopes are within 4 % of the adaptive solver's."""
STEPS_PER_DRIVE = 40.0
"""Minimum number of steps of an externally driven movement, such as that of a balloon in diastasis."""


@dataclass(frozen=True)
class PhaseGrid:
    """Blocks of equal steps that cover one beat."""

    resolution: int = 1

    @cached_property
    def block_steps(self) -> np.ndarray:
        """Step of each block, in phase, shape (blocks,)."""
        steps, start = [], 0.0
        for end, blocks in SEGMENTS:
            count = blocks * self.resolution
            steps += [(end - start) / (count * STEPS_PER_BLOCK)] * count
            start = end
        return np.array(steps)

    @cached_property
    def phases(self) -> np.ndarray:
        """Grid points from 0 to 1 inclusive, shape (steps + 1,)."""
        nodes, start = [np.zeros(1)], 0.0
        for end, blocks in SEGMENTS:
            count = blocks * self.resolution * STEPS_PER_BLOCK
            nodes.append(start + (end - start) * np.arange(1, count + 1) / count)
            start = end
        return np.concatenate(nodes)

    @property
    def n_steps(self) -> int:
        """Number of steps of a beat."""
        return len(self.phases) - 1

    @property
    def systolic_step(self) -> float:
        """Step in systole, in phase."""
        return float(self.block_steps[0])


def needed_resolution(assembly: Assembly, values: Values) -> np.ndarray:
    """Resolution of the grid for each patient; an integer array shaped like the parameters."""
    with np.errstate(divide="ignore", invalid="ignore"):
        speeds = [speed for speed, _ in oscillations(assembly, values)]
        fastest = reduce(np.maximum, speeds, np.zeros(()))
        step = PhaseGrid(1).systolic_step * 60.0 / np.asarray(values[HEART_RATE], dtype=float)
        finer = reduce(np.maximum, _driven(assembly, values), step * fastest / LARGEST_ANGLE)
        wanted = np.ceil(np.nan_to_num(finer, nan=1.0, posinf=math.inf))
    allowed = np.array(RESOLUTIONS)
    return allowed[np.minimum(np.searchsorted(allowed, wanted), len(allowed) - 1)]


@lru_cache(maxsize=256)
def read_for_resolution(assembly: Assembly) -> tuple[str, ...]:
    """Names of the parameters on which the resolution of the grid depends."""
    circuit = assembly.circuit
    joined = {k for j in assembly.inertial for end in assembly.ends[j] for k in end.positions}
    laws: list[Storage | Path] = [circuit.connections[j].component for j in assembly.inertial]
    laws += [circuit.compartments[k].component for k in sorted(joined)]
    laws += [c.component for c in circuit.compartments if type(c.component).driven is not Storage.driven]
    return tuple(dict.fromkeys([HEART_RATE, *(name for law in laws for name in _names(law))]))


@lru_cache(maxsize=4096)
def resolution_of_one(assembly: Assembly, numbers: tuple[float, ...]) -> int:
    """Resolution for one patient, from the values of `read_for_resolution`, which searches seldom change."""
    values = {n: np.float64(v) for n, v in zip(read_for_resolution(assembly), numbers, strict=True)}
    return int(needed_resolution(assembly, values))


def resolution_for_derivatives(assembly: Assembly, values: Values, parameters: Collection[str]) -> int | None:
    """Resolution for all derivatives of one patient's beat; None if the usual one will do."""
    if not include_switching_times(assembly, parameters):
        return None
    return refined_for_switching_times(int(needed_resolution(assembly, values)))


def include_switching_times(assembly: Assembly, parameters: Collection[str]) -> bool:
    """Whether parameters include a switching time, so that their derivatives need a refined grid."""
    return not switching_times(assembly).isdisjoint(parameters)


def switching_times(assembly: Assembly) -> frozenset[str]:
    """Parameters of a circuit that are phases of the beat at which something switches."""
    return frozenset(n for c in assembly.circuit.compartments for n in c.component.switching_times())


def refined_for_switching_times(resolution: int) -> int:
    """Resolution on which derivatives by a switching time are right, from the usual one."""
    return min(REFINED_FOR_SWITCHING_TIMES * resolution, FINEST)


def _driven(assembly: Assembly, values: Values) -> list[np.ndarray]:
    """Resolution at which each externally driven movement takes at least `STEPS_PER_DRIVE` steps."""
    result = []
    for compartment in assembly.circuit.compartments:
        driven = compartment.component.driven(values)
        if driven is None:
            continue
        begin, length, start = np.asarray(driven[0]), driven[1], 0.0
        for end, blocks in SEGMENTS:
            step = (end - start) / (blocks * STEPS_PER_BLOCK)
            there = (begin < end) & (begin + length > start)
            result.append(np.where(there, step * STEPS_PER_DRIVE / length, 0.0))
            start = end
    return result


def oscillations(assembly: Assembly, values: Values) -> list[tuple[np.ndarray, str]]:
    """Angular frequency [1/s] of each inertial flow with the compliances it joins, and the flow's name."""

    def of(component: Storage | Path) -> object:
        # Numbers of NumPy, so that a compliance of zero gives an infinite stiffness, not an exception.
        return component.constants({n: np.asarray(values[n], dtype=float)[()] for n in _names(component)})

    @cache
    def stiffness(position: int) -> np.ndarray:
        law = assembly.circuit.compartments[position].component
        return np.asarray(law.pressure(0.0, 0.0, of(law))[1] if law.constant_stiffness else 0.0)

    def stiffest(end: End) -> np.ndarray:
        return reduce(np.maximum, map(stiffness, end.positions), np.zeros(()))

    speeds = []
    with np.errstate(divide="ignore", invalid="ignore"):
        for j in assembly.inertial:
            source, target = map(stiffest, assembly.ends[j])
            connection = assembly.circuit.connections[j]
            inertance = np.asarray(connection.component.inertance(of(connection.component)))
            speeds.append((np.sqrt(np.divide(source + target, inertance)), connection.name))
    return speeds


@lru_cache(maxsize=1024)
def _names(component: Storage | Path) -> tuple[str, ...]:
    return component.parameter_names()


def grid_warning(assembly: Assembly, values: Values, resolution: int) -> str | None:
    """Warning if one patient's grid is too coarse for the oscillations of its circuit, otherwise None."""
    # Without inertia nothing oscillates.
    speeds = [(float(speed), name) for speed, name in oscillations(assembly, values) if np.isfinite(speed)]
    speed, name = max(speeds, default=(0.0, ""))
    angle = PhaseGrid(1).systolic_step / resolution * 60.0 / float(values[HEART_RATE]) * speed
    if angle <= WARNED_ANGLE:
        return None
    return (
        f"the step in time is too coarse: the flow through '{name}' oscillates with a period of "
        f"{2e3 * math.pi / speed:.2g} ms against the compliances at its ends, which needs a step "
        f"{angle / LARGEST_ANGLE:.3g} times finer; numbers may be off by more than 0.1 %: check that "
        "inertance and these compliances, or compare with the adaptive solver"
    )
