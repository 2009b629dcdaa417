"""What a posterior says of outputs: at the settings of the measurements, and at others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from eclsim.identification.batch_outputs import simulate_members
from eclsim.identification.importance import weighted_quantile
from eclsim.orbit.model import AS_PUBLISHED, Model

LARGEST_LOST_SHARE = 0.02
"""Of draws without a steady beat: beyond, the intervals speak of too particular a part of the posterior."""
CENTRAL_90 = np.array([0.05, 0.5, 0.95])


@dataclass(frozen=True)
class Predicted:
    """Outputs of draws of a posterior at some settings.

    Args:
        settings: what differs from the measured settings, as written; empty for those themselves.
        outputs: names.
        values: shape (draws, outputs); NaN where a draw has no steady beat.
        intervals: 5 %, 50 % and 95 % quantile of each output, shape (outputs, 3).
        lost: share of the draws without a steady beat; the intervals speak of the others.
    """

    settings: str
    outputs: tuple[str, ...]
    values: np.ndarray
    intervals: np.ndarray
    lost: float

    @property
    def lost_draws(self) -> int:
        """Draws without a steady beat."""
        return round(self.lost * len(self.values))

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the intervals are not to be trusted, whatever the draws; empty where they are."""
        if self.lost <= LARGEST_LOST_SHARE:
            return ()
        return (
            f"{self.lost_draws} of {len(self.values)} draws have no steady heartbeat at these settings (at "
            f"most {LARGEST_LOST_SHARE:.0%}): the intervals speak of the others alone; choose settings "
            "closer to the measured ones",
        )


def predict(
    model: Model,
    parameters: Mapping[str, np.ndarray],
    outputs: tuple[str, ...],
    settings: str = "",
    policy: str = AS_PUBLISHED,
) -> Predicted:
    """Simulate draws of the parameters with a model's other values.

    Args:
        model: circuit and values, with the settings asked for.
        parameters: draws of each free parameter, in its unit, shape (draws,).
        outputs: names of the registry.
        settings: what to call it.
        policy: blood volume policy.
    """
    count = len(next(iter(parameters.values())))
    middle = {n: float(np.median(v)) for n, v in parameters.items()}
    values = simulate_members(
        model, {**model.values, **parameters}, count, outputs, policy, {**model.values, **middle}
    )
    found = np.isfinite(values).all(axis=1)
    weights = np.ones(int(found.sum()))
    intervals = np.full((len(outputs), 3), np.nan)
    if found.any():
        each = [weighted_quantile(values[found, k], weights, CENTRAL_90) for k in range(len(outputs))]
        intervals = np.stack(each)
    return Predicted(settings, outputs, values, intervals, float(1.0 - found.mean()))
