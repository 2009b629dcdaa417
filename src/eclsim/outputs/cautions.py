"""Cautions about reflexes, drugs and laws of blood beyond the range in which they were measured."""

from __future__ import annotations

import math
from collections.abc import Mapping

from eclsim.blood.acid_base import CLOSED_PCO2_SLOPE
from eclsim.blood.types import NEUTRAL_PH_SLOPE
from eclsim.components.chambers import VentricularSystole
from eclsim.components.exchangers import TEMPERATURE
from eclsim.devices.description import CAUTION, Finding, organ_flow
from eclsim.outputs.gas import OF_LUNG_FLOW, lung_blood_stands
from eclsim.outputs.limits import HEART_RATE, limits_of
from eclsim.parameters import regulation as keys
from eclsim.parameters.gas import NORMAL_C, TEMPERATURE_DOUBT_C
from eclsim.parameters.physiology import CAVAL_SHARE
from eclsim.patient.anthropometry import AGE, SIZE, body_surface, greatest_heart_rate

VENODILATORS = ("dobutamine", "milrinone", "levosimendan", "nitroprusside")
CONGESTION_MMHG = 12.0
"""Wedge pressure below which a patient is not congested, unlike those these drugs were fitted to [mmHg]."""
SEPTIC_DYN, NOT_SEPTIC_DYN = 644.0, 700.0
"""Systemic resistance of patients that vasopressin was fitted to, and a clearly higher one [dyn s/cm5]."""
_DYN = 80.0
"""Conversion factor: dyn s/cm5 per mmHg min/L."""
LARGEST_COMBINED_LOGARITHM = 0.1
"""Largest change of the logarithm of a factor by several drugs, beyond that of the strongest drug."""
LARGEST_DILATING_ADRENALINE = 0.15
"""Larger dose of the study to which adrenaline is fitted [ug/kg/min]."""
ROUNDING = 1e-3
"""Share of a bound by which a dose must exceed it: an infusion that settles at the bound does not."""
TRACE_SHARE = 2e-3
"""Share of the largest usual dose below which a dose in effect is the rest of one that was washed out."""
PRESSORS = ("noradrenaline", "vasopressin")
NOTABLE_LOGARITHM = 0.02
"""Logarithm of a drug's factor below which the drug hardly acts."""
BLOOD_PH = (6.8, 7.7)
"""Approximate range of pH for which the laws of blood gases were fitted."""
WRONG_SIGN_MMHG, LARGEST_STUDIED_MMHG = 10.0, 25.0
"""Elevation of PaCO2 above the set point beyond which the published response has the wrong sign, and beyond
which the response measured in patients, up to 19 mmHg, is extrapolated [mmHg]."""
LARGEST_INDEX_L_MIN_M2 = 5.5
"""Flow through the organs for each m2 of body surface above which few patients are, as for measured ones."""
SLOW_BPM, FAST_BPM = 40.0, 150.0
"""Heart rates beyond which a systole of a fixed share of the beat is far from a patient's [bpm]."""
SYSTOLE_SHARE = VentricularSystole().end
"""Share of the beat that the ventricles of the published patient contract."""
TIGHT_PERICARDIUM_MMHG = 3.0
"""Pericardial pressure clearly above the usual one of about 0 (0.4 in the model's resting man) [mmHg]."""
PERICARDIAL_SHARE = 0.4
"""Share of the right atrial pressure from which so much of it is the pericardium's that it misleads."""
EQUAL_FILLING_MMHG = 4.0
"""Difference of right atrial and wedge pressure up to which the two sides count as filled alike [mmHg]."""
NOTABLE_BLOOD_ML = 100.0
"""Blood that veins give below zero pressure from which flows and pressures are held up noticeably."""
_VEINS = ("venous_pressure", "superior_caval_pressure", "inferior_caval_pressure")
_DANGEROUS_GASES = (("SaO2", "below"), ("PaCO2", "above"))
"""Outputs of arterial blood, and the side on which their alarms begin."""
_AT_TEMPERATURE = ("PaCO2", "PaO2", "pHa", "PaCO2_lower", "PaO2_lower", "PpostO2", "PpostCO2", "PvO2")
"""Outputs that an analyser at 37 C does not show as they are at another temperature."""
_WRONG_SIGN_ABOVE = (
    "with the chemoreflex, cardiac output and pulmonary pressure fall and resistance rises, whereas in "
    "healthy people output, heart rate and pulmonary pressure rise and resistance falls (Cullen and Eger "
    "1974, Kiely 1996)"
)
_WRONG_SIGN_BELOW = (
    "with the chemoreflex, resistance and arterial pressure fall as carbon dioxide is removed, the reverse "
    "of what is measured: the more carbon dioxide, the lower the resistance and the higher the output "
    "(Cullen and Eger 1974, Kiely 1996, Thorens 1996). Such a fall of pressure is not a patient's"
)
_ALTERNATIVE = f"; {keys.CARBON_DIOXIDE} = 1 uses the response measured in patients instead"


