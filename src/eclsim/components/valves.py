"""Heart valves: one-way orifices."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import jax.numpy as jnp

from eclsim.components.base import Key, Number, Path, Values, value_of


@dataclass(frozen=True)
class HeartValve(Path[Number]):
    """Diode with a pressure drop that grows with the square of the flow.

        source o---|>|---o target      Q = CQ sqrt(dp) if dp > 0, else 0

    Under a load b the open valve solves dp = b Q + Q^2 / CQ^2 in closed form,
    Q = 2 dp / (b + sqrt(b^2 + 4 dp / CQ^2)), which stays smooth where sqrt(dp) is stiff.

    Args:
        coefficient: CQ [mL/(s mmHg^1/2)].
        smoothing: width [mmHg] over which max(dp, 0) is rounded off where there is no load; only the
            explicit verification solver meets it.

    Source: Thiel et al., section 2.2 and Table S-1 (`CQtri`, `CQpa`, `CQmi`, `CQao`).
    """

    coefficient: Key
    smoothing: float = 1e-3
    above_zero: ClassVar = ("coefficient",)
    one_way: ClassVar = True

    def constants(self, values: Values) -> Number:
        """4 / CQ^2 [mmHg s^2/mL^2]."""
        return 4.0 / value_of(values, self.coefficient) ** 2

    def pressure_drop(self, flow: Number, constants: Number) -> Number:
        """Q^2 / CQ^2 [mmHg] of a forward flow."""
        return 0.25 * constants * jnp.square(jnp.maximum(flow, 0.0))

    def flow(self, pressure_difference: Number, load: Number, constants: Number) -> Number:
        """Flow [mL/s], never backwards."""
        if isinstance(load, float) and load == 0.0:
            rounded = jnp.sqrt(pressure_difference**2 + self.smoothing**2)
            forward = 0.5 * (pressure_difference + rounded)
            return 2.0 * jnp.sqrt(forward / constants)
        forward = jnp.maximum(pressure_difference, 0.0)
        return 2.0 * forward / (load + jnp.sqrt(load * load + constants * forward))

    def sharpened(self, smoothing: float) -> HeartValve:
        """The same valve, rounded off over another width [mmHg]."""
        return replace(self, smoothing=smoothing)
