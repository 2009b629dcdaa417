import json
import random
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from eclsim.cases.reading import read_mapping
from eclsim.execution import Distribution, ExecutionError, Executor, Shard, ShardDone
from eclsim.execution import folder as folder_module
from eclsim.files import LOCK, PARTIAL, whole_file
from eclsim.sensitivity import runs as runs_module
from eclsim.sensitivity.analysis import Analysis, SobolSettings, merge_shards, run_analysis, sensitivity
from eclsim.sensitivity.design import Design
from eclsim.sensitivity.failed_region import Condition, FailedRegion, failed_region, percent
from eclsim.sensitivity.inputs import Categorical, Continuous
from eclsim.sensitivity.results import SensitivityResult, indices_of_runs, indices_text
from eclsim.sensitivity.runs import DESIGN, SAMPLES, Runs, SteadyBeatEvaluator
from eclsim.simulation.single import simulate_many
from eclsim.validation.reference_cases import PAPER_PATIENT, reference_model
from known_indices import runs_of

MOMENTS = 50


class Stopped(KeyboardInterrupt):
    """Ctrl-C or a kill, at a moment that a test chooses."""


def run(
    plan: Analysis, folder: Path, until: float | None = None, progress=None, **options
) -> SensitivityResult:
    with Distribution(**options).running() as executor:
        return run_analysis(plan, folder, executor, until=until, progress=progress)


def test_the_samples_hold_inputs_outputs_design_seed_and_version(tmp_path, plan):
    result = run(plan, tmp_path)
    table = pq.read_table(tmp_path / SAMPLES)
    assert table.column_names == [
        "x1",
        "x2",
        "x3",
        "y",
        "square",
        "status",
        "beats",
        "residual",
        "impossible",
    ]
    assert np.array_equal(table.column("y").to_numpy(), result.runs.values[:, 0])
    about = table.schema.metadata[b"eclsim"].decode()
    design = json.loads((tmp_path / DESIGN).read_text())
    for word in ('"seed": 1', '"version"', '"sequence"', '"samples": 4096', design["hash"]):
        assert word in about
    assert sorted(p.name for p in tmp_path.iterdir()) == [DESIGN, SAMPLES]


def interrupted_run(plan: Analysis, folder: Path, monkeypatch, blow: int) -> bool:
    """Run until the `blow`-th chance to be stopped: before, in or after any write, or while computing."""
    chances = iter(range(10**6))

    def maybe_stop():
        if next(chances) == blow:
            raise Stopped

    @contextmanager
    def stopping(path):
        maybe_stop()
        with whole_file(path) as partial:
            yield partial
            maybe_stop()
        maybe_stop()

    def one_by_one(tasks, numbers):
        for number in numbers:
            maybe_stop()
            yield number, tasks.compute(tasks.arguments[number])

    with monkeypatch.context() as patched:
        for module in (folder_module, runs_module):
            patched.setattr(module, "whole_file", stopping)
        try:
            run_analysis(plan, folder, Executor(Distribution(resume=True), one_by_one))
        except Stopped:
            return False
    return True


@pytest.mark.slow
def test_stopped_at_random_moments_and_resumed_gives_the_identical_file(tmp_path, plan, monkeypatch):
    run(plan, tmp_path / "straight")
    expected = (tmp_path / "straight" / SAMPLES).read_bytes()
    chance = random.Random(4)
    stops = attempts = 0
    while stops < MOMENTS:
        attempts += 1
        folder = tmp_path / f"broken-{attempts}"
        while not interrupted_run(plan, folder, monkeypatch, chance.randrange(75)):
            stops += 1
        assert (folder / SAMPLES).read_bytes() == expected
        assert (folder / DESIGN).exists()