_MULTIPLIED = ("contractility", "systemic_resistance")
"""Factors of which several drugs together are doubted, by name in `Effects`."""


def cautions(outputs: Mapping[str, float], values: Mapping[str, float]) -> list[Finding]:
    """Cautions about reflexes, drugs and the laws of blood.

    Args:
        outputs: scalar outputs by name.
        values: values of all parameters.
    """
    doses = {
        drug: given * values.get(keys.sensitivity(drug), 1.0)
        for drug in keys.DRUG_DOSES
        if (given := values.get(keys.dose(drug), 0.0)) > TRACE_SHARE * keys.DRUG_DOSES[drug].usual
    }
    result = (
        _venodilators_without_congestion(outputs, doses)
        + _vasopressin_without_sepsis(outputs, doses)
        + _extrapolated_doses(doses)
        + _constricting_adrenaline(doses)
        + (_combined_effects(doses) or _vasopressin_on_noradrenaline(doses))
    )
    result += _unanswered_gases(outputs, values)
    result += _carbon_dioxide(outputs, values) + _at_another_temperature(outputs, values)
    result += _more_than_of_this_size(outputs, values) + _far_from_resting_rate(outputs, values)
    result += _constraining_pericardium(outputs) + _veins_below_zero(outputs, values)
    return result + _extrapolated_blood(outputs) + _without_lung_flow(outputs)


def _exceeds(dose: float, bound: float) -> bool:
    return dose > bound * (1.0 + ROUNDING)


def _venodilators_without_congestion(
    outputs: Mapping[str, float], doses: Mapping[str, float]
) -> list[Finding]:
    """Cautions about drugs whose effect on veins was measured in congested patients, unlike this one."""
    given = [drug for drug in VENODILATORS if drug in doses]
    wedge = outputs.get("PCWP")
    if not given or wedge is None or not wedge < CONGESTION_MMHG:
        return []
    text = (
        f"{' and '.join(given)}: fitted to failing hearts with a wedge pressure above 20 mmHg; here it is "
        f"{wedge:.0f} mmHg, and blood that pools in dilated veins empties the heart: pressures and outputs "
        "are probably too low, and may fall although they rise in patients"
    )
    return [Finding.without_limit(CAUTION, "PCWP", wedge, text, "CO", "MAP")]


def _vasopressin_without_sepsis(outputs: Mapping[str, float], doses: Mapping[str, float]) -> list[Finding]:
    """Caution about vasopressin in a patient whose vessels have not lost their tone."""
    names = ("MAP", "right_atrial_pressure")
    flow = organ_flow(outputs) or outputs.get("CO", 0.0)
    if "vasopressin" not in doses or not set(names) <= outputs.keys() or not flow > 0.0:
        return []
    pressure = outputs["MAP"] - outputs["right_atrial_pressure"]
    without = _DYN * pressure / flow / math.exp(_logarithm("systemic_resistance", "vasopressin", doses))
    if not without > NOT_SEPTIC_DYN:
        return []
    text = (
        f"vasopressin: fitted to septic shock with a resistance of {SEPTIC_DYN:.0f} dyn s/cm5 before the "
        f"drug, here {without:.0f}; it hardly raises the pressure of people who are not septic (Landry "
        "1997): the rise is probably too large"
    )
    return [Finding.without_limit(CAUTION, "systemic_resistance_factor", without, text, "MAP")]


def _extrapolated_doses(doses: Mapping[str, float]) -> list[Finding]:
    """Cautions about doses whose effect, with the patient's sensitivity, exceeds the studied range."""
    result = []
    for drug, dose in doses.items():
        usual, unit = keys.DRUG_DOSES[drug].usual, keys.DRUG_DOSES[drug].unit
        if _exceeds(dose, usual):
            text = (
                f"{drug}: dose times sensitivity is {dose:.3g} {unit}, above the usual {usual:g}: "
                "its effect is extrapolated"
            )
            result.append(Finding.without_limit(CAUTION, keys.dose(drug), dose, text, "MAP", "CO"))
    return result


