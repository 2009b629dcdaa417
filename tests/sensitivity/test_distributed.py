import os
import random
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from eclsim.cases.reading import read_mapping
from eclsim.execution import Distribution
from eclsim.sensitivity.analysis import SobolSettings, run_analysis, sensitivity
from eclsim.sensitivity.runs import SAMPLES

CASE = """
format = 1
patient = { id = "P", sex = "female", age_years = 70, heart_rate_bpm = 120 }
ecmo = { mode = "VA", pump = "Rotaflow", speed_rpm = 3425, oxygenator = "Quadrox-i Adult" }
"""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Dask's own clean-up, whose sockets and loops close late
def test_dask_gives_the_identical_file(tmp_path, plan):
    pytest.importorskip("dask.distributed")
    from dask.distributed import LocalCluster

    with Distribution().running() as executor:
        run_analysis(plan, tmp_path / "here", executor)
    before = dict(os.environ)
    # Threads of this process: workers in processes of their own could not import this test's function.
    threads = LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None)
    with threads as cluster, Distribution(dask=cluster.scheduler_address).running() as executor:
        run_analysis(plan, tmp_path / "there", executor)
    assert dict(os.environ) == before, "a worker leaves the environment as it is"
    assert (tmp_path / "there" / SAMPLES).read_bytes() == (tmp_path / "here" / SAMPLES).read_bytes()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # likewise
def test_local_dask_workers_give_the_identical_file(tmp_path):
    pytest.importorskip("dask.distributed")
    case = read_mapping(tomllib.loads(CASE)).case
    settings = SobolSettings(samples=512, parameters=("Rmc", "Emaxlv"))  # two blocks
    for name, distribution in (("here", Distribution()), ("there", Distribution(dask="local", workers=2))):
        sensitivity(case, settings=settings, folder=tmp_path / name, distribution=distribution)
    assert (tmp_path / "there" / SAMPLES).read_bytes() == (tmp_path / "here" / SAMPLES).read_bytes()


@pytest.mark.slow
def test_stopped_while_programs_are_compiled_ends_in_order(tmp_path):
    case = tmp_path / "case.toml"
    case.write_text(CASE)
    words = [sys.executable, "-m", "eclsim", "sensitivity", str(case), "--samples", "4096", "--no-figures"]
    for k in range(2):
        out, cache = tmp_path / f"out{k}", tmp_path / f"cache{k}"
        environment = {**os.environ, "ECLSIM_CACHE_DIR": str(cache)}
        with subprocess.Popen(
            [*words, "--out", str(out)], env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        ) as process:
            while process.poll() is None and not (out / "design.json").exists():
                time.sleep(0.05)
            time.sleep(0.5 + k)
            process.terminate()
            message = process.communicate()[1].decode()
        assert process.returncode == 128 + signal.SIGTERM, message
        assert "--resume goes on" in message


@pytest.mark.slow
def test_killed_or_stopped_processes_lose_nothing(tmp_path):
    """The real command, ended by Ctrl-C, SIGTERM and kill -9 at random moments, on one and on two threads."""
    case = tmp_path / "case.toml"
    case.write_text(CASE)

    def command(out: Path, threads: int, *more: str) -> subprocess.Popen:
        size = ["--samples", "4096", "--parameters", "Rmc", "--outputs", "MAP"]
        options = [*size, "--no-second-order", "--no-figures", "--out", str(out), *more]
        program = [sys.executable, "-m", "eclsim", "sensitivity", str(case), *options]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return subprocess.Popen(program, env={**os.environ, "ECLSIM_THREADS": str(threads)}, **quiet)

    assert command(tmp_path / "straight", 2).wait() == 0
    chance = random.Random(1)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        process = command(tmp_path / "broken", 1 + number % 2, "--resume")
        time.sleep(chance.uniform(2.0, 6.0))
        process.send_signal(number)
        process.wait()
    assert command(tmp_path / "broken", 1, "--resume").wait() == 0
    same = [(tmp_path / name / SAMPLES).read_bytes() for name in ("straight", "broken")]
    assert same[0] == same[1]
    assert not list((tmp_path / "broken").rglob(".eclsim-*"))
