"""Fitting the data points of one patient with some parameters in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from eclsim.identification.least_squares import Ending
from eclsim.identification.multi_start import FitStatus, Joint, Optimum
from eclsim.identification.objective import Box, Objective
from eclsim.identification.precision import covariance, prior_deviations
from eclsim.identification.shared import JointObjective, fit_together
from eclsim.sensitivity.identifiability import ScaledSensitivities
from eclsim.sensitivity.proposal import propose

if TYPE_CHECKING:
    from eclsim.identification.settings import FitSettings


def together(
    objective: Objective,
    box: Box,
    alone: Sequence[Optimum],
    errors: Sequence[np.ndarray],
    settings: FitSettings,
) -> list[Optimum]:
    """The optima of points that were fitted alone, fitted again with common parameters.

    Args:
        objective: the points of one patient.
        box: bounds of the parameters of one point.
        alone: optimum of each point.
        errors: standard uncertainties of the measurements of each point.
        settings: names what is shared.
    """
    if any(o.status is FitStatus.NO_STEADY_BEAT for o in alone):
        return list(alone)
    common = [box.names.index(n) for n in settings.shared if n in box.names]
    joint, found = fit_together(objective, box, common, np.stack([o.x for o in alone]))
    height = len(objective.outputs)
    space = joint.box(box)
    scaled = _scaled(objective, joint, found.jacobians[0], errors, space)
    spread = covariance(scaled.matrix, prior_deviations(space.lower, space.upper))
    excluded = propose(scaled).excluded
    status = FitStatus.FITTED if found.endings[0] == Ending.SETTLED else FitStatus.NOT_SETTLED
    optima = []
    for k, before in enumerate(alone):
        rows, places = slice(k * height, (k + 1) * height), joint.places[k]
        outputs = found.outputs[0, rows]
        cost = float(np.sum(((outputs - objective.measured[k]) * objective.weights[k]) ** 2))
        reasons = {
            name: excluded[space.names[place]]
            for name, place in zip(box.names, places, strict=True)
            if space.names[place] in excluded
        }
        optima.append(
            replace(
                before, x=found.x[0, places], outputs=outputs, cost=cost,
                jacobian=found.jacobians[0, rows][:, places], status=status,
                starts=replace(before.starts, agreeing=np.zeros(len(before.starts.agreeing), dtype=bool)),
                joint=Joint(spread[np.ix_(places, places)], reasons),
            )
        )  # fmt: skip
    return optima


def _scaled(
    objective: Objective,
    joint: JointObjective,
    jacobian: np.ndarray,
    errors: Sequence[np.ndarray],
    space: Box,
) -> ScaledSensitivities:
    """Sensitivities of everything that was measured of the patient, in standard uncertainties."""
    rows, names = [], []
    height = len(objective.outputs)
    for k, (target, own) in enumerate(zip(objective.targets, errors, strict=True)):
        for name, error in zip(target.measured, own, strict=True):
            rows.append(jacobian[k * height + objective.outputs.index(name)] / error)
            names.append(f"{name} of point {k + 1}")
    return ScaledSensitivities(tuple(names), space.names, np.array(rows))
