"""Findings about a beat on ECMO: flow and gases of the circuit, and what is not read off the patient."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

from eclsim.devices.cannulae import BACKWARD_L_MIN, caution_on_chart
from eclsim.devices.description import CAUTION, COLLAPSE_MMHG, Finding, organ_flow
from eclsim.devices.device import Naming
from eclsim.devices.ecmo_parts import SMALLEST_EXHAUST, is_closed, narrowest_line
from eclsim.devices.plausibility import ejection_fraction_findings
from eclsim.devices.products import LABEL_FLOWS, beyond_label
from eclsim.parameters.regulation import REGULATION
from eclsim.patient.sites import ARTERIAL_SITES, DRAINED, VENOUS_SITES

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit

LEFT_SIDE = ("PCWP", "EDVLV", "ESVLV", "left_atrial_pressure", "end_diastolic_pressure_lv")
"""Outputs that do not reproduce left ventricular distension by a pump that returns to the arteries."""

_GREAT_VEINS = frozenset((*VENOUS_SITES, *DRAINED.values()))
LEAST_EJECTED_L_MIN, DESATURATED_PERCENT = 0.3, 90.0
"""Output of the heart from which, and its saturation below which, a caution names differential hypoxaemia."""
USUAL_PO2 = 60.0
"""PO2 of such blood, of which little is dissolved [mmHg]."""
SMALLEST_EXCESS_L_MIN = 0.1
"""Flow of veno-venous ECMO beyond the venous return from which a caution says so."""
REACHES_NOBODY_L_MIN = 0.1
"""Flow below which a narrowed line (`NARROW`) is the reason, and nothing is mixed with the heart's blood."""
NARROW = 0.9
"""Closed share of a line from which findings name it."""
_BEHIND_PUMP = ("ecmotupo", "ecmooxy", "ecmotuor", "ecmoreturn")
_RUPTURES_MMHG, _VACUUM_MMHG = 5000.0, -760.0
"""Pressures that no tubing or connector holds (a convention), and that no pump can bring about by suction."""
_FORCE_LIMITS: Mapping[str, Mapping[str, float]] = {
    "drainage": {"collapse": _VACUUM_MMHG, "alarm": COLLAPSE_MMHG},
    "return": {"collapse": _RUPTURES_MMHG, "alarm": 400.0},
}
_PUMP_PRESSURES = {"drainage": "pump_inlet_pressure", "return": "post_pump_pressure"}
_WHERE = {"drainage": "before the pump", "return": "behind the pump"}
_BY_DIRECTION = (
    "SpreO2", "PpreO2", "PpreCO2", "SpostO2", "PpostO2", "PpostCO2", "SreturnO2", "PreturnCO2",
    "VO2_oxygenator", "VCO2_oxygenator", "recirculation_fraction",
)  # fmt: skip
"""Outputs whose names say in which direction blood runs."""
_CIRCUIT_GASES = ("SpreO2", "SpostO2", "PpostO2", "PpostCO2", "PexhaustCO2", "recirculation_fraction")


def beat_findings(
    names: Naming, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
) -> list[Finding]:
    """Findings on flow outside the label, exhausted sweep gas, recirculation, reading of ventricles."""
    against = [*_against_a_closed_line(names, outputs, circuit, values), *_by_force(names, outputs, values)]
    return [
        *(against or _outside_label(names, outputs, values)),
        *_backwards(names, outputs),
        *_standing_blood(names, outputs),
        *_without_exhaust_gas(names, outputs, values),
        *_more_than_venous_return(names, outputs, circuit, values),
        *_caution_on_left_ventricle(names, outputs, circuit),
        *_caution_on_mixed_artery(names, outputs, circuit, values),
        *caution_on_chart(names, outputs, circuit),
        *ejection_fraction_findings(names, outputs, circuit, ("ecmodrain", "ecmodrain2"), "PF"),
    ]


def returned_flow(names: Naming, outputs: Mapping[str, float], circuit: Circuit) -> float | None:
    """Mean flow [L/min] through all return cannulae of a circuit; None if it is unknown.

    A device with lines on the circuit adds or takes its flow behind the pump.
    """
    cannulae = [outputs.get(names.output(f"{which}_return_flow")) for which in ("first", "second")]
    if cannulae[0] is not None and cannulae[1] is not None:
        return cannulae[0] + cannulae[1]
    flow = outputs.get(names.output("PF"))
    if flow is None:
        return None
    from eclsim.devices.registry import namings

    behind = set(map(names.place, _BEHIND_PUMP))
    for connection in circuit.connections:
        if connection.group == names.key or not behind & {connection.source, connection.target}:
            continue
        for other in namings([connection.group]):
            through = outputs.get(other.flows()[0], 0.0) if other.device.lines else 0.0
            flow += through * ((connection.target in behind) - (connection.source in behind))
    return flow


