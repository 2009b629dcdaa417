"""Alarms of a steady beat: limits that it violates, and cautions about its numbers."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np

from eclsim.circuit.network import Circuit
from eclsim.devices.description import (
    CAUTION,
    COLLAPSE_MMHG,
    GRAVEST_FIRST,
    Finding,
    Limit,
    labelled_sentence,
    organ_flow,
)
from eclsim.devices.device import Naming, device_key
from eclsim.devices.registry import assist_flows, devices, naming_of, namings
from eclsim.outputs.cautions import cautions
from eclsim.outputs.contraction import running_through, softening
from eclsim.outputs.limits import CLOSED_L_MIN, NO_VALUES, broken_limits, levels
from eclsim.outputs.registry import CHAMBERS, first_name, output
from eclsim.outputs.sealed import TrappedBlood, sealed
from eclsim.patient.sites import DRAINED

IMPOSSIBLE_BEAT = "that no patient can have (a chamber without blood, a vein sucked shut)"
"""Description of beats that are `collapsed`."""
KINDS = (*GRAVEST_FIRST, CAUTION)
THIN_WALLED = {
    "ra": "right atrium", "svn": "systemic veins", "rv": "right ventricle", "pvn": "pulmonary veins",
    "la": "left atrium", "svc": "superior vena cava", "ivc": "inferior vena cava",
    "tvc": "thoracic vena cava", "tsvc": "superior vena cava", "tivc": "inferior vena cava",
}  # fmt: skip
_PULMONARY_ARTERY = ("pas", "part")
_SIDES = ((*DRAINED, *DRAINED.values(), "ra", "rv"), ("pvn", "la", "lv"))
_SMALLEST_FLOW_DIFFERENCE_L_MIN = 0.1
_NOT_SETTLED = "pulmonary artery in a beat that has not settled"
_LEFT = "the left ventricle itself ejects {} (LVO)"
_MOST_DECIMALS = 6
HARDLY_DRAINED_L_MIN = 1.0
"""Flow below which a device whose blood is held back, as by a clamp, does not empty a chamber."""
VALVE_OPEN_ML_S = 30.0
"""Peak flow above which a valve counts as opening even if its net flow is that of a closed valve."""


def findings(
    outputs: Mapping[str, float],
    extremes: Mapping[str, tuple[float, float]],
    circuit: Circuit | None = None,
    values: Mapping[str, float] = NO_VALUES,
    known: TrappedBlood | None = None,
) -> list[Finding]:
    """Findings about a beat, sorted by severity.

    Args:
        outputs: scalar outputs by name.
        extremes: smallest and largest value of each waveform.
        circuit: circuit with fixed sites; without it, findings that depend on the sites of devices are left
            out.
        values: values of all parameters; without them, findings on assumed values and on labels are left out,
            and limits are those of the table whatever the patient's size.
        known: blood behind closed valves, where earlier beats of the patient determine it.
    """
    result = [
        breach(limit, outputs[limit.quantity], entry.long_name, entry.unit)
        for limit in broken_limits(outputs, values)
        for entry in (output(limit.quantity),)
    ]
    result += _collapsed(extremes, outputs, circuit, values)
    result += _aortic_valve(outputs, circuit) + _different_flows(outputs, circuit)
    result += cautions(outputs, values) + running_through(outputs, values)
    if circuit is not None:
        if known is not None:
            about = ("V" + known.sealed.parts[0][0], 0.0, 0.0, known.sentence)
            result.append(Finding(CAUTION, *about))
        elif (trapped := sealed(outputs, circuit, values)) is not None:
            about = ("V" + trapped.parts[0][0], 0.0, 0.0, trapped.sentence)
            result.append(Finding(CAUTION, *about, concerns=trapped.concerns))
        if values:
            result += softening(outputs, extremes, circuit, values)
        for names in _devices_of(circuit):
            result += names.device.findings(names, outputs, circuit, values)
        result += assumptions(outputs, circuit, values)
    return gravest_first(result)


def gravest_first(findings: Iterable[Finding]) -> list[Finding]:
    """Sort findings by severity, causes of others first among those of a kind."""
    return sorted(findings, key=lambda finding: (KINDS.index(finding.kind), not finding.is_cause))


def sentences(findings: Iterable[Finding]) -> list[str]:
    """Sentences of findings with the labels of their kinds, as in the `warnings` of results."""
    return [labelled_sentence(finding.kind, finding.sentence) for finding in findings]


def marks(
    findings: Iterable[Finding], outputs: Mapping[str, float], values: Mapping[str, float] = NO_VALUES
) -> dict[str, str]:
    """Kind of the most severe finding about each output, also where only one of equivalent ones is reported.

    Args:
        findings: findings of a beat.
        outputs: outputs by name.
        values: parameters of the patient.
    """
    result = {name: kind for name, kind in levels(outputs, values).items() if kind != "ok"}
    for finding in findings:
        for name in finding.concerns:
            result[name] = min(finding.kind, result.get(name, finding.kind), key=KINDS.index)
    return result | {name: result[first] for name in outputs if (first := first_name(name)) in result}


def doubted_outputs(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Outputs that a caution concerns, also where a more severe finding is about them."""
    cautions = (one for one in findings if one.kind == CAUTION)
    return tuple(dict.fromkeys(name for one in cautions for name in one.concerns))


