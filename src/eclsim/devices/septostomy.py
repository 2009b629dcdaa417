"""Atrial septostomy: a hole between the atria that unloads the left atrium on V-A ECMO.

    la --( hole )-- ra      Q = CQ sqrt(dp) in either direction, CQ from the effective area

The jet through a sharp-edged hole contracts to 0.61 of its area (textbooks of hydraulics).
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

from eclsim.devices.description import Look, Mark, mean_flow
from eclsim.devices.device import Device
from eclsim.inputs.fields import number
from eclsim.inputs.sections import Section

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit

GROUP = "septostomy"
_DIAMETER = f"{GROUP}.diameter_mm"
CONTRACTION = 0.61
"""Ratio of effective to geometric area of a sharp-edged hole."""


class Septostomy(Section):
    """Section [septostomy]: diameter of the hole in the atrial septum."""

    section = GROUP
    diameter_mm: Annotated[float, number("Diameter of the hole", "mm", 1, 25, 8)]


class SeptostomyDevice(Device[Septostomy]):
    """Hole in the atrial septum."""

    key, name, section = GROUP, "Septostomy", Septostomy
    connections = MappingProxyType({"septostomy": "septostomy"})
    marks = MappingProxyType({"septostomy": Mark("tube", "septostomy")})
    look = Look("#7A4A72", "#F8F2F6", 1.6, marker="X")
    nominal = MappingProxyType({_DIAMETER: 8.0})
    usual = MappingProxyType({"diameter_mm": 8.0})
    outputs = (mean_flow("septostomy_flow", "flow from the left into the right atrium", "Qseptostomy"),)

    def circuit(self, section: Septostomy) -> Circuit:
        """Circuit of one orifice between the atria."""
        from eclsim.circuit.network import Circuit, Connection
        from eclsim.components import OpenOrifice, Orifice, Scaled

        area = Scaled(CONTRACTION * math.pi / 400.0, (_DIAMETER, _DIAMETER))
        return Circuit(connections=(Connection(GROUP, OpenOrifice(Orifice(area)), "la", "ra", GROUP),))

    def summary(self, section: Septostomy) -> str:
        """Diameter."""
        return f"{section.diameter_mm:g} mm"


SEPTOSTOMY = SeptostomyDevice()
