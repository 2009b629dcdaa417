"""Cautions about the ejection fraction of a ventricle that a device drains."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

from eclsim.devices.description import CAUTION, Finding
from eclsim.devices.device import Naming

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit

VENTRICLES = MappingProxyType({"lv": ("left ventricle", "aortic"), "rv": ("right ventricle", "pulmonary")})
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
