"""`eclsim crrt-study`: every way to connect CRRT to a patient's ECMO circuit, compared."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from eclsim.paper.reproduction import USUAL_EXPLORE

if TYPE_CHECKING:
    from eclsim.cases import Case
    from eclsim.cli.destinations import Destinations
    from eclsim.crrt_study.study import CrrtStudy

Policies = Literal["as_published", "patient_held", "both"]
SchemeH = Literal["published", "figure"]


def crrt_study(
    case_file: Annotated[
        str,
        typer.Argument(
            metavar="CASE.toml|COHORT.csv|DIR",
            help="Case file of a patient on ECMO; or a table of measurements, whose data points are fitted "
            "first; or a folder of case files, such as fitted ones: does one scheme win for all?",
        ),
    ],
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Value that wins over the case file, such as ecmo.speed_rpm=3000 [rpm]. May be repeated.",
        ),
    ] = None,
    schemes: Annotated[
        str,
        typer.Option(
            metavar="LIST",
            help="Schemes with commas between: letters a to i, all (those nine), pairs (all 36 ordered "
            "pairs of "
            "positions), separate (CRRT on the patient), or access:return such as post_oxy:pre_rc.",
        ),
    ] = "all",
    scheme_h: Annotated[
        SchemeH,
        typer.Option(
            help="Scheme h: published has both lines at pre pump, as the published code and numbers; "
            "figure has "
            "the return line at post drainage cannula, as Figure 2 of the paper.",
        ),
    ] = "published",
    speeds: Annotated[
        str,
        typer.Option(
            metavar="RANGE", help="Pump speeds [rpm], first:last:step or a list; the case's own is added."
        ),
    ] = "1000:5000:250",
    crrt_flow: Annotated[
        float | None,
        typer.Option(
            metavar="ML/MIN", help="Blood flow of the CRRT [mL/min]; default: the case's, else 200."
        ),
    ] = None,
    volume_policy: Annotated[
        Policies | None,
        typer.Option(
            help="as_published: the patient's blood fills the circuits; patient_held: the circuits are "
            "primed and the patient keeps the stressed volume; both: side by side. Left out, what the case "
            "file says, else both.",
        ),
    ] = None,
    posterior: Annotated[
        str | None,
        typer.Option(
            metavar="FILE.csv",
            help="Samples of the patient's parameters, a column each: tells how surely limits are kept.",
        ),
    ] = None,
    out: Annotated[
        str | None,
        typer.Option(
            metavar="DIR", help="Write report.html, study.json, study.nc, CSV tables and SVG figures here."
        ),
    ] = None,
    json_file: Annotated[
        str | None,
        typer.Option(
            "--json", metavar="FILE", help="Write results as JSON; - writes them to standard output."
        ),
    ] = None,
    explore: Annotated[
        int,
        typer.Option(
            min=2,
            help="Explored sets of parameters for each free one in the fits of COHORT.csv; `eclsim identify` "
            "takes 1000.",
        ),
    ] = USUAL_EXPLORE,
    resume: Annotated[
        bool, typer.Option("--resume", help="Take over the fits of COHORT.csv that --out holds already.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that exist.")] = False,
) -> None:
    """Compare the ways of connecting CRRT to the ECMO circuit: pressures [mmHg], flows [L/min], limits.

    Exit status: 0 all converged, 1 some did not, 2 bad input (nothing computed).
    """
    from eclsim.cli import cases, crrt_cohort
    from eclsim.cli.messages import SOME_DID_NOT_CONVERGE, fail, warn
    from eclsim.crrt_study.settings import BOTH, policies_of

    if crrt_cohort.is_cohort(case_file):
        crrt_cohort.run(
            crrt_cohort.Request(
                case_file, tuple(settings or ()), schemes, scheme_h, speeds, crrt_flow, volume_policy,
                posterior, out, json_file, explore, resume, force,
            )
        )  # fmt: skip
        return
    if resume:
        fail("--resume: for a cohort's table; the study of one case is done in one go")
    wins = None if volume_policy == BOTH else volume_policy
    readings = cases.read_all([case_file], settings or [], wins)
    case = cases.with_speeds(readings, volume_policy and policies_of(volume_policy)[0])[0].case
    samples = _check(case, schemes, scheme_h, speeds, crrt_flow, posterior)
    planned, folder = _plan(case_file, case, out, json_file, force)
    study = _compute(
        case,
        schemes=schemes,
        scheme_h=scheme_h,
        speeds=speeds,
        crrt_flow_ml_min=crrt_flow,
        volume_policy=volume_policy,
        samples=samples,
    )
    _write(study, planned, folder)
    if not study.converged:
        from eclsim.crrt_study.words import not_known

        warn(not_known(study))
        raise typer.Exit(SOME_DID_NOT_CONVERGE)


def _check(
    case: Case, schemes: str, scheme_h: str, speeds: str, flow: float | None, posterior: str | None
) -> dict[str, list[float]] | None:
    """Everything that can be wrong, told at once and before anything is computed; the samples if any."""
    from eclsim.cli.messages import fail
    from eclsim.crrt_study.schemes import select_schemes
    from eclsim.crrt_study.settings import case_speed, crrt_flow
    from eclsim.identification.posterior_samples import read_samples
    from eclsim.simulation.value_ranges import parse_speeds

    wrong, samples = [], None
    checks = (
        ("--schemes ", lambda: select_schemes(schemes, scheme_h)),
        ("--speeds ", lambda: parse_speeds(speeds)),
        ("--crrt-flow: ", lambda: crrt_flow(case, flow)),
        ("", lambda: case_speed(case)),
    )
    for option, check in checks:
        try:
            check()
        except ValueError as error:
            wrong.append(f"{option}{error}")
    try:
        samples = None if posterior is None else read_samples(posterior)
    except ValueError as error:
        wrong.append(f"--posterior {error}")
    if wrong:
        fail(*wrong)
    return samples


def _plan(
    case_file: str, case: Case, out: str | None, json_file: str | None, force: bool
) -> tuple[Destinations, Path | None]:
    from eclsim.cli import destinations
    from eclsim.cli.messages import fail
    from eclsim.cli.output_option import output_folder

    request = destinations.Request(json_file, None, None, None, force, 0.0)
    planned = destinations.plan(request, [case_file], [case.patient.id])
    folder = None if out is None else output_folder(out)
    if folder is not None and folder.is_dir() and not force:
        from eclsim.crrt_study.files import file_names

        standing = [name for name in file_names() if (folder / name).exists()]
        if standing:
            fail(f"--out {folder}: holds {standing[0]} already; --force overwrites it")
    return planned, folder


def _compute(case: Case, **options: object) -> CrrtStudy:
    from eclsim.cli.messages import Progress
    from eclsim.crrt_study.study import crrt_study

    progress = Progress()
    try:
        return crrt_study(case, progress=progress, **options)  # pyright: ignore[reportArgumentType] - the options were checked
    finally:
        progress.end()


def _write(study: CrrtStudy, planned: Destinations, folder: Path | None) -> None:
    from eclsim.cli.messages import fail, say
    from eclsim.crrt_study import files as crrt_files
    from eclsim.crrt_study import summary as crrt_summary

    try:
        if folder is not None:
            crrt_files.write_study(study, folder)
        if planned.json is not None:
            crrt_files.write_json(study, planned.json)
    except BrokenPipeError:
        raise
    except OSError as error:
        fail(f"{error.filename or 'output'}: cannot be written: {error.strerror or error}")
    if planned.json != "-":
        crrt_summary.show(study)
    if folder is not None:
        say(f"report: {folder / 'report.html'}")
