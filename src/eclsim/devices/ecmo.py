"""The ECMO circuit: six compartments in flow direction, attached anywhere.

    drainage site --(cannula)--> ecmodrain ==tube==> ecmotudp --(pump)--> ecmotupo ==tube==> ecmooxy
        --(oxygenator)--> ecmotuor ==tube==> ecmoreturn --(cannula)--> return site

Source: Thiel et al., Figure 1 and Table S-2.
"""

from __future__ import annotations

from eclsim.circuit.network import Circuit, Compartment, Connection, Site
from eclsim.components import Cannula, ElasticVessel, Path, Resistance, RollerPump, RotaryPump, Tube
from eclsim.devices.constants import CANNULAE
from eclsim.devices.positions import ECMO_POSITIONS

GROUP = "ecmo"
POSITIONS = ECMO_POSITIONS
"""Positions of a CRRT line in the ECMO circuit, in flow direction, and the compartment that stands there."""


def ecmo(
    drainage_site: Site,
    return_site: Site,
    drainage_cannula: str = "venous",
    return_cannula: str = "arterial",
    roller: bool = False,
) -> Circuit:
    """An ECMO circuit between two sites.

    Args:
        drainage_site: compartment that blood is taken from.
        return_site: compartment that blood is given to.
        drainage_cannula: "venous" or "arterial" (data sheet of the cannula's resistance).
        return_cannula: likewise.
        roller: True for a roller pump (`ecmo.roller_l_min`), else a rotary pump (`ecmo.speed_rpm`,
            `ecmo.pump.a` ...).
    """
    names = tuple(POSITIONS.values())
    compartments = tuple(Compartment(name, ElasticVessel("C" + name), GROUP) for name in names)
    pump: Path = (
        RollerPump("ecmo.roller_l_min", "l/min") if roller else RotaryPump("ecmo.speed_rpm", "ecmo.pump.")
    )
    drainage = Cannula("ecmo.drainage_fr", CANNULAE[drainage_cannula].coefficients)
    giving = Cannula("ecmo.return_fr", CANNULAE[return_cannula].coefficients)
    connections = (
        Connection("ecmodrain", drainage, drainage_site, "ecmodrain", GROUP),
        Connection("ecmotudp", Tube("Lecmotudp", "Decmotudp"), "ecmodrain", "ecmotudp", GROUP),
        Connection("ecmopump", pump, "ecmotudp", "ecmotupo", GROUP),
        Connection("ecmotupo", Tube("Lecmotupo", "Decmotupo"), "ecmotupo", "ecmooxy", GROUP),
        Connection("ecmooxy", Resistance("Recmooxy"), "ecmooxy", "ecmotuor", GROUP),
        Connection("ecmotuor", Tube("Lecmotuor", "Decmotuor"), "ecmotuor", "ecmoreturn", GROUP),
        Connection("ecmoreturn", giving, "ecmoreturn", return_site, GROUP),
    )
    return Circuit(compartments, connections)
