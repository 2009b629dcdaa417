"""Identifiability of a case: which parameters its measurements can distinguish, and a set to fit.

Scaled sensitivities and the collinearity index: Brun, Reichert and Kuensch 2001, doi 10.1029/2000WR900350.
Orthogonality: Yao et al. 2003, doi 10.1081/PRE-120024426. The Fisher information is that of independent
normal errors with the given standard uncertainties; its inverse bounds the variance of any unbiased estimate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from eclsim.arguments import number_of
from eclsim.cases.quantities import quantity
from eclsim.files import ORIGIN
from eclsim.inputs.mistakes import as_names
from eclsim.orbit.model import (
    CASE,
    CaseSource,
    UnknownValueError,
    VolumePolicy,
    as_case,
    case_json,
    model_of,
)
from eclsim.outputs.results import beat_warnings, derivatives
from eclsim.outputs.signals import output_names, parameters_read
from eclsim.outputs.uncertainty import DEFAULTS, Uncertainty, standard_uncertainties
from eclsim.reporting.numbers import number, significant, text_table
from eclsim.sensitivity.inputs import (
    CARDIOVASCULAR,
    OUTPUTS,
    InputError,
    missing_outputs,
    uncertainties_of,
    unknown_names,
)
from eclsim.simulation.target_flow import with_speed

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.orbit.model import Model

_CHUNK = 50_000
_SINGULAR = 1e-12


def change(name: str) -> tuple[float, str]:
    """Reference change of a parameter with its unit; 0 means a change of 100 %."""
    parameter = quantity(name)
    return (0.0, "") if parameter is None else (parameter.linear_unit, parameter.unit.removeprefix("1"))


def _in_words(name: str, share: float) -> str:
    """A share of the reference change as text: in percent, or in the unit of the parameter."""
    whole, unit = change(name)
    return f"{significant(share * whole, 3)} {unit}".strip() if whole else f"{significant(100 * share, 3)} %"


@dataclass(frozen=True)
class ScaledSensitivities:
    """Change of measurements, in standard uncertainties, if a parameter changes by 100 %, to first order.

    For parameters that may be zero or negative, a relative change is not meaningful. Their change is fixed:
    the unit of their linear scale (see `Parameter.linear_unit`), as in a fit.

    Args:
        outputs: names of the measurements.
        parameters: names of the parameters.
        matrix: scaled sensitivities, shape (outputs, parameters).
    """

    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    matrix: np.ndarray

    @classmethod
    def of(
        cls,
        outputs: Sequence[str],
        parameters: Sequence[str],
        derivatives: np.ndarray,
        parameter_values: np.ndarray,
        uncertainties: np.ndarray,
    ) -> ScaledSensitivities:
        """Compute from derivatives (outputs, parameters) in the units of both."""
        changes = [change(name)[0] or value for name, value in zip(parameters, parameter_values, strict=True)]
        matrix = np.asarray(derivatives) * changes / np.asarray(uncertainties)[:, None]
        return cls(tuple(outputs), tuple(parameters), matrix)

    @property
    def effect(self) -> np.ndarray:
        """Norm of each column: effect of a parameter on all measurements together, shape (parameters,)."""
        return np.linalg.norm(self.matrix, axis=0)

    @property
    def directions(self) -> np.ndarray:
        """Columns normalised to length one; zero where a parameter has no effect."""
        effect = self.effect
        return np.where(effect > 0, self.matrix / np.where(effect > 0, effect, 1.0), 0.0)

    @property
    def cosines(self) -> np.ndarray:
        """Cosine of the angle between the effects of two parameters, shape (parameters, parameters)."""
        return np.clip(self.directions.T @ self.directions, -1.0, 1.0)

    @property
    def orthogonality(self) -> np.ndarray:
        """Sine of the angle between the effects of two parameters: 1 if orthogonal, 0 if equal."""
        return np.sqrt(np.maximum(1.0 - self.cosines**2, 0.0))

    def collinearity(self, chosen: Sequence[str]) -> float:
        """Collinearity index of a set: how well a change of one parameter is compensated by the others."""
        if len(chosen) > len(self.outputs):
            return float("inf")
        columns = self.directions[:, [self.parameters.index(p) for p in chosen]]
        return float(_collinearity(columns.T @ columns))

    def closest(self, chosen: Sequence[str], name: str) -> tuple[float, list[str]]:
        """Share of a parameter's effect that others of a set cannot reproduce, and the main ones of these."""
        others = [p for p in chosen if p != name]
        columns = self.matrix[:, [self.parameters.index(p) for p in others]]
        target = self.matrix[:, self.parameters.index(name)]
        weights, *_ = np.linalg.lstsq(columns, target, rcond=None)
        left = np.linalg.norm(target - columns @ weights) / max(float(np.linalg.norm(target)), 1e-300)
        share = np.abs(weights) * np.linalg.norm(columns, axis=0)
        order = np.argsort(-share)
        return float(left), [others[k] for k in order if share[k] > 0.25 * share.max()][:3]


