"""Findings about a beat on ECMO: flow and gases of the circuit, and what is not read off the patient."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from eclsim.devices.cannulae import BACKWARD_L_MIN, caution_on_chart
from eclsim.devices.description import CAUTION, Finding, organ_flow
from eclsim.devices.device import Naming
from eclsim.devices.ecmo_parts import SMALLEST_EXHAUST, is_closed
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
_CIRCUIT_GASES = ("SpreO2", "SpostO2", "PpostO2", "PpostCO2", "PexhaustCO2", "recirculation_fraction")


def beat_findings(
    names: Naming, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
) -> list[Finding]:
    """Findings on flow outside the label, exhausted sweep gas, recirculation, reading of ventricles."""
    return [
        *_outside_label(names, outputs, values),
        *_standing_blood(names, outputs),
        *_without_exhaust_gas(names, outputs, values),
        *_more_than_venous_return(names, outputs, circuit),
        *_caution_on_left_ventricle(names, outputs, circuit),
        *_caution_on_mixed_artery(names, outputs, circuit, values),
        *caution_on_chart(names, outputs, circuit),
        *ejection_fraction_findings(names, outputs, circuit, ("ecmodrain", "ecmodrain2"), "PF"),
    ]


def _outside_label(names: Naming, outputs: Mapping[str, float], values: Mapping[str, float]) -> list[Finding]:
    """Warning for a flow outside the oxygenator's label; not for backward flow or a circuit clamped off."""
    name = names.output("PF")
    flow = outputs.get(name, -1.0)
    low, high = (values.get(names.parameter(end), math.nan) for end in LABEL_FLOWS)
    held = flow < low and is_closed(names, values)
    end = beyond_label(flow, low, high) if flow >= BACKWARD_L_MIN and not held else None
    if end is None:
        return []
    sentence = (
        f"{names.label} flow {flow:.3g} L/min is {'below' if end == low else 'above'} {end:g} L/min: outside "
        f"the label of its oxygenator, {low:g} to {high:g} L/min"
    )
    if values.get(names.parameter("ecmo.speed_rpm")) == 0.0:
        sentence = (
            f"the pump of the {names.label} stands still, and {max(flow, 0.0):.2f} L/min pass its "
            "oxygenator: it hardly supplies the patient, and blood that stands in it clots (not modelled): "
            "raise the speed, or clamp it"
        )
    return [Finding("warning", name, flow, end, sentence, concerns=(name,))]


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


def _more_than_venous_return(names: Naming, outputs: Mapping[str, float], circuit: Circuit) -> list[Finding]:
    """Caution if veno-venous ECMO drains more than the veins bring, so that blood flows back to it."""
    flow, organs = outputs.get(name := names.output("PF")), organ_flow(outputs)
    output = outputs.get("CO") if organs is None else organs
    sites = [(c.source, c.target) for c in circuit.connections if c.group == names.key]
    own = {c.name for c in circuit.compartments if c.group == names.key}
    outer = {site for ends in sites for site in ends} - own
    if flow is None or output is None or not outer or not outer <= _GREAT_VEINS:
        return []
    again = flow - output
    if not again > SMALLEST_EXCESS_L_MIN:
        return []
    text = (
        f"the {names.label} drains {flow:.2f} L/min, but only {output:.2f} L/min come back from the "
        f"body: at least {again:.2f} L/min flow from the return cannula back to the drainage cannula "
        "(recirculation) and supply nobody with oxygen; lower the flow"
    )
    concerns = (one for one in (name, names.output("recirculation_fraction")) if one in outputs)
    return [Finding.without_limit(CAUTION, name, flow, text, *concerns)]


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
    back = {c.target for c in circuit.connections if c.name == names.place("ecmoreturn")}
    divided = any(c.name == "upper" for c in circuit.compartments)
    if "SaO2" not in outputs or not back & ({"ao", "arch"} if divided else set(ARTERIAL_SITES)):
        return []
    lungs = _saturation_of_the_heart(names, outputs, values)
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
        f"brain and right hand first get what the heart ejects, {outputs['LVO']:.1f} L/min of about "
        f"{max(lungs, 0.0):.0f} % (differential hypoxaemia); {ways} shows it"
    )
    concerns = [name for name in ("SaO2", "PaO2", "SaO2_lower", "PaO2_lower") if name in outputs]
    return [Finding.without_limit(CAUTION, "SaO2", outputs["SaO2"], text, *concerns)]


def _saturation_of_the_heart(
    names: Naming, outputs: Mapping[str, float], values: Mapping[str, float]
) -> float:
    """Saturation [%] of the blood that the heart ejects, from the oxygen of its mixture with the pump's.

    NaN if the heart ejects next to nothing, or gases are not known.
    """
    from eclsim.blood.standard import OXYGEN_SOLUBILITY
    from eclsim.components.exchangers import HAEMOGLOBIN, OXYGEN_CAPACITY

    own = [names.output(name) for name in ("SreturnO2", "PpostO2", "PF")]
    known = [outputs.get(name, math.nan) for name in ("SaO2", "PaO2", *own, "LVO")]
    mixed, mixed_po2, pumped, pumped_po2, flow, ejected = known
    if not ejected > LEAST_EJECTED_L_MIN:
        return math.nan
    dissolved = 100.0 * OXYGEN_SOLUBILITY / (values[OXYGEN_CAPACITY] * values[HAEMOGLOBIN])
    excess = pumped - mixed + dissolved * (pumped_po2 - mixed_po2)
    return mixed + dissolved * (mixed_po2 - USUAL_PO2) - flow * excess / ejected


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
