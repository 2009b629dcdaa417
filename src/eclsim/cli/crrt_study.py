"""Command `eclsim crrt-study`: comparison of the ways to connect CRRT to ECMO, for one case or many."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from eclsim.cli.cases import (
    case_files_in,
    is_table,
    read_all,
    read_usable_cohort,
    warn_of_new_findings,
    with_reachable_speeds,
    with_speeds,
)
from eclsim.cli.console import INCOMPLETE, Progress, broken_rules, mistakes_in, refuse, refusing, say, warn
from eclsim.cli.destination import Destinations, Target, explaining_resume, reporting_write_errors
from eclsim.cli.options import Distributed, argument, option
from eclsim.files import write_text
from eclsim.inputs.mistakes import CaseError
from eclsim.paper.reproduction import DEFAULT_EXPLORE

if TYPE_CHECKING:
    from eclsim.cases import Case
    from eclsim.cases.cohort import CohortReading
    from eclsim.crrt_study.cohort import StudyOptions
    from eclsim.crrt_study.study import CrrtStudy
    from eclsim.execution import Distribution, Executor
    from eclsim.identification.cohort import FittedCases


@dataclass(frozen=True, kw_only=True)
class CrrtStudyOptions(Distributed):
    """Options of `eclsim crrt-study`."""

    file: str = argument(
        ...,
        "CASE.toml|COHORT.csv|DIR",
        "Case file of a patient on ECMO. Or, to see whether one scheme is best for all: a table of "
        "measurements, whose data points are fitted first, or a folder of case files, such as fitted ones.",
    )
    settings: list[str] = option(
        [],
        "Override a value of the case file, such as {setting}=3000 [rpm]. May be repeated.",
        "--set",
        metavar="KEY=VALUE",
    )
    schemes: str = option(
        "all",
        "Schemes, separated by commas: letters a to i, all (those nine), pairs (all 36 ordered pairs of "
        "positions), separate (CRRT on the patient), or access:return such as post_oxy:pre_rc.",
        metavar="LIST",
    )
    scheme_h: Literal["published", "figure"] = option(
        "published",
        "Scheme h. published: both lines at pre pump, as in the published code and numbers; figure: the "
        "return line at post drainage cannula, as in Figure 2 of the paper.",
    )
    speeds: str | None = option(
        None,
        "Pump speeds [rpm], first:last:step or a list; default: the usual range of the pump in steps "
        "of 250, 1000 to 5000 for the Rotaflow. The speed of the case is added.",
        metavar="RANGE",
    )
    crrt_flow: float | None = option(
        None, "Blood flow of the CRRT [mL/min]; default: the case's, else 200.", metavar="ML/MIN"
    )
    volume_policy: Literal["as_published", "patient_held", "both"] | None = option(
        None,
        "as_published: the patient's blood fills the circuits; patient_held: the circuits are primed and the "
        "patient keeps the stressed volume; both: side by side. Default: as in the case file, else both.",
    )
    rule: str | None = option(
        None,
        "Ranking rule: criteria in order, and limits, as TOML; default: the usual rule.",
        metavar="RULE.toml",
    )
    posterior: str | None = option(
        None,
        "Samples of the patient's parameters, one per column, to show how certain it is that limits are "
        "kept.",
        metavar="FILE.csv",
    )
    out: str | None = option(
        None, "Write report.html, study.json, study.nc, CSV tables and SVG figures here.", metavar="DIR"
    )
    explore: int = option(
        DEFAULT_EXPLORE,
        "Parameter sets explored per free parameter in the fits of COHORT.csv; `eclsim identify` uses 1000.",
        minimum=2,
    )
    resume: bool = option(False, "Keep the fits of COHORT.csv and the studies already in --out.", "--resume")


def crrt_study(options: CrrtStudyOptions) -> None:
    """Compare the ways of connecting CRRT to the ECMO circuit: pressures [mmHg], flows [L/min], limits.

    Exit status: 0 all converged, 1 some did not, 2 bad input (nothing computed).
    """
    cohort = is_table(options.file) or Path(options.file).is_dir()
    if doubts := _study_cohort(options) if cohort else _study_case(options):
        warn(doubts)
        raise typer.Exit(INCOMPLETE)


def _first_policy(o: CrrtStudyOptions) -> str | None:
    from eclsim.crrt_study.schemes import policies_of

    return policies_of(o.volume_policy)[0] if o.volume_policy else None


def _options(o: CrrtStudyOptions) -> StudyOptions:
    from eclsim.crrt_study.cohort import StudyOptions

    return StudyOptions(
        schemes=o.schemes, speeds=o.speeds, crrt_flow_ml_min=o.crrt_flow, volume_policy=o.volume_policy,
        scheme_h=o.scheme_h, rule=o.rule,
    )  # fmt: skip


def _check_options(o: CrrtStudyOptions, more: Mapping[str, Callable[[], object]]) -> list[str]:
    from eclsim.crrt_study.rule import read_rule
    from eclsim.crrt_study.schemes import parse_speeds, select_schemes

    return mistakes_in(
        {
            "--rule": lambda: read_rule(o.rule),
            "--schemes": lambda: select_schemes(o.schemes, o.scheme_h),
            "--speeds": lambda: o.speeds is None or parse_speeds(o.speeds),
            **more,
        }
    )


def _write(
    o: CrrtStudyOptions, target: Target, files: Callable[[Path], object], json: Callable[[], str]
) -> bool:
    """Write the requested files and JSON; return whether standard output is free for text."""
    with reporting_write_errors():
        if o.out is not None:
            files(Path(o.out))
        if target is not None:
            write_text(json(), target)
    if o.out is not None:
        say(f"report: {Path(o.out) / 'report.html'}")
    return target != "-"


# --- one case -------------------------------------------------------------------------------------


def _study_case(o: CrrtStudyOptions) -> Sequence[str]:
    """Study one case; return descriptions of what did not converge."""
    from eclsim.crrt_study.schemes import BOTH

    undivided = broken_rules({
        "--resume, --shard, --dask: work for cohorts only; the study of one case runs as a whole":
            o.continues or o.dask,
    })  # fmt: skip
    policy = None if o.volume_policy == BOTH else o.volume_policy
    readings = read_all([o.file], o.settings, policy, [*undivided, *_check_options(o, {})])
    refuse(undivided)
    (reading,) = with_speeds(readings, _first_policy(o))
    target, samples = _check_case(o, reading.case)
    study = _compute(o, reading.case, samples)
    warn_of_new_findings(reading, study.warnings)
    from eclsim.crrt_study import files, report
    from eclsim.crrt_study.beats import missing_beats_text

    if _write(o, target, lambda folder: files.write_study(study, folder), lambda: files.study_json(study)):
        report.show(study)
    return () if study.converged else missing_beats_text(study)


def _check_case(o: CrrtStudyOptions, case: Case) -> tuple[Target, Mapping[str, Sequence[float]] | None]:
    """Return the JSON destination and the samples, after checking all options before any computation."""
    from eclsim.crrt_study import schemes as ways
    from eclsim.crrt_study.files import file_names
    from eclsim.identification.draws import read_samples

    samples: list[Mapping[str, Sequence[float]]] = []
    places = Destinations(force=o.force, inputs=[o.file, o.posterior])
    target = places.target("--json", o.json)
    places.folder("--out", o.out, file_names())
    places.mistakes += _check_options(
        o,
        {
            "--schemes": lambda: ways.in_patient(case, ways.select_schemes(o.schemes, o.scheme_h)),
            "--crrt-flow:": lambda: ways.crrt_flow(case, o.crrt_flow),
            "": lambda: ways.case_speed(case),
            "--speeds": lambda: o.speeds is None or ways.check_speeds(case, ways.parse_speeds(o.speeds)),
            "--posterior": lambda: samples.append(read_samples(o.posterior)) if o.posterior else None,
        },
    )
    places.check()
    return target, samples[0] if samples else None


def _compute(o: CrrtStudyOptions, case: Case, samples: Mapping[str, Sequence[float]] | None) -> CrrtStudy:
    from eclsim.crrt_study.rule import RuleError
    from eclsim.crrt_study.study import crrt_study
    from eclsim.identification.draws import doubts_of

    with refusing(RuleError, CaseError, at=o.posterior or o.file), Progress() as progress:
        study = crrt_study(case, **vars(_options(o)), samples=samples, progress=progress)
    doubts = doubts_of(o.posterior, case) if o.posterior else ()
    return replace(study, warnings=(*doubts, *study.warnings))


# --- a table of measurements, or a folder of cases ------------------------------------------------


def _study_cohort(o: CrrtStudyOptions) -> Sequence[str]:
    """Fit or read the cases and study each; return descriptions of what could not be studied."""
    from eclsim.crrt_study import cohort_report
    from eclsim.crrt_study.cohort import PRELOAD, crrt_cohort
    from eclsim.crrt_study.schemes import StudyError

    target, distribution = _check_cohort(o)
    reading = None if Path(o.file).is_dir() else read_usable_cohort(o.file)
    with (
        refusing(StudyError),
        explaining_resume(o.out),
        reporting_write_errors(o.out),
        distribution.running(PRELOAD) as executor,
        Progress() as progress,
    ):
        fitted = _cases_of_folder(o) if reading is None else _fitted(o, reading, executor, progress)
        folder = None if o.out is None else Path(o.out)
        study = crrt_cohort(fitted, _options(o), folder=folder, executor=executor, progress=progress)
    of = cohort_report
    if _write(o, target, lambda folder: of.write_cohort(study, folder), lambda: of.cohort_json(study)):
        of.show(study)
    warn(of.impossible_points(study))
    failures = [f"{name}: {reason}" for name, reason in study.lost.items()]
    return failures + [f"{point.name}: {line}" for point in study.unsettled for line in point.unsettled]


def _check_cohort(o: CrrtStudyOptions) -> tuple[Target, Distribution]:
    from eclsim.crrt_study.cohort import FILES, FITS
    from eclsim.crrt_study.schemes import check_flow

    places = Destinations(force=o.force, resume=o.continues, inputs=[o.file])
    target = places.target("--json", o.json)
    places.folder("--out", o.out, (*FILES, FITS))
    distribution = o.distribution(places.mistakes)
    places.mistakes += broken_rules({
        "--set: works for one case file only; change the table or the case files instead": o.settings,
        "--posterior: works for one case file only; it contains the samples of one patient":
            o.posterior is not None,
    })  # fmt: skip
    flow = o.crrt_flow
    places.mistakes += _check_options(o, {"--crrt-flow:": lambda: flow is None or check_flow(flow)})
    places.check()
    return target, distribution


def _cases_of_folder(o: CrrtStudyOptions) -> FittedCases:
    from eclsim.identification.cohort import cases_as_given

    readings = read_all(case_files_in(o.file), [])
    solved, reasons = with_reachable_speeds(readings, _first_policy(o))
    return cases_as_given(solved, "case files", reasons)


def _fitted(
    o: CrrtStudyOptions, reading: CohortReading, executor: Executor, progress: Progress
) -> FittedCases:
    from eclsim.crrt_study.cohort import FITS
    from eclsim.identification.cohort import fit_points
    from eclsim.identification.multi_start import MultiStart
    from eclsim.identification.settings import FitSettings

    policy = "patient_held" if o.volume_policy == "patient_held" else "as_published"
    settings = FitSettings(multi_start=MultiStart.quick(o.explore), volume_policy=policy)
    folder = None if o.out is None else Path(o.out) / FITS
    return fit_points(reading, settings, folder=folder, executor=executor, progress=progress)
