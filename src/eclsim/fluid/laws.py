"""The slow laws that a circuit has."""

from __future__ import annotations

from eclsim.circuit.network import Circuit
from eclsim.fluid.law import fluid_law
from eclsim.parameters.fluid import HAEMATOCRIT
from eclsim.slow.law import SlowLaw


def slow_laws(circuit: Circuit) -> tuple[SlowLaw, ...]:
    """Laws of fluid, and of what is dissolved in it, as far as the circuit follows them."""
    return (fluid_law(circuit),) if HAEMATOCRIT in circuit.parameter_names() else ()
