"""Shards of a command and their merge, as the command line has them."""

import json
from pathlib import Path

import pytest

from eclsim.cases.fit_mark import with_mark
from eclsim.files import json_text
from eclsim.paper.cohort import SYNTHETIC
from eclsim.paper.report import as_object
from eclsim.paper.reproduction import ReproductionSettings, reproduce
from eclsim.sensitivity.runs import SteadyBeatEvaluator

CASE_OPTIONS = (
    "--samples", 256, "--parameters", "Rmc", "--outputs", "MAP", "--no-second-order", "--no-figures",
)  # fmt: skip


def are_shards_recorded(folder: Path) -> bool:
    return "shards" in json.loads((folder / "command.json").read_text())


@pytest.mark.slow
def test_merge_finishes_the_command_of_the_shards(shell):
    case, out = shell.case(), shell.folder / "out"
    assert shell.run("sensitivity", case, *CASE_OPTIONS, "--json", shell.folder / "one.json").exit_code == 0
    for shard in ("2/2", "1/2"):
        result = shell.run("sensitivity", case, *CASE_OPTIONS, "--out", out, "--shard", shard)
        assert result.exit_code == 0
        assert f"when all shards are done: eclsim merge {out}" in result.stderr
    assert shell.run("merge", out, "--json", shell.folder / "two.json").exit_code == 0
    one, two = (json.loads((shell.folder / f"{name}.json").read_text()) for name in ("one", "two"))
    assert one.pop("seconds") != 0
    assert two.pop("seconds") is None, "the time of the shards is not known"
    assert one == two
    assert "holds no shards" in shell.run("merge", out).stderr


def test_a_doubtful_fit_is_said_once_of_indices(shell):
    """The second line called it one of the values varied around."""
    file = Path(shell.case())
    file.write_text(with_mark(file.read_text(), "doubtful", "why"))
    done = shell.run("sensitivity", file, "--samples", "2", "--parameters", "Rmc", "--json", "-")
    assert json.loads(done.stdout)["warnings"][0].startswith("its parameters are a DOUBTFUL fit")
    assert done.stderr.count("DOUBTFUL fit") == 1


def test_merge_names_what_is_missing(shell):
    case, out = shell.case(), shell.folder / "out"
    assert "holds no shards (none are recorded in command.json)" in shell.run("merge", shell.folder).stderr
    assert shell.run("sensitivity", case, *CASE_OPTIONS, "--out", out, "--shard", "1/2").exit_code == 0
    result = shell.run("merge", out)
    assert result.exit_code == 2
    assert "1 of 1 blocks are missing (--shard 2/2); run their shards" in result.stderr
    assert (out / "command.json").exists(), "the missing shard may still come"


@pytest.mark.parametrize("stopped", [KeyboardInterrupt(), SystemExit(143)])
def test_a_shard_that_was_stopped_leaves_what_a_merge_needs(shell, monkeypatch, stopped):
    """Only a shard that ended left its command, so a merge said that no shard had been run."""
    case, out = shell.case(), shell.folder / "out"
    evaluate = SteadyBeatEvaluator.__call__

    def stop_in_the_second_block(evaluator, settings, count):
        if list(out.glob("blocks/*.parquet")):
            raise stopped
        return evaluate(evaluator, settings, count)

    monkeypatch.setattr("eclsim.sensitivity.design.RUNS_PER_BLOCK", 384)
    monkeypatch.setattr(SteadyBeatEvaluator, "__call__", stop_in_the_second_block)
    shard = ("sensitivity", case, *CASE_OPTIONS, "--workers", 1, "--out", out, "--shard", "1/1")
    result = shell.run(*shard)
    assert result.exit_code != 0
    assert "the same command with --resume goes on" in result.stderr
    assert "1 of 2 blocks are missing (--shard 1/1)" in shell.run("merge", out).stderr
    monkeypatch.setattr(SteadyBeatEvaluator, "__call__", evaluate)
    assert shell.run(*shard, "--resume").exit_code == 0
    assert shell.run("merge", out).exit_code == 0
    assert not are_shards_recorded(out)


@pytest.mark.slow
def test_a_shard_with_other_options_is_refused(shell):
    """Studies of other schemes have a folder of their own, and the merge called the first shard missing."""
    folder, out = shell.folder / "cases", shell.folder / "out"
    folder.mkdir()
    shell.case("cases/one.toml", more=shell.ecmo)
    chosen = ("crrt-study", folder, "--speeds", "3000", "--volume-policy", "as_published", "--out", out)
    assert shell.run(*chosen, "--schemes", "g,h", "--shard", "1/2").exit_code == 0
    result = shell.run(*chosen, "--schemes", "g,d", "--shard", "2/2")
    assert result.exit_code == 2
    assert "run with other options (schemes was 'g,h' and is 'g,d'); choose another folder" in result.stderr
    elsewhere = f"{folder.parent}/./cases"
    assert shell.run(chosen[0], elsewhere, *chosen[2:], "--schemes", "g,h", "--shard", "2/2").exit_code == 0
    assert shell.run("merge", out).exit_code == 0


@pytest.mark.slow
def test_a_merge_in_which_something_failed_is_done_too(shell):
    """Its command stayed in the folder, as if shards were still to be merged."""
    head, first, second, *_ = SYNTHETIC.read_text().splitlines()
    table, out = shell.folder / "rows.csv", shell.folder / "out"
    table.write_text("\n".join([head, first, second.replace(",6.6,", ",six,")]) + "\n")
    assert shell.run("course", table, "--until", "1", "--out", out, "--shard", "1/1").exit_code == 0
    assert shell.run("merge", out).exit_code == 1
    assert (out / "courses.json").exists()
    assert not are_shards_recorded(out)


def test_a_refused_shard_leaves_no_command(shell):
    out = shell.folder / "out"
    assert shell.run("sensitivity", shell.case(), "--out", out, "--shard", "3/2").exit_code == 2
    assert not (out / "command.json").exists()


@pytest.mark.slow
def test_shards_of_the_paper_do_their_share_of_every_long_part(shell):
    out = shell.folder / "paper"
    lines = SYNTHETIC.read_text().splitlines()
    table = shell.folder / "two.csv"
    table.write_text("\n".join([lines[0], *lines[1:3]]) + "\n")
    chosen = ("--parts", "sensitivity,cohort", "--samples", 4, "--cohort", table, "--explore", 8)
    for shard in ("1/2", "2/2"):
        result = shell.run("reproduce", out, *chosen, "--shard", shard)
        assert result.exit_code == 0, result.stderr
        assert f"when all shards are done: eclsim merge {out}" in result.stderr
        assert not (out / "index.html").exists()
    assert shell.run("merge", out, "--json", shell.folder / "merged.json").exit_code == 0
    whole = reproduce(shell.folder / "one", ReproductionSettings(4, 8, table), ("sensitivity", "cohort"))
    assert (shell.folder / "merged.json").read_text() == json_text(as_object(whole))
    assert (out / "figure_3.svg").exists()


def test_shards_are_of_commands_with_many_tasks(shell):
    case = shell.case()
    for command in (("identify", case, "--out", shell.folder / "a"), ("crrt-study", case)):
        result = shell.run(*command, "--shard", "1/2")
        assert result.exit_code == 2
        assert (
            "for cohorts" in result.stderr or "for a cohort" in result.stderr or "--out DIR" in result.stderr
        )
    result = shell.run("validate", "--shard", "1/2", "--out", shell.folder / "b")
    assert result.exit_code == 2
    assert (
        "--shard: needs exactly one part made of tasks: --only robustness or --only adaptive" in result.stderr
    )
