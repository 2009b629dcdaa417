"""Atrial septostomy: a hole between the atria that unloads the left atrium on V-A ECMO.

    la --( hole )-- ra      Q = CQ sqrt(dp) in either direction, CQ from the effective area

The jet through a sharp-edged hole contracts to 0.61 of its area (textbooks of hydraulics).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

from eclsim.devices.description import CAUTION, Finding, Look, mean_flow
from eclsim.devices.device import Device
from eclsim.inputs.fields import number
from eclsim.inputs.sections import Section

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eclsim.circuit.network import Circuit
    from eclsim.devices.device import Naming

GROUP = "septostomy"
_DIAMETER = f"{GROUP}.diameter_mm"
CONTRACTION = 0.61
"""Ratio of effective to geometric area of a sharp-edged hole."""

LARGE_L_MIN = 1.0
"""Flow through the hole above which the right ventricle's share in it is said [L/min]."""


class Septostomy(Section):
    """Section [septostomy]: diameter of the hole in the atrial septum."""

    section = GROUP
    diameter_mm: Annotated[float, number("Diameter of the hole", "mm", 1, 25, 8)]


class SeptostomyDevice(Device[Septostomy]):
    """Hole in the atrial septum."""

    key, name, section = GROUP, "Septostomy", Septostomy
    connections = {"septostomy": "septostomy"}
    look = Look("#7A4A72", "#F8F2F6", 1.6, marker="X")
    nominal = {_DIAMETER: 8.0}
    usual = {"diameter_mm": 8.0}
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

    def findings(
        self, names: Naming, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
    ) -> list[Finding]:
        """Caution on ECMO about blood that the right ventricle pumps round through the hole."""
        flow = outputs.get(names.output("septostomy_flow"), 0.0)
        if "PF" not in outputs or not flow > LARGE_L_MIN:
            return []
        text = (
            f"{flow:.1f} L/min run through the hole in the septum, and the right ventricle pumps them back "
            "to the lungs: more than in patients on V-A ECMO, whose left atrial pressure so falls further "
            "(in 64 from 24 to 8 mmHg with holes of 22 mm, Baruteau 2018; in this model from 24 to 13)"
        )
        concerns = (names.output("septostomy_flow"), "CO", "PCWP", "left_atrial_pressure")
        return [Finding.without_limit(CAUTION, concerns[0], flow, text, *concerns)]


SEPTOSTOMY = SeptostomyDevice()
