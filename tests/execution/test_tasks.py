"""The executor alone, on a function that is quickly computed."""

import json
import os
import random
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from eclsim.execution import (
    Distribution,
    ExecutionError,
    Shard,
    ShardDone,
    TaskFolder,
    TaskProgress,
    Tasks,
    announce,
    json_format,
    threads,
    using_threads,
)
from eclsim.execution.distribution import _client


@dataclass(frozen=True)
class Answer:
    number: int
    root: float
    names: tuple[str, ...]


def answer(number: int) -> Answer:
    announce(f"looking at {number}")
    time.sleep(0.001 * (number % 3))
    return Answer(number, number**0.5 if number != 7 else float("nan"), (str(number), "ü"))


def slow_answer(number: int) -> Answer:
    time.sleep(0.2)
    return answer(number)


@dataclass(frozen=True)
class DyingOnce:
    """Computes answers; the process that computes the sixth ends once."""

    mark: Path

    def __call__(self, number: int) -> Answer:
        if number == 5 and not self.mark.exists():
            self.mark.touch()
            os._exit(1)
        return answer(number)


def thread_count(_: int) -> int:
    return threads()


FORMAT = json_format(Answer)
TASKS = Tasks("roots", "numbers", answer, range(12), {"kind": "root", "over": {"first": 0, "last": 11}})


class Stopped(KeyboardInterrupt):
    """Ctrl-C at a moment that a test chooses."""


def complete(folder: Path | None, tasks=TASKS, progress=None, **options) -> list[Answer]:
    with Distribution(**options).running() as executor:
        return executor.complete(tasks, folder, FORMAT, progress)


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.parametrize("side_by_side", [False, True])
@pytest.mark.parametrize("workers", [1, 3])
def test_results_and_files_are_the_same_whatever_the_number_of_threads(tmp_path, side_by_side, workers):
    tasks = replace(TASKS, side_by_side=side_by_side)
    results = complete(tmp_path / "kept", tasks, workers=workers)
    assert repr(results) == repr([answer(k) for k in range(12)]) == repr(complete(None, tasks))
    complete(tmp_path / "again")
    assert files(tmp_path / "kept") == files(tmp_path / "again")


def dask_cluster(**options):
    """A Dask cluster on this machine, without its page."""
    distributed = pytest.importorskip("dask.distributed")
    return distributed.LocalCluster(dashboard_address=None, **options)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Dask's own clean-up, whose sockets and loops close late
def test_dask_gives_the_same_files_and_one_thread_to_a_task(tmp_path):
    complete(tmp_path / "here")
    workers = dask_cluster(n_workers=1, threads_per_worker=2, processes=False)
    with workers as cluster, Distribution(dask=cluster.scheduler_address).running() as executor:
        executor.complete(TASKS, tmp_path / "there", FORMAT)
        counting = Tasks("threads", "numbers", thread_count, range(3))
        assert executor.complete(counting, None, json_format(int)) == [1, 1, 1]
    assert files(tmp_path / "here") == files(tmp_path / "there")


def test_an_address_without_a_scheduler_says_what_is_allowed():
    pytest.importorskip("dask.distributed")
    with pytest.raises(ExecutionError, match="allowed: local, tcp://"):
        complete(None, dask="nonsense")


@pytest.mark.filterwarnings("ignore")  # of Dask's own clean-up, whose sockets and loops close late
def test_a_scheduler_without_workers_says_how_to_start_one(tmp_path, monkeypatch):
    """Dask's time-out was called a folder that cannot be written."""
    monkeypatch.setattr("eclsim.execution.distribution.FIRST_WORKER_SECONDS", 0.2)
    with dask_cluster(n_workers=0, processes=False) as cluster:
        address = cluster.scheduler_address
        with pytest.raises(ExecutionError, match=f"no workers after 0.2 s: .*dask worker {address}"):
            complete(tmp_path, dask=address)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Dask's own clean-up, whose sockets and loops close late