def watched_signals(signals: Iterable[str]) -> tuple[str, ...]:
    """Waveforms whose extremes show whether a chamber is empty or a vessel sucked shut."""
    places = {*THIN_WALLED, *CHAMBERS}
    return tuple(name for name in signals if name[0] in "PV" and name[1:] in places)


def collapsed(signals: Iterable[str], lowest: np.ndarray) -> np.ndarray:
    """Whether each member has an empty chamber or a vessel with more suction than its wall withstands.

    Args:
        signals: names of the waveforms.
        lowest: smallest value of each, shape (signals, members).
    """
    result = np.zeros(np.shape(lowest)[-1], dtype=bool)
    for name, smallest in zip(signals, lowest, strict=True):
        result |= _is_collapsed(name, smallest)
    return result


def _is_collapsed(name: str, smallest: Any) -> Any:
    if name[0] == "V" and name[1:] in CHAMBERS:
        return smallest <= 0.0
    return smallest < COLLAPSE_MMHG if name[0] == "P" and name[1:] in THIN_WALLED else False


def assumptions(outputs: Collection[str], circuit: Circuit, values: Mapping[str, float]) -> list[Finding]:
    """Findings on assumed device values that outputs depend on and the case does not replace.

    Args:
        outputs: names of the outputs.
        circuit: circuit of patient and devices.
        values: values of the parameters.
    """
    result = []
    for names in _devices_of(circuit):
        for entry in names.device.assumptions:
            concerned = tuple(name for name in map(names.output, entry.concerns) if name in outputs)
            if concerned and values.get(names.parameter(entry.parameter)) == entry.value:
                numbers = (entry.value, entry.value)
                result.append(Finding(CAUTION, concerned[0], *numbers, entry.sentence, concerns=concerned))
    return result


def _devices_of(circuit: Circuit) -> tuple[Naming, ...]:
    """All devices in a circuit, including those that add only an exchange."""
    return namings(e.group for e in (*circuit.compartments, *circuit.connections, *circuit.exchanges))


def impossible(findings: Collection[Finding]) -> bool:
    """Whether the findings include one that no patient can have."""
    return any(finding.kind == "collapse" for finding in findings)


def breach(limit: Limit, value: float, long_name: str, unit: str) -> Finding:
    """Return the finding for a limit that a value violates.

    Args:
        limit: the limit.
        value: value in the unit.
        long_name: name of the quantity in words.
        unit: unit of the value; "1" for none.
    """
    after = "" if unit == "1" else f" {unit}"
    sentence = (
        f"{long_name} {_number(value, unit, limit.value)}{after} is {limit.side} {limit.value:g}{after}: "
        f"{limit.meaning} ({limit.source})"
    )
    return Finding(limit.kind, limit.quantity, value, limit.value, sentence, limit.source, (limit.quantity,))


