"""What is usual: adult reference ranges of outputs; and the limits of outputs as plain data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from eclsim.outputs.limits import limits_of
from eclsim.outputs.recirculation import recirculation_labels
from eclsim.outputs.registry import all_outputs

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.devices.description import Output

_CATHETER = "practical table of right heart catheterisation, European Respiratory Society"
_NURSING = "nursing reference of haemodynamic norms"
_HUDSMITH = "Hudsmith et al. 2005, 63 men, mean ± 2 SD"
_KAWEL = "Kawel-Boehm et al. 2015, men, mean ± 2 SD"

REFERENCE: dict[str, tuple[float, float, str]] = {
    "SP": (90.0, 140.0, _NURSING),
    "DP": (60.0, 90.0, _NURSING),
    "MAP": (70.0, 100.0, _NURSING),
    "MPAP": (8.0, 20.0, _CATHETER),
    "PCWP": (4.0, 12.0, _CATHETER),
    "CO": (4.0, 8.0, _CATHETER),
    "SPAP": (15.0, 25.0, _CATHETER),
    "DPAP": (4.0, 12.0, _CATHETER),
    "right_atrial_pressure": (1.0, 6.0, _CATHETER),
    "end_diastolic_pressure_rv": (1.0, 8.0, _CATHETER),
    "peak_pressure_rv": (15.0, 25.0, _CATHETER),
    "EDVLV": (102.0, 218.0, _HUDSMITH),
    "ESVLV": (18.0, 82.0, _HUDSMITH),
    "EDVRV": (124.0, 256.0, _HUDSMITH),
    "ESVRV": (38.0, 118.0, _HUDSMITH),
    "stroke_volume_lv": (50.0, 100.0, _NURSING),
    "ejection_fraction_lv": (57.0, 77.0, _KAWEL),
}
"""Adult range of an output, in its unit, and where it comes from."""


def bounds(quantity: str) -> list[dict[str, Any]]:
    """The limits of an output as plain data, the gravest first."""
    return [
        {"kind": limit.kind, "side": limit.side, "value": limit.value, "meaning": limit.meaning}
        for limit in limits_of(quantity)
    ]


def output_specs() -> dict[str, dict[str, Any]]:
    """Words, unit, definition and reference range of every output, as plain data."""
    result = {name: _spec(entry, name, entry.long_name) for name, entry in all_outputs().items()}
    return result | {
        name: {"label": about["long_name"], "unit": about["units"], "definition": about["definition"]}
        for name, about in recirculation_labels().items()
    }


def named_specs(case: Case) -> dict[str, dict[str, Any]]:
    """The same of the outputs of devices that have a name, such as two of a kind."""
    return {
        one.output(entry.name): _spec(entry, one.output(entry.name), f"{entry.long_name}, {one.label}")
        for one in case.instances()
        for entry in (one.device.outputs if one.name else ())
    }


def _spec(entry: Output, name: str, label: str) -> dict[str, Any]:
    spec: dict[str, Any] = {"label": label, "unit": entry.unit, "definition": entry.definition}
    if name in REFERENCE:
        spec["range"] = list(REFERENCE[name])
    return spec | ({"limits": limits} if (limits := bounds(name)) else {})