def test_a_scheduler_that_ends_is_named_and_what_was_done_is_kept(tmp_path):
    config = pytest.importorskip("dask").config
    with (
        config.set({"distributed.comm.timeouts.connect": "1s"}),
        dask_cluster(n_workers=1, threads_per_worker=1, processes=False) as cluster,
    ):

        def end(progress: TaskProgress) -> None:
            if progress.done == 2:
                cluster.sync(cluster.scheduler.close)

        slow = replace(TASKS, compute=slow_answer)
        with pytest.raises(ExecutionError, match="the scheduler ended, or its connection was lost"):
            complete(tmp_path / "kept", slow, end, dask=cluster.scheduler_address)
    assert len(files(tmp_path / "kept")) >= 3
    complete(tmp_path / "kept", resume=True)
    complete(tmp_path / "whole")
    assert files(tmp_path / "kept") == files(tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Dask's own clean-up, whose sockets and loops close late
def test_a_worker_that_dies_is_replaced(tmp_path):
    """What was scattered to the only worker died with it, and the run ended."""
    complete(tmp_path / "here")
    tasks = replace(TASKS, compute=DyingOnce(tmp_path / "died"))
    with dask_cluster(n_workers=1, threads_per_worker=1) as cluster:
        complete(tmp_path / "there", tasks, dask=cluster.scheduler_address)
    assert (tmp_path / "died").exists()
    assert files(tmp_path / "here") == files(tmp_path / "there")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Dask's own clean-up, whose sockets and loops close late
def test_a_run_whose_workers_are_all_gone_says_so_and_goes_on_with_the_next(tmp_path, monkeypatch):
    """It waited for ever, and the last line was the time left."""
    monkeypatch.setattr("eclsim.execution.distribution.SECONDS_BETWEEN_LOOKS", 0.1)
    lines: list[str] = []
    with dask_cluster(n_workers=1, threads_per_worker=1, processes=False) as cluster:

        def lose_the_worker(progress: TaskProgress) -> None:
            lines.append(str(progress))
            if progress.done == 2 and not progress.detail:
                cluster.scale(0)
            elif "no worker is left" in progress.detail:
                cluster.scale(1)

        slow = replace(TASKS, compute=slow_answer)
        complete(tmp_path / "there", slow, lose_the_worker, dask=cluster.scheduler_address)
        waiting = f"; no worker is left, waiting for others (dask worker {cluster.scheduler_address})"
    assert any(line.endswith(waiting) for line in lines)
    complete(tmp_path / "here")
    assert files(tmp_path / "here") == files(tmp_path / "there")


def test_local_workers_that_do_not_start_are_an_error_of_their_own_and_hide_no_other(tmp_path, monkeypatch):
    """Ctrl-C while they started ended in a traceback of Dask, as if the command had failed."""
    pytest.importorskip("dask.distributed")

    def no_cluster(*_):
        raise RuntimeError("Nanny failed to start.")

    monkeypatch.setattr("eclsim.execution.distribution._local_cluster", no_cluster)
    monkeypatch.setattr("eclsim.execution.distribution._start_fork_server", lambda _: "spawn")
    with pytest.raises(ExecutionError, match=r"--dask local: workers cannot be started \(Nanny failed"):
        complete(tmp_path, dask="local")
    with pytest.raises(Stopped), Distribution(dask="local").running():
        raise Stopped


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ExecutionError, match=r"pip install 'eclsim\[dask\]'"):
        complete(None, dask="local")


@pytest.mark.parametrize("count", [1, 5, 12, 30])
def test_shards_in_any_order_and_a_merge_are_one_run(tmp_path, count):
    whole = complete(tmp_path / "whole")
    order = list(range(1, count + 1))
    random.Random(count).shuffle(order)
    for number in order:
        with pytest.raises(ShardDone, match=f"shard {number}/{count}: its numbers are in"):
            complete(tmp_path / "shards", shard=Shard(number, count))
    assert repr(complete(tmp_path / "shards", merge=True)) == repr(whole)
    assert files(tmp_path / "shards") == files(tmp_path / "whole")


