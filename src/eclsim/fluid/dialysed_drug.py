"""A drug that blood carries and dialysis removes, in one or two compartments, over hours.

                       doses, infusion
                              |
    peripheral  <-- Q -->  central  -->  body's own clearance
      V2, A2               V1, A1   -->  filters (effective clearance of the beat)
                                    -->  blood that is lost

    dA1/dt = given + Q (A2 / V2 - A1 / V1) - (CL + sum K + bleeding (1 - Hct)) A1 / V1
    dA2/dt = Q (A1 / V1 - A2 / V2)

with concentrations in the plasma, bound and unbound drug together. The drug acts on nothing. Blood that is
given is the patient's own, with the drug in it. Amounts in mg; what was given, and what left by each way, are
states, so that balances can be checked.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from eclsim.circuit.network import Circuit
from eclsim.components.dialysis import Hemofilter
from eclsim.fluid.solutes import Filter, filters_of, plasma_share
from eclsim.parameters import dialysed_drug as keys
from eclsim.slow import DOSE, DerivedQuantity, Named, SlowLaw, SlowState

SOLUTE = "drug"
"""Last part of the names of its clearances, as "urea" of those of urea."""
CONCENTRATION, UNBOUND = "drug_concentration", "drug_unbound"
_ML_PER_L, _MINUTE, _HOUR = 1000.0, 60.0, 3600.0
_CENTRAL, _PERIPHERAL, _GIVEN, _DIALYSED, _ELIMINATED, _BLED = AMOUNTS = tuple(
    f"{keys.SECTION}.{place}_mg"
    for place in ("central", "peripheral", "given", "dialysed", "eliminated", "bled")
)
_WORDS = (
    "drug in the central volume", "drug in the peripheral volume", "drug given", "drug removed by dialysis",
    "drug eliminated by the body", "drug lost with blood",
)  # fmt: skip
_TYPICAL_SHARE = 0.05
"""Share of a dose that matters."""


def with_dialysed_drug(circuit: Circuit) -> Circuit:
    """Return the circuit with filters that clear the drug."""
    drug = (keys.SIEVING, keys.AREA_PRODUCT)
    exchanges = (
        replace(one, component=replace(one.component, drug=drug))
        if isinstance(one.component, Hemofilter)
        else one
        for one in circuit.exchanges
    )
    return replace(circuit, exchanges=tuple(exchanges))


@dataclass(frozen=True)
class DialysedDrugLaw(SlowLaw):
    """Slow law of the drug.

    Args:
        scale: amount that matters [mg].
        filters: the dialyzers.
        fluid: whether plasma and red cells are followed.
    """

    scale: float
    filters: tuple[Filter, ...] = ()
    fluid: bool = False

    @property
    def states(self) -> tuple[SlowState, ...]:  # noqa: D102  (as documented in the base class; so below)
        held = (_CENTRAL, _PERIPHERAL)
        return tuple(
            SlowState(name, "mg", words, self.scale, name in held)
            for name, words in zip(AMOUNTS, _WORDS, strict=True)
        )

    @property
    def reads(self) -> tuple[str, ...]:  # noqa: D102
        return tuple(one.output(f"{one.clearance}_{SOLUTE}") for one in self.filters)

    def start(self, settings: Named, beat: Named) -> Named:  # noqa: D102
        concentration = np.asarray(settings[keys.START])
        amounts = dict.fromkeys(AMOUNTS, np.zeros_like(concentration))
        amounts[_CENTRAL] = concentration * settings[keys.CENTRAL]
        amounts[_PERIPHERAL] = concentration * settings[keys.PERIPHERAL]
        return amounts

    def in_effect(self, states: Named, settings: Named) -> Named:  # noqa: D102
        return {}

    def rates(self, states: Named, settings: Named, beat: Named, inflows: Named) -> Named:  # noqa: D102
        central = 1.0 / _ML_PER_L * states[_CENTRAL] / settings[keys.CENTRAL]  # mg/mL
        second = np.asarray(settings[keys.PERIPHERAL])
        outer = 1.0 / _ML_PER_L * states[_PERIPHERAL] / np.where(second > 0.0, second, 1.0)
        moved = np.where(second > 0.0, settings[keys.TRANSFER] / _MINUTE * (central - outer), 0.0)
        given = inflows[DOSE] + settings[keys.INFUSION] / _HOUR
        cleared = sum((one.cleared(beat, SOLUTE) for one in self.filters), np.zeros_like(central))
        dialysed, eliminated = cleared * central, settings[keys.BODY] / _MINUTE * central
        blood = inflows["bleed_ml"] - inflows["blood_ml"]
        bled = blood * plasma_share(states, settings, self.fluid) * central
        return {
            _CENTRAL: given - moved - dialysed - eliminated - bled, _PERIPHERAL: moved, _GIVEN: given,
            _DIALYSED: dialysed, _ELIMINATED: eliminated, _BLED: bled,
        }  # fmt: skip

    def derived_quantities(self, states: Named, in_effect: Named) -> tuple[DerivedQuantity, ...]:  # noqa: D102
        plasma = states[_CENTRAL] / in_effect[keys.CENTRAL]
        unbound = plasma * in_effect[keys.UNBOUND_SHARE]
        return (
            DerivedQuantity(CONCENTRATION, "mg/L", "drug in the plasma, bound and unbound", plasma),
            DerivedQuantity(UNBOUND, "mg/L", "unbound drug in the plasma", unbound),
        )


def dialysed_drug_law(circuit: Circuit, settings: Mapping[str, float], fluid: bool) -> DialysedDrugLaw:
    """Law of the drug of a case.

    Args:
        circuit: patient and devices.
        settings: parameters at the start, from which the amount that matters is taken.
        fluid: whether plasma and red cells are followed.
    """
    hourly, held = settings[keys.INFUSION], settings[keys.START] * settings[keys.CENTRAL]
    scale = _TYPICAL_SHARE * float(np.max([settings[keys.DOSE], 8.0 * hourly, held, 20.0]))
    return DialysedDrugLaw(scale, filters_of(circuit), fluid)
