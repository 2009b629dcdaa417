"""Commands `eclsim identify` and `eclsim import`: fit the model to a patient's or cohort's measurements."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import typer

from eclsim.cli.cases import is_table, names_of, read_all, read_usable_cohort
from eclsim.cli.console import INCOMPLETE, Progress, broken_rules, fail, note, refuse, refusing, say, warn
from eclsim.cli.destination import STANDARD_OUTPUT, Destinations, explaining_resume, write_json_output
from eclsim.cli.options import (
    CaseChanges,
    Distributed,
    Force,
    FreeParameters,
    VolumePolicy,
    argument,
    option,
)  # fmt: skip
from eclsim.files import write_text
from eclsim.identification import SUMMARY
from eclsim.inputs.mistakes import CaseError, InputError

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.cases.cohort import CohortReading
    from eclsim.execution import Distribution
    from eclsim.identification.fit import FitResult
    from eclsim.identification.settings import FitSettings
    from eclsim.inputs.mistakes import Mistake

Value = TypeVar("Value")
Prior = Literal["log-uniform", "log-normal"]
CHAINS = (4, 600, 1500)
"""Default numbers of chains, of discarded draws and of kept draws."""
ROWS_NAMED = 5
"""Number of table lines named in an error."""


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions(FreeParameters, CaseChanges, Distributed):
    """Options of `eclsim identify`."""

    file: str = argument(
        ..., "CASE.toml|COHORT.csv", "A case file with measurements, or a table of measurements."
    )
    out: str = option(..., "Write fitted case files, tables, JSON and figures here.", "--out", metavar="DIR")
    weights: Literal["relative", "uncertainty"] = option(
        "relative",
        "Divide each difference by the measured value (as in the paper), or by its uncertainty.",
    )
    posterior: bool = option(
        False,
        "Also sample the full posterior, by default with NUTS (minutes; needs the extra `bayes`).",
        "--posterior",
    )
    posterior_method: Literal["nuts", "importance"] = option(
        "nuts",
        "Method of --posterior. nuts: chains with exact derivatives; importance: weighted draws, in seconds.",
    )
    predict: list[str] = option(
        [],
        "Predict the outputs at other settings with 90 % intervals, such as {setting}=4000. Without "
        "--posterior the method is --predict-with. May be repeated.",
        metavar="KEY=VALUE,...",
    )
    predict_with: Literal["importance", "gaussian"] = option(
        "importance",
        "Method of --predict without --posterior. importance: draws weighted by the exact posterior, with a "
        "check of the weights (seconds); gaussian: the Gaussian approximation, unchecked.",
    )
    prior: Prior = option(
        "log-uniform", "Prior of --posterior and --predict: what is known before any measurement."
    )
    chains: int = option(CHAINS[0], "Chains of --posterior.", minimum=2, maximum=64)
    warmup: int = option(CHAINS[1], "Draws of each chain that are discarded.", minimum=50)
    draws: int = option(CHAINS[2], "Draws of each chain that are kept.", minimum=50)
    shared: str | None = option(
        None,
        "For cohorts: free parameters that are the same at all data points of a patient, such as Csvn.",
        metavar="NAMES",
    )
    seed: int = option(0, "Seed of the explored points; the same seed gives the same result.", minimum=0)

    @property
    def samples(self) -> bool:
        """Whether draws are to be made."""
        return self.posterior or bool(self.predict)


def identify(options: IdentifyOptions) -> None:
    """Fit parameters to measurements: multi-start least squares with exact derivatives.

    Explores 1,000 sets of parameters for each free parameter and refines the best until the optimum has been
    found again ten times. Shows whether the fit is good, doubtful or poor, and how reliable parameters are.
    A cohort has one row per data point; a bad row does not stop the others. Exit status: 0 all fitted
    (see the verdict: doubtful fits count), 1 some were not fitted or are poor, 2 bad input.
    """
    cohort = is_table(options.file)
    places = _destinations(options, cohort)
    target, distribution = places.target("--json", options.json), options.distribution(places.mistakes)
    if cohort:
        places.check()
        content, refused = _fit_cohort(options, distribution)
    else:
        content, refused = _fit_case(options, distribution, places.mistakes), False
    if write_json_output(content, target):
        from eclsim.identification.report import fits_text

        typer.echo(fits_text(content))
    if refused or any(p["status"] != "fitted" or p["verdict"]["level"] == "poor" for p in content["points"]):
        raise typer.Exit(INCOMPLETE)


def _destinations(o: IdentifyOptions, cohort: bool) -> Destinations:
    """Return the destinations of results, together with the errors in the options."""
    places = Destinations(force=o.force, resume=o.continues if cohort else None, inputs=[o.file])
    places.folder("--out", o.out, [SUMMARY])
    others = (o.chains, o.warmup, o.draws) != CHAINS
    places.mistakes += broken_rules({
        "--set: works for case files only; change the table of the cohort instead": cohort and o.settings,
        "--posterior, --predict: work for case files only; `eclsim identify` of a cohort gives intervals":
            cohort and o.samples,
        "--shared: works for cohorts only; a case is one data point": not cohort and o.shared is not None,
        "--resume, --shard, --dask: work for cohorts only; a case is fitted as a whole":
            not cohort and (o.continues or o.dask),
        "--chains, --warmup, --draws: need --posterior with --posterior-method nuts":
            others and not (o.posterior and o.posterior_method == "nuts"),
        "--posterior-method: needs --posterior": o.posterior_method != "nuts" and not o.posterior,
        "--prior: needs --posterior or --predict; the fit itself uses no prior":
            o.prior != "log-uniform" and not o.samples,
        "--predict-with: needs --predict without --posterior":
            o.predict_with != "importance" and (o.posterior or not o.predict),
    })  # fmt: skip
    return places


def fit_settings(
    free: FreeParameters,
    *,
    policy: VolumePolicy | None,
    weights: Literal["relative", "uncertainty"] = "relative",
    seed: int = 0,
) -> FitSettings:
    """Create settings from the options; report all errors and exit with status 2 if there are any."""
    from eclsim.identification.multi_start import MultiStart
    from eclsim.identification.settings import FitSettings, read_bounds
    from eclsim.outputs.uncertainty import DEFAULTS
    from eclsim.parameters.thiel2025 import BOUNDS
    from eclsim.sensitivity.inputs import read_uncertainties

    wrong: list[str] = []
    uncertainties = _read(read_uncertainties, free.uncertainty, wrong)
    allowed = ", ".join(DEFAULTS)
    wrong += [
        f"--uncertainty {n}: no measurement; allowed: {allowed}" for n in uncertainties if n not in DEFAULTS
    ]
    limits = _read(read_bounds, free.bounds, wrong)
    names = tuple(BOUNDS) if free.parameters is None else _unique(free.parameters)
    if not names:
        wrong.append("--parameters: no names")
    refuse(wrong)
    return FitSettings(names, limits, weights, uncertainties, MultiStart(seed=seed), policy)


def _read(read: Callable[[str], dict[str, Value]], text: str | None, wrong: list[str]) -> dict[str, Value]:
    """Return the values of an option by name; its errors are added to a list."""
    try:
        return read(text or "")
    except InputError as error:
        wrong += error.mistakes
        return {}


def source_of_mistake(mistake: Mistake, settings: FitSettings, file: str, line: int | None = None) -> Mistake:
    """Return an error with the option or the file in which it was made."""
    if mistake.key in settings.bounds:
        return mistake.at("--bounds", None)
    if mistake.key in settings.parameters:
        return mistake.at("--parameters", None)
    if mistake.key in settings.shared:
        return mistake.at("--shared", None)
    if mistake.key in ("parameters", "uncertainty"):
        return replace(mistake, key="").at(f"--{mistake.key}", None)
    return mistake.at(file, line)


def free_parameters_text(names: Sequence[str]) -> str:
    """Sentence on the free parameters, if they are other than the paper's seven."""
    reason = "blood gases, CVP or pressures of the CRRT were measured"
    return f"{reason}: the free parameters are {', '.join(names)} (--parameters chooses others)"


