"""Ventricles so weak, or so full, that contraction lowers their pressure, or that blood runs through them.

A ventricle of the published law passes in systole from its filling curve to a straight line through the
origin. Where it holds so much blood that the line lies below the curve, it softens as it contracts: it fills
when it should eject, and ejects as it relaxes. No heart does this, and a weaker one then pumps more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from eclsim.circuit.network import HEART_RATE, Circuit
from eclsim.devices.description import CAUTION, Finding
from eclsim.outputs.registry import CHAMBERS, VALVES
from eclsim.outputs.regulation import FACTORS

FACTORS_OF = {"lv": "contractility_lv_factor", "rv": "contractility_rv_factor"}
"""Ventricles, and the output by which reflexes and drugs multiply their contractility."""
_OF_BOTH = ("CO", "LVO", "MAP", "pulmonary_flow")
_OF_SIDE = {
    "lv": ("PCWP", "left_atrial_pressure", "MPAP"),
    "rv": ("CVP", "right_atrial_pressure", "venous_pressure"),
}
_OF_VENTRICLE = (
    "stroke_volume", "ejection_fraction", "stroke_work", "pressure_volume_area", "end_diastolic_pressure",
    "peak_pressure",
)  # fmt: skip
_VOLUMES = ("EDV", "ESV")
LEAST_FLOW_L_MIN, EJECTED_SHARE = 1.0, 0.8
"""Flow through a ventricle from which it is judged, and the share of it that its beats must explain."""


def softening(
    outputs: Mapping[str, float],
    extremes: Mapping[str, tuple[float, float]],
    circuit: Circuit,
    values: Mapping[str, float],
) -> list[Finding]:
    """Alarms about ventricles with a lower pressure at full contraction than at rest.

    Args:
        outputs: scalar outputs by name. Where reflexes or drugs act, only a ventricle whose factor of
            contractility is among them is judged.
        extremes: smallest and largest value of each waveform.
        circuit: circuit of the beat.
        values: values of all parameters, before reflexes and drugs act on them.
    """
    result = []
    for compartment in circuit.compartments:
        if (place := compartment.name) not in FACTORS_OF:
            continue
        volume = outputs.get(f"EDV{place.upper()}", extremes.get("V" + place, (math.nan, math.nan))[1])
        now = _in_effect(FACTORS_OF[place], outputs, circuit, values)
        if math.isfinite(volume) and now is not None and compartment.component.softens(volume, now):
            result.append(_finding(place, volume, outputs))
    return result


def _in_effect(
    factor: str, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
) -> Mapping[str, float] | None:
    """Values with the contractility of the beat; None if reflexes or drugs change it by an unknown factor."""
    parameter = FACTORS[factor]
    if not any(parameter in control.acts_on for control in circuit.controllers):
        return values
    if factor not in outputs:
        return None
    return {**values, parameter: values[parameter] * outputs[factor]}


def _finding(place: str, volume: float, outputs: Mapping[str, float]) -> Finding:
    text = (
        f"the {CHAMBERS[place]} is too weak for the {volume:.0f} mL in it: contracted it would have a lower "
        "pressure than at rest, so it fills when it should eject and ejects as it relaxes, which no heart "
        f"does, and a weaker one would pump more. Do not read output or pressures: raise Emax{place} or "
        "lower its filling"
    )
    own = (f"{name}_{place}" for name in _OF_VENTRICLE)
    names = (*_OF_BOTH, *_OF_SIDE[place], *(f"{name}{place.upper()}" for name in _VOLUMES), *own)
    concerns = tuple(name for name in names if name in outputs)
    return Finding.without_limit("alarm", f"EDV{place.upper()}", volume, text, *concerns)


def running_through(outputs: Mapping[str, float], values: Mapping[str, float]) -> list[Finding]:
    """Cautions about ventricles that let more blood run through them than they eject.

    Args:
        outputs: scalar outputs by name; stroke volumes and flows through the valves are needed.
        values: values of all parameters.
    """
    result = []
    rate = outputs.get("heart_rate", values.get(HEART_RATE, math.nan))
    for place in FACTORS_OF:
        stroke = outputs.get(f"stroke_volume_{place}", math.nan)
        flow = outputs.get(f"{VALVES[place]}_valve_flow", math.nan)
        ejected = stroke * rate / 1000.0
        if not (flow > LEAST_FLOW_L_MIN and ejected < EJECTED_SHARE * flow):
            continue
        text = (
            f"blood runs through the {CHAMBERS[place]} while both its valves are open: {flow:.2f} L/min "
            f"pass, and its beats of {stroke:.0f} mL explain {ejected:.2f}. Ejection fraction, stroke volume "
            "and stroke work do not describe its output; upstream pressures drive it, as through a conduit"
        )
        names = (f"{name}_{place}" for name in ("stroke_volume", "ejection_fraction", "stroke_work"))
        concerns = [name for name in names if name in outputs]
        result.append(Finding.without_limit(CAUTION, concerns[0], stroke, text, *concerns))
    return result
