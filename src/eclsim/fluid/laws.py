"""Slow laws of a circuit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from eclsim.circuit.network import Circuit
from eclsim.components.exchangers import HAEMOGLOBIN
from eclsim.fluid.law import fluid_law
from eclsim.fluid.solutes import solutes_law, stores_of_carbon_dioxide
from eclsim.parameters.fluid import HAEMATOCRIT, SOLUTES_FOLLOWED
from eclsim.slow import SlowLaw


def slow_laws(circuit: Circuit, settings: Mapping[str, float | np.ndarray]) -> tuple[SlowLaw, ...]:
    """Slow laws of fluid, solutes and carbon dioxide stores, as far as the case follows them.

    Args:
        circuit: patient and devices.
        settings: the case's parameters.
    """
    fluid = HAEMATOCRIT in circuit.parameter_names()
    laws: tuple[SlowLaw, ...] = (fluid_law(circuit, settings),) if fluid else ()
    followed, gas = np.any(settings.get(SOLUTES_FOLLOWED, 0.0)), HAEMOGLOBIN in circuit.content_names()
    solutes = solutes_law(circuit, fluid, gas) if followed else None
    dissolved = () if solutes is None else (solutes,)
    return (*laws, *dissolved, *stores_of_carbon_dioxide(circuit, solutes))
