"""What views compute beyond one beat: the speed ramp and the nine CRRT schemes, each one batch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.app.circuits import page_circuit
from eclsim.app.display import curves_of, plain_curves, sweep_of
from eclsim.app.ranges import LINES, line_bounds
from eclsim.app.state import key_of
from eclsim.beat.grid import needed_resolution
from eclsim.circuit.assembly import assemble
from eclsim.orbit.steady import Batch
from eclsim.outputs.limits import level
from eclsim.outputs.signals import output_names
from eclsim.outputs.steady_beat import steady_beat

if TYPE_CHECKING:
    from eclsim.app.state import PageState

NODES = {"access": "crrttuin", "return": "crrttuout"}
SPEEDS = 15
WAVE_POINTS = 60


def ramp(state: PageState) -> dict[str, Any] | None:
    """Outputs over the speeds of the state's pump; None without a rotary pump."""
    sweep = sweep_of(state.case)
    if sweep is None:
        return None
    circuit, values = page_circuit(state.case)
    speeds = np.unique([*np.linspace(sweep.low, sweep.high, SPEEDS), sweep.own])
    members = values | {sweep.key: speeds}
    resolution = int(np.max(needed_resolution(assemble(circuit), members)))
    batch = Batch(circuit, members, len(speeds), state.policy)
    known = output_names(circuit)
    shown = [curve.output for _, curve in curves_of(state.case) if curve.output in known]
    found = steady_beat(batch, shown, start=values, resolution=resolution)
    return {
        "of": key_of(state), "key": sweep.key, "own": sweep.own, "speeds": speeds.tolist(),
        "outputs": {n: plain_curve(found.output(n)) for n in shown},
        "curves": plain_curves(state.case, shown),
        "lost": speeds[~found.converged].tolist(),
    }  # fmt: skip


def schemes(state: PageState) -> dict[str, Any] | None:
    """Line pressures of the nine schemes at the state's own speed; None without a rotary ECMO pump."""
    from eclsim.crrt_study.beats import study_circuits
    from eclsim.crrt_study.schemes import nine_schemes

    ecmo = state.case.ecmo
    if ecmo is None or not isinstance(ecmo.pump, str):
        return None
    chosen = tuple(nine_schemes().values())
    flow = state.case.crrt.flow_ml_min if state.case.crrt is not None else 200.0
    circuits = study_circuits(state.case, chosen, flow)
    found = circuits.run(np.array([float(ecmo.speed_rpm or 0.0)]), state.policy, keep=range(len(chosen)))
    even = np.linspace(0.0, 1.0, WAVE_POINTS)
    cells = []
    for k, scheme in enumerate(chosen):
        cell: dict[str, Any] = {
            "letter": scheme.letter, "name": scheme.name,
            "settings": {"crrt.access_site": scheme.access_site, "crrt.return_site": scheme.return_site},
            "converged": bool(found.determined[k]),
            "MAP": _number(found.output("MAP")[k]),
        }  # fmt: skip
        for line, name in LINES.items():
            signal = "P" + NODES[line]
            mean = float(found.mean(signal)[k])
            wave = np.interp(even, found.waveforms[k].phases, found.waveform(signal, k))
            cell[line] = {
                "mean": _number(mean),
                "level": level(name, mean),
                "wave": plain_curve(wave) if found.determined[k] else [],
            }
        cells.append(cell)
    return {
        "of": key_of(state),
        "cells": cells,
        "flow": flow,
        "limits": line_bounds(),
        "device": "crrt",
    }


def plain_curve(values: np.ndarray) -> list[float | None]:
    """Rounded numbers for the browser; null for what is not finite."""
    return [_number(v) for v in values.tolist()]


def _number(value: float) -> float | None:
    return float(f"{float(value):.5g}") if np.isfinite(value) else None
