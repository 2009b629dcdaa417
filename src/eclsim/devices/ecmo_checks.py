"""Checks of the section [ecmo]: contradictory or doubtful sites, settings and measured flows."""

from __future__ import annotations

from eclsim.devices.cannulae import CANNULAE, check_lumens, check_second, check_vessels
from eclsim.devices.device import CaseValues
from eclsim.devices.ecmo_parts import (
    ASSUMED_ML,
    GAS_IF_OMITTED,
    GAS_KEYS,
    GROUP,
    LINES,
    OXYGENATORS,
    PUMPS,
    TUBING,
    narrowest_line_of,
)
from eclsim.devices.plausibility import check_cannula, check_sites, check_speed
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.sections import Raw
from eclsim.patient.anthropometry import body_surface
from eclsim.patient.sites import ARTERIAL_SITES, LEFT_HEART, PATIENT_SITES, VENOUS_SITES
from eclsim.units import ML_S_PER_L_MIN

MIXED_SITE = "ra"
"""Compartment in which drainage and return of V-V ECMO meet where recirculation is to be stated."""

_CLOSED_TO_ROLLER = 0.99
"""Closed share of a line from which a running roller pump is refused: no line holds what it would need."""

# Above these, a cardiac output on V-A ECMO probably includes the pump flow.
_LARGEST_INDEX = 5.5  # L/min/m^2
_LARGEST_COMPLIANCE = 5.0  # mL/mmHg, stroke volume per pulse pressure


def check_section(values: Raw, case: CaseValues, key: str, remarks: Remarks) -> None:
    """Check sites, mode, cannulae, speed, gas settings and measured flows of a section."""
    if values.get("return_site") in VENOUS_SITES and "gas" not in case.physiology:
        check_sites(key, values, "drainage_site", "return_site", remarks, "; in a vein only with [gas]")
    elif not _shares_a_vein(values, case):
        check_sites(key, values, "drainage_site", "return_site", remarks)
    _check_mode(values, key, remarks)
    for line in LINES:
        kind, size = values.get(f"{line}_cannula"), values.get(f"{line}_fr")
        if kind is not None and size is not None:
            check_cannula(f"{key}.{line}_fr", size, CANNULAE[kind], remarks)
    check_vessels(key, values, remarks)
    check_lumens(key, values, remarks)
    check_second(key, values, remarks)
    line, share = narrowest_line_of(values, key == GROUP and bool(case.of("vent")))
    check_speed(key, values, PUMPS, remarks, share >= 1.0)
    _check_roller(values, line, share, key, remarks)
    _check_gases(values, case, key, remarks)
    single = len(case.of(GROUP)) == 1
    _check_pump_flow(values, case.measurements if single else {}, key, remarks)
    if single:
        _check_native_output(values, case, remarks)


def _check_roller(values: Raw, line: str, share: float, key: str, remarks: Remarks) -> None:
    """Refuse a running roller pump with a closed line, through which it would force its flow."""
    pump = values.get("pump")
    if not isinstance(pump, dict) or not pump["roller_l_min"] > 0.0 or share < _CLOSED_TO_ROLLER:
        return
    message = (
        f"a roller pump cannot run against a closed line: it moves {pump['roller_l_min']:g} L/min whatever "
        "pressure that takes, until the line bursts"
    )
    allowed = f"below {_CLOSED_TO_ROLLER:g}, or pump = {{ roller_l_min = 0 }}"
    remarks.error(f"{key}.{line}_clamp", message, shown(values[f"{line}_clamp"]), allowed)


def _shares_a_vein(values: Raw, case: CaseValues) -> bool:
    """Whether drainage and return share a venous compartment in a case with gas exchange (recirculation)."""
    site = values.get("return_site")
    return "gas" in case.physiology and site in VENOUS_SITES and values.get("drainage_site") == site


