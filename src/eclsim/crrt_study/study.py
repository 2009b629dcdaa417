"""The combined ECMO and CRRT study: all ways to connect the CRRT, over the range of pump speeds.

It applies section 3.3 of Thiel et al. 2025 to any patient on ECMO with a rotary pump, under either blood
volume policy, and compares RenOx, oxygenator and dialyzer in one housing, on the same beats.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from eclsim.cases.quantities import as_samples, check_samples
from eclsim.cases.sections import AS_PUBLISHED
from eclsim.crrt_study import beats as crrt_datasets
from eclsim.crrt_study.assumptions import assumptions_in_words
from eclsim.crrt_study.beats import split_differences, study_circuits, summarise, unsettled
from eclsim.crrt_study.limits import beat_warnings, largest_flows, uncertainty
from eclsim.crrt_study.ranking import rank
from eclsim.crrt_study.renox import in_one_housing, without_renox
from eclsim.crrt_study.rule import DEFAULT_RULE, Rule, check_quantities, read_rule
from eclsim.crrt_study.schemes import (
    BOTH,
    NINE,
    PUBLISHED,
    Scheme,
    SpeedError,
    case_speed,
    check_speeds,
    crrt_flow,
    default_speeds,
    in_patient,
    parse_speeds,
    policies_of,
    select_schemes,
)
from eclsim.files import ORIGIN
from eclsim.orbit.model import CASE, CaseSource, as_case, case_json
from eclsim.outputs.alarms import assumptions
from eclsim.outputs.signals import parameters_read
from eclsim.simulation.target_flow import with_speed

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from eclsim.cases.case import Case
    from eclsim.crrt_study.beats import MissingBeats, StudyCircuits
    from eclsim.crrt_study.ranking import Ranked
    from eclsim.files import Json
    from eclsim.outputs.steady_beat import SteadyBeat


@dataclass(frozen=True)
class CrrtStudy:
    """Results of the CRRT study.

    Args:
        case: case that was studied.
        schemes: schemes that are compared.
        case_speed: pump speed of the case, one of the speeds [rpm].
        crrt_flow_ml_min: blood flow of the CRRT [mL/min].
        means: cycle means and outputs over `policy`, `scheme` and `speed`; NaN if the beat was not found,
            with the reason in `status`.
        without_crrt: means and outputs of the patient on ECMO alone, over `policy` and `speed`.
        waveforms: waveforms at the case's speed over `policy`, `scheme` and `phase`.
        summary: median and variation over the schemes, by `policy` and `speed`.
        limits: limits that each scheme keeps, over `policy`, `scheme` and `limit`.
        uptake: differences at the case's speed, split into effects of blood taken up and of flow; None unless
            the published policy was studied.
        ranking: schemes from best to worst, by policy.
        uncertainty: probabilities that each scheme keeps its limits; None unless samples were given.
        rule: rule by which schemes are ranked.
        renox: oxygenator and dialyzer in one housing on the beats without CRRT, over `policy` and `speed`;
            None if the case has no fluids for it.
        assumed: sentences on values without a source that numbers of the study depend on.
        warnings: warnings about the beats at the case's speed under the first policy.
    """

    case: Case
    schemes: tuple[Scheme, ...]
    case_speed: float
    crrt_flow_ml_min: float
    means: xr.Dataset
    without_crrt: xr.Dataset
    waveforms: xr.Dataset
    summary: xr.Dataset
    limits: xr.Dataset
    uptake: xr.Dataset | None
    ranking: dict[str, tuple[Ranked, ...]]
    uncertainty: xr.Dataset | None = None
    rule: Rule = DEFAULT_RULE
    renox: xr.Dataset | None = None
    assumed: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for result in vars(self).values():
            if isinstance(result, xr.Dataset):
                result.attrs |= ORIGIN

    def __repr__(self) -> str:
        orders = (f"{policy}: {' '.join(r.letter for r in rank)}" for policy, rank in self.ranking.items())
        return f"<CrrtStudy {self.case.patient.id}: schemes from the first {', '.join(orders)}>"

    @property
    def policies(self) -> tuple[str, ...]:
        """Blood volume policies that were studied."""
        return tuple(str(policy) for policy in self.means["policy"].values)

    @property
    def dataset(self) -> xr.Dataset:
        """Cycle means and outputs over `policy`, `scheme` and `speed`, with what they depend on.

        These are `means` and, over `policy` and `scheme`, `rank` (1 is best; NaN with the reason in
        `why_no_rank`). The attribute `case` is the case as JSON text, for `Case.model_validate_json`, and
        `rule` the rule of ranking as JSON text, for `crrt_study(rule=json.loads(...))`.
        """
        order = self.means["scheme"].values.tolist()
        by_letter = [{ranked.letter: ranked for ranked in self.ranking[policy]} for policy in self.policies]
        ranks = [[np.nan if (rank := by[s].rank) is None else rank for s in order] for by in by_letter]
        why = [[by[s].why_no_rank for s in order] for by in by_letter]
        about = {"units": "1", "long_name": "rank among the schemes, 1 is best"}
        dims = ("policy", "scheme")
        return self.means.assign(rank=(dims, ranks, about), why_no_rank=(dims, why)).assign_attrs({
            "id": self.case.patient.id, CASE: case_json(self.case), "converged": int(self.converged),
            "case_speed_rpm": self.case_speed, "crrt_flow_ml_min": self.crrt_flow_ml_min,
            "rule": json.dumps(self.rule.as_object()),
            "rule_in_words": [criterion.sentence for criterion in self.rule.criteria],
            "assumed": assumptions_in_words(self), "warnings": list(self.warnings),
        })  # fmt: skip

    def as_object(self) -> dict[str, Json]:
        """Plain data for JSON, as written by `eclsim crrt-study --json`."""
        from eclsim.crrt_study.files import study_object

        return study_object(self)

    @property
    def converged(self) -> bool:
        """Whether every steady beat was found, including those of the samples."""
        return not self.unsettled and not self.samples_without_a_beat

    @property
    def unsettled(self) -> tuple[MissingBeats, ...]:
        """Beats that were not found, by policy, scheme and reason."""
        return unsettled(self)

    @property
    def samples_without_a_beat(self) -> dict[str, int]:
        """Number of samples of the patient's parameters without a steady beat, for schemes that have any."""
        if (found := self.uncertainty) is None:
            return {}
        counts = np.rint((1.0 - found["settled"].values) * found.attrs["samples"]).astype(int).tolist()
        return {k: n for k, n in zip(found["scheme"].values.tolist(), counts, strict=True) if n}


