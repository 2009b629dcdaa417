"""Checks and cautions shared by several devices: sites, speeds and sizes of cannulae, drained ventricles."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

from eclsim.devices.description import CAUTION, Finding
from eclsim.devices.device import Naming
from eclsim.devices.products import CannulaType, PumpCurve
from eclsim.inputs.fields import Field, one_of
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.numbers import suspected_unit
from eclsim.inputs.sections import Raw
from eclsim.patient.sites import AFTER_LUNGS, ARTERIAL_SITES, PATIENT_SITES, VENOUS_SITES

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit


_IN_FLOW_DIRECTION = (VENOUS_SITES, ("rv",), ("pas", "part"), ("pvn",), ("la",), ("lv",), ARTERIAL_SITES)
_PLACES = {site: place for place, sites in enumerate(_IN_FLOW_DIRECTION) for site in sites}
# Multiple of the highest usual speed up to which a pump curve is valid.
SPEED_LIMIT = 1.25


def patient_site(description: str, *, required: bool = True) -> Field:
    """Field for a compartment of the patient to which a device is connected."""
    return one_of(description, tuple(PATIENT_SITES), required=required)


def check_sites(
    key: str, values: Raw, source: str, target: str, remarks: Remarks, more: str = "", shunt: bool = False
) -> None:
    """Report a device that pumps in a circle, or back to a site that the heart's flow passes earlier.

    Args:
        key: key of the section.
        values: values of the section.
        source: name of the key of the site from which blood is drained.
        target: name of the key of the site to which blood is pumped.
        remarks: collects mistakes, warnings and notes.
        more: what is said of equal sites besides.
        shunt: whether a flow back to an earlier site is what the device is for, and no mistake.
    """
    taken_from, given_to = values.get(source), values.get(target)
    if taken_from is None or given_to is None:
        return
    if taken_from == given_to:
        message = f"the same as {source}: the device would pump in a circle{more}"
        remarks.error(f"{key}.{target}", message, shown(given_to), "a compartment other than " + source)
    elif not shunt and pumps_back(taken_from, given_to):
        reason = "against the heart's own flow"
        if taken_from in AFTER_LUNGS and given_to not in AFTER_LUNGS:
            arterial = taken_from in ARTERIAL_SITES
            reason = "an arterio-venous shunt" if arterial else "a shunt from the left to the right heart"
        message = f"drains {PATIENT_SITES[taken_from]} into {PATIENT_SITES[given_to]}: {reason}"
        hint = f"{source} = {shown(given_to)} and {target} = {shown(taken_from)} (reversed)"
        remarks.warning(f"{key}.{target}", message, shown(given_to), hint)


def pumps_back(taken_from: str | None, given_to: str | None) -> bool:
    """Whether blood is returned to a site that it passes before the one from which it is drained."""
    return _PLACES.get(given_to or "", math.inf) < _PLACES.get(taken_from or "", -math.inf)


def check_speed(
    key: str, values: Raw, pumps: Mapping[str, PumpCurve], remarks: Remarks, is_closed: bool = False
) -> None:
    """Compare the `speed_rpm` of a section with the usual speeds of its `pump`.

    Args:
        key: key of the section.
        values: values of the section.
        pumps: rotary pumps by name.
        remarks: collects mistakes and warnings.
        is_closed: whether a line is clamped off, so that a pump may stand still.
    """
    name, speed = values.get("pump"), values.get("speed_rpm")
    if not isinstance(name, str) or speed is None:
        return
    low, high = pumps[name].speed_range_rpm
    span = f"{low:g} to {high:g} rpm"
    if speed > high * SPEED_LIMIT:
        remarks.error(f"{key}.speed_rpm", f"far above the speed of a {name}", shown(speed), span)
    elif speed == 0:
        venous = {values.get("drainage_site"), values.get("return_site")} <= set(VENOUS_SITES)
        what = "hardly any blood flows through it" if venous else "blood flows back through it"
        message = f"the pump stands still in an open circuit: {what}"
        if not is_closed:
            remarks.warning(f"{key}.speed_rpm", message, "0")
    elif not low <= speed <= high:
        message = f"outside the usual speed of a {name}, {span}"
        hint = suspected_unit(speed, "rpm", pumps[name].usual_speed_rpm, (low, high))
        remarks.warning(f"{key}.speed_rpm", message, shown(speed), hint)


def check_cannula(key: str, size: float, cannula: CannulaType, remarks: Remarks) -> None:
    """Compare a cannula size [Fr] with those that the maker lists; `key` is the key of the size."""
    sizes = cannula.sizes_fr
    listed = ", ".join(map(str, sizes))
    if not sizes[0] <= size <= sizes[-1]:
        suggestion = suspected_unit(size, "Fr", 19.0, (sizes[0], sizes[-1]))
        message = f"no {cannula.key} cannula of this size"
        remarks.error(key, message, shown(size), f"{listed} Fr and sizes between them", suggestion)
    elif size not in sizes:
        message = f"between the listed sizes of {cannula.key} cannulae ({listed} Fr): interpolated"
        remarks.warning(key, message, shown(size))


# --- drained ventricles ---------------------------------------------------------------------------


VENTRICLES = {"lv": ("left ventricle", "aortic"), "rv": ("right ventricle", "pulmonary")}
"""Label of each ventricle that may be drained, and of the valve through which it ejects."""


def drained_ventricles(names: Naming, circuit: Circuit, places: Collection[str]) -> tuple[str, ...]:
    """Ventricles ("lv", "rv") that a device drains through the given connections."""
    own = set(map(names.place, places))
    sources = (str(c.source) for c in circuit.connections if c.name in own)
    return tuple(source for source in sources if source in VENTRICLES)


def ejection_fraction_findings(
    names: Naming, outputs: Mapping[str, float], circuit: Circuit, places: Collection[str], flow: str
) -> list[Finding]:
    """Cautions about how to read the ejection fraction of a ventricle that a device drains.

    Args:
        names: names of the instance.
        outputs: outputs of the beat, by name.
        circuit: circuit of patient and devices.
        places: connections of the device that may drain a ventricle.
        flow: the device's output of their flow, which may be negative.
    """
    backwards = outputs.get(names.output(flow), 0.0) < 0.0
    result = []
    for drained in drained_ventricles(names, circuit, places):
        name, (ventricle, valve) = f"ejection_fraction_{drained}", VENTRICLES[drained]
        if name not in outputs:
            continue
        does, counts = "empties", "what the device takes"
        counts += f", and do not describe ejection through the {valve} valve"
        if backwards:
            does, counts = "lets blood back into", "how much of that it ejects again"
        text = f"the {names.label} {does} the {ventricle}: "
        text += f"its ejection fraction and stroke volume count {counts}"
        stroke = f"stroke_volume_{drained}"
        result.append(Finding.without_limit(CAUTION, name, outputs[name], text, name, stroke))
    return result