def _unique(names: str | None) -> tuple[str, ...]:
    return tuple(dict.fromkeys(names_of(names) or ()))


# --- one case -------------------------------------------------------------------------------------


def _fit_case(o: IdentifyOptions, distribution: Distribution, mistakes: Collection[str]) -> dict[str, Any]:
    """Fit one case and write its files; return the content of the JSON.

    Errors in the options are reported together with those of the case.
    """
    from eclsim.identification.settings import checked_fit, unmeasured_uncertainties

    (reading,) = read_all([o.file], o.settings, o.volume_policy, mistakes)
    refuse(mistakes)
    settings = fit_settings(o, policy=reading.case.volume_policy, weights=o.weights, seed=o.seed)
    settings = settings if o.parameters is not None else _with_informed_parameters(reading.case, settings)
    predictions = _predictions(o, settings.names)
    checked = checked_fit(reading.case, settings)
    unmeasured = unmeasured_uncertainties([reading.case], settings)
    refuse([source_of_mistake(m, settings, o.file) for m in (*checked.mistakes, *unmeasured)])
    warn(checked.warnings)
    note(line for line in checked.notes if not line.key.startswith("measurements."))

    from eclsim.devices.description import placed_sentence
    from eclsim.identification.fit import fit

    folder = Path(o.out)
    with distribution.running(), Progress() as progress:
        result = fit(reading.case, settings=settings, progress=progress)
        warn(placed_sentence(f"{o.file}, fitted", line) for line in result.warnings)
        if result.simulated:
            result = _with_profiles(result, folder, progress)
        content, page = _write_fit(folder, result, settings, {})
        if o.samples and result.simulated:
            say(f"report: {page}, the posterior will be added when it is sampled")
            result, posterior = _with_posterior(o, result, predictions, folder, progress)
            content, page = _write_fit(folder, result, settings, posterior)
    say(f"report: {page}")
    return content