def _number(value: float, unit: str, limit: float) -> str:
    """Format a value with as many decimals as it takes to tell it from a limit."""
    decimals = 2 if unit in ("L/min", "1") else 1
    while round(value, decimals) == limit and decimals < _MOST_DECIMALS:
        decimals += 1
    return f"{value:.{decimals}f}"


def _collapsed(
    extremes: Mapping[str, tuple[float, float]],
    outputs: Mapping[str, float],
    circuit: Circuit | None,
    values: Mapping[str, float],
) -> list[Finding]:
    """Findings on chambers without blood, and on vessels with more suction than their wall withstands."""
    result = []
    found = {name: least for name, (least, _) in extremes.items() if _is_collapsed(name, least)}
    drained = _drained(circuit, outputs, values) if found and circuit is not None else {}
    for name, smallest in found.items():
        place = name[1:]
        cause = f"; {drained[place]}" if place in drained else ""
        if name[0] == "V":
            text = f"volume of the {CHAMBERS[place]} falls to {smallest:.1f} mL: the chamber collapses{cause}"
            concerns = tuple(f"{what}{place.upper()}" for what in ("EDV", "ESV"))
            result.append(Finding("collapse", name, smallest, 0.0, text, concerns=concerns))
        else:
            text = (
                f"pressure in the {THIN_WALLED[place]} {smallest:.1f} mmHg is below {COLLAPSE_MMHG:g} mmHg: "
                f"the vessel collapses{cause}"
            )
            result.append(Finding("collapse", name, smallest, COLLAPSE_MMHG, text))
    return result


def _drained(circuit: Circuit, outputs: Mapping[str, float], values: Mapping[str, float]) -> dict[str, str]:
    """Advice by compartment if it collapses, naming the device that drains its side of the heart.

    Of several devices, this is a pump of the circulation that drains this very compartment, else one that
    does not return its blood to this side (a CRRT returns it).
    """
    groups = {c.name: device_key(c.group) for c in circuit.compartments}
    outer = [c for c in circuit.connections if device_key(c.group) in devices()]
    drains = [(str(c.source), c.group) for c in outer if groups.get(str(c.source)) not in devices()]
    given = {(str(c.target), c.group) for c in outer}
    result = {}
    for side in _SIDES:
        comes_back = {group for site, group in given if site in side}
        on_this_side = [(source, group) for source, group in drains if source in side]
        for place in side if on_this_side else ():
            ranks = (
                (not (carries and source == place), group in comes_back, not carries)
                for source, group in on_this_side
                for carries in (devices()[device_key(group)].carries_circulation,)
            )
            _, (_, group) = min(zip(ranks, on_this_side, strict=True), key=lambda ranked: ranked[0])
            (names,) = namings([group])
            result[place] = _why_empty(names, outputs, values)
    return result


def _why_empty(names: Naming, outputs: Mapping[str, float], values: Mapping[str, float]) -> str:
    """Why a chamber is empty beside a device that drains it, and what to do."""
    flow = next((outputs[name] for name in names.flows() if name in outputs), math.inf)
    if flow < HARDLY_DRAINED_L_MIN and (held := names.device.held_back(names, values)):
        return f"the {names.label} carries {flow:.2f} L/min, and {held}, or give blood"
    if flow < CLOSED_L_MIN:
        return f"too little blood is left in the patient, as the {names.label} drains nothing: give blood"
    return f"the {names.label} drains more than flows in: lower its flow or give blood"


def stays_closed(aortic: float, peak: float = 0.0) -> bool:
    """Whether an aortic valve never opens in a beat, from its mean [L/min] and peak flow [mL/s]."""
    return abs(aortic) < CLOSED_L_MIN and peak < VALVE_OPEN_ML_S


