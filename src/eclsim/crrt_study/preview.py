"""The nine schemes at one speed as plain data: line pressures over a beat, for the page."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eclsim.crrt_study.beats import study_circuits
from eclsim.crrt_study.schemes import nine_schemes
from eclsim.devices.crrt import CRRT
from eclsim.files import finite
from eclsim.outputs.limits import level, limits_of

if TYPE_CHECKING:
    from eclsim.cases.case import Case

LINES = {
    line: (output, f"P{CRRT.lines[f'{line}_site']}")
    for line, output in (("access", "crrt_access_pressure"), ("return", "crrt_return_pressure"))
}
"""Output and waveform of each line's pressure."""
POINTS = 60


def nine_at_own_speed(case: Case, policy: str) -> dict[str, object] | None:
    """Pressures of both lines in each scheme; None without an ECMO circuit with a rotary pump."""
    if case.ecmo is None or not isinstance(case.ecmo.pump, str):
        return None
    chosen = tuple(nine_schemes().values())
    flow = float(CRRT.usual["flow_ml_min"]) if case.crrt is None else case.crrt.flow_ml_min
    circuits = study_circuits(case, chosen, flow)
    result = circuits.run(np.array([float(case.ecmo.speed_rpm or 0.0)]), policy, keep=range(len(chosen)))
    even = np.linspace(0.0, 1.0, POINTS)
    cells = []
    for k, scheme in enumerate(chosen):
        cell: dict[str, object] = {
            "letter": scheme.letter, "name": scheme.name,
            "settings": {"crrt.access_site": scheme.access_site, "crrt.return_site": scheme.return_site},
            "converged": bool(result.determined[k]), "MAP": float(result.output("MAP")[k]),
        }  # fmt: skip
        for line, (output, signal) in LINES.items():
            mean = float(result.mean(signal)[k])
            wave = np.interp(even, result.waveforms[k].phases, result.waveform(signal, k))
            shown = wave if result.determined[k] else []
            cell[line] = {"mean": mean, "level": level(output, mean), "wave": shown}
        cells.append(finite(cell, digits=5))
    limits = {
        line: sorted(limit.value for limit in limits_of(output) if limit.kind == "alarm")
        for line, (output, _) in LINES.items()
    }
    return {"cells": cells, "flow": flow, "limits": limits, "device": CRRT.key}