def _constricting_adrenaline(doses: Mapping[str, float]) -> list[Finding]:
    """Caution about adrenaline at doses at which it constricts vessels, unlike those that were fitted."""
    dose = doses.get("adrenaline", 0.0)
    if not _exceeds(dose, LARGEST_DILATING_ADRENALINE):
        return []
    text = (
        f"adrenaline: fitted at 0.075 and {LARGEST_DILATING_ADRENALINE:g} ug/kg/min, where it dilates; "
        "larger doses constrict in patients, but dilate here, so that pressure is too low: not for a bolus "
        "or a resuscitation"
    )
    return [Finding.without_limit(CAUTION, "systemic_resistance_factor", dose, text, "MAP", "CO")]


def _vasopressin_on_noradrenaline(doses: Mapping[str, float]) -> list[Finding]:
    """Caution about vasopressin on noradrenaline: what was measured of it, which the model exceeds."""
    if not set(PRESSORS) <= doses.keys():
        return []
    first, added = (_logarithm("systemic_resistance", drug, doses) for drug in PRESSORS)
    if min(first, added) < NOTABLE_LOGARITHM:
        return []
    text = (
        "vasopressin on noradrenaline: their factors are multiplied, and this was not fitted. In septic "
        "shock on catecholamines, with a mean arterial pressure of 65 mmHg before it, 0.04 U/min multiplied "
        "resistance by 1.84, to 93 mmHg (Landry 1997, to which it is fitted); after heart surgery on "
        "noradrenaline, which was lowered, 0.1 U/min multiplied it by 1.46 (Argenziano 1997), and pressure "
        "rose by 17 mmHg (Morales 2000): read the rise as an upper limit, above all from a pressure that is "
        "not low"
    )
    return [Finding.without_limit(CAUTION, "systemic_resistance_factor", first + added, text, "MAP", "CO")]


def _combined_effects(doses: Mapping[str, float]) -> list[Finding]:
    """Caution about drugs whose combined factors exceed those of any pair that was studied."""
    if len(doses) < 2 or doses.keys() == set(PRESSORS):
        return []
    parts = []
    for effect in _MULTIPLIED:
        changes = [_logarithm(effect, drug, doses) for drug in doses]
        rises, falls = (sorted(abs(c) for c in changes if sign * c > 0.0) for sign in (1.0, -1.0))
        if any(sum(side[:-1]) > LARGEST_COMBINED_LOGARITHM for side in (rises, falls)):
            parts.append(f"{effect.replace('_', ' ')} x {math.exp(sum(changes)):.2g}")
    if not parts:
        return []
    text = (
        f"{', '.join(doses)} together ({', '.join(parts)}): their factors are multiplied; no combination was "
        "fitted. Of dobutamine and milrinone the measured effect was smaller: read it as an upper limit"
    )
    return [Finding.without_limit(CAUTION, "contractility_lv_factor", float("nan"), text, "MAP", "CO")]


def _logarithm(effect: str, drug: str, doses: Mapping[str, float]) -> float:
    """Logarithm of the factor by which a drug, alone, changes something; `effect` as in `combined_effect`."""
    from eclsim.drugs.published import combined_effect

    return float(combined_effect(effect, {drug: doses[drug]}))


def _unanswered_gases(outputs: Mapping[str, float], values: Mapping[str, float]) -> list[Finding]:
    """Caution about dangerous blood gases in a case in which nothing responds to them."""
    if any(values.get(key, 0.0) > 0.0 for key in keys.GAS_RESPONSES):
        return []
    name = next((name for name, side in _DANGEROUS_GASES if _is_in_alarm(outputs, name, side)), None)
    if name is None:
        return []
    text = (
        "nothing in the circulation responds to these blood gases: heart rate, pressures and output are "
        "those of normal gases, while the heart of a patient races, then fails ([regulation] chemoreflex, "
        "hypoxic_vasodilation, hypoxic_vasoconstriction and carbon_dioxide_response hold part of the "
        "response)"
    )
    return [Finding.without_limit(CAUTION, name, outputs[name], text, "MAP", "CO", "heart_rate")]


def _is_in_alarm(outputs: Mapping[str, float], name: str, side: str) -> bool:
    """Whether an output is beyond the limit of an alarm on one side."""
    value = outputs.get(name, math.nan)
    alarms = (limit for limit in limits_of(name) if limit.kind == "alarm" and limit.side == side)
    return any(limit.broken_by(value) for limit in alarms)


