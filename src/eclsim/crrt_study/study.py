"""The combined ECMO and CRRT study: all ways to connect the CRRT, over the range of pump speeds.

It applies section 3.3 of Thiel et al. 2025 to any patient on ECMO with a rotary pump, under either blood
volume policy, and compares RenOx, oxygenator and dialyzer in one housing, on the same beats. RenOx has no
lines, so blood flows as without CRRT, and only the exchange across the membrane is added to the beats of the
patient on ECMO alone. Its fluids are those of the case's section [renox]; without it, all dialysate and
replacement fluid of the case's CRRT is used as dialysate.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from eclsim.cases.resolve import resolve_parameters
from eclsim.components.dialysis import PLASMA_WATER
from eclsim.crrt_study import beats as crrt_datasets
from eclsim.crrt_study.assumptions import assumptions_in_words
from eclsim.crrt_study.beats import SPEED, split_differences, study_circuits, summarise, unsettled
from eclsim.crrt_study.limits import beat_warnings, largest_flows, uncertainty
from eclsim.crrt_study.ranking import rank
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
    in_patient,
    parse_speeds,
    policies_of,
    select_schemes,
)
from eclsim.devices.crrt import CRRT, Crrt
from eclsim.devices.dialysed_blood import FILTER_PARAMETERS, FLUIDS, HAEMATOCRIT_IN
from eclsim.devices.renox import GROUP, Renox
from eclsim.files import ORIGIN
from eclsim.orbit.model import CASE, CaseSource, as_case, case_json, circuit_of, values_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.alarms import assumptions
from eclsim.outputs.results import output_labels
from eclsim.outputs.signals import output_names, parameters_read
from eclsim.outputs.steady_beat import steady_beat

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from eclsim.cases.case import Case
    from eclsim.crrt_study.beats import MissingBeats
    from eclsim.crrt_study.ranking import Ranked
    from eclsim.files import Json


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
    from eclsim.cases.quantities import as_samples, check_samples
    from eclsim.simulation.target_flow import with_speed

    case = as_case(case)
    chosen = in_patient(case, select_schemes(schemes, scheme_h))
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


# --- RenOx: oxygenator and dialyzer in one housing --------------------------------------------------


PERMEABILITY = FILTER_PARAMETERS[0].key
GASES = ("SreturnO2", "PreturnCO2", "SaO2", "PaCO2")
COLUMNS = {
    "access_mmhg": "Pcrrttuin", "return_mmhg": "Pcrrttuout", "urea_ml_min": "effective_clearance_urea",
    "filtration_fraction": "filtration_fraction", "effluent_pressure_mmhg": "effluent_pressure",
    "SreturnO2": "SreturnO2", "SaO2": "SaO2", "PaCO2": "PaCO2",
}  # fmt: skip
"""Quantities of a scheme that are compared with RenOx, by their keys in JSON."""


def without_renox(case: Case) -> Case:
    """Return the case without RenOx; without a CRRT, it gets one with the fluids of its RenOx."""
    crrt, renox = case.crrt, case.renox
    if crrt is None and renox is not None:
        crrt = Crrt(**CRRT.usual, **renox.model_dump())
    return case.model_copy(update={"renox": None, "crrt": crrt})


def section_of(case: Case) -> Renox | None:
    """Return the fluids of RenOx; None if the case has neither its section nor a CRRT with dialysis."""
    if case.renox is not None:
        return case.renox
    if case.crrt is None or not case.crrt.dialyses:
        return None
    fluids = (case.crrt.dialysate_ml_h, case.crrt.replacement_pre_ml_h, case.crrt.replacement_post_ml_h)
    shared = ("haematocrit_in", "fluid_bicarbonate_mmol_l", "plasma_bicarbonate_mmol_l")
    return Renox.model_construct(
        dialysate_ml_h=sum(flow or 0.0 for flow in fluids),
        net_ultrafiltration_ml_h=case.crrt.net_ultrafiltration_ml_h or 0.0,
        **{key: getattr(case.crrt, key) for key in shared},
    )


def in_one_housing(case: Case, policies: Sequence[str], speeds: np.ndarray) -> xr.Dataset | None:
    """Outputs of RenOx and the patient's gases over `policy` and `speed`; None without fluids of RenOx."""
    section = section_of(case)
    if section is None:
        return None
    case = case.model_copy(update={"crrt": None, "renox": section})
    circuit, values = circuit_of(case), values_of(case)
    known = output_names(circuit)
    names = [n for n in known if n.startswith(f"{GROUP}_")] + [n for n in ("PF", *GASES) if n in known]
    beats = []
    for policy in policies:
        batch = Batch(circuit, values | {SPEED: speeds}, len(speeds), policy)
        beats.append(steady_beat(batch, names, start=values).determined_only())
    dims = ("policy", "speed")
    data = {name: (dims, np.stack([b.output(name) for b in beats]), output_labels(name)) for name in names}
    attributes = {key: value for key, value in section.model_dump().items() if value is not None}
    attributes["assumed"] = [
        f"RenOx: {assumption.sentence}" for assumption in assumptions(names, circuit, values)
    ]
    return xr.Dataset(data, {"policy": list(policies), "speed": speeds}, attributes)


