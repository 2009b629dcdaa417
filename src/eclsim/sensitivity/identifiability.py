"""Identifiability of a case: its measurements, their uncertainties, exact derivatives of its steady beat."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.orbit.model import CaseSource, VolumePolicy, as_case, model_of
from eclsim.reporting.text_table import text_table
from eclsim.sensitivity.collinearity import (
    FisherInformation,
    Proposal,
    ScaledSensitivities,
    SubsetIndices,
    all_subsets,
    fisher_information,
    propose,
)
from eclsim.sensitivity.inputs import CARDIOVASCULAR, OUTPUTS, InputError, unknown_names
from eclsim.sensitivity.uncertainties import Uncertainty, standard_uncertainties, uncertainties_of
from eclsim.simulation.target_flow import with_speed

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.cases.case import Case
    from eclsim.orbit.model import Model

FAR_OFF = 2.0
"""Standard uncertainties."""


@dataclass(frozen=True)
class Identifiability:
    """What a set of measurements says about a set of parameters.

    Args:
        name: of the case.
        simulated: outputs of the model at the case's parameters.
        measured: measured values; empty where the case has none.
        uncertainties: standard uncertainty of each measurement, in its unit.
        scaled: scaled sensitivities.
        subsets: collinearity indices of all sets, by size.
        fisher: Fisher information.
        proposal: a set to fit.
    """

    name: str
    simulated: dict[str, float]
    measured: dict[str, float]
    uncertainties: dict[str, float]
    scaled: ScaledSensitivities
    subsets: list[SubsetIndices]
    fisher: FisherInformation
    proposal: Proposal

    @property
    def far_off(self) -> dict[str, float]:
        """Measurements that the model misses by more than two uncertainties, and by how many of them.

        The analysis is local: it then speaks of another patient than the one that was measured.
        """
        off = {n: (self.simulated[n] - value) / self.uncertainties[n] for n, value in self.measured.items()}
        return {n: d for n, d in off.items() if abs(d) > FAR_OFF}

    @property
    def dataset(self) -> xr.Dataset:
        """Scaled sensitivities, effects, angles between effects and Fisher information, labelled."""
        import xarray as xr

        names = list(self.scaled.parameters)
        pair = ("parameter", "other_parameter")
        return xr.Dataset(
            {
                "scaled_sensitivity": (("output", "parameter"), self.scaled.matrix),
                "effect": ("parameter", self.scaled.effect),
                "orthogonality": (pair, self.scaled.orthogonality),
                "fisher_information": (pair, self.fisher.matrix),
                "simulated": ("output", list(self.simulated.values())),
                "uncertainty": ("output", list(self.uncertainties.values())),
                "proposed": ("parameter", [name in self.proposal.chosen for name in names]),
            },
            {"output": list(self.scaled.outputs), "parameter": names, "other_parameter": names},
        )

    def as_object(self) -> dict[str, Any]:
        """As plain data for JSON."""
        s, names = self.scaled, self.scaled.parameters
        rows = (dict(zip(names, row.tolist(), strict=True)) for row in s.matrix)
        vectors = (dict(zip(names, column.tolist(), strict=True)) for column in self.fisher.eigenvectors.T)
        angles = (dict(zip(names, row.tolist(), strict=True)) for row in s.orthogonality)
        return {
            "id": self.name,
            "status": "converged",
            "simulated": self.simulated,
            "measured": self.measured,
            "uncertainties": self.uncertainties,
            "scaled_sensitivity": dict(zip(s.outputs, rows, strict=True)),
            "effect": dict(zip(names, s.effect.tolist(), strict=True)),
            "orthogonality": dict(zip(names, angles, strict=True)),
            "collinearity": [
                {
                    "size": c.size, "sets": c.count, "best": list(c.best), "smallest": c.smallest,
                    "quantiles_5_50_95": list(c.quantiles), "below_limit": c.below_limit,
                }
                for c in self.subsets
            ],
            "fisher_eigenvalues": self.fisher.eigenvalues.tolist(),
            "fisher_eigenvectors": list(vectors),
            "proposed": list(self.proposal.chosen),
            "proposed_collinearity": self.proposal.collinearity,
            "relative_errors": self.proposal.relative_errors,
            "excluded": self.proposal.excluded,
        }  # fmt: skip


def identifiability(
    case: CaseSource,
    *,
    parameters: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    uncertainties: Mapping[str, Uncertainty] | None = None,
    limit: float = 10.0,
    threshold: float = 1.0,
    volume_policy: VolumePolicy | None = None,
) -> Identifiability:
    """Which parameters the measurements of a case can tell apart.

    Args:
        case: path of a case file, what `read_case` returned, or a case; best with fitted parameters.
            Uncertainties in percent are those of its measurements, else of the model's own outputs.
        parameters: in question; left out, the paper's 24.
        outputs: what is measured; left out, the case's measurements, or all seven that it has.
        uncertainties: standard uncertainties that differ from the defaults.
        limit: largest collinearity index of a set that can be told apart.
        threshold: smallest effect that counts, in uncertainties for a change of 100 %.
        volume_policy: blood volume policy; left out, the case's.

    Raises:
        InputError: names that the case does not have.
        NoDerivativesError: the case has no steady beat, or none with derivatives: nothing can be ranked.
    """
    from eclsim.outputs.results import derivatives

    case, _ = with_speed(as_case(case), volume_policy)
    model = model_of(case)
    names = tuple(dict.fromkeys(CARDIOVASCULAR if parameters is None else parameters))
    measured = _measured(case) if outputs is None else tuple(dict.fromkeys(outputs))
    _check_names(names, measured, model)
    chosen = uncertainties_of(measured, uncertainties or {})
    slopes = derivatives(model, measured, names, volume_policy)
    simulated = dict(zip(measured, np.asarray(slopes["value"]).tolist(), strict=True))
    taken = {o: v for o in measured if (v := getattr(case.measurements, o, None)) is not None}
    errors = standard_uncertainties({**simulated, **taken}, chosen)
    scaled = ScaledSensitivities.of(
        measured, names, slopes.values, np.asarray(slopes["parameter_value"]), np.array(list(errors.values()))
    )
    return Identifiability(
        name=case.patient.id,
        simulated=simulated,
        measured=taken,
        uncertainties=errors,
        scaled=scaled,
        subsets=all_subsets(scaled, limit),
        fisher=fisher_information(scaled),
        proposal=propose(scaled, limit, threshold),
    )


def _measured(case: Case) -> tuple[str, ...]:
    """Outputs that the case has measurements of, else all that it has."""
    given = case.measurements
    named = () if given is None else tuple(o for o in OUTPUTS if getattr(given, o) is not None)
    return named or tuple(o for o in OUTPUTS if o != "PF" or case.ecmo is not None)


def _check_names(parameters: Sequence[str], outputs: Sequence[str], model: Model) -> None:
    from eclsim.outputs.signals import output_names, parameters_read

    wrong = [
        f"no {kind} given" for kind, names in (("parameter", parameters), ("output", outputs)) if not names
    ]
    wrong += unknown_names(parameters, parameters_read(model.circuit), "parameter of this case")
    wrong += unknown_names(outputs, output_names(model.circuit), "output of this case")
    if wrong:
        raise InputError(wrong)


# --- in the terminal --------------------------------------------------------------------------------


def identifiability_text(result: Identifiability, limit: float) -> str:
    """Measurements, collinearity of all sets, the set proposed, and why others are left out."""
    p = result.proposal
    effect = dict(zip(result.scaled.parameters, result.scaled.effect, strict=True))
    chosen = [(n, f"{effect[n]:.3g}", f"{100 * p.relative_errors[n]:.3g} %") for n in p.chosen]
    return "\n".join((
        "Measurements and their standard uncertainties (a percentage is one of the measured value)",
        _measurements(result),
        *_far_off(result),
        "\nCollinearity index of all sets of a size (above the limit: cannot be told apart)",
        _subsets(result, limit),
        f"\nProposed to fit together (collinearity index {p.collinearity:.2f})",
        text_table(("parameter", "effect", "least standard error"), chosen, numeric=(1, 2)),
        "\nLeft out",
        text_table(("parameter", "reason"), list(p.excluded.items())),
    ))  # fmt: skip


def _measurements(result: Identifiability) -> str:
    measured = {o: f"{value:.4g}" for o, value in result.measured.items()}
    rows = [
        (o, measured.get(o, "-"), f"{result.simulated[o]:.4g}", f"±{u:.3g}")
        for o, u in result.uncertainties.items()
    ]
    return text_table(("output", "measured", "simulated", "uncertainty"), rows, numeric=(1, 2, 3))


def _far_off(result: Identifiability) -> list[str]:
    if not result.far_off:
        return []
    off = ", ".join(f"{o} by {abs(d):.0f}" for o, d in result.far_off.items())
    return [
        f"The model misses these measurements, in standard uncertainties: {off}. What follows holds near the "
        "model's values: fit the case first (eclsim identify) and analyse the fitted one."
    ]


def _subsets(result: Identifiability, limit: float) -> str:
    rows = []
    for s in result.subsets:
        counts = (str(s.size), str(s.count), str(s.below_limit))
        rows.append((*counts, f"{s.smallest:.2f}", f"{s.quantiles[1]:.3g}", " ".join(s.best)))
    head = ("size", "sets", f"up to {limit:g}", "smallest", "median", "set with the smallest")
    return text_table(head, rows, numeric=range(5))