def test_a_merge_computes_nothing_and_names_what_is_missing(tmp_path):
    with pytest.raises(ExecutionError, match=r"holds no shards \(inputs.json is missing\)"):
        complete(tmp_path / "none", merge=True)
    with pytest.raises(ShardDone):
        complete(tmp_path, shard=Shard(2, 3))
    with pytest.raises(ExecutionError, match=r"roots: 8 of 12 numbers are missing \(0, 1, 2, 3, 8"):
        complete(tmp_path, merge=True)
    with pytest.raises(ExecutionError, match=r"8 of 12 .* missing \(--shard 1/3, --shard 3/3\); run"):
        complete(tmp_path, merge=True, merged_shards=3)


@pytest.mark.parametrize("side_by_side", [False, True])
def test_stopped_at_any_moment_and_resumed_gives_the_same_files_and_repeats_nothing(tmp_path, side_by_side):
    complete(tmp_path / "whole")
    seen = []

    def stop_at(last: int):
        def progress(state):
            seen.append((state.done, state.total))
            if state.done == last and not state.detail:
                raise Stopped

        return progress

    tasks = replace(TASKS, side_by_side=side_by_side)
    for last in (3, 4, 9):
        with pytest.raises(Stopped):
            complete(tmp_path / "broken", tasks, stop_at(last), resume=True)
        assert len(files(tmp_path / "broken")) == 1 + last
    complete(tmp_path / "broken", tasks, stop_at(99), resume=True)
    assert seen[-1] == (12, 12)
    assert files(tmp_path / "broken") == files(tmp_path / "whole")
    seen.clear()
    complete(tmp_path / "broken", tasks, stop_at(99), resume=True)
    assert seen == [(12, 12)]


def test_a_stop_does_not_wait_for_what_is_running(tmp_path):
    """Nobody would store it: a command went on for two minutes after Ctrl-C."""
    released = threading.Event()

    def held(number: int) -> Answer:
        if number > 1:
            released.wait(20.0)
        return answer(number)

    def stop(progress: TaskProgress) -> None:
        if progress.done == 2:
            raise Stopped

    started = time.monotonic()
    try:
        with pytest.raises(Stopped):
            complete(tmp_path, replace(TASKS, compute=held, side_by_side=True), stop, workers=3)
        assert time.monotonic() - started < 10.0
    finally:
        released.set()
    assert files(tmp_path).keys() == {"inputs.json", "00000.json", "00001.json"}


def test_the_time_left_goes_down_while_a_task_reports(tmp_path, monkeypatch):
    """Details of a running task showed what was left when the last one had ended."""
    clock = iter(float(k) for k in range(100))
    monkeypatch.setattr("eclsim.execution.tasks.time.perf_counter", lambda: next(clock))
    shown: list[tuple[float | None, str]] = []

    def reports(number: int) -> Answer:
        for step in range(4):
            announce(f"step {step}")
        return answer(number)

    tasks = replace(TASKS, compute=reports, arguments=range(2))
    complete(tmp_path, tasks, lambda state: shown.append((state.left, state.detail)), workers=1)
    left = [left for left, detail in shown if detail.startswith("step") and left is not None]
    assert left == sorted(left, reverse=True)
    assert left[0] - left[-1] == 3.0
    assert min(left) >= 0.0


def test_more_shards_than_tasks_are_remarked_on_at_the_start(tmp_path):
    remarks: list[str] = []
    with pytest.raises(ShardDone):
        complete(tmp_path, shard=Shard(1, 20), remark=remarks.append)
    with pytest.raises(ShardDone):
        complete(tmp_path, shard=Shard(20, 20), remark=remarks.append)
    line = "roots: more shards (20) than numbers (12): 8 of the shards have nothing to do"
    assert remarks == [f"{line}, as this one", line]
    with pytest.raises(ShardDone):
        complete(tmp_path, shard=Shard(1, 12), remark=remarks.append)
    assert len(remarks) == 2


