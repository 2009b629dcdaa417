"""What `eclsim sensitivity` does with its options."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eclsim.cli.messages import fail, resumable, say, warn

if TYPE_CHECKING:
    from eclsim.cases import Case
    from eclsim.sensitivity.analysis import Analysis, Finished
    from eclsim.sensitivity.indices import Indices
    from eclsim.sensitivity.runner import Executor


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
    from eclsim.sensitivity.states import union_over

    _check(request)
    (reading,) = with_speeds(read_all([request.case_file], request.settings, request.policy))
    results: dict[str, Indices] = {}
    with _executor(request) as execute:
        plans = {state: _plan(request, reading.case, state) for state in request.states or ("",)}
        for state, plan in plans.items():
            if state:
                say(f"{state}: {_around(plan)}")
            finished = _run_one(request, plan, state, execute)
            if finished is not None:
                results[state] = finished.indices
    if not results:
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
    from eclsim.sensitivity.analysis import conclude
    from eclsim.sensitivity.store import Store, StoreError

    if request.out is None:
        fail("merge: --out DIR names the folder of the shards")
    try:
        store = Store.found_in(Path(request.out))
        missing = sorted(set(range(store.design.blocks)) - store.finished())
        if missing:
            shown = ", ".join(map(str, missing[:10])) + (" ..." if len(missing) > 10 else "")
            said = f"{len(missing)} of {store.design.blocks} blocks are missing ({shown})"
            fail(f"{request.out}: {said}; run their shards, or --resume without --shard")
        with resumable(request.out):
            found = store.load(range(store.design.blocks))
            finished = conclude(store.design, store.outputs, found)
            store.finish(found)
    except (StoreError, ValueError) as error:
        fail(error)
    _write_files(request, Path(request.out), finished)
    _hand_over(request, finished.indices.as_object(bool(request.second_order)), {"": finished.indices})
    return len(finished.indices.failed)


def _check(request: Request) -> None:
    from eclsim.cli.output_option import over_input

    wrong = over_input("--json", request.json, (request.case_file,))
    if request.out is None and (request.resume or request.shard):
        wrong.append("--resume and --shard need --out DIR")
    if request.out is not None and Path(request.out).exists() and not Path(request.out).is_dir():
        wrong.append(f"--out {request.out}: a file; a folder belongs here")
    if request.shard and (request.until is not None or request.states):
        wrong.append("--shard: without --until and --states, which look at all runs")
    if request.resume and request.force:
        wrong.append("--resume keeps what is there and --force throws it away: one of them")
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
    if request.shard and _shard(request.shard) is None:
        wrong.append(f"--shard {request.shard}: allowed: i/n with i from 1 to n, such as 3/16")
    if wrong:
        fail(*wrong)


def _shard(text: str) -> tuple[int, int] | None:
    number, _, count = text.partition("/")
    if not (text.isascii() and number.isdigit() and count.isdigit() and 1 <= int(number) <= int(count)):
        return None
    return int(number), int(count)


def _plan(request: Request, case: Case, state: str) -> Analysis:
    from eclsim.orbit.model import model_of
    from eclsim.sensitivity.analysis import plan_analysis
    from eclsim.sensitivity.case_inputs import CARDIOVASCULAR, InputError
    from eclsim.sensitivity.design import DesignError
    from eclsim.sensitivity.states import StateError, state_values

    try:
        values = state_values(model_of(case), state, case.volume_policy) if state else None
        return plan_analysis(
            case,
            samples=request.samples,
            perturbation_percent=request.perturbation,
            parameters=CARDIOVASCULAR if request.parameters is None else request.parameters,
            include=request.include,
            groups=request.groups,
            outputs=request.outputs,
            seed=request.seed,
            second_order=request.second_order is not False,
            values=values,
        )
    except InputError as error:
        fail(*error.mistakes)
    except (DesignError, StateError) as error:
        fail(error)


def _around(plan: Analysis) -> str:
    from eclsim.sensitivity.states import ADJUSTED

    return f"around {ADJUSTED} = {getattr(plan.evaluator, 'base')[ADJUSTED]:.4g} mmHg s/mL"  # noqa: B009  # Evaluator


def _run_one(request: Request, plan: Analysis, state: str, execute: Executor | None) -> Finished | None:
    """One analysis; None for a shard, which has no indices of its own."""
    from eclsim.sensitivity.analysis import run_analysis
    from eclsim.sensitivity.distributed import UnreachableError
    from eclsim.sensitivity.runner import run_blocks
    from eclsim.sensitivity.store import Store, StoreError

    shard = _shard(request.shard) if request.shard else None
    try:
        with resumable(request.out), _folder(request, state) as folder, _progress() as report:
            store = Store.of(folder, plan.design, plan.evaluator)
            store.open(request.resume or shard is not None, request.force and shard is None)
            if shard is not None:
                run_blocks(store, plan.evaluator, store.shard(*shard), execute, report)
                return None
            finished = run_analysis(plan, store, until=request.until, execute=execute, report=report)
            if request.out is not None:
                _write_files(request, folder, finished)
            return finished
    except (StoreError, UnreachableError, ValueError) as error:
        fail(error)
    except OSError as error:
        fail(f"{error.filename or request.out}: {error.strerror or error}")


@contextmanager
def _executor(request: Request) -> Iterator[Executor | None]:
    if request.dask is None:
        yield None
        return
    from eclsim.sensitivity.distributed import MissingDaskError, on_dask

    with ExitStack() as stack:
        try:
            execute = stack.enter_context(on_dask(request.dask))
        except MissingDaskError as error:
            fail(error)
        yield execute


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
            bar.update(task, completed=p.done, total=p.total, left=f"{p.left:.0f} s left")

        yield report


class _Lines:
    """Progress in lines."""

    def __init__(self) -> None:
        self.said = 0.0

    def report(self, progress: Any) -> None:
        """Say it, unless it was said a moment ago."""
        if progress.seconds - self.said >= 10.0:
            self.said = progress.seconds
            say(f"sensitivity: {progress.done} of {progress.total} blocks, {progress.left:.0f} s left")


def _write_files(request: Request, folder: Path, finished: Finished) -> None:
    from eclsim.sensitivity.convergence import convergence
    from eclsim.sensitivity.tables import write_results

    settled = convergence(finished)
    write_results(folder, finished.indices, settled)
    if request.figures:
        from eclsim.sensitivity.figures import write_sensitivity_figures

        write_sensitivity_figures(finished.indices, folder / "figures", finished.values, settled)


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