def _setting(names: Naming, values: Mapping[str, float]) -> tuple[float, str]:
    """Speed [rpm] of a rotary pump or flow [L/min] of a roller pump, as number and with its unit."""
    roller = values.get(names.parameter("ecmo.roller_l_min"))
    if roller is not None:
        return roller, f"{roller:g} L/min"
    speed = values.get(names.parameter("ecmo.speed_rpm"), math.nan)
    return speed, f"{speed:g} rpm"


def _against_a_closed_line(
    names: Naming, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
) -> list[Finding]:
    """Alarm for a running pump with a line so narrow that next to nothing reaches the patient."""
    setting, stated = _setting(names, values)
    (line, share), flow = narrowest_line(names, values), returned_flow(names, outputs, circuit)
    if flow is None or not setting > 0.0 or share < NARROW:
        return []
    if not BACKWARD_L_MIN <= flow < REACHES_NOBODY_L_MIN:
        return []
    closed = (
        f"a closed {line} line" if share >= 1.0 else f"a {line} line that is {100.0 * share:.3g} % closed"
    )
    reaches = "no blood reaches" if flow < -BACKWARD_L_MIN else f"only {flow:.2f} L/min reach"
    how = "against" if line == "return" else "with"
    text = f"the {names.label} pump runs at {stated} {how} {closed}: {reaches} the patient"
    pressure, name = names.output(_PUMP_PRESSURES[line]), names.output("PF")
    if pressure in outputs:
        text += f", with {outputs[pressure]:.0f} mmHg {_WHERE[line]}"
    return [Finding("alarm", name, flow, REACHES_NOBODY_L_MIN, text, concerns=(name,), is_cause=True)]


def _by_force(names: Naming, outputs: Mapping[str, float], values: Mapping[str, float]) -> list[Finding]:
    """Finding on the pressure that a roller pump needs to move its flow through a narrowed line."""
    setting, stated = _setting(names, values)
    if names.parameter("ecmo.roller_l_min") not in values or not setting > 0.0:
        return []
    line, share = narrowest_line(names, values)
    name = names.output(_PUMP_PRESSURES[line])
    pressure, limits = outputs.get(name, 0.0), _FORCE_LIMITS[line]
    beyond = [kind for kind, limit in limits.items() if abs(pressure) > abs(limit) and pressure * limit > 0.0]
    if not share > 0.0 or not beyond:
        return []
    kind = beyond[0]
    text = (
        f"the {names.label} roller pump moves {stated} through a {line} line that is {100.0 * share:.3g} % "
        f"closed, for which it takes {pressure:.0f} mmHg {_WHERE[line]}: lower the flow, or open the line"
    )
    return [Finding(kind, name, pressure, limits[kind], text, concerns=(name,), is_cause=True)]


def _outside_label(names: Naming, outputs: Mapping[str, float], values: Mapping[str, float]) -> list[Finding]:
    """Warning for a flow outside the oxygenator's label; not backwards, nor of a clamped circuit at rest."""
    name = names.output("PF")
    flow = outputs.get(name, -1.0)
    low, high = (values.get(names.parameter(end), math.nan) for end in LABEL_FLOWS)
    stopped = _setting(names, values)[0] == 0.0
    held = flow < low and stopped and is_closed(names, values)
    end = beyond_label(flow, low, high) if flow >= BACKWARD_L_MIN and not held else None
    if end is None:
        return []
    sentence = (
        f"{names.label} flow {flow:.3g} L/min is {'below' if end == low else 'above'} {end:g} L/min: outside "
        f"the label of its oxygenator, {low:g} to {high:g} L/min"
    )
    if stopped:
        sentence = (
            f"the pump of the {names.label} stands still, and {max(flow, 0.0):.2f} L/min pass its "
            "oxygenator: it hardly supplies the patient, and blood that stands in it clots (not modelled): "
            "turn it up, or clamp it"
        )
    return [Finding("warning", name, flow, end, sentence, concerns=(name,))]


