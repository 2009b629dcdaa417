"""What `eclsim sensitivity` does with its options."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eclsim.cli.messages import fail, resumable, say, warn

if TYPE_CHECKING:
    from eclsim.cases import Case
    from eclsim.execution import Distribution, Executor
    from eclsim.sensitivity.analysis import SobolSettings
    from eclsim.sensitivity.results import Indices, SensitivityResult


@dataclass(frozen=True, slots=True)
class Request:
    """The options of the command, as they were written."""

    case_file: str
    out: str | None
    json: str | None
    samples: int
    perturbation: float
    parameters: tuple[str, ...] | None
    include: tuple[str, ...]
    groups: tuple[str, ...]
    outputs: tuple[str, ...] | None
    second_order: bool | None
    seed: int
    states: tuple[str, ...]
    until: float | None
    policy: str | None
    settings: tuple[str, ...]
    shard: str | None
    dask: str | None
    resume: bool
    force: bool
    figures: bool


def run(request: Request) -> int:
    """Run the analysis, or one around each state; returns the number of failed runs."""
    from eclsim.cli.cases import read_all, with_speeds
    from eclsim.execution import ShardDone
    from eclsim.sensitivity.analysis import PRELOAD
    from eclsim.sensitivity.patients import union_over

    distribution = _check(request)
    (reading,) = with_speeds(read_all([request.case_file], request.settings, request.policy))
    results: dict[str, Indices] = {}
    with _mistakes(request), distribution.running(PRELOAD) as executor:
        for state in request.states or ("",):
            settings = _settings(request, reading.case, state)
            if settings.values is not None:
                around = ", ".join(f"{name} = {value:.4g}" for name, value in settings.values.items())
                say(f"{state}: around {around} mmHg s/mL")
            try:
                results[state] = _run_one(request, reading.case, settings, state, executor).indices
            except ShardDone as done:
                say(done)
                return 0
    wanted = bool(request.second_order)
    if not request.states:
        content = results[""].as_object(wanted)
    else:
        union = union_over([r.union() for r in results.values()])
        content = {"states": {s: r.as_object(wanted) for s, r in results.items()}, "union": union}
    _hand_over(request, content, results)
    return sum(len(r.failed) for r in results.values())


def merge(request: Request) -> int:
    """Finish an analysis whose shards are all there."""
    from eclsim.sensitivity.analysis import merge_shards

    if request.out is None:
        fail("merge: --out DIR names the folder of the shards")
    with _mistakes(request), resumable(request.out):
        result = merge_shards(Path(request.out))
    _write_files(request, Path(request.out), result)
    _hand_over(request, result.indices.as_object(bool(request.second_order)), {"": result.indices})
    return len(result.indices.failed)


@contextmanager
def _mistakes(request: Request) -> Iterator[None]:
    """Say what cannot be, and leave with the exit status of bad input."""
    from eclsim.execution import ExecutionError
    from eclsim.sensitivity.inputs import InputError

    try:
        yield
    except InputError as error:
        fail(*error.mistakes)
    except (ExecutionError, ValueError) as error:
        fail(error)
    except BrokenPipeError:
        raise
    except OSError as error:
        fail(f"{error.filename or request.out}: {error.strerror or error}")


def _check(request: Request) -> Distribution:
    from eclsim.cli.output_option import over_input

    wrong = over_input("--json", request.json, (request.case_file,))
    if request.out is None and (request.resume or request.shard):
        wrong.append("--resume and --shard need --out DIR")
    if request.out is not None and Path(request.out).exists() and not Path(request.out).is_dir():
        wrong.append(f"--out {request.out}: a file; a folder belongs here")
    if request.shard and (request.until is not None or request.states):
        wrong.append("--shard: without --until and --states, which look at all runs")
    distribution = _distribution(request, wrong)
    if request.until is not None and not 0.0 < request.until < math.inf:
        wrong.append(f"--until {request.until:g}: allowed: above 0, such as 0.02")
    if (
        request.json not in (None, "-")
        and Path(request.json).exists()
        and not (request.force or request.resume)
    ):
        wrong.append(f"--json {request.json}: exists already; --force overwrites it")
    if request.json not in (None, "-") and not Path(request.json).absolute().parent.is_dir():
        wrong.append(f"--json {request.json}: the folder does not exist")
    if wrong:
        fail(*wrong)
    return distribution


def _distribution(request: Request, wrong: list[str]) -> Distribution:
    from eclsim.execution import Distribution, ExecutionError, Shard

    try:
        shard = Shard.parse(request.shard) if request.shard else None
        return Distribution(dask=request.dask, shard=shard, resume=request.resume, force=request.force)
    except ExecutionError as error:
        wrong.append(str(error))
        return Distribution()


def _settings(request: Request, case: Case, state: str) -> SobolSettings:
    from eclsim.orbit.model import model_of
    from eclsim.sensitivity.analysis import SobolSettings
    from eclsim.sensitivity.patients import state_values

    return SobolSettings(
        samples=request.samples,
        perturbation_percent=request.perturbation,
        parameters=request.parameters,
        include=request.include,
        groups=request.groups,
        outputs=request.outputs,
        seed=request.seed,
        second_order=request.second_order is not False,
        values=state_values(model_of(case), state, case.volume_policy) if state else None,
        until=request.until,
    )


def _run_one(
    request: Request, case: Case, settings: SobolSettings, state: str, executor: Executor
) -> SensitivityResult:
    from eclsim.sensitivity.analysis import sensitivity

    with resumable(request.out), _folder(request, state) as folder, _progress() as report:
        result = sensitivity(case, settings=settings, folder=folder, distribution=executor, progress=report)
        if request.out is not None:
            _write_files(request, folder, result)
        return result


@contextmanager
def _folder(request: Request, state: str) -> Iterator[Path]:
    if request.out is not None:
        folder = Path(request.out) / state
        folder.mkdir(parents=True, exist_ok=True)
        yield folder
        return
    with tempfile.TemporaryDirectory(prefix="eclsim-") as name:
        yield Path(name)


@contextmanager
def _progress() -> Iterator[Any]:
    """A bar on a terminal; elsewhere a line on standard error about every ten seconds."""
    import sys

    if not sys.stderr.isatty():
        yield _Lines().report
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("blocks"))
    left = TextColumn("{task.fields[left]}")
    with Progress(*columns, TimeElapsedColumn(), left, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("sensitivity", total=None, left="")

        def report(p: Any) -> None:
            bar.update(
                task, completed=p.done, total=p.total, left="" if p.left is None else f"{p.left:.0f} s left"
            )

        yield report


class _Lines:
    """Progress in lines."""

    def __init__(self) -> None:
        self.said = 0.0

    def report(self, progress: Any) -> None:
        """Say it, unless it was said a moment ago."""
        if progress.seconds - self.said >= 10.0:
            self.said = progress.seconds
            say(progress)


def _write_files(request: Request, folder: Path, result: SensitivityResult) -> None:
    from eclsim.sensitivity.results import write_results

    write_results(folder, result)
    if request.figures:
        from eclsim.sensitivity.figures import write_sensitivity_figures

        write_sensitivity_figures(result, folder / "figures")


def _hand_over(request: Request, content: dict[str, Any], results: dict[str, Indices]) -> None:
    from eclsim.files import write_json

    for state, indices in results.items():
        warn(_about_failures(indices, state))
    if request.json == "-":
        write_json(content, "-")
        return
    from eclsim.cli.sensitivity_tables import show, show_pairs

    if request.json is not None:
        write_json(content, request.json)
    for state, indices in results.items():
        show(indices, state)
        if request.second_order:
            show_pairs(indices)


def _about_failures(indices: Indices, state: str) -> list[str]:
    if not indices.failed:
        return []
    kinds = ", ".join(sorted({f.status for f in indices.failed}))
    lost = indices.samples - indices.rows_used
    said = f"{len(indices.failed)} of {indices.evaluations} runs failed ({kinds}); {lost} rows are left out"
    return [f"{state + ': ' if state else ''}{said}"]
