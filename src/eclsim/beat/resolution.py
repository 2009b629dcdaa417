"""How fine a grid a patient needs: from the circuit's own oscillations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from eclsim.beat.grid import PhaseGrid
from eclsim.beat.heartbeat import HEART_RATE
from eclsim.circuit.assembly import Assembly

LARGEST_ANGLE = 0.7
"""Largest step times angular frequency: outputs are within 0.1 % of the converged ones (docs, Numerics)."""
RESOLUTIONS = (1, 2, 3, 4, 6, 8)


def fastest_oscillation(assembly: Assembly, values: Mapping[str, Any]) -> Any:
    """Angular frequency [1/s] of the fastest flow against the compliances it joins, as in the aortic root."""
    fastest: Any = 0.0
    for speed, _ in oscillations(assembly, values):
        with np.errstate(invalid="ignore"):
            fastest = np.maximum(fastest, speed)
    return fastest


def oscillations(assembly: Assembly, values: Mapping[str, Any]) -> list[tuple[Any, str]]:
    """Angular frequency [1/s] of each flow with inertia against the compliances it joins, and its name."""
    with np.errstate(divide="ignore", invalid="ignore"):
        # As arrays, so that a compliance of zero is an infinite stiffness and no exception.
        constants = assembly.constants({k: np.asarray(v, dtype=float) for k, v in values.items()})
    stiffness = [
        c.component.pressure(0.0, 0.0, law)[1] if c.component.constant_stiffness else 0.0
        for c, law in zip(assembly.circuit.compartments, constants.storages, strict=True)
    ]
    found = []
    for j in assembly.inertial:
        source, target = assembly.ends[j]
        stiff = max_stiffness(source.positions, stiffness) + max_stiffness(target.positions, stiffness)
        connection = assembly.circuit.connections[j]
        inertance = connection.component.inertance(constants.paths[j])
        with np.errstate(divide="ignore", invalid="ignore"):
            found.append((np.sqrt(np.divide(stiff, inertance)), connection.name))
    return found


def max_stiffness(positions: tuple[int, ...], stiffness: list[Any]) -> Any:
    """Stiffest of the compartments that an end may attach to."""
    found: Any = 0.0
    for position in positions:
        found = np.maximum(found, stiffness[position])
    return found


def needed_resolution(assembly: Assembly, values: Mapping[str, Any]) -> np.ndarray:
    """Resolution of the grid for each patient; an integer array shaped like the parameters."""
    with np.errstate(divide="ignore", invalid="ignore"):
        step = PhaseGrid(1).systolic_step * 60.0 / np.asarray(values[HEART_RATE], dtype=float)
        angle = step * fastest_oscillation(assembly, values)
        wanted = np.ceil(np.nan_to_num(angle / LARGEST_ANGLE, nan=1.0, posinf=math.inf))
    allowed = np.array(RESOLUTIONS)
    return allowed[np.minimum(np.searchsorted(allowed, wanted), len(allowed) - 1)]


def grid_doubt(assembly: Assembly, values: Mapping[str, Any], resolution: int) -> str | None:
    """A sentence where one patient's grid is too coarse for what oscillates in it; None where it is fine."""
    # Without inertia nothing oscillates.
    found = [(float(speed), name) for speed, name in oscillations(assembly, values) if np.isfinite(speed)]
    speed, name = max(found, default=(0.0, ""))
    angle = PhaseGrid(1).systolic_step / resolution * 60.0 / float(values[HEART_RATE]) * speed
    if angle <= LARGEST_ANGLE:
        return None
    return (
        f"the step in time is too coarse: the flow through '{name}' swings with a period of "
        f"{2e3 * math.pi / speed:.2g} ms against the compliances at its ends, which needs a step "
        f"{angle / LARGEST_ANGLE:.3g} times finer; numbers may be off by more than 0.1 %: check that "
        "inertance and these compliances, or compare with the adaptive solver"
    )
