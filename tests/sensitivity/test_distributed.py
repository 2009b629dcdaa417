import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from eclsim.sensitivity.analysis import run_analysis
from eclsim.sensitivity.distributed import on_dask
from eclsim.sensitivity.store import SAMPLES

CASE = """
format = 1
patient = { id = "P", sex = "female", age_years = 70, heart_rate_bpm = 120 }
ecmo = { mode = "VA", pump = "Rotaflow", speed_rpm = 3425, oxygenator = "Quadrox-i Adult" }
"""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Dask's own clean-up, whose sockets and loops close late
def test_dask_gives_the_identical_file(tmp_path, plan, open_store):
    pytest.importorskip("dask.distributed")
    from dask.distributed import LocalCluster

    run_analysis(plan, open_store(tmp_path / "here"))
    # Threads of this process: workers in processes of their own could not import this test's function.
    with LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None) as cluster:
        execute = on_dask(cluster.scheduler_address)
        run_analysis(plan, open_store(tmp_path / "there"), execute=execute)
    os.environ.pop("ECLSIM_THREADS", None)  # what a worker sets in its own process
    assert (tmp_path / "there" / SAMPLES).read_bytes() == (tmp_path / "here" / SAMPLES).read_bytes()


@pytest.mark.slow
def test_killed_or_stopped_processes_lose_nothing(tmp_path):
    """The real command, ended by Ctrl-C, SIGTERM and kill -9 at random moments, on one and on two threads."""
    case = tmp_path / "case.toml"
    case.write_text(CASE)

    def command(out: Path, threads: int, *more: str) -> subprocess.Popen:
        size = ["--samples", "4096", "--parameters", "Rmc", "--outputs", "MAP"]
        options = [*size, "--no-second-order", "--no-figures", "--out", str(out), *more]
        program = [sys.executable, "-m", "eclsim.cli", "sensitivity", str(case), *options]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return subprocess.Popen(program, env={**os.environ, "ECLSIM_THREADS": str(threads)}, **quiet)

    assert command(tmp_path / "straight", 2).wait() == 0
    chance = random.Random(1)
    for number in (signal.SIGINT, signal.SIGKILL, signal.SIGTERM, signal.SIGKILL):
        process = command(tmp_path / "broken", 1 + number % 2, "--resume")
        time.sleep(chance.uniform(2.0, 6.0))
        process.send_signal(number)
        process.wait()
    assert command(tmp_path / "broken", 1, "--resume").wait() == 0
    same = [(tmp_path / name / SAMPLES).read_bytes() for name in ("straight", "broken")]
    assert same[0] == same[1]
    assert not list((tmp_path / "broken").rglob(".eclsim-*"))