def test_stopping_in_threads_keeps_finished_blocks_and_what_is_done_is_not_done_again(tmp_path, plan):
    def stop_at_six(progress):
        if progress.done == 6:
            raise Stopped

    with pytest.raises(Stopped):
        run(plan, tmp_path, progress=stop_at_six)
    assert len(list((tmp_path / "blocks").iterdir())) == 6
    first = []
    resumed = run(plan, tmp_path, resume=True, progress=lambda p: first.append(p.done))
    assert first == list(range(6, 17))
    assert resumed.indices.stored == resumed.indices.evaluations * 6 // 16
    assert run(plan, tmp_path, resume=True).indices.stored == resumed.indices.evaluations


@pytest.mark.parametrize("count", [1, 3, 16, 20])
def test_shards_and_merge_give_the_identical_file(tmp_path, plan, count):
    straight = run(plan, tmp_path / "straight")
    order = list(range(1, count + 1))
    random.Random(count).shuffle(order)
    for number in order:
        with pytest.raises(ShardDone, match=f"shard {number}/{count}: its blocks are in"):
            run(plan, tmp_path / "sharded", shard=Shard(number, count))
    merged = merge_shards(tmp_path / "sharded")
    assert (tmp_path / "sharded" / SAMPLES).read_bytes() == (tmp_path / "straight" / SAMPLES).read_bytes()
    np.testing.assert_array_equal(merged.indices.estimates.ST, straight.indices.estimates.ST)


