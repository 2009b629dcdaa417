"""The combined ECMO and CRRT study: every way to connect the CRRT, over the range of pump speeds.

Section 3.3 of Thiel et al. 2025 for any patient on ECMO with a rotary pump, under either blood volume policy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eclsim.crrt_study.rule import DEFAULT_RULE, Rule, check_quantities, read_rule
from eclsim.crrt_study.schemes import (
    AS_PUBLISHED,
    BOTH,
    NINE,
    PUBLISHED,
    Scheme,
    SpeedError,
    case_speed,
    check_speeds,
    crrt_flow,
    default_speeds,
    parse_speeds,
    policies_of,
    select_schemes,
)
from eclsim.orbit.model import CaseSource, as_case

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import ArrayLike

    from eclsim.cases.case import Case
    from eclsim.crrt_study.beats import MissingBeats
    from eclsim.crrt_study.ranking import Ranked
    from eclsim.files import Json


@dataclass(frozen=True)
class CrrtStudy:
    """Results of the study.

    Args:
        case: the case.
        schemes: schemes compared.
        case_speed: pump speed of the case [rpm]; one of the speeds.
        crrt_flow_ml_min: blood flow of the CRRT.
        means: cycle means and outputs over `policy`, `scheme` and `speed`; NaN where the beat was not found,
            and `status` says why.
        without_crrt: the same for the patient on ECMO alone, over `policy` and `speed`.
        waveforms: at the case's speed, over `policy`, `scheme` and `phase`.
        summary: median and variation over the schemes, over `policy` and `speed`.
        limits: what each scheme keeps, over `policy`, `scheme` and `limit`.
        uptake: differences at the case's speed, split into blood taken up and flow; None unless the published
            policy was studied.
        ranking: schemes from best to worst, by policy.
        uncertainty: how surely each scheme keeps its limits; None unless samples were given.
        rule: by which schemes are ranked.
        renox: oxygenator and dialyzer in one housing on the beats without CRRT, over `policy` and `speed`;
            None where the case has no fluids for it.
        assumed: what numbers of the study follow from without a source, a sentence each.
        warnings: of the beats at the case's speed under the first policy.
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

    def __repr__(self) -> str:
        orders = (f"{policy}: {' '.join(r.letter for r in rank)}" for policy, rank in self.ranking.items())
        return f"<CrrtStudy {self.case.patient.id}: schemes from the first {', '.join(orders)}>"

    @property
    def policies(self) -> tuple[str, ...]:
        """Blood volume policies that were studied."""
        return tuple(str(policy) for policy in self.means["policy"].values)

    @property
    def dataset(self) -> xr.Dataset:
        """Cycle means and outputs over `policy`, `scheme` and `speed`: the same as `means`."""
        return self.means

    def as_object(self) -> dict[str, Json]:
        """Plain data for JSON, what `eclsim crrt-study --json` writes."""
        from eclsim.crrt_study.files import study_object

        return study_object(self)

    @property
    def converged(self) -> bool:
        """Whether every steady beat was found, those of the samples included."""
        return not self.unsettled and not self.samples_without_a_beat

    @property
    def unsettled(self) -> tuple[MissingBeats, ...]:
        """Beats that were not found, by policy, scheme and reason."""
        from eclsim.crrt_study.beats import unsettled

        return unsettled(self)

    @property
    def samples_without_a_beat(self) -> dict[str, int]:
        """Number of samples of the patient's parameters without a steady beat, by scheme that has any."""
        from eclsim.crrt_study.beats import samples_without_a_beat

        return {} if self.uncertainty is None else samples_without_a_beat(self.uncertainty)


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
    """Where the CRRT lines go on an ECMO circuit: each scheme simulated, compared with limits, and ranked.

    Args:
        case: case or its file, with an ECMO circuit and a rotary pump; its CRRT section gives the flow only.
            Of a case that names a pump flow the speed is solved for, under the first policy, and held.
        schemes: letters, groups and pairs, see `select_schemes`.
        speeds: pump speeds [rpm], see `parse_speeds`; left out, the range in use of the case's pump. The
            case's own speed is added.
        crrt_flow_ml_min: blood flow of the CRRT; left out, the case's own, else 200 mL/min.
        volume_policy: "as_published", "patient_held" or "both"; left out, what the case says, else both.
        scheme_h: "published" or "figure", see `SCHEME_H`.
        samples: values by parameter, one per sample of the patient's posterior; the limits are then held
            against each, at the case's speed and the first policy.
        rule: a centre's own rule of ranking or its file, see `eclsim.crrt_study.rule`; left out, the usual.
        progress: called with what is being computed.

    Raises:
        CaseError: If the file cannot be read, or samples have names that the study does not read, different
            lengths or values out of range.
        FlowNotReachedError: If no speed gives the pump flow that the case names.
        RuleError: If the rule cannot be read, or asks for what is not computed.
        StudyError: If the case has no ECMO circuit with a rotary pump, a speed is far above what that runs
            at, or the policy is none.
        SchemeError: If a scheme cannot be read.
        SpeedError: If a speed cannot be read, or is not above 0.
    """
    from eclsim.cases.samples import as_samples, check_samples
    from eclsim.crrt_study import beats as crrt_datasets
    from eclsim.crrt_study.beats import split_differences, study_circuits, summarise
    from eclsim.crrt_study.limits import beat_warnings, largest_flows, uncertainty
    from eclsim.crrt_study.one_housing import in_one_housing, without_renox
    from eclsim.crrt_study.ranking import rank
    from eclsim.outputs.alarms import assumptions
    from eclsim.outputs.signals import parameters_read
    from eclsim.simulation.target_flow import with_speed

    case = as_case(case)
    chosen = select_schemes(schemes, scheme_h)
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
    at = np.arange(len(chosen)) * len(rpm) + int(np.flatnonzero(rpm == own_speed)[0])
    runs, without_crrt = [], []
    for k, policy in enumerate(policies):
        of = f"policy {k + 1} of {len(policies)} ({policy})"
        progress(f"{of}: {len(chosen)} schemes at {len(rpm)} speeds")
        runs.append(circuits.run(rpm, policy, keep=at.tolist()))
        without_crrt.append(circuits.run_without(rpm, policy))
    uptake = None
    if AS_PUBLISHED in policies:
        progress("effects of the schemes split into blood volume and flow")
        first = policies.index(AS_PUBLISHED)
        uptake = split_differences(
            circuits, runs[first], circuits.run_without(np.array([own_speed]), AS_PUBLISHED), at, own_speed
        )
    doubt = None
    if samples:
        progress("samples of the patient's parameters")
        doubt = uncertainty(circuits, own_speed, policies[0], samples, judged_by.limits)
    progress("limits and ranking")
    means = crrt_datasets.means(circuits, runs, without_crrt, policies, rpm)
    limits = largest_flows(means, own_speed, judged_by.limits)
    ranking = {
        policy: rank(means.sel(policy=policy, speed=own_speed), limits.sel(policy=policy), chosen, judged_by)
        for policy in policies
    }
    renox = in_one_housing(case, policies, rpm)
    names = [str(name) for name in means]
    sentences = [assumption.sentence for assumption in assumptions(names, circuits.circuit, circuits.values)]
    sentences += [] if renox is None else renox.attrs["assumed"]
    return CrrtStudy(
        case, chosen, own_speed, flow, means, crrt_datasets.without(without_crrt, policies, rpm),
        crrt_datasets.waveforms(circuits, runs, policies), summarise(means), limits, uptake, ranking, doubt,
        judged_by, renox, tuple(sentences),
        (*case.doubts, *beat_warnings(circuits, runs[0], at.tolist(), without_crrt[0], sentences)),
    )  # fmt: skip


def _speeds(given: str | ArrayLike) -> tuple[float, ...]:
    """Speeds [rpm] in ascending order, each once: of a text as in `parse_speeds`, or of a list.

    Raises:
        SpeedError: If any of it is no speed, or a table in place of a list.
    """
    if isinstance(given, str):
        return parse_speeds(given)
    if np.ndim(given) > 1:
        shape = " x ".join(map(str, np.shape(given)))
        raise SpeedError(f"speeds: an array of {shape}; allowed: a list of speeds [rpm]")
    return parse_speeds(",".join(map(str, np.ravel(given).tolist())))