@dataclass(frozen=True)
class SubsetIndices:
    """Collinearity indices of all sets of one size.

    Args:
        size: number of parameters in a set.
        count: number of sets.
        best: parameters of the set with the smallest index.
        smallest: smallest index.
        quantiles: 5, 50 and 95 % quantiles of the indices; infinite where a set cannot be distinguished.
        below_limit: number of sets at or below the limit.
    """

    size: int
    count: int
    best: tuple[str, ...]
    smallest: float
    quantiles: tuple[float, float, float]
    below_limit: int


def all_subsets(scaled: ScaledSensitivities, limit: float) -> list[SubsetIndices]:
    """Compute the indices of all sets of every size, from pairs to the number of measurements.

    Larger sets have an infinite index, as there are fewer measurements than parameters.
    """
    products = scaled.directions.T @ scaled.directions
    names, sizes = scaled.parameters, []
    for size in range(2, min(len(scaled.outputs), len(names)) + 1):
        sets = np.array(list(combinations(range(len(names)), size)))
        chunks = [sets[k : k + _CHUNK] for k in range(0, len(sets), _CHUNK)]
        values = np.concatenate([_collinearity(products[c[:, :, None], c[:, None, :]]) for c in chunks])
        best = int(np.argmin(values))
        low, middle, high = np.quantile(values, (0.05, 0.5, 0.95), method="nearest").tolist()
        chosen = tuple(names[k] for k in sets[best])
        below = int((values <= limit).sum())
        sizes.append(SubsetIndices(size, len(sets), chosen, float(values[best]), (low, middle, high), below))
    return sizes


def _collinearity(products: np.ndarray) -> np.ndarray:
    """1 / sqrt(smallest eigenvalue) of the products of unit columns, shape (..., size, size)."""
    smallest = np.linalg.eigvalsh(products)[..., 0]
    singular = smallest <= _SINGULAR
    return np.where(singular, np.inf, 1.0 / np.sqrt(np.where(singular, 1.0, smallest)))


@dataclass(frozen=True)
class FisherInformation:
    """Information of the measurements about relative changes of the parameters.

    Args:
        matrix: Fisher information, shape (parameters, parameters).
        eigenvalues: eigenvalues, the largest first.
        eigenvectors: combinations of parameters as columns, the best determined first.
    """

    matrix: np.ndarray
    eigenvalues: np.ndarray
    eigenvectors: np.ndarray


def fisher_information(scaled: ScaledSensitivities) -> FisherInformation:
    """Fisher information and its eigenvectors, from the singular values of the scaled sensitivities."""
    _, singular, right = np.linalg.svd(scaled.matrix)
    values = np.zeros(len(scaled.parameters))
    values[: len(singular)] = singular**2
    signs = np.sign(right[np.arange(len(right)), np.abs(right).argmax(axis=1)])
    return FisherInformation(scaled.matrix.T @ scaled.matrix, values, (right * signs[:, None]).T)


def relative_errors(scaled: ScaledSensitivities, chosen: Sequence[str]) -> dict[str, float]:
    """Smallest relative standard error of each parameter if these are fitted together.

    The errors are relative to the value, or to the fixed change of a parameter (see `change`).
    """
    columns = scaled.matrix[:, [scaled.parameters.index(p) for p in chosen]]
    if len(chosen) > len(scaled.outputs) or np.linalg.matrix_rank(columns) < len(chosen):
        return dict.fromkeys(chosen, float("inf"))
    inverse = np.linalg.pinv(columns)
    return dict(zip(chosen, np.linalg.norm(inverse, axis=1).tolist(), strict=True))


