import json

import pytest

from eclsim.paper.comparison import Check, Explanation, at_most, within


@pytest.fixture
def checks(monkeypatch):
    """Instant checks in place of the real ones; the effort that was asked for is collected."""
    good = Check(
        "good", "Good things", "1 %", (within("a", 100.0, 100.5, 1.0, "mmHg"), at_most("b", 1e-9, 1e-8))
    )
    moon = Explanation("the moon", (within("without the moon", 100.0, 100.1, 1.0, "mL"),))
    tide = Explanation("the tide", (within("without the tide", 100.0, 102.0, 1.0, "mL"),))
    rows = (
        within("c", 100.0, 102.0, 1.0, "mL", explanation=moon),
        within("e", 100.0, 103.0, 1.0, "mL", explanation=tide),
    )
    bad = Check("bad", "Bad things", "1 %", rows)
    unknown = Explanation("not stated", (within("where it is stated", 1.0, 1.0, 0.1),), undecided=True)
    open_one = within("f", 1.0, 3.0, 0.1, explanation=unknown)
    shown = Check("shown", "Measurements", "none", (within("d", 1.0, 2.0, 0.1), open_one), required=False)
    asked = []

    def run(effort, parts, announce):
        asked.append((effort, list(parts)))
        announce("this part")
        yield from ([good, shown, bad] if "gradients" in parts else [good, shown])

    monkeypatch.setattr("eclsim.validation.suite.run", run)
    return asked


def test_rows_are_shown_with_error_and_verdict(shell, checks):
    done = shell.run("validate")
    assert done.exit_code == 0
    lines = [line.split() for line in done.stdout.splitlines()]
    assert ["a", "100", "100.5", "mmHg", "+0.50", "%", "ok"] in lines
    assert ["d", "1", "2", "1", "+100.00", "%", "MISS"] in lines
    assert ["f", "1", "3", "1", "+200.00", "%", "not", "decidable"] in lines
    assert "All required comparisons pass." in done.stdout
    assert done.stderr == "running: this part\n"


def test_a_missed_bar_is_named_and_ends_with_status_1(shell, checks):
    done = shell.run("validate", "--only", "gradients")
    assert done.exit_code == 1
    assert "missed: Bad things: c" in done.stdout
    assert "explained: the moon" in done.stdout
    assert "the tide" not in done.stdout
    assert "2 miss (1 of them explained)" in done.stdout


def test_json_holds_every_row_and_nothing_else_is_written(shell, checks):
    done = shell.run("validate", "--only", "gradients", "--json", "-")
    assert done.exit_code == 1
    found = json.loads(done.stdout)
    assert found["all_bars_hold"] is False
    assert [check["key"] for check in found["checks"]] == ["good", "shown", "bad"]
    row, regressed = found["checks"][2]["rows"]
    assert row["evidence"][0]["got"] == 100.1
    assert (regressed["holds"], regressed["explanation"]) == (False, "")
    assert (row["expected"], row["got"], row["holds"], row["explanation"]) == (
        100.0,
        102.0,
        False,
        "the moon",
    )
    assert {"date", "processor", "eclsim"} <= set(found["machine"])


@pytest.mark.parametrize(("option", "points", "quick"), [("--quick", 64, True), ("--full", 10_000, False)])
def test_effort(shell, checks, option, points, quick):
    shell.run("validate", option)
    ((effort, _),) = checks
    assert (effort.points, effort.quick) == (points, quick)


def test_an_unknown_part_is_named_with_the_nearest(shell, checks):
    done = shell.run("validate", "--only", "gradient")
    assert done.exit_code == 2
    assert "--only 'gradient': no such part" in done.stderr
    assert "did you mean gradients?" in done.stderr
    assert checks == []


def test_parts_may_stand_with_commas_between(shell, checks):
    assert shell.run("validate", "--only", "drugs,fluid", "--only", "gas").exit_code == 0
    ((_, parts),) = checks
    assert parts == ["drugs", "fluid", "gas"]


def test_quick_and_full_exclude_each_other(shell, checks):
    assert shell.run("validate", "--quick", "--full").exit_code == 2
    assert checks == []


def test_parts_of_the_help_are_those_of_the_suite():
    from eclsim.cli.validate import PARTS
    from eclsim.validation import suite

    assert PARTS.split() == list(suite.PARTS)


@pytest.mark.parametrize("command", ["validate", "benchmark"])
def test_a_file_that_exists_is_not_overwritten(shell, checks, command):
    target = shell.folder / "old.json"
    target.write_text("mine")
    done = shell.run(command, "--json", target)
    assert done.exit_code == 2
    assert "--force overwrites it" in done.stderr
    assert target.read_text() == "mine"


def test_markdown_holds_the_summary_and_every_miss(shell, checks):
    target = shell.folder / "validation.md"
    done = shell.run("validate", "--only", "gradients", "--markdown", target)
    assert done.exit_code == 1
    lines = target.read_text().splitlines()
    assert "| Good things | 1 % | 2 of 2 |  |  | a: +0.5 % |" in lines
    assert "| bad | c | 100 mL | 102 mL | +2 % | miss, explained | 2 |" in lines
    assert "| shown | d | 1 | 2 | +100 % | MISS |  |" in lines


def test_two_outputs_need_two_files(shell, checks):
    done = shell.run("validate", "--json", shell.folder / "a", "--markdown", shell.folder / "a")
    assert done.exit_code == 2
    assert "name the same file" in done.stderr
    assert checks == []


def test_a_missing_extra_is_said_before_anything_is_computed(shell, monkeypatch):
    """After minutes of other parts, it ended the command without a verdict."""
    monkeypatch.setattr("eclsim.cli.validate.find_spec", lambda name: None)
    done = shell.run("validate", "--only", "paper,adaptive")
    assert done.exit_code == 2
    assert "adaptive needs diffrax: pip install 'eclsim[verify]', or --only paper" in done.stderr