def _backwards(names: Naming, outputs: Mapping[str, float]) -> list[Finding]:
    """Caution on samples of a circuit in which blood runs backwards."""
    flow = outputs.get(names.output("PF"), math.nan)
    concerns = [name for one in _BY_DIRECTION if (name := names.output(one)) in outputs]
    if not concerns or not flow < BACKWARD_L_MIN:
        return []
    drained, behind, returned, share = (
        names.output(name) for name in ("SpreO2", "SpostO2", "SreturnO2", "recirculation_fraction")
    )
    text = (
        f"blood runs backwards through the {names.label} ({flow:.2f} L/min): {drained} and {behind} are of "
        f"blood that has passed the oxygenator and flows to the drainage site with all that it took up, "
        f"{returned} is of blood from the return site, and {share} has no meaning"
    )
    return [Finding.without_limit(CAUTION, concerns[0], outputs[concerns[0]], text, *concerns)]


def _standing_blood(names: Naming, outputs: Mapping[str, float]) -> list[Finding]:
    """Caution on blood gases in a circuit in which blood hardly moves: they say nothing of the patient."""
    flow = outputs.get(names.output("PF"), math.nan)
    concerns = [name for one in _CIRCUIT_GASES if (name := names.output(one)) in outputs]
    if not concerns or not abs(flow) < -BACKWARD_L_MIN:
        return []
    text = (
        f"blood stands in the {names.label} circuit: before and behind the oxygenator it has met the sweep "
        "gas for a long time, and its gases reach nobody"
    )
    return [Finding.without_limit(CAUTION, concerns[0], outputs[concerns[0]], text, *concerns)]


def _without_exhaust_gas(
    names: Naming, outputs: Mapping[str, float], values: Mapping[str, float]
) -> list[Finding]:
    """Caution if blood takes up nearly all of the sweep gas, so that carbon dioxide is not removed."""
    gained, removed = (outputs.get(names.output(name)) for name in ("VO2_oxygenator", "VCO2_oxygenator"))
    sweep = values.get(names.parameter("ecmo.sweep_l_min"), 0.0)
    if gained is None or removed is None:
        return []
    from eclsim.components.exchangers import FLOWMETER_TO_STPD, USED_UP_SHARE

    brought = 1000.0 * FLOWMETER_TO_STPD * sweep
    left = brought - gained + removed
    used_up = left < max(USED_UP_SHARE * brought, SMALLEST_EXHAUST)
    if not (gained > 0.5 * brought > SMALLEST_EXHAUST and used_up):
        return []
    text = (
        f"the blood of the {names.label} takes up nearly all of its sweep gas ({gained:.0f} of "
        f"{brought:.0f} mL/min STPD): hardly any leaves the oxygenator, which removes "
        f"{max(removed, 0.0):.0f} mL/min of carbon dioxide; raise the sweep"
    )
    concerned = ("VCO2_oxygenator", "VO2_oxygenator", "PpostCO2", "PexhaustCO2")
    concerns = tuple(map(names.output, concerned))
    return [Finding.without_limit(CAUTION, concerns[0], removed, text, *concerns)]


def _circuits_of_its_kind(names: Naming, circuit: Circuit) -> list[Naming]:
    """All ECMO circuits of a patient."""
    from eclsim.devices.registry import namings

    groups = (part.group for part in circuit.connections)
    return [one for one in namings(groups) if one.device.key == names.device.key]


def _returns_to_great_veins(names: Naming, circuit: Circuit) -> bool:
    """Whether all cannulae of a circuit end in the great veins or the right atrium."""
    sites = [(c.source, c.target) for c in circuit.connections if c.group == names.key]
    own = {c.name for c in circuit.compartments if c.group == names.key}
    outer = {site for ends in sites for site in ends} - own
    return bool(outer) and outer <= _GREAT_VEINS


def _more_than_venous_return(
    names: Naming, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
) -> list[Finding]:
    """Caution if veno-venous ECMO drains more than the veins bring, so that blood flows back to it.

    Of several such circuits it is said once, of all: each may drain what another returns.
    """
    every = _circuits_of_its_kind(names, circuit)
    among = [one for one in every if _returns_to_great_veins(one, circuit)]
    flows = [returned_flow(one, outputs, circuit) for one in among]
    organs = organ_flow(outputs)
    output = outputs.get("CO") if organs is None else organs
    known = [flow for flow in flows if flow is not None]
    if output is None or len(known) < len(flows) or not among or among[0].key != names.key:
        return []
    drained = sum(known)
    again = drained - output
    if not again > SMALLEST_EXCESS_L_MIN:
        return []
    if len(among) == 1:
        text = _recirculation_text(names, drained, output)
    else:
        share = _share_by_oxygen(among, known, output, outputs, values)
        text = _recirculation_text_of_several(among, drained, output, share)
    name = names.output("PF")
    concerns = [one.output(what) for one in among for what in ("PF", "recirculation_fraction")]
    return [Finding.without_limit(CAUTION, name, drained, text, *(one for one in concerns if one in outputs))]