def crrt_study(
    case: CaseSource,
    *,
    schemes: str | Sequence[str] = NINE,
    speeds: str | Sequence[float] | None = None,
    crrt_flow_ml_min: float | None = None,
    volume_policy: str | None = None,
    scheme_h: str = PUBLISHED,
    samples: Mapping[str, Sequence[float]] | None = None,
    rule: str | Path | Mapping[str, object] | Rule | None = None,
    progress: Callable[[object], None] = lambda _: None,
) -> CrrtStudy:
    """Study the connection of CRRT lines to an ECMO circuit: simulate, compare with limits, and rank schemes.

    Args:
        case: case or its file, with an ECMO circuit and a rotary pump; of its CRRT section, the connection is
            replaced by the schemes. If a case gives a pump flow, the speed is solved for under the first
            policy and then held.
        schemes: letters, groups and pairs, see `select_schemes`.
        speeds: pump speeds [rpm], see `parse_speeds`; None for the usual range of the case's pump. The case's
            own speed is added.
        crrt_flow_ml_min: blood flow of the CRRT [mL/min]; None for the case's own, else 200 mL/min.
        volume_policy: "as_published", "patient_held" or "both"; None for that of the case, else both.
        scheme_h: "published" or "figure", see `SCHEME_H`.
        samples: values by parameter, one per sample of the patient's posterior; the limits are then checked
            for each sample, at the case's speed and under the first policy.
        rule: rule of ranking of a centre or its file, see `eclsim.crrt_study.rule`; None for the default.
        progress: called with a description of the current step.

    Raises:
        CaseError: The file cannot be read, or samples have parameters that the study does not use, different
            lengths or values out of range.
        FlowNotReachedError: No speed gives the pump flow of the case.
        RuleError: The rule cannot be read, or uses a quantity that is not computed.
        StudyError: The case has no ECMO circuit with a rotary pump, a speed is far above its range, or the
            policy is unknown.
        SchemeError: A scheme cannot be read.
        SpeedError: A speed cannot be read or is not above 0.
    """
    inputs = _checked_inputs(
        as_case(case),
        select_schemes(schemes, scheme_h),
        volume_policy=volume_policy,
        rule=rule,
        speeds=speeds,
        crrt_flow_ml_min=crrt_flow_ml_min,
        samples=samples,
    )
    runs, without_crrt = _runs(inputs, progress)
    uptake = _uptake(inputs, runs, progress)
    doubt = None
    if samples:
        progress("samples of the patient's parameters")
        own = inputs.own_speed
        doubt = uncertainty(inputs.circuits, own, inputs.policies[0], samples, inputs.rule.limits)
    progress("limits and ranking")
    means = crrt_datasets.means(inputs.circuits, runs, without_crrt, inputs.policies, inputs.speeds)
    limits = largest_flows(means, inputs.own_speed, inputs.rule.limits)
    renox = in_one_housing(inputs.case, inputs.policies, inputs.speeds)
    assumed = _assumed(inputs.circuits, means, renox)
    about = beat_warnings(inputs.circuits, runs[0], inputs.at_own_speed.tolist(), without_crrt[0], assumed)
    return CrrtStudy(
        case=inputs.case,
        schemes=inputs.schemes,
        case_speed=inputs.own_speed,
        crrt_flow_ml_min=inputs.crrt_flow_ml_min,
        means=means,
        without_crrt=crrt_datasets.without(without_crrt, inputs.policies, inputs.speeds),
        waveforms=crrt_datasets.waveforms(inputs.circuits, runs, inputs.policies),
        summary=summarise(means),
        limits=limits,
        uptake=uptake,
        ranking=_ranking(inputs, means, limits),
        uncertainty=doubt,
        rule=inputs.rule,
        renox=renox,
        assumed=assumed,
        warnings=(*inputs.case.doubts, *about),
    )