def _carbon_dioxide(outputs: Mapping[str, float], values: Mapping[str, float]) -> list[Finding]:
    """Caution about responses of nerves and organs to a carbon dioxide far from the set point."""
    pressure, rest = outputs.get("PaCO2"), values.get(keys.PACO2_SET_POINT)
    if pressure is None or rest is None or not abs(pressure - rest) > WRONG_SIGN_MMHG:
        return []
    measured = values.get(keys.CARBON_DIOXIDE, 0.0)
    published = [key for key in (keys.CHEMOREFLEX, keys.DILATION) if values.get(key, 0.0) > 0.0]
    above = pressure > rest
    side = f"{abs(pressure - rest):.0f} {'above' if above else 'below'} the set point"
    text = f"PaCO2 {pressure:.0f} mmHg, {side}: "
    if measured < 1.0 and keys.CHEMOREFLEX in published:
        text += _WRONG_SIGN_ABOVE if above else _WRONG_SIGN_BELOW
        text += _ALTERNATIVE
    elif measured < 1.0 and published:
        text += "the organs' response was published for small changes and not compared with people"
        text += _ALTERNATIVE
    elif measured > 0.0:
        return _measured_response(text, pressure - rest, outputs)
    else:
        return []
    return [Finding.without_limit(CAUTION, "PaCO2", pressure, text, "CO", "MAP", "MPAP", "heart_rate")]


def _measured_response(text: str, change: float, outputs: Mapping[str, float]) -> list[Finding]:
    """Caution about the response that was measured in patients, whose carbon dioxide rose by 19 mmHg."""
    if change < 0.0:
        text += (
            "carbon_dioxide_response was measured while carbon dioxide rose, up to 19 mmHg above, and is "
            "extrapolated below it: how far resistance rises and output falls is not known"
        )
    else:
        text += (
            "with carbon_dioxide_response mean arterial pressure falls (9 % for 19 mmHg), but it was "
            "unchanged in the patients in whom this resistance was measured (Thorens 1996) and rises in "
            "healthy people (Kiely 1996): it is probably too low"
        )
    if change > LARGEST_STUDIED_MMHG:
        text += "; the response was measured up to 19 mmHg above, and is extrapolated"
    others = () if 0.0 <= change <= LARGEST_STUDIED_MMHG else ("CO", "MPAP", "heart_rate")
    return [Finding.without_limit(CAUTION, "MAP", outputs.get("MAP", math.nan), text, "MAP", *others)]


def _at_another_temperature(outputs: Mapping[str, float], values: Mapping[str, float]) -> list[Finding]:
    """Caution about gases of cold or hot blood, which an analyser shows as they are at 37 C."""
    pressure, warmer = outputs.get("PaCO2"), values.get(TEMPERATURE, NORMAL_C) - NORMAL_C
    if pressure is None or not abs(warmer) > TEMPERATURE_DOUBT_C:
        return []
    shown = pressure / 10.0 ** (CLOSED_PCO2_SLOPE * warmer)
    text = (
        "blood gases are those at the patient's temperature, and limits are compared with them: an analyser "
        f"at 37 C shows an arterial PCO2 of {shown:.1f} in place of {pressure:.1f} mmHg, "
    )
    if (ph := outputs.get("pHa")) is not None:
        text += f"a pH of {ph + NEUTRAL_PH_SLOPE * warmer:.2f} in place of {ph:.2f}, "
    text += f"and a {'lower' if warmer > 0.0 else 'higher'} PO2"
    at_temperature = [name for name in _AT_TEMPERATURE if name in outputs]
    return [Finding.without_limit(CAUTION, "PaCO2", pressure, text, *at_temperature)]


def _extrapolated_blood(outputs: Mapping[str, float]) -> list[Finding]:
    """Caution about a pH for which the laws of blood gases were not fitted."""
    ph, (low, high) = outputs.get("pHa"), BLOOD_PH
    if ph is None or not (ph < low or ph > high):
        return []
    digits = 2 if not low <= round(ph, 2) <= high else 3
    text = (
        f"pH {ph:.{digits}f} of the arterial blood is outside {low:g} to {high:g}, the range for which the "
        "blood gas laws were fitted: saturations and carbon dioxide are extrapolated"
    )
    return [Finding.without_limit(CAUTION, "pHa", ph, text, "SaO2", "PaCO2")]


def _more_than_of_this_size(outputs: Mapping[str, float], values: Mapping[str, float]) -> list[Finding]:
    """Caution about a flow that is too large for the patient's size, which scales the blood volume alone."""
    flow, (height, weight) = organ_flow(outputs), map(values.get, SIZE)
    if flow is None or height is None or weight is None:
        return []
    index = flow / body_surface(height, weight)
    if not index > LARGEST_INDEX_L_MIN_M2:
        return []
    text = (
        f"the organs get {flow:.2f} L/min, {index:.1f} L/min per m2 of this patient's surface (at rest 2.5 "
        "to 4, in sepsis up to 6): body size changes the blood volume alone, while resistances and "
        "contractility are those of one adult; raise Rmc, or fit it. Oxygen delivery is too high likewise"
    )
    concerns = [name for name in ("CO", "LVO", "systemic_flow", "DO2", "O2ER", "SvO2") if name in outputs]
    return [Finding.without_limit(CAUTION, concerns[0], flow, text, *concerns)]