def _check_gases(values: Raw, case: CaseValues, key: str, remarks: Remarks) -> None:
    """Warn of gas settings without effect if there is no [gas]; otherwise report assumed values."""
    with_gas = "gas" in case.physiology
    for name in GAS_KEYS:
        if name in values and not with_gas:
            message = "without effect: gases are computed only if the case has a [gas] section"
            remarks.warning(f"{key}.{name}", message, shown(values[name]))
    if with_gas and "sweep_l_min" not in values:
        remarks.note(f"{key}.sweep_l_min", f"left out, so assumed: {GAS_IF_OMITTED['sweep_l_min']:g} L/min")
    product = OXYGENATORS.get(values.get("oxygenator", ""))
    if with_gas and product is not None and product.priming_volume_ml is None:
        message = (
            f"its blood volume is not known: {ASSUMED_ML:g} mL, that of a Quadrox-i Adult, is assumed where "
            "a course follows gases beat by beat"
        )
        remarks.note(f"{key}.oxygenator", message, shown(product.key))
    if with_gas:
        _check_recirculation(values, key, remarks)


def _check_recirculation(values: Raw, key: str, remarks: Remarks) -> None:
    """Say where drained and returned blood meet in no compartment, so that their mixing has no effect."""
    drained, returned = values.get("drainage_site"), values.get("return_site")
    if drained is None or returned is None or drained in (returned, values.get("second_return_site")):
        return
    apart = f"drainage ({shown(drained)}) and return ({shown(returned)}) share no compartment"
    usual = GAS_IF_OMITTED["drainage_mixing"]
    mixing = values.get("drainage_mixing", usual)
    in_veins = drained in VENOUS_SITES and returned in VENOUS_SITES
    if mixing != usual:
        advice = f': to state recirculation, write drainage_site and return_site = "{MIXED_SITE}"'
        message = f"without effect: {apart}{advice if in_veins else ''}"
        remarks.warning(f"{key}.drainage_mixing", message, shown(mixing))
    elif in_veins:
        message = (
            f"{apart}, so only blood that flows back between them recirculates, whatever the cannulae, and "
            "the more the higher the flow: to state recirculation (with usual cannulae, 9 to 28 % at 4 L/min "
            f'were measured), write "{MIXED_SITE}" for both sites, and drainage_mixing'
        )
        remarks.note(f"{key}.drainage_site", message)


def _check_mode(values: Raw, key: str, remarks: Remarks) -> None:
    mode, site = values.get("mode"), values.get("return_site")
    if mode is None or site is None:
        return
    if site in (VENOUS_SITES if mode == "VA" else ARTERIAL_SITES):
        message = f"contradicts return_site = {shown(site)} ({PATIENT_SITES[site]})"
        other = "VV" if mode == "VA" else "VA"
        allowed = f'mode = "{other}", another return_site, or no mode: the sites then decide'
        remarks.error(f"{key}.mode", message, shown(mode), allowed)


def _check_pump_flow(values: Raw, measured: Raw, section: str, remarks: Remarks) -> None:
    """Compare the measured or set pump flow with the oxygenator's label and the pump's speed."""
    pump, flow, key = values.get("pump"), measured.get("PF"), "measurements.PF"
    if isinstance(pump, dict):
        rate = pump["roller_l_min"]
        if flow is not None and abs(flow - rate) > max(0.3, 0.2 * flow):
            remarks.warning(key, f"the roller pump is set to {rate:g} L/min", shown(flow))
        key, flow = f"{section}.pump", rate
    if flow is None:
        return
    oxygenator = OXYGENATORS.get(values.get("oxygenator", ""))
    if oxygenator is not None and (warning := oxygenator.label_warning(flow)):
        remarks.warning(key, warning, shown(flow))
    expected = _expected_flow(values, measured) if isinstance(pump, str) else None
    if expected is not None and not 0.4 * expected <= flow <= 1.6 * expected + 0.5:
        message = f"implausible at {values['speed_rpm']:g} rpm, which gives about {expected:.1f} L/min"
        remarks.warning(key, message, shown(flow))


