"""What a clinician must know of a steady beat: limits that it breaks, and how its numbers are to be read."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from eclsim.outputs.limits import (
    CLOSED_L_MIN,
    COLLAPSE_MMHG,
    GRAVEST_FIRST,
    SANSOM_ACCESS_MMHG,
    SUCTION_MMHG,
    Limit,
    broken_limits,
)
from eclsim.outputs.registry import CHAMBERS, output
from eclsim.outputs.sealed import sealed

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit

__all__ = ["COLLAPSE_MMHG", "SANSOM_ACCESS_MMHG", "SUCTION_MMHG", "Finding", "findings"]

CAUTION = "caution"
"""Kind of a finding that breaks no limit: how a number is to be read."""
KINDS = (*GRAVEST_FIRST, CAUTION)
LEFT_SIDE_ON_VA = ("PCWP", "EDVLV", "ESVLV", "left_atrial_pressure", "end_diastolic_pressure_lv")
"""Outputs that do not show the distension of the left ventricle by a pump that returns to the arteries."""
_ARTERIES = ("ao", "sart")
_THIN_WALLED = {
    "ra": "right atrium", "svn": "systemic veins", "rv": "right ventricle", "pvn": "pulmonary veins",
    "la": "left atrium",
}  # fmt: skip
_SIDES = (("svn", "ra", "rv"), ("pvn", "la", "lv"))
_DEVICES = {"ecmo": "ECMO", "lvad": "LVAD", "crrt": "CRRT"}
_PARTED_L_MIN = 0.1


@dataclass(frozen=True)
class Finding:
    """Something to say about a beat.

    Attributes:
        kind: "collapse" (impossible), "alarm", "warning", or "caution" (no limit: how to read a number).
        quantity: output or waveform that it is about.
        value: what the beat has.
        limit: what it is compared with.
        sentence: in words.
        source: where the limit comes from.
        concerns: outputs that it speaks of.
    """

    kind: str
    quantity: str
    value: float
    limit: float
    sentence: str
    source: str = ""
    concerns: tuple[str, ...] = ()


def findings(
    outputs: Mapping[str, float],
    extremes: Mapping[str, tuple[float, float]],
    circuit: Circuit | None = None,
) -> list[Finding]:
    """What there is to say about a beat, the gravest first.

    Args:
        outputs: scalar outputs by name.
        extremes: smallest and largest value of each waveform.
        circuit: with fixed sites; without it nothing is said that depends on where devices are connected.
    """
    found = [_broken(limit, outputs[limit.quantity]) for limit in broken_limits(outputs)]
    found += _collapsed(extremes, {} if circuit is None else _drained(circuit))
    found += _aortic_valve(outputs) + _parted(outputs)
    if circuit is not None:
        found += _more_than_ecmo(outputs, circuit) + _shut_in(outputs, circuit) + _left_side(outputs, circuit)
        found += _assisted(outputs, circuit)
    return sorted(found, key=lambda finding: KINDS.index(finding.kind))


def impossible(said: Collection[Finding]) -> bool:
    """Whether a beat cannot be that of a patient."""
    return any(finding.kind == "collapse" for finding in said)


def _broken(limit: Limit, value: float) -> Finding:
    entry = output(limit.quantity)
    sentence = (
        f"{entry.long_name} {_number(value, entry.unit)} is {limit.side} {limit.value:g} {entry.unit}: "
        f"{limit.meaning} ({limit.source})"
    )
    return Finding(limit.kind, limit.quantity, value, limit.value, sentence, limit.source, (limit.quantity,))


def _number(value: float, unit: str) -> str:
    return f"{value:.2f} {unit}" if unit == "L/min" else f"{value:.1f} {unit}"


def _collapsed(extremes: Mapping[str, tuple[float, float]], drained: Mapping[str, str]) -> list[Finding]:
    """Chambers without blood, and vessels under a suction that their wall does not bear."""
    found = []
    for name, (smallest, _) in extremes.items():
        place = name[1:]
        why = f"; {drained[place]}" if place in drained else ""
        if name[0] == "V" and place in CHAMBERS and smallest <= 0.0:
            text = f"volume of the {CHAMBERS[place]} falls to {smallest:.1f} mL: the chamber collapses{why}"
            concerns = tuple(f"{what}{place.upper()}" for what in ("EDV", "ESV"))
            found.append(Finding("collapse", name, smallest, 0.0, text, concerns=concerns))
        if name[0] == "P" and place in _THIN_WALLED and smallest < COLLAPSE_MMHG:
            text = (
                f"pressure in the {_THIN_WALLED[place]} {smallest:.1f} mmHg is below {COLLAPSE_MMHG:g} mmHg: "
            )
            text += f"the vessel collapses{why}"
            found.append(Finding("collapse", name, smallest, COLLAPSE_MMHG, text))
    return found


def _drained(circuit: Circuit) -> dict[str, str]:
    """By place what to do where it collapses: the device that drains its side of the heart."""
    groups = {c.name: c.group for c in circuit.compartments}
    found: dict[str, str] = {}
    for connection in circuit.connections:
        source, group = str(connection.source), connection.group
        if group not in _DEVICES or groups.get(source) in _DEVICES or connection.name == "crrttuout":
            continue
        side = next((s for s in _SIDES if source in s), ())
        said = f"the {_DEVICES[group]} drains more than flows in: lower its flow or give blood"
        found = dict.fromkeys(side, said) | found
    return found


def _aortic_valve(outputs: Mapping[str, float]) -> list[Finding]:
    """A valve that stays closed: the heart's failure, or an assist pump at work."""
    aortic, pump = outputs.get("aortic_valve_flow"), outputs.get("lvad_flow", 0.0)
    if aortic is None or aortic >= CLOSED_L_MIN:
        return []
    text = f"aortic valve flow {aortic:.3f} L/min: "
    if pump >= CLOSED_L_MIN:
        text += f"the valve stays closed, the LVAD carries the left ventricle's output ({pump:.2f} L/min)"
    else:
        text += "the left ventricle does not eject"
    return [Finding("warning", "aortic_valve_flow", aortic, CLOSED_L_MIN, text, concerns=("LVO",))]