def compared_with_schemes(study: CrrtStudy, policy: str) -> dict[str, Mapping[str, float | bool | None]]:
    """RenOx and every scheme at the case's speed, in the order of the ranking; empty without RenOx.

    RenOx has no lines, hence no line pressures and alarms; without a beat all its numbers are unknown.
    `open_effluent_l_h` is the filtration by blood pressure through a membrane whose effluent side is open to
    the atmosphere, at most all water of the plasma that reaches it.
    """
    if study.renox is None:
        return {}
    renox = study.renox.sel(policy=policy, speed=study.case_speed)
    has_beat = bool(np.isfinite(float(renox["PF"])))
    result: dict[str, Mapping[str, float | bool | None]] = {
        "RenOx": {
            "access_mmhg": None, "return_mmhg": None, "alarms_kept": True if has_beat else None,
            "blood_taken_up_ml": 0.0 if has_beat else None,
            "urea_ml_min": float(renox["renox_clearance_urea"]),
            "filtration_fraction": float(renox["renox_filtration_fraction"]),
            "effluent_pressure_mmhg": float(renox["renox_effluent_pressure"]),
            "open_effluent_l_h": 1e-3 * float(renox["renox_free_ultrafiltration_ml_h"]),
            **{name: float(renox[name]) for name in GASES if name in renox and name in COLUMNS},
        }
    }  # fmt: skip
    means = study.means.sel(policy=policy, speed=study.case_speed)
    for ranked in study.ranking[policy]:
        scheme = means.sel(scheme=ranked.letter)
        numbers: dict[str, float | bool | None] = {
            key: float(scheme[name]) for key, name in COLUMNS.items() if name in scheme
        }
        numbers["alarms_kept"] = ranked.alarms_kept
        numbers["blood_taken_up_ml"] = -float(scheme["patient_volume_change"])
        if "effluent_pressure" in scheme:
            blood = float(scheme["effluent_pressure"] + scheme["transmembrane_pressure"])
            numbers["open_effluent_l_h"] = 1e-3 * _open_effluent_ml_h(study, blood)
        result[ranked.letter] = numbers
    return result


def _open_effluent_ml_h(study: CrrtStudy, pressure: float) -> float:
    """Filtration of the CRRT's filter [mL/h] at a blood pressure [mmHg] if nothing holds its effluent."""
    values = resolve_parameters(without_renox(study.case))
    plasma = 60.0 * study.crrt_flow_ml_min * (1.0 - values[HAEMATOCRIT_IN])
    water = PLASMA_WATER * plasma + values[f"{CRRT.key}.{FLUIDS[1]}"]
    return min(values[PERMEABILITY] * pressure, water)