def _recirculation_text(names: Naming, drained: float, output: float) -> str:
    """Sentence on blood that a circuit drains although it has just returned it."""
    return (
        f"the {names.label} drains {drained:.2f} L/min, but only {output:.2f} L/min come back from "
        f"the body: at least {drained - output:.2f} L/min flow from the return cannula back to the drainage "
        "cannula (recirculation) and supply nobody with oxygen; lower the flow"
    )


def _recirculation_text_of_several(
    circuits: Sequence[Naming], drained: float, output: float, share_by_oxygen: float
) -> str:
    """The same of several circuits together; the share of it in drained blood is NaN if it is not known."""
    again = drained - output
    least, by_oxygen = 100.0 * again / drained, 100.0 * share_by_oxygen
    known = f", by its oxygen about {by_oxygen:.0f} %" if least <= by_oxygen <= 100.0 else ""
    return (
        f"the {' and the '.join(one.label for one in circuits)} together drain {drained:.2f} L/min, but only "
        f"{output:.2f} L/min come back from the body: at least {again:.2f} L/min flow from the return "
        "cannulae back to the drainage cannulae (recirculation), of the same or of another circuit, and "
        f"supply nobody with oxygen: at least {least:.0f} % of the drained blood{known} "
        "(recirculation_fraction of each counts only its own); lower the flows"
    )


def _share_by_oxygen(
    circuits: Sequence[Naming],
    flows: Sequence[float],
    output: float,
    outputs: Mapping[str, float],
    values: Mapping[str, float],
) -> float:
    """Share of drained blood that has just passed an oxygenator, from contents; NaN without blood gases.

    Blood of the body has the content of arterial blood less what the body takes up.
    """
    from eclsim.blood.standard import OXYGEN_SOLUBILITY
    from eclsim.components.exchangers import HAEMOGLOBIN, OXYGEN_CAPACITY

    bound = values.get(OXYGEN_CAPACITY, math.nan) * values.get(HAEMOGLOBIN, math.nan) / 100.0

    def content(saturation: str, pressure: str) -> float:
        """Oxygen [mL/dL]."""
        dissolved = OXYGEN_SOLUBILITY * outputs.get(pressure, math.nan)
        return bound * outputs.get(saturation, math.nan) + dissolved

    drained, passed = (
        sum(
            flow * content(one.output(f"S{where}O2"), one.output(f"P{where}O2"))
            for one, flow in zip(circuits, flows, strict=True)
        )
        / sum(flows)
        for where in ("pre", "post")
    )
    taken_up = outputs.get("VO2", math.nan) / (10.0 * output) if output > 0.0 else math.nan
    venous = content("SaO2", "PaO2") - taken_up
    return (drained - venous) / (passed - venous) if passed > venous else math.nan


def _caution_on_left_ventricle(
    names: Naming, outputs: Mapping[str, float], circuit: Circuit
) -> list[Finding]:
    """Caution that left ventricular distension is not reproduced if a pump returns blood to arteries."""
    back = (names.place("ecmoreturn"), names.place("ecmoreturn2"))
    returns = any(c.name in back and c.target in ARTERIAL_SITES for c in circuit.connections)
    if not returns or "EDVLV" not in outputs:
        return []
    text = (
        f"{names.label} returns to the arteries: do not read distension or unloading of the left "
        f"ventricle off EDVLV, LVEDP and PCWP; {_reason_for_left_ventricle(circuit)}"
    )
    concerns = (name for name in LEFT_SIDE if name in outputs)
    return [Finding.without_limit(CAUTION, "EDVLV", outputs["EDVLV"], text, *concerns)]