def test_resuming_with_other_inputs_names_what_differs(tmp_path):
    complete(tmp_path)
    with pytest.raises(ExecutionError, match="holds results already; --resume goes on, --force starts anew"):
        complete(tmp_path)
    other = replace(TASKS, inputs={"kind": "root", "over": {"first": 1, "last": 11}, "more": [1]})
    for options in ({"resume": True}, {"shard": Shard(1, 2)}, {"merge": True}):
        with pytest.raises(ExecutionError, match=r"\(more; over.first was 0 and is 1\); choose another"):
            complete(tmp_path, other, **options)
    assert len(complete(tmp_path, other, force=True)) == 12
    several = replace(other, inputs=dict(other.inputs) | {"more": [2]})
    with pytest.raises(ExecutionError, match=r"\(more\[1\] was 1 and is 2\); choose another"):
        complete(tmp_path, several, resume=True)
    one, another = (replace(TASKS, inputs={"events": digit * 16}) for digit in "ab")
    complete(tmp_path / "digests", one)
    with pytest.raises(ExecutionError, match=r"other inputs \(events\); choose another"):
        complete(tmp_path / "digests", another, resume=True)


def test_another_version_is_refused(tmp_path):
    complete(tmp_path)
    file = tmp_path / "inputs.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"version": "0.0.1"}))
    with pytest.raises(ExecutionError, match=r"version was '0\.0\.1' and is"):
        complete(tmp_path, resume=True)
    file.write_text("{")
    with pytest.raises(ExecutionError, match=r"inputs.json: cannot be read"):
        complete(tmp_path, resume=True)


@pytest.mark.parametrize("damage", ["cut", "edited", "of other inputs"])
def test_a_damaged_result_is_refused_before_anything_is_computed(tmp_path, damage):
    with pytest.raises(ShardDone):
        complete(tmp_path, shard=Shard(1, 2))
    file = tmp_path / "00003.json"
    text = file.read_text()
    changed = {"cut": text[:-9], "edited": text.replace("1.7320", "1.8320")}
    changed["of other inputs"] = text.replace(json.loads(text)["hash"], "0" * 16)
    file.write_text(changed[damage])
    with pytest.raises(ExecutionError, match=r"00003\.json: .*remove it"):
        complete(tmp_path, resume=True)
    assert not (tmp_path / "00011.json").exists()
    file.unlink()
    assert len(complete(tmp_path, resume=True)) == 12


def test_a_result_under_the_name_of_another_task_is_not_taken_for_its(tmp_path):
    with pytest.raises(ShardDone):
        complete(tmp_path, shard=Shard(1, 2))
    file = tmp_path / "00008.json"
    file.write_bytes((tmp_path / "00002.json").read_bytes())
    with pytest.raises(
        ExecutionError, match=r"00008\.json: belongs to another task, under a wrong name; remove it"
    ):
        complete(tmp_path, resume=True)
    file.unlink()
    assert repr(complete(tmp_path, resume=True)) == repr([answer(k) for k in range(12)])


def test_files_of_other_names_are_no_results_and_stay(tmp_path):
    with pytest.raises(ShardDone):
        complete(tmp_path, shard=Shard(1, 2))
    copies = [tmp_path / "00008 (conflicted copy).json", tmp_path / "2024-notes.json"]
    for copy in copies:
        copy.write_text("{}")
    assert len(complete(tmp_path, resume=True)) == 12
    assert len(complete(tmp_path, force=True)) == 12
    assert all(copy.exists() for copy in copies)


