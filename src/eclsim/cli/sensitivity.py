"""Commands `eclsim sensitivity` and `eclsim identifiability`: influence and identifiability of parameters."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from eclsim.cli.cases import names_of, read_all, warn_of_new_findings, with_speeds
from eclsim.cli.console import INCOMPLETE, Progress, fail, say, warn
from eclsim.cli.destination import (
    Destinations,
    Target,
    explaining_resume,
    reporting_write_errors,
    write_json_output,
)
from eclsim.cli.options import MERGE, CaseChanges, Distributed, Json, argument, option
from eclsim.files import write_json

if TYPE_CHECKING:
    from eclsim.cases import Case, CaseReading
    from eclsim.execution import Distribution
    from eclsim.sensitivity.analysis import SobolSettings
    from eclsim.sensitivity.results import Indices, SensitivityResult


@dataclass(frozen=True, kw_only=True)
class SensitivityOptions(CaseChanges, Distributed):
    """Options of `eclsim sensitivity`."""

    case_file: str = argument(..., "CASE.toml", "Case file.")
    out: str | None = option(None, "Folder for samples, indices and figures.", metavar="DIR")
    samples: int = option(
        2048, "Rows N of Saltelli's design, a power of two; N (2 D + 2) runs for D inputs.", minimum=2
    )
    perturbation: float = option(25.0, "Half width of the range of each input [%].", metavar="PERCENT")
    ranges: list[str] = option(
        [],
        "Own range of an input in its unit, in place of --perturbation: Rmc=0.5:1.5. Rmc=0.1:10:log is "
        "uniform in the logarithm. May be repeated.",
        "--range",
        metavar="NAME=LOW:HIGH",
    )
    parameters: str | None = option(
        None, "Parameters to vary: Rmc,Emaxlv ...; default: the paper's 24.", metavar="NAMES"
    )
    include: str | None = option(
        None,
        "Further inputs: {setting} and any number of a device (for cannulae the sizes sold), "
        "positions of lines ({lines}), heart_rate_bpm, any parameter.",
        metavar="NAMES",
    )
    groups: str | None = option(
        None, "Treat all parameters of one unit as one factor, such as all resistances.", metavar="R,C,L,E"
    )
    outputs: str | None = option(None, "Outputs; default: SP,DP,MAP,MPAP,PCWP,CO,PF.", metavar="NAMES")
    second_order: bool | None = option(
        None,
        "Show the indices of pairs, or omit the runs that they need (N (D + 2) remain). Default: pairs in "
        "the files only.",
        "--second-order/--no-second-order",
        show_default=False,
    )
    seed: int = option(1, "Seed of the design and of the intervals.", minimum=0)
    states: str | None = option(
        None,
        "Analyse around these states instead of the case's values: normal,hypertensive,hypotensive (mean "
        "arterial pressure 79, 102, 60 mmHg, set by Rmc), each in its own folder.",
        metavar="NAMES",
    )
    until: float | None = option(
        None,
        "Stop at 64, 128, 256 ... rows once every total order is known to within +- this (95 %).",
        metavar="WIDTH",
    )
    figures: bool = option(True, "Write figures to --out.")
    force: bool = option(False, "Discard the contents of --out and --json.", "--force")


def sensitivity(options: SensitivityOptions) -> None:
    """Sobol sensitivity indices of a case: which parameters its outputs [mmHg, L/min] depend on.

    Ctrl-C keeps finished runs; --resume continues. Exit status: 0 done, 1 some runs failed (listed in
    failed.csv; their rows are left out), 2 bad input.
    """
    merges = options.case_file == MERGE or options.merges
    target, distribution, reading = _checked(options, merges)
    if options.case_file == MERGE:
        warn([f"eclsim sensitivity merge will be removed: use eclsim merge {options.out}"])
    with _refuse_mistakes(options), explaining_resume(options.out):
        if reading:
            results, reported = _analysed(options, distribution, reading)
        else:
            results, reported = _merged(options, distribution.merged_shards), ()
    pairs = bool(options.second_order)
    states = {state: indices.as_object(pairs) for state, indices in results.items()}
    union = list(dict.fromkeys(name for indices in results.values() for name in indices.union()))
    content = states.get("", {"states": states, "union": union})
    _show(options, content, results, target, reported)
    if any(indices.failed for indices in results.values()):
        raise typer.Exit(INCOMPLETE)


def _checked(o: SensitivityOptions, merges: bool) -> tuple[Target, Distribution, CaseReading | None]:
    """Return the JSON destination, the distribution of runs, and the case if shards are not only merged."""
    places = Destinations(force=o.force, inputs=[o.case_file], resume=o.resume or o.merges)
    target = places.target("--json", o.json)
    places.folder("--out", o.out, parents=True)
    if o.out is None and o.case_file == MERGE:
        places.mistakes.append("merge: give the folder of the shards as --out DIR")
    if o.shard and (o.until is not None or o.states):
        places.mistakes.append("--shard: cannot be combined with --until or --states, which need all runs")
    if o.until is not None and not 0.0 < o.until < math.inf:
        places.mistakes.append(f"--until {o.until:g}: allowed: above 0, such as 0.02")
    if o.states and any(one.partition("=")[0].strip() == "Rmc" for one in o.ranges):
        places.mistakes.append("--states: differ in Rmc alone, to which --range gives one range: choose one")
    distribution = o.distribution(places.mistakes)
    readings = [] if merges else read_all([o.case_file], o.settings, o.volume_policy, places.mistakes)
    places.check()
    return target, distribution, None if merges else with_speeds(readings)[0]


@contextmanager
def _refuse_mistakes(o: SensitivityOptions) -> Iterator[None]:
    """Report all errors in the options, and exit with the status of bad input."""
    from eclsim.sensitivity.inputs import InputError

    try:
        with reporting_write_errors(o.out):
            yield
    except InputError as error:
        fail(*error.mistakes)
    except ValueError as error:
        fail(error)


def _analysed(
    o: SensitivityOptions, distribution: Distribution, reading: CaseReading
) -> tuple[Mapping[str, Indices], Collection[str]]:
    """Return the indices, for each state if several, and the warnings shown when the case was read."""
    from eclsim.sensitivity.analysis import PRELOAD
    from eclsim.sensitivity.analysis import sensitivity as analyse

    results: dict[str, Indices] = {}
    with distribution.running(PRELOAD) as executor, Progress() as progress:
        for state in names_of(o.states) or ("",):
            settings = _settings(o, reading.case, state)
            if settings.values is not None:
                around = ", ".join(f"{name} = {value:.4g}" for name, value in settings.values.items())
                say(f"{state}: around {around} mmHg s/mL")
            folder = None if o.out is None else Path(o.out) / state
            result = analyse(
                reading.case, settings=settings, folder=folder, distribution=executor, progress=progress
            )
            result = replace(result, indices=replace(result.indices, state=state))
            if folder is not None:
                _write_files(o, folder, result)
            results[state] = result.indices
    return results, reading.case.doubts


def _merged(o: SensitivityOptions, shards: int | None) -> Mapping[str, Indices]:
    """Return the indices of an analysis whose shards are complete."""
    from eclsim.sensitivity.analysis import merge_shards

    folder = Path(o.out or "")
    result = merge_shards(folder, shards)
    _write_files(o, folder, result)
    return {"": result.indices}


def _settings(o: SensitivityOptions, case: Case, state: str) -> SobolSettings:
    from eclsim.orbit.model import model_of
    from eclsim.sensitivity.analysis import SobolSettings, state_values
    from eclsim.sensitivity.ranges import read_ranges

    return SobolSettings(
        samples=o.samples, perturbation_percent=o.perturbation, ranges=read_ranges(o.ranges),
        parameters=names_of(o.parameters), include=names_of(o.include) or (),
        groups=names_of(o.groups) or (), outputs=names_of(o.outputs),
        seed=o.seed, second_order=o.second_order is not False, until=o.until,
        values=state_values(model_of(case), state, case.volume_policy) if state else None,
    )  # fmt: skip


def _write_files(o: SensitivityOptions, folder: Path, result: SensitivityResult) -> None:
    from eclsim.sensitivity.results import write_results

    write_results(folder, result)
    if o.figures:
        from eclsim.sensitivity.figures import write_sensitivity_figures

        write_sensitivity_figures(result, folder / "figures")


def _show(
    o: SensitivityOptions, content: object, results: Mapping[str, Indices], target: Target,
    reported: Collection[str],
) -> None:  # fmt: skip
    from eclsim.sensitivity.results import doubts, indices_text, pairs_text

    for state, indices in results.items():
        warn(doubts(indices, state, reported))
    if not write_json_output(content, target):
        return
    for state, indices in results.items():
        typer.echo(indices_text(indices, state))
        if o.second_order and (text := pairs_text(indices)):
            typer.echo(text)


@dataclass(frozen=True, kw_only=True)
class IdentifiabilityOptions(CaseChanges, Json):
    """Options of `eclsim identifiability`."""

    case_file: str = argument(..., "CASE.toml", "Case file.")
    parameters: str | None = option(None, "Parameters to analyse; default: the paper's 24.", metavar="NAMES")
    outputs: str | None = option(
        None, "Measured outputs; default: the case's measurements, or all seven.", metavar="NAMES"
    )
    uncertainty: str | None = option(
        None,
        "Standard uncertainties of measurements: SP=4,CO=10% [mmHg, L/min or %]. Defaults: "
        "SP=4,DP=4,MAP=3,MPAP=2,PCWP=2,CVP=2 mmHg, CO=10 %, PF=5 %.",
        metavar="NAME=VALUE,...",
    )
    limit: float = option(
        10.0, "Largest collinearity index of parameters that count as distinguishable.", minimum=1.0
    )
    threshold: float = option(
        1.0,
        "Smallest effect that counts: change of the measurements, in uncertainties, if a parameter changes "
        "by 100 %.",
        minimum=0.0,
    )
    out: str | None = option(None, "Write JSON and figures here.", metavar="DIR")


def identifiability(options: IdentifiabilityOptions) -> None:
    """Which parameters the measurements of a case can tell apart, from exact derivatives of the steady beat.

    Proposes a set of parameters to fit, and says why each other parameter is not in it.
    """
    target, folder, reading = _checked_places(options)
    from eclsim.orbit.status import NoDerivativesError
    from eclsim.sensitivity.identifiability import identifiability as analyse
    from eclsim.sensitivity.inputs import InputError, read_uncertainties

    try:
        result = analyse(
            reading.case, parameters=names_of(options.parameters), outputs=names_of(options.outputs),
            uncertainties=read_uncertainties(options.uncertainty or ""), limit=options.limit,
            threshold=options.threshold,
        )  # fmt: skip
    except InputError as error:
        fail(*error.mistakes)
    except NoDerivativesError as error:
        reason = f"parameters cannot be ranked: there are no derivatives ({error.word}): {error.reason}"
        _write_json({"id": error.name, "status": error.word, "message": reason}, target, folder)
        warn([f"{reading.file}: {reason}"])
        raise typer.Exit(INCOMPLETE) from None
    warn_of_new_findings(reading, result.warnings)
    shown = _write_json(result.as_object(), target, folder)
    if folder is not None:
        from eclsim.sensitivity.figures import write_identifiability_figures

        with reporting_write_errors(folder):
            write_identifiability_figures(result, folder / "figures")
    if shown:
        from eclsim.sensitivity.identifiability import identifiability_text

        typer.echo(identifiability_text(result, options.limit))


def _checked_places(o: IdentifiabilityOptions) -> tuple[Target, Path | None, CaseReading]:
    places = Destinations(force=o.force, inputs=[o.case_file])
    target = places.target("--json", o.json)
    folder = places.folder("--out", o.out, ["identifiability.json"], parents=True)
    if not math.isfinite(o.limit) or not math.isfinite(o.threshold):
        places.mistakes.append("--limit, --threshold: infinite; allowed: numbers such as 10 and 1")
    readings = read_all([o.case_file], o.settings, o.volume_policy, places.mistakes)
    places.check()
    return target, folder, with_speeds(readings)[0]


def _write_json(content: object, target: Target, folder: Path | None) -> bool:
    with reporting_write_errors():
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            write_json(content, folder / "identifiability.json")
        return write_json_output(content, target)
