r"""Blood that thickens and thins: resistances follow the haematocrit.

Relative viscosity against haematocrit H in a tube of D micrometres (Pries, Neuhaus and Gaehtgens 1992, Am J
Physiol 263:H1770, in vitro):

    eta = 1 + (eta_45 - 1) ((1 - H)^C - 1) / ((1 - 0.45)^C - 1)
    eta_45 = 220 exp(-1.3 D) + 3.2 - 2.44 exp(-0.06 D^0.645),  C as in `_shape`

Resistances change with the ratio to the viscosity at the reference haematocrit, so that at the reference
they are what they were to the last bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from eclsim.circuit.network import Circuit, Connection
from eclsim.components import Artery, Cannula, Resistance, Tube
from eclsim.components.base import Derived, Key, Number, Values, names_in, value_of
from eclsim.parameters.fluid import HAEMATOCRIT, REFERENCE

MICROCIRCULATION = {"Rmc", "Rpmc"}
"""Resistances of the body whose blood's viscosity is followed, with what lies in series."""
ARTERIOLE_UM = 25.0
"""Diameter of the vessels that make most of these resistances; chosen, not verified."""
TURBULENT = 0.25
"""Exponent of viscosity in the pressure drop of turbulent flow (Blasius 1913), as cannulae have it."""


@dataclass(frozen=True)
class ViscosityCorrected(Derived):
    """A resistance or viscosity times the change of the blood's viscosity with the haematocrit.

    Args:
        of: the value at the reference haematocrit.
        diameter_um: of the tubes that the blood runs through; 1000 and more are wide.
        exponent: of the viscosity in the resistance: 1 in laminar flow.
        haematocrit: parameter, of the blood [-].
        reference: parameter, haematocrit that `of` is for [-].
    """

    of: Key
    diameter_um: float = 1e3
    exponent: float = 1.0
    haematocrit: Key = HAEMATOCRIT
    reference: Key = REFERENCE

    def value(self, values: Values) -> Number:
        """The product."""
        now, then = (
            relative_viscosity(value_of(values, key), self.diameter_um)
            for key in (self.haematocrit, self.reference)
        )
        return value_of(values, self.of) * (now / then) ** self.exponent


def relative_viscosity(haematocrit: Number, diameter_um: float = 1e3) -> Number:
    """Viscosity of blood over that of plasma (Pries 1992), in tubes of a diameter [um]."""
    shape = _shape(diameter_um)
    narrow, wide = 220.0 * math.exp(-1.3 * diameter_um), 2.44 * math.exp(-0.06 * diameter_um**0.645)
    at_45 = narrow + 3.2 - wide
    return 1.0 + (at_45 - 1.0) * ((1.0 - haematocrit) ** shape - 1.0) / ((1.0 - 0.45) ** shape - 1.0)


def _shape(diameter_um: float) -> float:
    plug = 1.0 / (1.0 + 1e-11 * diameter_um**12)
    return (0.8 + math.exp(-0.075 * diameter_um)) * (plug - 1.0) + plug


def with_viscosity(circuit: Circuit) -> Circuit:
    """The circuit with resistances that follow the haematocrit, `fluid.haematocrit`.

    Laminar flow in tubes, oxygenator and dialyzer is proportional to viscosity, turbulent flow in cannulae
    to its fourth root, flow through the body's and the lungs' small vessels to that in narrow tubes.
    """
    return replace(circuit, connections=tuple(map(_with_viscosity, circuit.connections)))


def _with_viscosity(connection: Connection) -> Connection:
    law = connection.component
    if isinstance(law, Tube):
        law = replace(law, viscosity=ViscosityCorrected(law.viscosity))
    elif isinstance(law, Cannula):
        law = replace(law, viscosity=ViscosityCorrected(1.0, exponent=TURBULENT))
    elif isinstance(law, Artery | Resistance) and MICROCIRCULATION & set(names_in(law.ohmic)):
        law = replace(law, ohmic=ViscosityCorrected(law.ohmic, ARTERIOLE_UM))
    elif isinstance(law, Resistance) and connection.group != "patient":
        law = replace(law, ohmic=ViscosityCorrected(law.ohmic))
    return replace(connection, component=law)
