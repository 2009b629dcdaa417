import os
import random
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest

import eclsim.sensitivity.store as store_module
from eclsim.sensitivity.analysis import conclude, run_analysis
from eclsim.sensitivity.evaluation import SteadyBeatEvaluator, evaluate_block
from eclsim.sensitivity.runner import in_threads, run_blocks
from eclsim.sensitivity.store import SAMPLES, Store, StoreError
from eclsim.validation.cases import reference_model

MOMENTS = 50


class Stopped(KeyboardInterrupt):
    """Ctrl-C or a kill, at a moment that a test chooses."""


def test_the_samples_hold_inputs_outputs_design_seed_and_version(tmp_path, plan, open_store):
    store = open_store(tmp_path)
    finished = run_analysis(plan, store)
    table = pq.read_table(tmp_path / SAMPLES)
    assert table.column_names == ["x1", "x2", "x3", "y", "square", "status", "beats", "residual"]
    assert np.array_equal(table.column("y").to_numpy(), finished.found.values[:, 0])
    about = table.schema.metadata[b"eclsim"].decode()
    for word in ('"seed": 1', '"version"', '"sequence"', '"samples": 4096', store.hash):
        assert word in about
    assert sorted(p.name for p in tmp_path.iterdir()) == ["design.json", SAMPLES]


def interrupted_run(folder, plan, open_store, monkeypatch, blow: int) -> bool:
    """Run until the `blow`-th chance to be stopped: before, in or after any write, or while computing."""
    chances = iter(range(10**6))

    def maybe_stop():
        if next(chances) == blow:
            raise Stopped

    real_write = store_module.write_whole

    def write(path, writer):
        def watched(partial):
            writer(partial)
            maybe_stop()

        maybe_stop()
        real_write(path, watched)
        maybe_stop()

    def one_by_one(design, evaluator, blocks):
        for block in blocks:
            maybe_stop()
            yield block, evaluate_block(design, evaluator, block)

    monkeypatch.setattr(store_module, "write_whole", write)
    try:
        run_analysis(plan, open_store(folder, resume=True), execute=one_by_one)
    except Stopped:
        return False
    finally:
        monkeypatch.setattr(store_module, "write_whole", real_write)
    return True


def test_stopped_at_random_moments_and_resumed_gives_the_identical_file(
    tmp_path, plan, open_store, monkeypatch
):
    run_analysis(plan, open_store(tmp_path / "straight"))
    wanted = (tmp_path / "straight" / SAMPLES).read_bytes()
    chance = random.Random(4)
    stops = attempts = 0
    while stops < MOMENTS:
        attempts += 1
        folder = tmp_path / f"broken-{attempts}"
        while not interrupted_run(folder, plan, open_store, monkeypatch, chance.randrange(75)):
            stops += 1
        assert (folder / SAMPLES).read_bytes() == wanted
        assert (folder / "design.json").exists()


def test_what_is_done_is_not_done_again(tmp_path, plan, open_store):
    store = open_store(tmp_path)
    run_blocks(store, plan.evaluator, range(5))
    counted = []

    def counting(design, evaluator, blocks):
        counted.extend(blocks)
        for block in blocks:
            yield block, evaluate_block(design, evaluator, block)

    run_analysis(plan, open_store(tmp_path, resume=True), execute=counting)
    assert counted == list(range(5, 16))


def test_stopping_in_threads_keeps_finished_blocks_and_ends_the_pool(tmp_path, plan, open_store):
    def stop_at_six(progress):
        if progress.done == 6:
            raise Stopped

    with pytest.raises(Stopped):
        run_analysis(plan, open_store(tmp_path), report=stop_at_six)
    assert len(open_store(tmp_path, resume=True).finished()) == 6


@pytest.mark.parametrize("count", [1, 3, 16, 20])
def test_shards_and_merge_give_the_identical_file(tmp_path, plan, open_store, count):
    run_analysis(plan, open_store(tmp_path / "straight"))
    order = list(range(1, count + 1))
    random.Random(count).shuffle(order)
    for shard in order:
        store = open_store(tmp_path / "sharded", resume=True)
        run_blocks(store, plan.evaluator, store.shard(shard, count))
    store = Store.found_in(tmp_path / "sharded")
    store.finish(store.load(range(store.design.blocks)))
    assert (tmp_path / "sharded" / SAMPLES).read_bytes() == (tmp_path / "straight" / SAMPLES).read_bytes()


def test_a_finished_analysis_goes_on_to_more_rows(tmp_path, plan):
    small = replace(plan, design=replace(plan.design, samples=1024))
    for folder, plans in (("grown", (small, plan)), ("straight", (plan,))):
        for step in plans:
            store = Store.of(tmp_path / folder, step.design, step.evaluator)
            store.open(resume=True)
            run_analysis(step, store)
    assert (tmp_path / "grown" / SAMPLES).read_bytes() == (tmp_path / "straight" / SAMPLES).read_bytes()


