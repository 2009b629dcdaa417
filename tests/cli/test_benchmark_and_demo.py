import json
import sys

import pytest

from eclsim.validation.timing import Measurement

FAST = Measurement("one steady beat, warm", 8.0, "ms", 10.0, 7.5, 1740.0, "median of 15")
SLOW = Measurement("first result", 9.0, "s", 6.0, 5.0, None, "three processes")


@pytest.fixture
def measured(monkeypatch):
    result = [FAST]
    monkeypatch.setattr("eclsim.validation.timing.measurements", lambda: iter(result))
    return result


def test_figures_stand_beside_bar_and_published_code(shell, measured):
    done = shell.run("benchmark")
    assert done.exit_code == 0
    (line,) = [line for line in done.stdout.splitlines() if " ok " in line]
    assert line.split()[-1] == "218"
    assert "processor" in done.stdout


def test_a_missed_bar_ends_with_status_1_and_is_in_the_json(shell, measured):
    measured.append(SLOW)
    done = shell.run("benchmark", "--json", "-")
    assert done.exit_code == 1
    first, second = json.loads(done.stdout)["measurements"]
    assert (first["holds"], second["holds"]) == (True, False)
    assert first["times_faster"] == pytest.approx(217.5)
    assert second["times_faster"] is None


def test_times_are_medians_of_what_was_run():
    from eclsim.validation.timing import _medians

    calls = []
    wall, processor = _medians(lambda: calls.append(sum(range(2000))), repeats=5)
    assert len(calls) == 7
    assert 0.0 < wall < 100.0
    assert processor >= 0.0


@pytest.mark.slow
def test_memory_is_that_of_the_process_and_not_of_the_one_that_started_it():
    import numpy as np

    from eclsim.validation.timing import _process

    held = np.ones(100_000_000)  # 800 MB here, about four times what a process that only imports takes
    report = "from eclsim.validation.timing import _largest_memory_mb; print(_largest_memory_mb())"
    result = float(_process([sys.executable, "-c", report], {})[2])
    assert 5.0 < result < held.nbytes / 2e6


@pytest.mark.slow
def test_demo_writes_case_results_and_figures_and_shows_the_papers_numbers(shell):
    target = shell.folder / "new" / "demo"
    done = shell.run("demo", "--out", target, "--no-png")
    assert done.exit_code == 0
    rows = [line.split() for line in done.stdout.splitlines() if "paper, section" in line]
    assert [(row[0], row[1]) for row in rows] == [
        ("PF", "3.7"), ("Psart", "70.3"), ("Psvn", "3.7"), ("Pcrrttuin", "119"), ("Pcrrttuout", "313"),
    ]  # fmt: skip
    assert " no " not in done.stdout.split("quantity")[1].split("means over")[0]
    (case,) = json.loads((target / "results.json").read_text())["cases"]
    assert case["warnings"]
    assert all(sentence in done.stderr for sentence in case["warnings"])
    assert case["converged"] is True
    assert case["outputs"]["PF"] == pytest.approx(3.70, abs=0.01)
    assert (target / "results.nc").stat().st_size > 10_000
    assert (target / "s4_crrt_g_3425_circuit.svg").read_text().lstrip().startswith("<?xml")
    again = shell.run("simulate", target / "s4_crrt_g_3425.toml", "--json", "-")
    assert json.loads(again.stdout)["cases"][0]["outputs"] == case["outputs"]


def test_demo_refuses_a_file_in_place_of_a_folder(shell):
    target = shell.folder / "taken"
    target.write_text("mine")
    done = shell.run("demo", "--out", target)
    assert done.exit_code == 2
    assert "is a file; give a folder" in done.stderr