@dataclass(frozen=True)
class Proposal:
    """A proposed set of parameters to fit.

    Args:
        chosen: parameters in the order of selection; each has the largest effect that the earlier ones lack.
        excluded: reason for each parameter left out.
        collinearity: collinearity index of the set.
        relative_errors: smallest standard error of each parameter if all are fitted together, relative to its
            value or to its `change`.
    """

    chosen: tuple[str, ...]
    excluded: dict[str, str]
    collinearity: float
    relative_errors: dict[str, float]


def propose(
    scaled: ScaledSensitivities, limit: float = 10.0, threshold: float = 1.0, first: Sequence[str] = ()
) -> Proposal:
    """Select one by one the parameter with the largest effect that the selected ones cannot reproduce.

    Args:
        scaled: scaled sensitivities.
        first: parameters that are selected before all others, as far as they can be distinguished.
        limit: largest collinearity index of the set (Brun et al. 2001 found sets above 10 to 15 not
            identifiable).
        threshold: smallest effect, in standard uncertainties for a change of 100 %.
    """
    effect = dict(zip(scaled.parameters, scaled.effect.tolist(), strict=True))
    weak = [p for p in scaled.parameters if effect[p] < threshold]
    chosen: list[str] = []
    left = [p for p in scaled.parameters if p not in weak]
    while left and len(chosen) < len(scaled.outputs):
        ranked = sorted(left, key=lambda p: (p not in first, -_own_effect(scaled, chosen, p)))
        best = next((p for p in ranked if _fits(scaled, [*chosen, p], limit, threshold)), None)
        if best is None:
            break
        chosen.append(best)
        left.remove(best)
    excluded = {p: _weak_reason(scaled, p, effect[p], threshold) for p in weak}
    excluded |= {p: _reason(scaled, chosen, p, limit, threshold) for p in left}
    ordered = {p: excluded[p] for p in sorted(excluded, key=lambda p: -effect[p])}
    gamma = scaled.collinearity(chosen) if chosen else float("nan")
    return Proposal(tuple(chosen), ordered, gamma, relative_errors(scaled, chosen))


def _own_effect(scaled: ScaledSensitivities, chosen: list[str], name: str) -> float:
    """Size of the effect of a parameter that no combination of the chosen ones can reproduce."""
    target = scaled.matrix[:, scaled.parameters.index(name)]
    if not chosen:
        return float(np.linalg.norm(target))
    return scaled.closest([*chosen, name], name)[0] * float(np.linalg.norm(target))


def _fits(scaled: ScaledSensitivities, chosen: list[str], limit: float, threshold: float) -> bool:
    return scaled.collinearity(chosen) <= limit and _own_effect(scaled, chosen[:-1], chosen[-1]) >= threshold


def _weak_reason(scaled: ScaledSensitivities, name: str, effect: float, threshold: float) -> str:
    column = np.abs(scaled.matrix[:, scaled.parameters.index(name)])
    most = scaled.outputs[int(column.argmax())]
    if effect == 0.0:
        return "no effect on any measurement"
    return (
        f"too little effect: a change of {_in_words(name, 1.0)} moves {most} most, by {column.max():.2g} of "
        f"its uncertainty (all together {effect:.2g}, needed {threshold:g})"
    )


def _reason(scaled: ScaledSensitivities, chosen: list[str], name: str, limit: float, threshold: float) -> str:
    left, others = scaled.closest([*chosen, name], name)
    like = " and ".join(others)
    if len(chosen) >= len(scaled.outputs):
        return (
            f"the set already has as many parameters as measurements ({len(chosen)}); its effect is like "
            f"that of {like}"
        )
    gamma = scaled.collinearity([*chosen, name])
    if gamma > limit:
        cosine = scaled.cosines[scaled.parameters.index(name), scaled.parameters.index(others[0])]
        index = number(gamma, digits=3, missing="infinite")
        return (
            f"cannot be told from {like}: collinearity index {index} with the set (limit {limit:g}), "
            f"cosine {cosine:+.3f} with {others[0]}"
        )
    remaining = left * float(np.linalg.norm(scaled.matrix[:, scaled.parameters.index(name)]))
    share = f"its own effect is {remaining:.2g} uncertainties (needed {threshold:g})"
    return f"nearly all of its effect could come from {like}: {share}"