def _write_fit(
    folder: Path, fit: FitResult, settings: FitSettings, posterior: Mapping[str, Any]
) -> tuple[dict[str, Any], Path]:
    """Write tables, JSON, page and fitted case; return the content of the JSON and the path of the page."""
    from eclsim.identification.files import fits_object, write_fits, write_fitted_case
    from eclsim.identification.report import write_fit_page

    content = {**fits_object([fit.as_object()], settings.as_object()), **posterior}
    write_fits(folder, content)
    if fit.simulated:
        (folder / "cases").mkdir(exist_ok=True)
        path = write_fitted_case(folder / "cases", fit)
        if not posterior:
            say(f"fitted case: {path}")
    return content, write_fit_page(folder, content, folder / "figures", fit.case)


def _with_informed_parameters(case: Case, settings: FitSettings) -> FitSettings:
    """Return the settings with the parameters that further measurements can determine, named in a note."""
    from eclsim.identification.settings import case_to_fit, free_parameters, parameters_informed_by_pressures

    usual = (*settings.parameters, *parameters_informed_by_pressures(case))
    case = case_to_fit(case, replace(settings, parameters=usual))
    names = free_parameters(case, usual, settings.volume_policy)
    if names != settings.parameters:
        note([free_parameters_text(names)])
    return replace(settings, parameters=names)


def _with_profiles(fit: FitResult, folder: Path, progress: Progress) -> FitResult:
    """Return the fit with its intervals, after writing the figures."""
    from eclsim.identification.files import write_fit_figures
    from eclsim.identification.profiles import with_profiles

    progress("profiles: how far each parameter can move")
    fit, profiled = with_profiles(fit)
    write_fit_figures(folder / "figures", fit, profiled)
    return fit


def _predictions(o: IdentifyOptions, free: Collection[str]) -> list[tuple[str, Case]]:
    """Return the case at the settings of each --predict; errors are reported before anything is computed."""
    from eclsim.cases import read_case
    from eclsim.cases.settings import parse_settings
    from eclsim.devices.registry import example_setting

    if o.posterior and o.posterior_method == "nuts" and find_spec("numpyro") is None:
        fail("--posterior needs NumPyro: pip install 'eclsim[bayes]', or --posterior-method importance")
    cases: list[tuple[str, Case]] = []
    wrong = [
        f"--predict {written}: given {count} times; leave all but one of them out"
        for written, count in Counter(o.predict).items()
        if count > 1
    ]
    for written in o.predict:
        changes = names_of(written)
        if not changes:
            wrong.append(f"--predict: empty; allowed: KEY=VALUE,... such as {example_setting()}=4000")
            continue
        keys = Counter(change.partition("=")[0].strip() for change in changes)
        wrong += [
            f"--predict {written}: gives {key} {count} times; allowed: once, or one --predict for each"
            for key, count in keys.items()
            if count > 1
        ]
        try:
            case = read_case(o.file, [*o.settings, *changes]).case
            wrong += _mistakes_of_prediction(written, parse_settings(changes), case, free)
            cases.append((written, case))
        except CaseError as error:
            wrong += [f"--predict: {mistake.at('', None)}" for mistake in error.mistakes]
    refuse(wrong)
    return cases