def _far_from_resting_rate(outputs: Mapping[str, float], values: Mapping[str, float]) -> list[Finding]:
    """Caution about flow and pressure at a rate at which systole and filling have not a patient's length."""
    rate = outputs.get("heart_rate", values.get(HEART_RATE, FAST_BPM))
    age = values.get(AGE)
    fast = FAST_BPM if age is None else min(FAST_BPM, greatest_heart_rate(age))
    concerns = [name for name in ("CO", "LVO", "systemic_flow", "MAP") if name in outputs]
    if not concerns or SLOW_BPM <= rate <= fast:
        return []
    text = f"heart rate {rate:.0f} bpm: "
    if rate > fast:
        text += (
            "the heart has the same share of every beat to fill here, whereas a patient's fills less the "
            "faster it beats: output and arterial pressure are too high"
        )
    else:
        text += (
            f"systole takes the same share of every beat here and lasts {60.0 * SYSTOLE_SHARE / rate:.1f} s, "
            "a patient's about 0.4 s: output and arterial pressure are up to a tenth too high"
        )
    return [Finding.without_limit(CAUTION, "heart_rate", rate, text, *concerns)]


def _constraining_pericardium(outputs: Mapping[str, float]) -> list[Finding]:
    """Caution about filling pressures that are those of a tight pericardium, as in a tamponade."""
    names = ("pericardial_pressure", "right_atrial_pressure", "PCWP")
    if not set(names) <= outputs.keys():
        return []
    pericardial, right, left = (outputs[name] for name in names)
    tight = pericardial > max(TIGHT_PERICARDIUM_MMHG, PERICARDIAL_SHARE * right)
    if not tight or abs(left - right) > EQUAL_FILLING_MMHG:
        return []
    text = (
        f"pericardial pressure {pericardial:.1f} mmHg (usually about 0): the pericardium constrains filling, "
        "as in a tamponade or around an overfilled heart; right atrial "
        f"{right:.1f} and wedge pressure {left:.1f} mmHg are nearly equal, and only "
        f"{right - pericardial:.1f} and {left - pericardial:.1f} mmHg of them distend the heart "
        "(transmural pressure): judge its filling by these"
    )
    concerns = [
        n for n in ("CVP", *names, "left_atrial_pressure", "end_diastolic_pressure_lv") if n in outputs
    ]
    return [Finding.without_limit(CAUTION, names[0], pericardial, text, *concerns)]


def _veins_below_zero(outputs: Mapping[str, float], values: Mapping[str, float]) -> list[Finding]:
    """Caution where veins behind a collapsible vena cava give blood below zero pressure."""
    pressures = [outputs[name] for name in _VEINS if name in outputs]
    compliance = values.get("Csvn", 0.0) * (1.0 - values.get(CAVAL_SHARE, 1.0))
    if "venous_pressure" not in outputs and len(pressures) == 2:
        shares = (values["svc_vessel_share"], 1.0 - values["svc_vessel_share"])
    else:
        shares = (1.0,)
    given = compliance * sum(s * max(-p, 0.0) for s, p in zip(shares, pressures, strict=False))
    if not given > NOTABLE_BLOOD_ML:
        return []
    text = (
        f"veins behind the vena cava are at {min(pressures):.1f} mmHg and hold {given:.0f} mL less than at "
        "zero: a patient's veins collapse and give no more, these never do. Pump flow and arterial pressure "
        "are too high, and suction comes later than in a patient"
    )
    names = ("PF", "MAP", "CO", "systemic_flow", "drainage_pressure", "lowest_drainage_pressure")
    concerns = [name for name in names if name in outputs]
    return [Finding.without_limit(CAUTION, concerns[0], given, text, *concerns)]


def _without_lung_flow(outputs: Mapping[str, float]) -> list[Finding]:
    """Caution about the saturation of mixed venous blood that does not flow."""
    saturation, flow = outputs.get("SvO2"), outputs.get("pulmonary_flow")
    if saturation is None or flow is None or not lung_blood_stands(flow):
        return []
    text = (
        "no blood flows through the lungs: the blood in the pulmonary artery stands still, and its gases "
        "are not those of mixed venous blood; read the saturation of the drained or venous blood instead"
    )
    return [Finding.without_limit(CAUTION, "SvO2", saturation, text, *OF_LUNG_FLOW)]
