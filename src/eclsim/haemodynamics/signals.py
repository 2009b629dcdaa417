"""From volumes and flows at the grid points to the waveforms that people read."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from eclsim.circuit.assembly import Assembly
from eclsim.circuit.network import StartPressure
from eclsim.components import RollerPump, RotaryPump
from eclsim.components.base import Values, value_of
from eclsim.solver.grid import PhaseGrid

BLOOD_VOLUME = "total_blood_volume_ml"


def signals(assembly: Assembly, grid: PhaseGrid, values: Values, volumes: Any, flows: Any) -> dict[str, Any]:
    """Waveforms by the paper's names: P, Q or V and the compartment or connection.

    Args:
        assembly: the circuit.
        grid: phases of the rows.
        values: parameters, each a number or an array (patients,).
        volumes: stressed volumes [mL], shape (points, compartments[, patients]).
        flows: flows [mL/s], shape (points, connections[, patients]).

    Returns:
        P of every compartment [mmHg], head of every pump [mmHg] (P + connection), Q of every connection
        [mL/s], V of every compartment [mL] (absolute where the share of the total blood volume is known);
        arrays of shape (points[, patients]).
    """
    shape = (-1,) + (1,) * (volumes.ndim - 2)
    curves = [jnp.asarray(a.at(grid.phases, np)).reshape(shape) for a in assembly.activations]
    stressed = [volumes[:, i] for i in range(assembly.n_volumes)]
    constants = assembly.constants(values)
    pressures, _ = assembly.pressures(stressed, curves, constants)
    circuit = assembly.circuit
    found: dict[str, Any] = {}
    for i, compartment in enumerate(circuit.compartments):
        found["P" + compartment.name] = pressures[i]
        found["V" + compartment.name] = stressed[i] + _unstressed(compartment, values)
    for j, connection in enumerate(circuit.connections):
        found["Q" + connection.name] = flows[:, j]
        if isinstance(connection.component, RotaryPump | RollerPump):
            source, target = assembly.ends[j]
            high, low = (assembly.at(end, pressures, constants) for end in (target, source))
            found["P" + connection.name] = high - low
    return found


def _unstressed(compartment: Any, values: Values) -> Any:
    """Volume [mL] that a vessel holds at zero pressure: its share of the blood less the stressed start."""
    if compartment.total_fraction is None or not isinstance(compartment.start, StartPressure):
        return 0.0
    total = value_of(values, compartment.total_fraction) * values[BLOOD_VOLUME]
    stiffness = compartment.component.constants(values)
    return total - value_of(values, compartment.start.pressure) / stiffness