def _mistakes_of_prediction(
    written: str, changes: Iterable[tuple[str, str]], case: Case, free: Collection[str]
) -> list[str]:
    """Changes by section and key that no prediction can be made with, each in a sentence."""
    from eclsim.cases.quantities import section_and_key

    names = {section_and_key(name): name for name in free}
    wrong = []
    for section, key in changes:
        if (name := names.get((section, key))) is not None:
            wrong.append(
                f"{name} is free, so every draw has its own value; predict at another setting, or fix it "
                "with --bounds"
            )
        elif section == "measurements" or (section, key) == ("patient", "id"):
            wrong.append(f"no output depends on {section}.{key}; predict a setting")
    wrong += [
        f"a target flow cannot be used for predictions; give {instance.key}.{target.setting} instead"
        for instance, target in case.targets()
    ]
    return [f"--predict {written}: {sentence}" for sentence in wrong]


def _with_posterior(
    o: IdentifyOptions,
    fit: FitResult,
    predictions: Sequence[tuple[str, Case]],
    folder: Path,
    progress: Progress,
) -> tuple[FitResult, dict[str, Any]]:
    """Return the fit with its verdict updated by the draws, and the posterior as content for JSON."""
    from eclsim.identification.verdict import interval_agreement

    posterior = _sample(o, fit, predictions, folder, progress)
    if posterior["method"] != "gaussian" and posterior["trusted"]:
        fitted = fit.as_object()["parameters"]
        fit = fit.judged(interval_agreement(fitted, posterior["parameters"], "posterior"))
    return fit, {"posterior": posterior}


def _sample(
    o: IdentifyOptions,
    fit: FitResult,
    predictions: Sequence[tuple[str, Case]],
    folder: Path,
    progress: Progress,
) -> dict[str, Any]:
    """Sample the posterior and write the files of the draws."""
    from eclsim.identification.files import write_posterior
    from eclsim.identification.nuts import Sampling
    from eclsim.identification.posterior import PosteriorSettings, posterior

    chosen = PosteriorSettings(
        method=o.posterior_method if o.posterior else o.predict_with,
        prior=o.prior,
        sampling=Sampling(o.chains, o.warmup, o.draws, o.seed),
        volume_policy=fit.settings.volume_policy,
    )
    result = posterior(fit, settings=chosen, predictions=predictions, progress=progress)
    write_posterior(folder / "posterior", result)
    say(f"posterior: {folder / 'posterior'}")
    return result.as_object()


# --- a table of data points -----------------------------------------------------------------------


def _fit_cohort(o: IdentifyOptions, distribution: Distribution) -> tuple[dict[str, Any], bool]:
    """Fit all points and write the files; return the JSON content, and if rows were refused or changed."""
    reading = read_usable_cohort(o.file)
    settings = fit_settings(o, policy=o.volume_policy or "as_published", weights=o.weights, seed=o.seed)
    settings = replace(settings, shared=_unique(o.shared))
    _check_points(reading, settings, o.file)

    from eclsim.cases.table import digest_of
    from eclsim.identification.cohort import PRELOAD, fit_cohort
    from eclsim.identification.files import fits_object, write_cohort_figures, write_fits
    from eclsim.identification.report import write_fit_page

    folder = Path(o.out)
    with explaining_resume(folder), distribution.running(PRELOAD) as executor, Progress() as progress:
        results = fit_cohort(
            reading.points, settings, digest=reading.digest, folder=folder, executor=executor,
            progress=progress,
        )  # fmt: skip
    content = fits_object(results, settings.as_object(), reading)
    write_fits(folder, content, reading.refusals)
    write_cohort_figures(folder / "figures", content)
    say(f"report: {write_fit_page(folder, content, folder / 'figures')}")
    changed = digest_of(o.file) != reading.digest
    if changed:
        say(f"error: {o.file}: changed or deleted during the fit; the results are those of the original file")
    return content, changed or bool(reading.refused)