def _caution_on_mixed_artery(
    names: Naming, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
) -> list[Finding]:
    """Caution that desaturated blood of the heart is not seen where the pump's blood mixes with all of it."""
    divided = any(c.name == "upper" for c in circuit.compartments)
    mixed_in = {"ao", "arch"} if divided else set(ARTERIAL_SITES)
    every = _circuits_of_its_kind(names, circuit)
    into = {one: _flow_into(mixed_in, one, outputs, circuit) for one in every}
    flows = {one: flow for one, flow in into.items() if flow > REACHES_NOBODY_L_MIN}
    if "SaO2" not in outputs or names.key not in [one.key for one in flows][:1]:
        return []
    from eclsim.devices.registry import assist_flows

    assisting = {label: max(flow, 0.0) for label, flow in assist_flows(outputs, circuit).items()}
    ejected = outputs.get("LVO", math.nan) + sum(assisting.values())
    lungs = _saturation_of_the_heart(flows, ejected, outputs, values)
    if not lungs < DESATURATED_PERCENT:
        return []
    place = (
        "the pump returns to the ascending aorta (central cannulation)"
        if divided
        else "one artery holds the blood of pump and heart, mixed"
    )
    ways = ("" if divided else "[physiology] regional = true and ") + 'ecmo.return_site = "lower"'
    text = (
        f"{place}: SaO2 {outputs['SaO2']:.0f} % is not that of a patient with femoral return, whose heart, "
        f"brain and right hand first get what the {' and the '.join(('heart', *assisting))} "
        f"{'eject' if assisting else 'ejects'}, {ejected:.1f} L/min of about {max(lungs, 0.0):.0f} % "
        f"(differential hypoxaemia); {ways} shows it"
    )
    concerns = [name for name in ("SaO2", "PaO2", "SaO2_lower", "PaO2_lower") if name in outputs]
    return [Finding.without_limit(CAUTION, "SaO2", outputs["SaO2"], text, *concerns)]


def _flow_into(
    sites: Collection[str], names: Naming, outputs: Mapping[str, float], circuit: Circuit
) -> float:
    """Flow [L/min] through the return cannulae of a circuit that end in some sites."""
    into = {c.name: c.target in sites for c in circuit.connections}
    first, second = (outputs.get(names.output(f"{which}_return_flow")) for which in ("first", "second"))
    if first is None or second is None:
        first, second = returned_flow(names, outputs, circuit) or 0.0, 0.0
    return sum(
        flow
        for flow, cannula in ((first, "ecmoreturn"), (second, "ecmoreturn2"))
        if into.get(names.place(cannula), False)
    )


def _saturation_of_the_heart(
    flows: Mapping[Naming, float],
    ejected: float,
    outputs: Mapping[str, float],
    values: Mapping[str, float],
) -> float:
    """Saturation [%] of the left heart's blood, from that of its mixture with the blood of ECMO pumps.

    NaN if next to nothing is ejected, or gases are not known.

    Args:
        flows: flow of each circuit into the mixture [L/min].
        ejected: flow out of the left heart, through its valve or an assist device [L/min].
        outputs: outputs of the beat.
        values: values of the parameters.
    """
    from eclsim.blood.standard import OXYGEN_SOLUBILITY
    from eclsim.components.exchangers import HAEMOGLOBIN, OXYGEN_CAPACITY

    mixed, mixed_po2 = (outputs.get(name, math.nan) for name in ("SaO2", "PaO2"))
    if not ejected > LEAST_EJECTED_L_MIN:
        return math.nan
    dissolved = 100.0 * OXYGEN_SOLUBILITY / (values[OXYGEN_CAPACITY] * values[HAEMOGLOBIN])
    surplus = 0.0
    for names, flow in flows.items():
        pumped, po2 = (outputs.get(names.output(name), math.nan) for name in ("SreturnO2", "PpostO2"))
        surplus += flow * (pumped - mixed + dissolved * (po2 - mixed_po2))
    return mixed + dissolved * (mixed_po2 - USUAL_PO2) - surplus / ejected


def _reason_for_left_ventricle(circuit: Circuit) -> str:
    """Reason why left ventricular filling on V-A ECMO differs from that of patients."""
    there = {
        "reflexes": any(c.name == REGULATION for c in circuit.controllers),
        "bronchial return": any(c.name == "bronchial" for c in circuit.connections),
    }
    missing = " and ".join(name for name, known in there.items() if not known)
    if not missing:
        return "they depend on what is held while the flow changes (volume, tone); not validated in patients"
    return (
        f"without {missing} they follow filling alone (with pump flow they rise in a well-filled patient "
        "and fall in a poorly filled one), whereas patients' ventricles distend"
    )