# --- identifiability of a case ----------------------------------------------------------------------


LARGEST_DEVIATION = 2.0
"""Largest deviation of the model from a measurement, in standard uncertainties, without a warning."""


@dataclass(frozen=True)
class Identifiability:
    """Information of a set of measurements about a set of parameters.

    Args:
        name: name of the case.
        simulated: outputs of the model at the case's parameters.
        measured: measured values; empty where the case has none.
        uncertainties: standard uncertainty of each measurement, in its unit.
        scaled: scaled sensitivities.
        subsets: collinearity indices of all sets, by size.
        fisher: Fisher information.
        proposal: proposed set of parameters to fit.
        warnings: warnings about the case's beat, around which the analysis is local.
        case_json: the case, with the pump speed that its flow needs, for `Case.model_validate_json`.
    """

    name: str
    simulated: dict[str, float]
    measured: dict[str, float]
    uncertainties: dict[str, float]
    scaled: ScaledSensitivities
    subsets: list[SubsetIndices]
    fisher: FisherInformation
    proposal: Proposal
    warnings: tuple[str, ...] = ()
    case_json: str = ""

    def __repr__(self) -> str:
        proposed = ", ".join(self.proposal.chosen) or "none"
        return (
            f"<Identifiability {self.name}: of {len(self.scaled.parameters)} parameters, to fit: {proposed}>"
        )

    @property
    def far_off(self) -> dict[str, float]:
        """Deviations of the model from measurements, in standard uncertainties, where above two.

        The analysis is local: in this case it describes another patient than the one measured.
        """
        off = {n: (self.simulated[n] - value) / self.uncertainties[n] for n, value in self.measured.items()}
        return {n: d for n, d in off.items() if abs(d) > LARGEST_DEVIATION}

    @property
    def doubts(self) -> list[str]:
        """A warning if the model is far from the measurements, else empty."""
        if not self.far_off:
            return []
        off = ", ".join(f"{o} by {abs(d):.0f}" for o, d in self.far_off.items())
        return [
            f"The model misses these measurements, in standard uncertainties: {off}. What follows holds near "
            "the model's values: fit the case first (eclsim identify) and analyse the fitted one."
        ]

    @property
    def dataset(self) -> xr.Dataset:
        """Scaled sensitivities, effects, angles between effects and Fisher information, labelled."""
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
            {
                **ORIGIN,
                "id": self.name,
                "warnings": [*self.warnings, *self.doubts],
                **({CASE: self.case_json} if self.case_json else {}),
            },
        )

    def as_object(self) -> dict[str, Any]:
        """Plain data for JSON."""
        s, names = self.scaled, self.scaled.parameters
        rows = (dict(zip(names, row.tolist(), strict=True)) for row in s.matrix)
        vectors = (dict(zip(names, column.tolist(), strict=True)) for column in self.fisher.eigenvectors.T)
        angles = (dict(zip(names, row.tolist(), strict=True)) for row in s.orthogonality)
        return {
            "id": self.name,
            "status": "converged",
            "warnings": [*self.warnings, *self.doubts],
            "far_off": self.far_off,
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
            "changes_for_100_percent": {n: fixed for n in names if (fixed := change(n)[0])},
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
    """Analyse which parameters the measurements of a case can distinguish.

    Args:
        case: path of a case file, what `read_case` returned, or a case; best with fitted parameters.
            Uncertainties in percent are those of its measurements, else of the model's own outputs.
        parameters: parameters in question; None for the paper's 24.
        outputs: measured outputs; None for the case's measurements, or all seven that it has.
        uncertainties: standard uncertainties that differ from the defaults.
        limit: largest collinearity index of a set that can be distinguished.
        threshold: smallest effect that counts, in uncertainties for a change of 100 % (see
            `ScaledSensitivities`).
        volume_policy: blood volume policy; None takes that of the case.

    Raises:
        InputError: The case does not have these names, or the limit is below 1 or the threshold below 0.
        NoDerivativesError: The case has no steady beat, or one without derivatives.
    """
    limit, threshold = number_of("limit", limit), number_of("threshold", threshold)
    if not (1.0 <= limit < np.inf and 0.0 <= threshold < np.inf):
        raise InputError(
            [f"limit = {limit:g}, threshold = {threshold:g}: allowed: from 1, from 0, both finite"]
        )
    case, _ = with_speed(as_case(case), volume_policy)
    model = model_of(case)
    given = CARDIOVASCULAR if parameters is None else as_names(parameters, "parameters")
    asked = _measured(case, model) if outputs is None else as_names(outputs, "outputs")
    names, measured = tuple(dict.fromkeys(given)), tuple(dict.fromkeys(asked))
    _check_names(names, measured, model)
    chosen = uncertainties_of(measured, uncertainties or {})
    try:
        slopes = derivatives(model, measured, names, volume_policy)
    except UnknownValueError as error:
        raise InputError([str(error)]) from None
    simulated = dict(zip(measured, np.asarray(slopes["value"]).tolist(), strict=True))
    values = {o: v for o in measured if (v := getattr(case.measurements, o, None)) is not None}
    errors = standard_uncertainties({**simulated, **values}, chosen)
    scaled = ScaledSensitivities.of(
        measured, names, slopes.values, np.asarray(slopes["parameter_value"]), np.array(list(errors.values()))
    )
    return Identifiability(
        case.patient.id, simulated, values, errors, scaled, all_subsets(scaled, limit),
        fisher_information(scaled), propose(scaled, limit, threshold),
        beat_warnings(model, volume_policy, measured, case), case_json(case, volume_policy),
    )  # fmt: skip


def _measured(case: Case, model: Model) -> tuple[str, ...]:
    """Outputs that the case has measurements of, else all outputs that it has."""
    available = output_names(model.circuit)
    named = tuple(o for o in DEFAULTS if getattr(case.measurements, o, None) is not None and o in available)
    return named or tuple(o for o in OUTPUTS if o in available)


def _check_names(parameters: Sequence[str], outputs: Sequence[str], model: Model) -> None:
    wrong = [
        f"no {kind} given" for kind, names in (("parameter", parameters), ("output", outputs)) if not names
    ]
    wrong += unknown_names(parameters, parameters_read(model.circuit), "parameter of this case")
    wrong += missing_outputs(outputs, output_names(model.circuit))
    if wrong:
        raise InputError(wrong)


# --- terminal text ----------------------------------------------------------------------------------


def identifiability_text(result: Identifiability, limit: float) -> str:
    """Text of measurements, collinearity of all sets, the proposed set, and the reasons for exclusions."""
    p = result.proposal
    effect = dict(zip(result.scaled.parameters, result.scaled.effect, strict=True))
    chosen = [(n, f"{effect[n]:.3g}", _in_words(n, p.relative_errors[n])) for n in p.chosen]
    lines = [
        "Measurements and their standard uncertainties (a percentage is one of the measured value)",
        _measurements(result),
        *result.doubts,
    ]
    if result.subsets:
        head = "\nCollinearity index of all sets of a size (above the limit: cannot be told apart)"
        lines += [head, _subsets(result, limit)]
    if chosen:
        head = ("parameter", "effect", "least standard error")
        lines.append(f"\nProposed to fit together (collinearity index {p.collinearity:.2f})")
        lines.append(text_table(head, chosen, numeric=(1, 2)))
    else:
        lines.append("\nNone is proposed: these measurements determine none of the parameters")
    if p.excluded:
        lines += ["\nLeft out", text_table(("parameter", "reason"), list(p.excluded.items()))]
    return "\n".join(lines)


def _measurements(result: Identifiability) -> str:
    measured = {o: significant(value) for o, value in result.measured.items()}
    rows = [
        (o, measured.get(o, "-"), significant(result.simulated[o]), f"±{u:.3g}")
        for o, u in result.uncertainties.items()
    ]
    return text_table(("output", "measured", "simulated", "uncertainty"), rows, numeric=(1, 2, 3))


def _subsets(result: Identifiability, limit: float) -> str:
    rows = []
    for s in result.subsets:
        counts = (str(s.size), str(s.count), str(s.below_limit))
        rows.append((*counts, f"{s.smallest:.2f}", f"{s.quantiles[1]:.3g}", " ".join(s.best)))
    head = ("size", "sets", f"up to {limit:g}", "smallest", "median", "set with the smallest")
    return text_table(head, rows, numeric=range(5))