def _in_rows(mistake: Mistake, lines: Sequence[int], points: int) -> Mistake:
    """Add the table lines concerned to an error in an option, unless all lines are."""
    if mistake.line is not None or len(lines) == points:
        return mistake
    rest = f" and {len(lines) - ROWS_NAMED} more" if len(lines) > ROWS_NAMED else ""
    named = ", ".join(str(line) for line in lines[:ROWS_NAMED])
    return replace(mistake, message=f"{mistake.message} (line{'s' if len(lines) > 1 else ''} {named}{rest})")


def _check_points(reading: CohortReading, settings: FitSettings, file: str) -> None:
    """Check all points; bounds and free parameters are common to all, so an error in them stops the run."""
    from eclsim.identification.cohort import patients_of_several_circuits
    from eclsim.identification.settings import checked_fit, unmeasured_uncertainties

    doubts: dict[str, None] = {}
    mistakes: dict[Mistake, list[int]] = {}
    for point in reading.points:
        checked = checked_fit(point.case, settings)
        for mistake in checked.mistakes:
            mistakes.setdefault(source_of_mistake(mistake, settings, file, point.line), []).append(point.line)
        doubts |= dict.fromkeys(str(w.at(file, point.line)) for w in checked.warnings)
    refuse([_in_rows(m, lines, len(reading.points)) for m, lines in mistakes.items()])
    unmeasured = unmeasured_uncertainties([point.case for point in reading.points], settings)
    refuse([source_of_mistake(mistake, settings, file) for mistake in unmeasured])
    warn(doubts)
    if settings.shared:
        names = ", ".join(settings.shared)
        warn(
            f"{file}: {patient}: lines {', '.join(map(str, lines))} are points of different circuits: those "
            f"of the same circuit alone share {names}"
            for patient, lines in patients_of_several_circuits(reading.points).items()
        )


# --- clinical data as the table of a cohort ---------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ImportOptions(Force):
    """Options of `eclsim import`."""

    file: str = argument(
        ...,
        "BUNDLE.json|LONG.csv",
        "A FHIR R4 bundle of Observations and Patients, or a table patient,time,code,value,unit.",
    )
    out: str = option(..., "The cohort to write.", "--out", metavar="COHORT.csv")
    base: str | None = option(
        None,
        "Case file with the devices, and with sex, age, size and heart rate if missing in the data.",
        metavar="CASE.toml",
    )
    within: float = option(
        5.0, "Values within this time after the first form one data point.", metavar="MINUTES", minimum=0.0
    )


def import_data(options: ImportOptions) -> None:
    """Convert clinical data to a cohort for `eclsim identify`.

    Reads heart rate, SP, DP, MAP, MPAP, PCWP, CVP, CO, ECMO flow, blood gases, height and weight by LOINC or
    SNOMED CT code or by column name. Every conversion of a unit is reported. Exit status: 0 written, 2 bad
    input (all mistakes are listed and nothing is written).
    """
    from eclsim.cases.importing import as_table, import_cohort
    from eclsim.cases.reading import read_case

    places = Destinations(force=options.force, inputs=[options.file, options.base])
    target = places.target("--out", options.out)
    places.check()
    with refusing(CaseError):
        case = read_case(options.base).case if options.base is not None else None
        cohort = import_cohort(options.file, case, timedelta(minutes=options.within))
    warn(cohort.warnings)
    note(cohort.notes)
    write_text(as_table(cohort.rows), target or STANDARD_OUTPUT)
    if target != STANDARD_OUTPUT:
        patients = len({row["patient_id"] for row in cohort.rows})
        points = "1 data point" if len(cohort.rows) == 1 else f"{len(cohort.rows)} data points"
        say(f"{target}: {points} of {patients} patient{'s' * (patients != 1)}")