def test_it_stops_once_the_wanted_width_is_reached(tmp_path, plan, open_store):
    early = run_analysis(plan, open_store(tmp_path / "a"), until=0.15)
    assert early.design.samples in (256, 512, 1024, 2048)
    assert early.indices.estimates.ST_conf.max() <= 0.15
    assert early.indices.evaluations == early.design.evaluations
    whole = run_analysis(plan, open_store(tmp_path / "b"), until=1e-6)
    assert whole.design.samples == 4096


def test_another_analysis_in_the_folder_is_refused_by_name(tmp_path, plan, open_store):
    open_store(tmp_path)
    with pytest.raises(StoreError, match="--resume"):
        open_store(tmp_path)
    other = Store.of(tmp_path, replace(plan.design, seed=2), plan.evaluator)
    with pytest.raises(StoreError, match=r"design\.seed"):
        other.open(resume=True)


def test_a_foreign_block_is_refused(tmp_path, plan, open_store):
    run_blocks(open_store(tmp_path / "a"), plan.evaluator, range(1))
    other = replace(plan.design, seed=2)
    store = Store.of(tmp_path / "b", other, plan.evaluator)
    store.open(resume=False)
    block = "blocks/block-00000.parquet"
    (tmp_path / "b" / block).write_bytes((tmp_path / "a" / block).read_bytes())
    with pytest.raises(StoreError, match="another analysis"):
        store.load(range(1))


def test_failed_runs_take_their_rows_along_and_are_named(plan):
    design = plan.design
    found = [evaluate_block(design, plan.evaluator, b) for b in range(design.blocks)]
    values = np.concatenate([f.values for f in found])
    status = np.zeros(len(values), dtype=int)
    lost = [3, 5 * design.runs_per_row + 4, 5 * design.runs_per_row + 7, 900 * design.runs_per_row]
    values[lost], status[lost] = np.nan, 2
    broken = replace(found[0], values=values, status=status)
    indices = conclude(design, plan.evaluator.outputs, broken).indices
    assert [f.run for f in indices.failed] == lost
    assert [f.row for f in indices.failed] == [0, 5, 5, 900]
    assert [f.point for f in indices.failed] == ["AB x3", "BA x1", "B", "A"]
    assert {f.status for f in indices.failed} == {"not_converged"}
    assert indices.rows_used == 4093
    assert indices.as_object()["failed"] == 4
    # The same as a design that never had these rows.
    rows = np.delete(values.reshape(4096, design.runs_per_row, 2), [0, 5, 900], axis=0)
    without = replace(
        found[0], values=rows.reshape(-1, 2), status=np.zeros(rows.shape[0] * rows.shape[1], int)
    )
    again = conclude(design, plan.evaluator.outputs, without).indices
    assert np.array_equal(indices.estimates.ST, again.estimates.ST)


def test_when_every_row_has_failed_it_says_so(plan):
    found = evaluate_block(plan.design, plan.evaluator, 0)
    broken = replace(found, status=np.ones_like(found.status))
    with pytest.raises(ValueError, match="256 of 256 rows have a failed run"):
        conclude(replace(plan.design, samples=256), plan.evaluator.outputs, broken)


@pytest.mark.parametrize("chosen", [None, "2"])
def test_blocks_run_in_one_thread_each_and_leave_the_environment_alone(plan, chosen, monkeypatch):
    """Also while the results are read one by one, and for what runs beside them."""
    monkeypatch.delenv("ECLSIM_THREADS", raising=False)
    if chosen:
        monkeypatch.setenv("ECLSIM_THREADS", chosen)
    before = dict(os.environ)
    results = in_threads(plan.design, plan.evaluator, list(range(plan.design.blocks)))
    for _ in results:
        assert dict(os.environ) == before
        break
    results.close()
    assert dict(os.environ) == before


def test_a_steady_beat_of_a_design_takes_one_thread(monkeypatch):
    asked = []

    def spied(function, jobs, parallel=None):
        asked.append(parallel)
        return [function(job) for job in jobs]

    monkeypatch.setattr("eclsim.orbit.steady.map_parallel", spied)
    monkeypatch.setattr("eclsim.outputs.evaluation.map_parallel", spied)
    patient = reference_model("cvs_healthy_75bpm")
    evaluator = SteadyBeatEvaluator(patient.circuit, patient.values, ("MAP",), "as_published", 1)
    found = evaluator({"Rmc": np.linspace(0.4, 0.6, 8)}, 8)
    assert np.isfinite(found.values).all()
    assert asked == [1, 1]
