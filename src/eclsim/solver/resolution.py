"""How fine a grid a patient needs: from the circuit's own oscillations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from eclsim.circuit.assembly import Assembly
from eclsim.solver.beat import HEART_RATE
from eclsim.solver.grid import PhaseGrid

LARGEST_ANGLE = 0.7
"""Largest step times angular frequency: outputs are within 0.1 % of the converged ones (docs, Numerics)."""
RESOLUTIONS = (1, 2, 3, 4, 6, 8)


def fastest_oscillation(assembly: Assembly, values: Mapping[str, Any]) -> Any:
    """Angular frequency [1/s] of the fastest flow against the compliances it joins, as in the aortic root."""
    constants = assembly.constants(values)
    stiffness = [
        c.component.pressure(0.0, None, law)[1] if c.component.constant_stiffness else 0.0
        for c, law in zip(assembly.circuit.compartments, constants.storages, strict=True)
    ]
    fastest: Any = 0.0
    for j in assembly.inertial:
        source, target = assembly.ends[j]
        stiff = max_stiffness(source.positions, stiffness) + max_stiffness(target.positions, stiffness)
        inertance = assembly.circuit.connections[j].component.inertance(constants.paths[j])
        with np.errstate(divide="ignore", invalid="ignore"):
            fastest = np.maximum(fastest, np.sqrt(stiff / inertance))
    return fastest


def max_stiffness(positions: tuple[int, ...], stiffness: list[Any]) -> Any:
    """Stiffest of the compartments that an end may attach to."""
    found: Any = 0.0
    for position in positions:
        found = np.maximum(found, stiffness[position])
    return found


def needed_resolution(assembly: Assembly, values: Mapping[str, Any]) -> np.ndarray:
    """Resolution of the grid for each patient; an integer array shaped like the parameters."""
    step = PhaseGrid(1).systolic_step * 60.0 / np.asarray(values[HEART_RATE], dtype=float)
    angle = step * fastest_oscillation(assembly, values)
    wanted = np.ceil(np.nan_to_num(angle / LARGEST_ANGLE, nan=1.0, posinf=math.inf))
    allowed = np.array(RESOLUTIONS)
    return allowed[np.minimum(np.searchsorted(allowed, wanted), len(allowed) - 1)]
