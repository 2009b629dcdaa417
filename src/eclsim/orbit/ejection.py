"""Whether the native heart ejects: without ejection most patients on V-A support have no steady beat."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from eclsim.beat.heartbeat import BeatProgram
from eclsim.beat.recording import MEAN
from eclsim.circuit.network import Circuit
from eclsim.orbit.status import Status
from eclsim.units import ML_S_PER_L_MIN

NO_EJECTION_L_MIN = 0.02
"""Native output below which the heart is said not to eject."""
AORTIC_VALVE, LVAD, PULMONARY_ARTERY = "lv", "lvadpump", "pas"
"""Connections that carry the native output."""


def native_output(flows: Mapping[str, float]) -> float:
    """What the left heart with its assist device, or else the right heart, moves; in the unit of the flows.

    Args:
        flows: mean flow of each connection by its name.

    Returns:
        The larger of the two; infinite in a circuit without an aortic valve, where nothing can be said.
    """
    left = flows.get(AORTIC_VALVE, np.inf) + flows.get(LVAD, 0.0)
    right = flows.get(PULMONARY_ARTERY, left)
    return float(np.maximum(left, right))


def judged(status: Status, native_l_min: float) -> Status:
    """The status of a search: a heart that does not eject and does not settle is named as such."""
    quiet = status is Status.NOT_CONVERGED and native_l_min < NO_EJECTION_L_MIN
    return Status.NO_EJECTION if quiet else status


def recorded_output(program: BeatProgram, state: np.ndarray, packed: np.ndarray) -> float:
    """Native output [L/min] of one patient over one beat from a state.

    Args:
        program: beat of the circuit.
        state: at phase 0, shape (states,).
        packed: parameters in the order of the program, shape (names,).
    """
    names = carriers(program.assembly.circuit)
    _, recorded = program.trace(program.signals)(state, packed)
    series = dict(zip(program.signals, np.asarray(recorded).T, strict=True))
    widths = np.diff(program.grid.phases)
    return native_output({n: _mean(series, n, widths) for n in names}) / ML_S_PER_L_MIN


def carriers(circuit: Circuit) -> tuple[str, ...]:
    """Connections of a circuit that carry the native output."""
    known = {c.name for c in circuit.connections}
    return tuple(n for n in (AORTIC_VALVE, LVAD, PULMONARY_ARTERY) if n in known)


def _mean(series: Mapping[str, np.ndarray], name: str, widths: np.ndarray) -> float:
    moved = series.get("Q" + name + MEAN)
    if moved is not None:
        return float(widths @ moved)
    flow = series["Q" + name]
    return float(widths @ (0.5 * (flow + np.roll(flow, 1))))