def _expected_flow(values: Raw, measured: Raw) -> float | None:
    """Steady flow [L/min], 0 or more, at which the pump's head equals the circuit's pressure drop."""
    lines = (f"{line}_{what}" for line in LINES for what in ("cannula", "fr"))
    needed = ("pump", "speed_rpm", "oxygenator", *lines)
    if any(name not in values for name in needed) or not values["speed_rpm"]:
        return None
    pump, oxygenator = PUMPS[values["pump"]], OXYGENATORS[values["oxygenator"]]
    arterial = values.get("return_site") in (*ARTERIAL_SITES, "lv")
    afterload = measured.get("MAP", 75.0) - 5.0 if arterial else 0.0

    def surplus(flow: float) -> float:
        drop = oxygenator.resistance * flow * ML_S_PER_L_MIN + _tubing_drop_mmhg(flow)
        for line in LINES:
            drop += CANNULAE[values[f"{line}_cannula"]].pressure_drop_mmhg(values[f"{line}_fr"], flow)
        return pump.head_mmhg(values["speed_rpm"], flow) - drop - afterload

    low, high = 0.0, 15.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if surplus(middle) > 0 else (low, middle)
    return low


def _tubing_drop_mmhg(flow_l_min: float) -> float:
    """Laminar pressure drop [mmHg] of the tubing at a flow [L/min], about 4 per 100 cm and L/min."""
    length_cm = sum(parameter.value for parameter in TUBING if parameter.key.startswith("Lecmotu"))
    return 0.0179 * length_cm * flow_l_min


def _check_native_output(values: Raw, case: CaseValues, remarks: Remarks) -> None:
    """Compare a measured CO, read as native output through the lungs, with the pump flow."""
    output, pump_flow = case.measurements.get("CO"), case.measurements.get("PF")
    if output is None or pump_flow is None:
        return
    added = _adds_to_native_output(values, case)
    if added is None:
        return
    if not added:
        if output < pump_flow:
            message = (
                f"below the pump flow {pump_flow:g} L/min: where ECMO returns before the lungs, CO is the "
                "whole flow of the body, and the pump would drain blood that it has just returned"
            )
            remarks.warning("measurements.CO", message, shown(output))
        return
    message = "is read as the native output, through the lungs; "
    if reason := _reason_for_total_output(case, output, pump_flow):
        hint = f"CO = {output - pump_flow:.3g}, a total minus the pump flow {pump_flow:g} L/min"
        remarks.warning("measurements.CO", message + reason, shown(output), hint)
    else:
        message += f"with the pump flow the organs get {output + pump_flow:.3g} L/min"
        remarks.note("measurements.CO", message, shown(output))


def _adds_to_native_output(values: Raw, case: CaseValues) -> bool | None:
    """Whether the pump flow adds to CO in supplying the organs or is part of it; None if it is mixed."""
    drained, given = ({values.get(f"{n}{line}_site") for n in ("", "second_")} - {None} for line in LINES)
    if case.of("vent") or drained & {*ARTERIAL_SITES, *LEFT_HEART}:
        return None
    behind = {site in (*ARTERIAL_SITES, *LEFT_HEART, "part") for site in given}
    return behind.pop() if len(behind) == 1 else None


def _reason_for_total_output(case: CaseValues, output: float, pump_flow: float) -> str:
    """Reason why a CO on V-A ECMO probably includes the pump flow (it then exceeds it), or ""."""
    if output <= pump_flow:
        return ""
    height, weight = case.patient.get("height_cm"), case.patient.get("weight_kg")
    if height is not None and weight is not None:
        index = (output + pump_flow) / body_surface(height, weight)
        if index > _LARGEST_INDEX:
            return (
                f"with the pump flow {pump_flow:g} L/min the organs would get {output + pump_flow:.3g} "
                f"L/min, {index:.1f} L/min/m^2; values above {_LARGEST_INDEX:g} are hardly ever seen"
            )
    systolic, diastolic = case.measurements.get("SP"), case.measurements.get("DP")
    rate = case.patient.get("heart_rate_bpm")
    if systolic is None or diastolic is None or not rate or systolic <= diastolic:
        return ""
    stroke = output * ML_S_PER_L_MIN * 60.0 / rate
    compliance = stroke / (systolic - diastolic)
    if compliance <= _LARGEST_COMPLIANCE:
        return ""
    return (
        f"a stroke volume of {stroke:.0f} mL with a pulse pressure of {systolic - diastolic:g} mmHg means "
        f"an arterial compliance of {compliance:.1f} mL/mmHg; 1 to 2 is usual, and values above "
        f"{_LARGEST_COMPLIANCE:g} are hardly ever seen"
    )