@dataclass(frozen=True)
class Slow:
    """A task that is still running when somebody else asks for one of the same name."""

    factor: int

    def __call__(self, number: int) -> int:
        time.sleep(0.2)
        return self.factor * number


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Dask's own clean-up, whose sockets and loops close late
def test_two_analyses_on_one_scheduler_get_their_own_results(tmp_path):
    results = {}

    def run(factor: int) -> None:
        with Distribution(dask=cluster.scheduler_address).running() as executor:
            tasks = Tasks("products", "numbers", Slow(factor), range(5))
            results[factor] = executor.complete(tasks, None, json_format(int))

    workers = dask_cluster(n_workers=1, threads_per_worker=1, processes=False)
    with workers as cluster, ThreadPoolExecutor(2) as pool:
        list(pool.map(run, (1, 100)))
    assert results == {1: [0, 1, 2, 3, 4], 100: [0, 100, 200, 300, 400]}


@pytest.mark.filterwarnings("ignore")  # of Dask's own clean-up, whose sockets and loops close late
def test_what_else_runs_in_a_process_is_not_sent_to_the_scheduler_of_an_analysis():
    """Where two were at work and the first ended first, no NetCDF file could be written any more."""
    dask = pytest.importorskip("dask")
    workers = dask_cluster(n_workers=1, threads_per_worker=1, processes=False)
    with workers as cluster:
        analyses = [_client(cluster.scheduler_address) for _ in range(2)]
        assert dask.config.get("scheduler", None) is None
        for client in analyses:
            client.close()
        assert dask.config.get("scheduler", None) is None


def test_progress_counts_and_shows_what_a_task_says():
    lines = []
    complete(None, progress=lambda state: lines.append(str(state)))
    assert lines[0] == "roots: 0 of 12 numbers"
    assert lines[1] == "roots: 0 of 12 numbers; looking at 0"
    assert lines[-1] == "roots: 12 of 12 numbers, 0 s left"


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "a/b", "1/0", "-1/3", "²/3"])
def test_a_shard_that_cannot_be_says_what_is_allowed(text):
    with pytest.raises(ExecutionError, match="allowed: k/n with k from 1 to n, such as 3/16"):
        Shard.parse(text)


def test_the_shards_of_a_count_share_all_tasks():
    for total in (1, 7, 50):
        for count in (1, 3, 8, 60):
            numbers = [n for k in range(count) for n in Shard.parse(f"{k + 1}/{count}").numbers(total)]
            assert numbers == list(range(total))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"resume": True, "force": True}, "one of them"),
        ({"shard": Shard(1, 2), "force": True}, "--shard keeps what the others did"),
        ({"workers": 0}, "--workers 0: allowed: 1, 2, 3"),
    ],
)
def test_options_that_contradict_each_other(options, message):
    with pytest.raises(ExecutionError, match=message):
        Distribution(**options)


def test_a_shard_without_a_folder_has_nowhere_to_leave_its_results():
    with pytest.raises(ExecutionError, match="need a folder"):
        complete(None, shard=Shard(1, 2))


@pytest.mark.parametrize("wanted", [None, "2"])
def test_tasks_side_by_side_have_one_thread_each_and_leave_the_environment_alone(monkeypatch, wanted):
    monkeypatch.delenv("ECLSIM_THREADS", raising=False)
    if wanted:
        monkeypatch.setenv("ECLSIM_THREADS", wanted)
    before = dict(os.environ)
    tasks = Tasks("threads", "numbers", thread_count, range(6), side_by_side=True)
    with Distribution().running() as executor:
        for _, count in executor.run(tasks, range(6)):
            assert count == 1
            assert dict(os.environ) == before
            assert threads() == (2 if wanted else len(os.sched_getaffinity(0)))


def test_the_innermost_number_of_threads_counts(monkeypatch):
    monkeypatch.setenv("ECLSIM_THREADS", "5")
    with using_threads(3):
        with using_threads(2), using_threads(None):
            assert threads() == 2
        assert threads() == 3
    assert threads() == 5
    with Distribution(workers=4).running():
        assert threads() == 4


def test_leftovers_of_a_kill_are_no_results(tmp_path):
    complete(tmp_path)
    (tmp_path / ".eclsim-xyz.json").write_text("{")
    assert TaskFolder(tmp_path, TASKS.inputs, FORMAT).finished() == set(range(12))
    assert len(complete(tmp_path, resume=True)) == 12
