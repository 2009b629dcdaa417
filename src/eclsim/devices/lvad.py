"""The ventricular assist device: one connection with inertia, no compartment of its own.

    inlet site --(pump, graft)--> outlet site

Source: Boes et al. 2019 for the pump's equation; Thiel et al. for the constants.
"""

from __future__ import annotations

from eclsim.circuit.network import Circuit, Connection, Site
from eclsim.components import RotaryPump

GROUP = "lvad"


def lvad(
    inlet_site: Site = "lv", outlet_site: Site = "ao", name: str = "lvadpump", prefix: str = "lvad."
) -> Circuit:
    """A ventricular assist device between two compartments.

    Args:
        inlet_site: compartment that blood is taken from.
        outlet_site: compartment that blood is given to.
        name: name of the connection; a second device needs another one.
        prefix: parameters are prefix + "speed_rpm", prefix + "pump.a" ...
    """
    pump = RotaryPump(prefix + "speed_rpm", prefix + "pump.", periphery=True)
    return Circuit((), (Connection(name, pump, inlet_site, outlet_site, GROUP),))