@pytest.mark.parametrize("damage", ["another block", "a flipped bit"])
def test_a_block_that_is_not_its_own_or_was_damaged_is_refused(tmp_path, plan, damage):
    with pytest.raises(ShardDone):
        run(plan, tmp_path, shard=Shard(1, 2))
    file = tmp_path / "blocks" / "block-00003.parquet"
    content = bytearray(file.read_bytes())
    if damage == "another block":
        content = (tmp_path / "blocks" / "block-00002.parquet").read_bytes()
    else:
        content[len(content) // 3] ^= 4
    file.write_bytes(content)
    said = {
        "another block": "belongs to another task, under a wrong name",
        "a flipped bit": "truncated or edited",
    }
    with pytest.raises(ExecutionError, match=f"block-00003.parquet: {said[damage]}"):
        run(plan, tmp_path, resume=True)


def test_a_merge_names_what_is_missing(tmp_path, plan):
    with pytest.raises(ExecutionError, match=r"holds no analysis \(design.json is missing\)"):
        merge_shards(tmp_path)
    with pytest.raises(ShardDone):
        run(plan, tmp_path, shard=Shard(2, 4))
    with pytest.raises(ExecutionError, match=r"12 of 16 blocks are missing \(0, 1, 2, 3, 8, 9"):
        merge_shards(tmp_path)


def test_a_finished_analysis_goes_on_to_more_rows(tmp_path, plan):
    small = replace(plan, design=replace(plan.design, samples=1024))
    for folder, plans in (("grown", (small, plan)), ("straight", (plan,))):
        for step in plans:
            run(step, tmp_path / folder, resume=True)
    assert (tmp_path / "grown" / SAMPLES).read_bytes() == (tmp_path / "straight" / SAMPLES).read_bytes()


def test_it_stops_once_the_wanted_width_is_reached(tmp_path, plan):
    early = run(plan, tmp_path / "a", until=0.15)
    assert early.design.samples in (256, 512, 1024, 2048)
    assert early.indices.estimates.ST_conf.max() <= 0.15
    assert early.indices.evaluations == early.design.evaluations
    assert early.indices.doubts == ()
    whole = run(plan, tmp_path / "b", until=1e-6)
    assert whole.design.samples == 4096
    (doubt,) = whole.indices.doubts  # it ended without a word
    assert "not to ±1e-06: raise --samples" in doubt


def test_another_analysis_in_the_folder_is_refused_by_name(tmp_path, plan):
    run(plan, tmp_path)
    with pytest.raises(ExecutionError, match="--resume goes on"):
        run(plan, tmp_path)
    other = replace(plan, design=replace(plan.design, seed=2))
    with pytest.raises(ExecutionError, match=r"design\.seed was 1 and is 2"):
        run(other, tmp_path, resume=True)
    assert run(other, tmp_path, force=True).design.seed == 2


def test_a_foreign_or_damaged_block_is_refused(tmp_path, plan):
    other = replace(plan, design=replace(plan.design, seed=2))
    for name, one in (("a", plan), ("b", other)):
        with pytest.raises(ShardDone):
            run(one, tmp_path / name, shard=Shard(1, 16))
    block = tmp_path / "b" / "blocks" / "block-00000.parquet"
    block.write_bytes((tmp_path / "a" / "blocks" / block.name).read_bytes())
    with pytest.raises(ExecutionError, match="belongs to another analysis"):
        run(other, tmp_path / "b", resume=True)
    block.write_bytes(block.read_bytes()[:-20])
    with pytest.raises(ExecutionError, match=r"block-00000.parquet: truncated or edited"):
        run(other, tmp_path / "b", resume=True)
    assert [path.name for path in block.parent.iterdir()] == [block.name], "before anything is computed"


def test_failed_runs_take_their_rows_along_and_are_named(plan):
    design = plan.design
    runs = Runs.joined([plan.block(b) for b in range(design.blocks)])
    values = runs.values.copy()
    status = np.zeros(len(values), dtype=int)
    lost = [3, 5 * design.runs_per_row + 4, 5 * design.runs_per_row + 7, 900 * design.runs_per_row]
    values[lost], status[lost] = np.nan, 2
    broken = replace(runs, values=values, status=status)
    indices = indices_of_runs(design, plan.evaluator.outputs, broken).indices
    assert [f.run for f in indices.failed] == lost
    assert [f.row for f in indices.failed] == [0, 5, 5, 900]
    assert [f.point for f in indices.failed] == ["AB x3", "BA x1", "B", "A"]
    assert {f.status for f in indices.failed} == {"not_converged"}
    assert indices.rows_used == 4093
    assert indices.as_object()["failed"] == 4
    # The same as a design that never had these rows.
    rows = np.delete(values.reshape(4096, design.runs_per_row, 2), [0, 5, 900], axis=0)
    without = runs_of(rows.reshape(-1, 2))
    again = indices_of_runs(design, plan.evaluator.outputs, without).indices
    assert np.array_equal(indices.estimates.ST, again.estimates.ST)


def with_failures(plan: Analysis, failed) -> SensitivityResult:
    """An analysis whose runs failed where a function of the inputs, shape (runs,) each, says so."""
    design = plan.design
    unit = design.unit()
    lost = failed(*(i.table_column(unit[:, k]) for k, i in enumerate(design.inputs)))
    runs = Runs.joined([plan.block(b) for b in range(design.blocks)])
    return indices_of_runs(design, plan.evaluator.outputs, replace(runs, status=np.where(lost, 2, 0)))


def test_it_is_said_where_among_the_inputs_runs_failed(plan):
    """A corner of two of three inputs, -pi to pi: 3 % of the runs."""
    indices = with_failures(plan, lambda x1, x2, x3: (x1 > 2.0) & (x3 < -2.0)).indices
    region = indices.where_failed
    assert region is not None
    first, second = sorted(region.conditions, key=lambda condition: condition.name)
    assert (first.name, first.relation, second.name, second.relation) == ("x1", ">", "x3", "<")
    assert first.limit == pytest.approx(2.0, abs=0.01)
    assert second.limit == pytest.approx(-2.0, abs=0.01)
    assert region.failed == region.of_failed == len(indices.failed)
    assert region.share == pytest.approx(1.0, abs=0.02)
    assert region.share_elsewhere == 0.0
    assert any(f"runs fail mostly where {region.conditions[0]} and" in doubt for doubt in indices.doubts)
    assert indices.as_object()["where_failed"]["conditions"][0]["name"] in ("x1", "x3")


def test_lost_rows_narrow_what_the_indices_describe_and_that_is_said_where_the_indices_are(plan):
    """54 of 128 rows were lost at high speeds, and neither table nor JSON said what the indices describe."""
    indices = with_failures(plan, lambda x1, x2, x3: x1 > 2.9).indices
    said = "the indices describe only the part of the ranges where the case has a steady beat: "
    lost = f"{indices.rows_lost} of 4096 rows are lost, most of them where x1 > 2.9"
    assert 0 < indices.rows_lost == 4096 - indices.rows_used
    assert indices.domain.startswith(said + lost)
    assert f"T{indices.domain[1:]}" in indices_text(indices).splitlines()
    assert indices.as_object()["domain"] == indices.dataset.attrs["domain"] == indices.domain
    assert indices.domain in indices.as_object()["warnings"]
    whole = with_failures(plan, lambda x1, x2, x3: x1 > 4.0).indices
    assert whole.domain == ""
    assert "the indices describe" not in indices_text(whole)


def test_thresholds_and_shares_are_written_as_at_the_bedside():
    """They were "ecmo.speed_rpm > 3.08e+03" and "1e+02 %"."""
    fast, all_there = Condition("ecmo.speed_rpm", ">", 3080.4), (0.9996, 1.0, 0.655, 0.0092, 0.0)
    assert str(fast) == "ecmo.speed_rpm > 3080 rpm"
    assert str(Condition("Emaxlv", "<", 0.46632)) == "Emaxlv < 0.466 mmHg/mL"
    assert [percent(share) for share in all_there] == ["> 99 %", "100 %", "66 %", "0.92 %", "0 %"]
    region = FailedRegion((fast,), 10, 10, 1.0, 0.846)
    assert str(region).endswith("(100 % of the runs there, 85 % elsewhere)")


@pytest.mark.slow
def test_a_case_without_a_steady_beat_of_its_own_is_named_before_its_inputs():
    """All runs failed, and the speed was blamed: "> 3.08e+03 (1e+02 % of the runs there, 85 % elsewhere)"."""
    case = read_mapping(
        {
            "format": 1,
            "patient": {"id": "P", "sex": "male", "age_years": 62, "heart_rate_bpm": 104},
            "ecmo": {"pump": "Rotaflow", "speed_rpm": 4500, "oxygenator": "Quadrox-i Adult", "mode": "VA"},
            "parameters": {"Emaxlv": 0.2, "Emaxrv": 0.1},
        }
    ).case
    settings = SobolSettings(
        samples=4, perturbation_percent=5.0, parameters=("Rmc",), second_order=False, outputs=("MAP",)
    )
    with pytest.raises(ValueError, match="too few are left") as refused:
        sensitivity(case, settings=settings)
    said = str(refused.value)
    assert said.startswith("the case itself has no definite steady beat (one_of_many: valves of the heart")
    assert "runs fail mostly" not in said


def test_runs_that_fail_anywhere_are_not_put_down_to_an_input(plan):
    chance = np.random.default_rng(3)
    indices = with_failures(plan, lambda x1, x2, x3: chance.random(len(x1)) < 0.01).indices
    assert len(indices.failed) > 100
    assert indices.where_failed is None
    assert "no input sets the failed runs apart from the others" in indices.doubts


def test_it_is_said_which_choice_failed():
    inputs = (Continuous("a", 0.0, 1.0), Categorical("scheme", ("p", "q", "r"), (("s", (0.0, 1.0, 2.0)),)))
    design = Design(inputs, 256)
    unit = design.unit()
    a, scheme = (i.table_column(unit[:, k]) for k, i in enumerate(inputs))
    region = failed_region(design, (scheme == "q") & (a > 0.6))
    assert region is not None
    assert {str(condition)[:8] for condition in region.conditions} == {"scheme =", "a > 0.60"}


@pytest.mark.slow
def test_hearts_that_a_fast_pump_shuts_are_where_runs_of_a_patient_fail():
    case = read_mapping(
        {
            "format": 1,
            "patient": {"id": "P", "sex": "male", "age_years": 50, "heart_rate_bpm": 95},
            "ecmo": {
                "pump": "Rotaflow", "speed_rpm": 3600, "oxygenator": "Quadrox-i Adult", "mode": "VA",
                "drainage_fr": 25, "return_fr": 17,
            },
            "parameters": {"Emaxlv": 0.5},
        }
    ).case  # fmt: skip
    settings = SobolSettings(
        samples=64, perturbation_percent=35.0, parameters=("Emaxlv", "Csart", "Edla"),
        include=("ecmo.speed_rpm",), second_order=False, outputs=("MAP",),
    )  # fmt: skip
    result = sensitivity(case, settings=settings)
    region = result.indices.where_failed
    assert region is not None
    assert str(region.conditions[0]).startswith(("Emaxlv <", "ecmo.speed_rpm >"))
    assert region.share > 4.0 * region.share_elsewhere


def test_when_every_row_has_failed_it_says_so(plan):
    result = plan.block(0)
    broken = replace(result, status=np.ones_like(result.status))
    with pytest.raises(ValueError, match="256 of 256 rows have a failed run"):
        indices_of_runs(replace(plan.design, samples=256), plan.evaluator.outputs, broken)


def test_a_steady_beat_of_a_design_takes_one_thread(monkeypatch):
    requests = []

    def spied(function, jobs, parallel=None):
        requests.append(parallel)
        return [function(job) for job in jobs]

    monkeypatch.setattr("eclsim.orbit.steady.in_threads", spied)
    monkeypatch.setattr("eclsim.outputs.steady_beat.in_threads", spied)
    patient = reference_model("cvs_healthy_75bpm")
    evaluator = SteadyBeatEvaluator(patient.circuit, patient.values, ("MAP",), "as_published", resolution=1)
    result = evaluator({"Rmc": np.linspace(0.4, 0.6, 8)}, 8)
    assert np.isfinite(result.values).all()
    assert requests == [1, 1]


@pytest.mark.slow
def test_runs_that_no_patient_can_have_are_counted_and_said():
    """The pump empties a chamber in some runs: they have a steady beat, and the indices rest on them."""
    patient = reference_model(PAPER_PATIENT)
    base = {**patient.values, "ecmo.speed_rpm": 5000.0}
    plan = Analysis(
        Design(
            (Continuous("Rmc", 0.3, 1.5), Continuous("ecmo.speed_rpm", 4000.0, 6000.0)), 4, second_order=False
        ),
        SteadyBeatEvaluator(patient.circuit, base, ("MAP",), "as_published", resolution=1),
    )
    runs = plan.block(0)
    settings = plan.design.settings(plan.design.unit())
    alone = simulate_many(patient, settings, ["MAP"])
    expected = ((alone["impossible"] == 1) & (alone["status"] == "converged")).to_numpy()
    np.testing.assert_array_equal(runs.impossible & (runs.status == 0), expected & (runs.status == 0))
    indices = indices_of_runs(plan.design, ("MAP",), runs).indices
    assert indices.as_object()["impossible"] == indices.impossible > 0
    assert any(f"{indices.impossible} of the runs that count" in text for text in indices.doubts)
    assert not any("no patient" in text for text in replace(indices, impossible=0).doubts)


def test_the_lock_of_a_running_command_outlives_the_blocks(tmp_path, plan):
    """It was deleted with the files of killed processes, so that a second command could begin."""
    lock, left = tmp_path / f"{LOCK}", tmp_path / f"{PARTIAL}12345"
    for path in (lock, left):
        path.write_text("")
    run(plan, tmp_path)
    assert lock.exists()
    assert not left.exists()