@dataclass(frozen=True)
class _Inputs:
    """Checked inputs of a study.

    Args:
        case: case with a pump speed.
        schemes: schemes that are compared.
        policies: blood volume policies.
        rule: rule by which schemes are ranked.
        own_speed: pump speed of the case [rpm].
        speeds: all pump speeds in ascending order, among them that of the case, shape (speeds,) [rpm].
        crrt_flow_ml_min: blood flow of the CRRT [mL/min].
        circuits: circuits with and without CRRT.
    """

    case: Case
    schemes: tuple[Scheme, ...]
    policies: tuple[str, ...]
    rule: Rule
    own_speed: float
    speeds: np.ndarray
    crrt_flow_ml_min: float
    circuits: StudyCircuits

    @property
    def at_own_speed(self) -> np.ndarray:
        """Indices of the members of a run at the case's speed, one per scheme."""
        own = int(np.flatnonzero(self.speeds == self.own_speed)[0])
        return np.arange(len(self.schemes)) * len(self.speeds) + own


def _checked_inputs(
    case: Case,
    schemes: Sequence[Scheme],
    *,
    volume_policy: str | None,
    rule: str | Path | Mapping[str, object] | Rule | None,
    speeds: str | Sequence[float] | None,
    crrt_flow_ml_min: float | None,
    samples: Mapping[str, Sequence[float]] | None,
) -> _Inputs:
    """Check the arguments of `crrt_study`, which has the same errors, and return the inputs."""
    chosen = in_patient(case, schemes)
    policies = policies_of(volume_policy or case.blood_volume_policy or BOTH)
    case = with_speed(case, policies[0])[0]
    judged_by = read_rule(rule)
    own_speed = case_speed(case)
    asked = default_speeds(case) if speeds is None else _speeds(speeds)
    rpm = np.unique([*asked, own_speed]).astype(float)
    check_speeds(case, rpm.tolist())
    flow = crrt_flow(case, crrt_flow_ml_min)
    circuits = study_circuits(without_renox(case), chosen, flow)
    check_quantities(judged_by, crrt_datasets.quantities(circuits))
    if samples is not None:
        check_samples(as_samples(samples), (*parameters_read(circuits.circuit), "total_blood_volume_ml"))
    return _Inputs(case, chosen, policies, judged_by, own_speed, rpm, flow, circuits)


