"""The posterior of a patient's parameters: prior, measurements, and the model in between.

The noise model: every measurement is normally distributed around the model's output, with the standard
uncertainty of the measurement, independent of the others. The potential is minus the logarithm of the
posterior density of the hidden variables z, up to a constant:

    U(z) = sum ((output(z) - measured) / uncertainty)^2 / 2 + z . z / 2

and infinite where the model has no steady beat: such parameters are excluded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from eclsim.identification.batch_outputs import simulate_members
from eclsim.identification.prior import Prior
from eclsim.orbit.model import AS_PUBLISHED, Model


@dataclass(frozen=True)
class Posterior:
    """Density of the hidden variables of a patient's free parameters.

    Args:
        model: circuit and values; those of the free parameters are replaced.
        measured: measured value of each output [mmHg, L/min].
        errors: standard uncertainty of each, in the unit of the output.
        prior: of the free parameters.
        policy: blood volume policy.
    """

    model: Model
    measured: Mapping[str, float]
    errors: Mapping[str, float]
    prior: Prior
    policy: str = AS_PUBLISHED

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """What was measured."""
        return tuple(self.measured)

    @cached_property
    def target(self) -> np.ndarray:
        """Measured values, shape (outputs,)."""
        return np.array([self.measured[n] for n in self.outputs])

    @cached_property
    def scale(self) -> np.ndarray:
        """Standard uncertainties, shape (outputs,)."""
        return np.array([self.errors[n] for n in self.outputs])

    def values(self, x: np.ndarray) -> dict[str, Any]:
        """Parameter values of members with logarithms (members, parameters), or of one (parameters,)."""
        free = {name: np.exp(x[..., k]) for k, name in enumerate(self.prior.names)}
        return {**self.model.values, **free}

    def potential(self, z: np.ndarray, outputs: np.ndarray, temper: float = 1.0) -> np.ndarray:
        """U of members, shape (members,), from their outputs (members, outputs).

        Args:
            z: hidden variables, shape (members, parameters).
            outputs: of the model there.
            temper: how much the measurements count: 1 for the posterior, 0 for the prior.
        """
        misfit = np.sum(((outputs - self.target) / self.scale) ** 2, axis=-1)
        fit = np.where(np.isfinite(misfit), 0.5 * temper * misfit, np.inf)
        return fit + 0.5 * np.sum(np.square(z), axis=-1)

    def simulate(self, z: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
        """Outputs of many members side by side, shape (members, outputs); NaN without a steady beat.

        Args:
            z: hidden variables, shape (members, parameters).
            near: hidden variables that all members are close to.
        """
        start = None if near is None else self.values(self.prior.x_of(near))
        values = self.values(self.prior.x_of(z))
        return simulate_members(self.model, values, len(z), self.outputs, self.policy, start)
