r"""Blood viscosity: resistances as functions of the haematocrit.

Relative viscosity against haematocrit H in a tube of D micrometres (Pries, Neuhaus and Gaehtgens 1992, Am J
Physiol 263:H1770, in vitro):

    eta = 1 + (eta_45 - 1) ((1 - H)^C - 1) / ((1 - 0.45)^C - 1)
    eta_45 = 220 exp(-1.3 D) + 3.2 - 2.44 exp(-0.06 D^0.645),  C as in `_shape`

Resistances are multiplied by the ratio to the viscosity at the reference haematocrit; at the reference they
are unchanged to the last bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from eclsim.circuit.network import Circuit, Connection
from eclsim.components import Artery, Cannula, Resistance, Tube
from eclsim.components.base import Derived, Key, Number, Values, names_in, value_of
from eclsim.parameters.fluid import HAEMATOCRIT, REFERENCE

MICROCIRCULATION = {"Rmc", "Rpmc"}
"""Resistances of the patient that depend on viscosity, together with those in series."""
ARTERIOLE_UM = 25.0
"""Diameter of the vessels with most of these resistances [um]; chosen, not verified."""
TURBULENT = 0.25
"""Exponent of viscosity in the pressure drop of turbulent flow (Blasius 1913), as in cannulae."""


@dataclass(frozen=True)
class ViscosityCorrected(Derived):
    """A resistance or viscosity multiplied by the relative change of viscosity with the haematocrit.

    Args:
        of: value at the reference haematocrit.
        diameter_um: diameter of the vessels or tubes [um]; from 1000 the viscosity is that of wide tubes.
        exponent: exponent of viscosity in the resistance: 1 for laminar flow.
        haematocrit: parameter, haematocrit of the blood [-].
        reference: parameter, haematocrit at which `of` is valid [-].
    """

    of: Key
    diameter_um: float = 1e3
    exponent: float = 1.0
    haematocrit: Key = HAEMATOCRIT
    reference: Key = REFERENCE

    def value(self, values: Values) -> Number:
        """The value at the present haematocrit."""
        now, then = (
            relative_viscosity(value_of(values, key), self.diameter_um)
            for key in (self.haematocrit, self.reference)
        )
        return value_of(values, self.of) * (now / then) ** self.exponent


def relative_viscosity(haematocrit: Number, diameter_um: float = 1e3) -> Number:
    """Viscosity of blood relative to plasma (Pries 1992) in tubes of a diameter [um]."""
    shape = _shape(diameter_um)
    narrow, wide = 220.0 * math.exp(-1.3 * diameter_um), 2.44 * math.exp(-0.06 * diameter_um**0.645)
    at_45 = narrow + 3.2 - wide
    return 1.0 + (at_45 - 1.0) * ((1.0 - haematocrit) ** shape - 1.0) / ((1.0 - 0.45) ** shape - 1.0)


def _shape(diameter_um: float) -> float:
    plug = 1.0 / (1.0 + 1e-11 * diameter_um**12)
    return (0.8 + math.exp(-0.075 * diameter_um)) * (plug - 1.0) + plug


def with_viscosity(circuit: Circuit) -> Circuit:
    """The circuit with resistances that depend on the haematocrit, `fluid.haematocrit`.

    The resistance of tubes, oxygenator and dialyzer (laminar flow) is proportional to viscosity, that of
    cannulae (turbulent flow) to its fourth root, and that of systemic and pulmonary small vessels to
    viscosity in narrow tubes.
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
