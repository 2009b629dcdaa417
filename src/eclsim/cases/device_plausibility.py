"""Plausibility of the devices of a case: sites, cannula sizes, speeds, labels, pump flow for the speed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from eclsim.cases.fields import ARTERIAL_SITES, ECMO_POSITIONS, PATIENT_SITES, VENOUS_SITES
from eclsim.cases.mistakes import Mistake, shown
from eclsim.cases.numbers import suspected_unit
from eclsim.devices.constants import CANNULAE, OXYGENATORS, PUMPS
from eclsim.parameters import thiel2025
from eclsim.units import ML_S_PER_L_MIN, convert

# Beyond this share of the highest speed in use a pump curve says nothing any more.
_SPEED_LIMIT = 1.25
_LEFT_HEART = ("pvn", "la", "lv")
_RIGHT_HEART = ("rv", "pas")


def check_devices(
    values: Mapping[str, Any], mistakes: list[Mistake], warnings: list[Mistake], notes: list[Mistake]
) -> None:
    """Check the device sections that are there; what is found is added to the three lists."""
    if "ecmo" in values:
        ecmo = values["ecmo"]
        _check_sites("ecmo", ecmo, ("drainage_site", "return_site"), mistakes, warnings)
        _check_mode(ecmo, mistakes)
        for line in ("drainage", "return"):
            _check_cannula(line, ecmo, mistakes, warnings)
        _check_speed("ecmo", ecmo, mistakes, warnings)
        _check_pump_flow(values, warnings)
    if "crrt" in values:
        _check_crrt(values, mistakes, warnings)
        if "ecmo" in values:
            _check_crrt_flow(values, warnings)
    if "lvad" in values:
        _check_sites("lvad", values["lvad"], ("inlet_site", "outlet_site"), mistakes, warnings)
        _check_lvad_inlet(values["lvad"], warnings)
        _check_speed("lvad", values["lvad"], mistakes, warnings)
        if "ecmo" in values:
            notes.append(
                Mistake("lvad", "ECMO and LVAD work on the same circulation and may oppose each other")
            )


def _check_sites(
    section: str,
    device: Mapping[str, Any],
    names: tuple[str, str],
    mistakes: list[Mistake],
    warnings: list[Mistake],
) -> None:
    taken_from, given_to = (device.get(name) for name in names)
    if taken_from is None or given_to is None:
        return
    key = f"{section}.{names[1]}"
    if taken_from == given_to:
        message = f"the same as {names[0]}: the device would pump in a circle"
        mistakes.append(Mistake(key, message, shown(given_to), "another compartment than " + names[0]))
    elif taken_from in ARTERIAL_SITES and given_to in (*VENOUS_SITES, *_LEFT_HEART):
        why = "against the heart's own flow" if given_to in _LEFT_HEART else "an arterio-venous shunt"
        message = f"drains {PATIENT_SITES[taken_from]} into {PATIENT_SITES[given_to]}: {why}"
        hint = f"{names[0]} = {shown(given_to)} and {names[1]} = {shown(taken_from)} (reversed)"
        warnings.append(Mistake(key, message, shown(given_to), suggestion=hint))


def _check_lvad_inlet(lvad: Mapping[str, Any], warnings: list[Mistake]) -> None:
    """A pump from the right heart to the arteries sends blood past the lungs."""
    inlet, outlet = lvad.get("inlet_site"), lvad.get("outlet_site")
    if inlet in (*VENOUS_SITES, *_RIGHT_HEART) and outlet in (*ARTERIAL_SITES, *_LEFT_HEART):
        message = f"drains {PATIENT_SITES[inlet]}: blood passes the lungs by, with no oxygenator in its way"
        warnings.append(Mistake("lvad.inlet_site", message, shown(inlet), suggestion="lv or la"))


def _check_mode(ecmo: Mapping[str, Any], mistakes: list[Mistake]) -> None:
    mode, site = ecmo.get("mode"), ecmo.get("return_site")
    if mode is None or site is None:
        return
    contradicts = site in VENOUS_SITES if mode == "VA" else site in ARTERIAL_SITES
    if contradicts:
        message = f"contradicts return_site = {shown(site)} ({PATIENT_SITES[site]})"
        other = "VV" if mode == "VA" else "VA"
        allowed = f'mode = "{other}", another return_site, or no mode: then the sites count'
        mistakes.append(Mistake("ecmo.mode", message, shown(mode), allowed))


def _check_cannula(
    line: str, ecmo: Mapping[str, Any], mistakes: list[Mistake], warnings: list[Mistake]
) -> None:
    kind, size = ecmo.get(f"{line}_cannula"), ecmo.get(f"{line}_fr")
    if kind is None or size is None:
        return
    sizes = CANNULAE[kind].sizes_fr
    listed = ", ".join(str(listed_size) for listed_size in sizes)
    key = f"ecmo.{line}_fr"
    if not sizes[0] <= size <= sizes[-1]:
        message = f"no {kind} cannula of this size"
        meant = suspected_unit(size, "Fr", 19.0, (sizes[0], sizes[-1]))
        mistakes.append(Mistake(key, message, shown(size), f"{listed} Fr and what lies between", meant))
    elif size not in sizes:
        message = f"between the listed sizes of {kind} cannulae ({listed} Fr): interpolated"
        warnings.append(Mistake(key, message, shown(size)))


def _check_speed(
    section: str, device: Mapping[str, Any], mistakes: list[Mistake], warnings: list[Mistake]
) -> None:
    name, speed = device.get("pump"), device.get("speed_rpm")
    if not isinstance(name, str) or speed is None:
        return
    key = f"{section}.speed_rpm"
    low, high = PUMPS[name].speed_range_rpm
    span = f"{low:g} to {high:g} rpm"
    if speed > high * _SPEED_LIMIT:
        mistakes.append(Mistake(key, f"far above what a {name} runs at", shown(speed), span))
    elif speed == 0:
        warnings.append(
            Mistake(key, "the pump stands still in an open circuit: blood flows back through it", "0")
        )
    elif not low <= speed <= high:
        warnings.append(Mistake(key, f"outside the usual speed of a {name}, {span}", shown(speed)))


def _check_crrt(values: Mapping[str, Any], mistakes: list[Mistake], warnings: list[Mistake]) -> None:
    crrt = values["crrt"]
    for name in ("access_site", "return_site"):
        if crrt.get(name) in ECMO_POSITIONS and "ecmo" not in values:
            message = "a position in the ECMO circuit, but the case has no [ecmo] section"
            allowed = ", ".join(PATIENT_SITES) + ", or add [ecmo]"
            mistakes.append(Mistake(f"crrt.{name}", message, shown(crrt[name]), allowed))
    access, back = crrt.get("access_site"), crrt.get("return_site")
    if access is not None and access == back:
        message = "the same as access_site: the filter cleans blood that just passed it (recirculation)"
        warnings.append(Mistake("crrt.return_site", message, shown(back)))
    elif access in ARTERIAL_SITES and back in VENOUS_SITES:
        warnings.append(Mistake("crrt.return_site", "drains an artery into a vein: a shunt", shown(back)))


def _check_crrt_flow(values: Mapping[str, Any], warnings: list[Mistake]) -> None:
    """A CRRT that draws more from the ECMO circuit than the circuit is set to carry."""
    crrt, pump = values["crrt"], values["ecmo"].get("pump")
    carried = pump["roller_l_min"] if isinstance(pump, dict) else values["ecmo"].get("flow_l_min")
    drawn, sites = crrt.get("flow_ml_min"), (crrt.get("access_site"), crrt.get("return_site"))
    if drawn is None or carried is None or not all(site in ECMO_POSITIONS for site in sites):
        return
    if drawn > convert(carried, "L/min", "mL/min"):
        message = (
            f"above the ECMO flow {carried:g} L/min that it is drawn from: between the CRRT lines blood runs "
            "backwards or in a circle"
        )
        warnings.append(Mistake("crrt.flow_ml_min", message, shown(drawn)))


def _check_pump_flow(values: Mapping[str, Any], warnings: list[Mistake]) -> None:
    """The measured or set pump flow against the oxygenator's label and against the pump's speed."""
    ecmo, measured = values["ecmo"], values.get("measurements", {})
    pump, flow = ecmo.get("pump"), measured.get("PF")
    key = "measurements.PF"
    if isinstance(pump, dict):
        if flow is not None and abs(flow - pump["roller_l_min"]) > max(0.3, 0.2 * flow):
            message = f"the roller pump is set to {pump['roller_l_min']:g} L/min"
            warnings.append(Mistake(key, message, shown(flow)))
        key, flow = "ecmo.pump", pump["roller_l_min"]
    if flow is None:
        return
    oxygenator = ecmo.get("oxygenator")
    if oxygenator is not None and (said := OXYGENATORS[oxygenator].label_warning(flow)):
        warnings.append(Mistake(key, said, shown(flow)))
    expected = _expected_flow(ecmo, measured) if isinstance(pump, str) else None
    if expected is not None and not 0.4 * expected <= flow <= 1.6 * expected + 0.5:
        message = f"implausible at {ecmo['speed_rpm']:g} rpm, which gives about {expected:.1f} L/min"
        warnings.append(Mistake(key, message, shown(flow)))


def _expected_flow(ecmo: Mapping[str, Any], measured: Mapping[str, float]) -> float | None:
    """Steady flow [L/min] at which the pump's head equals the circuit's pressure drop, 0 at the least."""
    needed = (
        "pump",
        "speed_rpm",
        "oxygenator",
        *(f"{line}_{what}" for line in _LINES for what in ("cannula", "fr")),
    )
    if any(name not in ecmo for name in needed) or not ecmo["speed_rpm"]:
        return None
    pump, oxygenator = PUMPS[ecmo["pump"]], OXYGENATORS[ecmo["oxygenator"]]
    afterload = measured.get("MAP", 75.0) - 5.0 if ecmo.get("return_site") in (*ARTERIAL_SITES, "lv") else 0.0

    def surplus(flow: float) -> float:
        drop = oxygenator.resistance * flow * ML_S_PER_L_MIN + _tubing_drop_mmhg(flow)
        for line in _LINES:
            drop += CANNULAE[ecmo[f"{line}_cannula"]].pressure_drop_mmhg(ecmo[f"{line}_fr"], flow)
        return pump.head_mmhg(ecmo["speed_rpm"], flow) - drop - afterload

    low, high = 0.0, 15.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if surplus(middle) > 0 else (low, middle)
    return low


_LINES = ("drainage", "return")


def _tubing_drop_mmhg(flow_l_min: float) -> float:
    """Laminar pressure drop [mmHg] of the ECMO tubing at a flow [L/min], about 4 per 100 cm and L/min."""
    length_cm = sum(thiel2025.PARAMETERS[f"Lecmo{tube}"].value for tube in ("tudp", "tupo", "tuor"))
    return 0.0179 * length_cm * flow_l_min