def _parted(outputs: Mapping[str, float]) -> list[Finding]:
    """What CO is where a device makes it another flow than what a ventricle ejects or what the lungs get."""
    lungs, left = outputs.get("CO"), outputs.get("LVO")
    if lungs is None or left is None:
        return []
    others = {
        "the left ventricle itself ejects {} (LVO)": left,
        "the right ventricle itself ejects {}": outputs.get("pulmonary_valve_flow", lungs),
        "the lungs get {}": outputs.get("pulmonary_flow", lungs),
    }
    apart = {
        words: flow for words, flow in others.items() if abs(lungs - flow) > _PARTED_L_MIN + 0.05 * abs(lungs)
    }
    if not apart:
        return []
    place = "pulmonary artery before the ECMO return" if "the lungs get {}" in apart else "lungs"
    said = [words.format(f"{flow:.2f} L/min") for words, flow in apart.items()]
    if "systemic_flow" in outputs:
        said.append(f"the organs get {outputs['systemic_flow']:.2f} L/min")
    text = f"CO {lungs:.2f} L/min is the flow through the {place}; {', '.join(said)}"
    return [Finding(CAUTION, "CO", lungs, next(iter(apart.values())), text, concerns=("CO", "LVO"))]


def _more_than_ecmo(outputs: Mapping[str, float], circuit: Circuit) -> list[Finding]:
    """A CRRT that draws more from the ECMO circuit than the circuit carries."""
    lines = {c.name: c for c in circuit.connections if c.name in ("crrttuin", "crrttuout")}
    ecmo = {c.name for c in circuit.compartments if c.group == "ecmo"}
    drawn, carried = outputs.get("crrt_flow"), outputs.get("PF")
    if drawn is None or carried is None or drawn <= abs(carried) or len(lines) < 2:
        return []
    if lines["crrttuin"].source not in ecmo or lines["crrttuout"].target not in ecmo:
        return []
    text = (
        f"CRRT flow {drawn:.2f} L/min is above the ECMO flow {carried:.2f} L/min: "
        "between the CRRT lines blood runs backwards or in a circle"
    )
    return [Finding("alarm", "crrt_flow", drawn, carried, text, concerns=("crrt_flow", "PF"))]


def _shut_in(outputs: Mapping[str, float], circuit: Circuit) -> list[Finding]:
    """Numbers of a beat that repeats with other volumes just as well."""
    found = sealed(outputs, circuit)
    if found is None:
        return []
    return [Finding(CAUTION, "V" + found.parts[0][0], 0.0, 0.0, found.sentence, concerns=found.concerns)]


def _left_side(outputs: Mapping[str, float], circuit: Circuit) -> list[Finding]:
    """What this model does not show of the left ventricle while a pump returns blood to the arteries."""
    ecmo = {c.name for c in circuit.compartments if c.group == "ecmo"}
    returns = any(
        c.source in ecmo and c.target in _ARTERIES and c.group == "ecmo" for c in circuit.connections
    )
    if not returns or "EDVLV" not in outputs:
        return []
    text = (
        "ECMO returns to the arteries: do not read distension or unloading of the left ventricle off "
        "EDVLV, LVEDP and PCWP; without reflexes and bronchial return they follow the filling alone (with "
        "the pump's flow they rise in a filled patient and fall in an empty one), where patients' "
        "ventricles distend"
    )
    concerns = tuple(name for name in LEFT_SIDE_ON_VA if name in outputs)
    return [Finding(CAUTION, "EDVLV", outputs["EDVLV"], float("nan"), text, concerns=concerns)]


def _assisted(outputs: Mapping[str, float], circuit: Circuit) -> list[Finding]:
    """What an ejection fraction is where a pump empties the left ventricle."""
    name = "ejection_fraction_lv"
    if name not in outputs or not any(c.name == "lvadpump" and c.source == "lv" for c in circuit.connections):
        return []
    text = (
        "the LVAD empties the left ventricle: its ejection fraction and stroke volume count what the pump "
        "takes, and say nothing of ejection through the aortic valve"
    )
    return [Finding(CAUTION, name, outputs[name], float("nan"), text, concerns=(name, "stroke_volume_lv"))]
