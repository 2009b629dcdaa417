"""The posterior density of a patient's parameters: prior, measurements, and the model in between.

Every free parameter has a latent variable z of its own that is standard normal before any measurement; the
parameter is a rising function of it that ends at the bounds. Samplers and filters work on z: no bounds, one
scale, and a parameter that the measurements say nothing about keeps z at N(0, 1).

Every measurement is normally distributed around the model's output, with the standard uncertainty of the
measurement, independent of the others. The potential is minus the logarithm of the posterior density of z, up
to a constant:

    U(z) = sum ((output(z) - measured) / uncertainty)^2 / 2 + z . z / 2

and infinite where the model has no steady beat: such parameters are excluded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.special import ndtr, ndtri

from eclsim.identification.objective import Box, execution_of
from eclsim.identification.scale import Scale
from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.model import AS_PUBLISHED, Model
from eclsim.orbit.steady import Batch, Values
from eclsim.outputs.steady_beat import steady_beat

PriorKind = Literal["log-uniform", "log-normal"]
DEVIATIONS_TO_BOUNDS = 2.0
"""Bounds of the log-normal prior are this many standard deviations from the start value (the wider side)."""
FARTHEST = 6.0
"""Largest |z| that a parameter is turned into: a share of 1e-9 of the prior lies beyond."""
SETTLED = OrbitOptions(tolerance=1e-5, error_tolerance=1e-4, newton_iterations=6)
"""Enough for a density: outputs differ from those of the exact orbit by 1e-4 of their uncertainty."""


@dataclass(frozen=True)
class Prior:
    """Independent priors of the coordinates of the parameters: the logarithms of most (see `scale`).

    Args:
        names: of the parameters.
        lower: coordinates of the lower bounds, shape (parameters,).
        upper: of the upper bounds.
        start: of the start values, the median of the log-normal kind before it is cut at the bounds.
        kind: "log-uniform", each coordinate between the bounds as likely as any other, or "log-normal".
    """

    names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    start: np.ndarray
    kind: PriorKind = "log-uniform"

    @classmethod
    def of(cls, box: Box, kind: PriorKind = "log-uniform") -> Prior:
        """Of free parameters with bounds."""
        return cls(box.names, box.lower, box.upper, box.clip(box.start), kind)

    @property
    def scale(self) -> Scale:
        """The coordinates."""
        return Scale.of(self.names)

    def values_of(self, z: np.ndarray) -> np.ndarray:
        """The parameters in their units, shape (..., parameters) as z."""
        return self.scale.values(self.x_of(z))

    def x_of(self, z: np.ndarray) -> np.ndarray:
        """Coordinates of the parameters, shape (..., parameters) as z."""
        share = ndtr(z)
        if self.kind == "log-uniform":
            return self.lower + (self.upper - self.lower) * share
        first, last = self._ends()
        inside = self.start + self._spread() * ndtri(first + (last - first) * share)
        return np.clip(inside, self.lower, self.upper)

    def slopes(self, z: np.ndarray) -> np.ndarray:
        """d coordinate / dz, shape (..., parameters)."""
        density = np.exp(-0.5 * np.asarray(z) ** 2) / np.sqrt(2.0 * np.pi)
        if self.kind == "log-uniform":
            return (self.upper - self.lower) * density
        first, last = self._ends()
        standard = (self.x_of(z) - self.start) / self._spread()
        return self._spread() * (last - first) * density / (np.exp(-0.5 * standard**2) / np.sqrt(2.0 * np.pi))

    def z_of(self, x: np.ndarray) -> np.ndarray:
        """Latent variables of coordinates; a parameter at a bound gives -`FARTHEST` or `FARTHEST`."""
        if self.kind == "log-uniform":
            share = (np.asarray(x) - self.lower) / (self.upper - self.lower)
        else:
            first, last = self._ends()
            share = (ndtr((np.asarray(x) - self.start) / self._spread()) - first) / (last - first)
        return np.clip(ndtri(np.clip(share, 0.0, 1.0)), -FARTHEST, FARTHEST)

    def _spread(self) -> np.ndarray:
        return np.maximum(self.upper - self.start, self.start - self.lower) / DEVIATIONS_TO_BOUNDS

    def _ends(self) -> tuple[np.ndarray, np.ndarray]:
        spread = self._spread()
        return ndtr((self.lower - self.start) / spread), ndtr((self.upper - self.start) / spread)


@dataclass(frozen=True)
class PosteriorDensity:
    """Density of the latent variables of a patient's free parameters.

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

    def values(self, x: np.ndarray) -> dict[str, float | np.ndarray]:
        """Parameter values of members with coordinates (members, parameters), or of one (parameters,)."""
        free = np.moveaxis(self.prior.scale.values(x), -1, 0)
        return {**self.model.values, **dict(zip(self.prior.names, free, strict=True))}

    def numbers(self, z: np.ndarray) -> dict[str, float]:
        """Parameter values at one point."""
        return {name: float(value) for name, value in self.values(self.prior.x_of(z)).items()}

    def potential(self, z: np.ndarray, outputs: np.ndarray, temper: float = 1.0) -> np.ndarray:
        """U of members, shape (members,), from their outputs (members, outputs).

        Args:
            z: latent variables, shape (members, parameters).
            outputs: of the model there.
            temper: how much the measurements count: 1 for the posterior, 0 for the prior.
        """
        misfit = np.sum(((outputs - self.target) / self.scale) ** 2, axis=-1)
        likelihood = np.where(np.isfinite(misfit), 0.5 * temper * misfit, np.inf)
        return likelihood + 0.5 * np.sum(np.square(z), axis=-1)

    def simulate(self, z: np.ndarray, centre: np.ndarray | None = None) -> np.ndarray:
        """Outputs of many members side by side, shape (members, outputs); NaN without a steady beat.

        Args:
            z: latent variables, shape (members, parameters).
            centre: latent variables that all members are close to.
        """
        start = None if centre is None else self.numbers(centre)
        values = self.values(self.prior.x_of(z))
        return simulate_members(self.model, values, len(z), self.outputs, self.policy, start)


def simulate_members(
    model: Model,
    values: Values,
    count: int,
    outputs: tuple[str, ...],
    policy: str = AS_PUBLISHED,
    start: Mapping[str, float] | None = None,
) -> np.ndarray:
    """Outputs of members that share a circuit, shape (members, outputs); NaN where no beat is determined.

    Args:
        model: gives the circuit.
        values: a number or an array (members,) for every parameter.
        count: number of members.
        outputs: names of the registry.
        policy: blood volume policy.
        start: values that all members are close to, at whose beat searches begin.
    """
    batch = Batch(model.circuit, values, count, policy)
    beat = steady_beat(batch, outputs, options=SETTLED, start=start, execution=execution_of(count))
    return beat.determined_only().values.T