def _speeds(given: str | ArrayLike) -> tuple[float, ...]:
    """Return speeds in ascending order, without repetition, from a text as in `parse_speeds` or a list [rpm].

    Raises:
        SpeedError: A part is no speed, or the list is a table.
    """
    if isinstance(given, str):
        return parse_speeds(given)
    if np.ndim(given) > 1:
        shape = " x ".join(map(str, np.shape(given)))
        raise SpeedError(f"speeds: an array of {shape}; allowed: a list of speeds [rpm]")
    return parse_speeds(",".join(map(str, np.ravel(given).tolist())))


def _runs(inputs: _Inputs, progress: Callable[[object], None]) -> tuple[list[SteadyBeat], list[SteadyBeat]]:
    """Return the beats of all schemes, and those without CRRT, at all speeds, one entry per policy."""
    runs, without_crrt, policies = [], [], inputs.policies
    for k, policy in enumerate(policies):
        of = f"policy {k + 1} of {len(policies)} ({policy})"
        progress(f"{of}: {len(inputs.schemes)} schemes at {len(inputs.speeds)} speeds")
        runs.append(inputs.circuits.run(inputs.speeds, policy, keep=inputs.at_own_speed.tolist()))
        without_crrt.append(inputs.circuits.run_without(inputs.speeds, policy))
    return runs, without_crrt


def _uptake(
    inputs: _Inputs, runs: Sequence[SteadyBeat], progress: Callable[[object], None]
) -> xr.Dataset | None:
    """Return the effects of the schemes split into uptake and flow; None without the published policy."""
    if AS_PUBLISHED not in inputs.policies:
        return None
    progress("effects of the schemes split into blood volume and flow")
    circuits, own = inputs.circuits, inputs.own_speed
    published = runs[inputs.policies.index(AS_PUBLISHED)]
    without = circuits.run_without(np.array([own]), AS_PUBLISHED)
    return split_differences(circuits, published, without, inputs.at_own_speed, own)


def _ranking(inputs: _Inputs, means: xr.Dataset, limits: xr.Dataset) -> dict[str, tuple[Ranked, ...]]:
    """Return the schemes from best to worst at the case's speed, by policy."""
    return {
        policy: rank(
            means.sel(policy=policy, speed=inputs.own_speed), limits.sel(policy=policy), inputs.schemes,
            inputs.rule,
        )
        for policy in inputs.policies
    }  # fmt: skip


def _assumed(circuits: StudyCircuits, means: xr.Dataset, renox: xr.Dataset | None) -> tuple[str, ...]:
    """Return the sentences on values without a source that the numbers of the study depend on."""
    names = [str(name) for name in means]
    sentences = [assumption.sentence for assumption in assumptions(names, circuits.circuit, circuits.values)]
    return (*sentences, *([] if renox is None else renox.attrs["assumed"]))