def _aortic_valve(outputs: Mapping[str, float], circuit: Circuit | None) -> list[Finding]:
    """Findings on an aortic valve that leaks, or stays closed in heart failure or with an assist pump."""
    aortic = outputs.get("aortic_valve_flow")
    if aortic is None or aortic >= CLOSED_L_MIN:
        return []
    pumps = assist_flows(outputs, circuit)
    carried, peak = sum(pumps.values()), outputs.get("peak_aortic_valve_flow", 0.0)
    text = f"aortic valve flow {round(aortic, 3) + 0.0:.3f} L/min: "
    opened = peak >= VALVE_OPEN_ML_S
    opens = f"the valve opens (peak flow {peak:.0f} mL/s)" if opened else "the valve stays closed"
    if aortic <= -CLOSED_L_MIN:
        text += f"{opens} and leaks {-aortic:.2f} L/min more than it lets through"
        if carried >= CLOSED_L_MIN:
            left = carried + aortic
            share = f"{left:.2f}" if left > 0.0 else "nothing"
            text += f": of the {carried:.2f} L/min of the {' and the '.join(pumps)} the organs get {share}"
        return [Finding("alarm", "aortic_valve_flow", aortic, -CLOSED_L_MIN, text, concerns=("LVO",))]
    if opened:
        text += f"{opens}, and as much as it lets through leaks back"
    elif carried >= CLOSED_L_MIN:
        text += (
            f"{opens}, the {' and the '.join(pumps)} {'carry' if len(pumps) > 1 else 'carries'} the left "
            f"ventricle's output ({carried:.2f} L/min)"
        )
    else:
        text += "the left ventricle does not eject"
    return [Finding("warning", "aortic_valve_flow", aortic, CLOSED_L_MIN, text, concerns=("LVO",))]


def flows_differ(flow: float, lungs: float) -> bool:
    """Whether a flow differs from that through the lungs [L/min] by more than a beat repeats to."""
    return abs(lungs - flow) > _SMALLEST_FLOW_DIFFERENCE_L_MIN + 0.05 * abs(lungs)


def _different_flows(outputs: Mapping[str, float], circuit: Circuit | None) -> list[Finding]:
    """Findings on CO where a device makes it differ from ventricular output or lung flow."""
    lungs, left = outputs.get("CO"), outputs.get("LVO")
    if lungs is None or left is None:
        return []
    others = {
        _LEFT if left >= 0.0 else "the aortic valve leaks more than it lets through, net {} (LVO)": left,
        "the right ventricle itself ejects {}": outputs.get("pulmonary_valve_flow", lungs),
        "the lungs get {}": outputs.get("pulmonary_flow", lungs),
    }
    apart = {text: flow for text, flow in others.items() if flows_differ(flow, lungs)}
    if not apart:
        return []
    place = "lungs"
    if "the lungs get {}" in apart:
        returning, draining = device_returning_to_pulmonary_artery(circuit), _device_draining(circuit)
        drained = f"pulmonary artery before the {draining}drains it" if draining else _NOT_SETTLED
        place = f"pulmonary artery before the {returning}return" if returning else drained
    messages = [text.format(f"{flow:.2f} L/min") for text, flow in apart.items()]
    if (organs := organ_flow(outputs)) is not None:
        messages.append(f"the organs get {organs:.2f} L/min")
    text = f"CO {lungs:.2f} L/min is the flow through the {place}; {', '.join(messages)}"
    return [Finding(CAUTION, "CO", lungs, next(iter(apart.values())), text, concerns=("CO", "LVO"))]


def device_returning_to_pulmonary_artery(circuit: Circuit | None) -> str:
    """Return the name of the device that returns blood to the pulmonary artery; empty if there is none."""
    paths = () if circuit is None else circuit.connections
    return _first_label(path.group for path in paths if path.target in _PULMONARY_ARTERY)


def _device_draining(circuit: Circuit | None) -> str:
    """Return the name of the device that draws blood from the pulmonary artery; empty if there is none."""
    paths = () if circuit is None else circuit.connections
    return _first_label(path.group for path in paths if path.source in _PULMONARY_ARTERY)


def _first_label(groups: Iterable[str]) -> str:
    named = filter(None, map(naming_of, groups))
    return next((f"{names.label} " for names in named), "")
