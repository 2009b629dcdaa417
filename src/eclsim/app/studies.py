"""What views compute beyond one beat: the speed ramp and the nine schemes, each one batch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.app.beat import page_circuit
from eclsim.app.display import curves_of, plain_curves, sweep_of
from eclsim.app.state import key_of
from eclsim.beat.grid import needed_resolution
from eclsim.circuit.assembly import assemble
from eclsim.files import finite
from eclsim.orbit.steady import Batch
from eclsim.outputs.signals import output_names
from eclsim.outputs.steady_beat import steady_beat

if TYPE_CHECKING:
    from eclsim.app.state import PageState

SPEEDS = 15


def ramp(state: PageState) -> dict[str, Any] | None:
    """Outputs over the speeds of the state's pump; None without a rotary pump."""
    sweep = sweep_of(state.case)
    if sweep is None:
        return None
    circuit, values = page_circuit(state.computed)
    speeds = np.unique([*np.linspace(sweep.low, sweep.high, SPEEDS), sweep.present])
    members = values | {sweep.key: speeds}
    resolution = int(np.max(needed_resolution(assemble(circuit), members)))
    batch = Batch(circuit, members, len(speeds), state.policy)
    known = output_names(circuit)
    shown = [curve.output for _, curve in curves_of(state.case) if curve.output in known]
    result = steady_beat(batch, shown, start=values, resolution=resolution)
    return {
        "of": key_of(state), "key": sweep.key, "own": sweep.present, "speeds": speeds.tolist(),
        "outputs": {n: plain_curve(result.output(n)) for n in shown},
        "curves": plain_curves(state.case, shown),
        "lost": speeds[~result.converged].tolist(),
    }  # fmt: skip


def schemes(state: PageState) -> dict[str, Any] | None:
    """Line pressures of the nine schemes at the state's own speed; None without a rotary ECMO pump."""
    from eclsim.crrt_study.preview import nine_at_own_speed

    result = nine_at_own_speed(state.case, state.policy)
    return None if result is None else {"of": key_of(state), **result}


def plain_curve(values: np.ndarray) -> list[float | None]:
    """Rounded numbers for the browser; null for what is not finite."""
    return [finite(float(value), digits=5) for value in values]
