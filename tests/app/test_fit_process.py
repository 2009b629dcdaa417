"""The process for fits: started when needed, and gone without a trace when the server stops."""

from __future__ import annotations

import multiprocessing
import subprocess
import sys

import pytest

from eclsim.app.fitting import _prepare

STOPPED = """
import os, threading, time
from eclsim.app.fitting import FitProcess

if __name__ == "__main__":
    process = FitProcess()
    if {running}:
        def fit():
            process.run("fit", {{}}, "as_published", print, threading.Event())
        threading.Thread(target=fit, daemon=True).start()
        while process._process is None or not process._process.is_alive():
            time.sleep(0.1)
        time.sleep(0.5)
    else:
        process.prepare()
    process.stop()
    os._exit(0)  # as a command ends that Ctrl-C has stopped
"""


@pytest.mark.slow
@pytest.mark.parametrize("running", [False, True])
def test_a_server_that_stops_leaves_no_semaphores(running, tmp_path):
    script = tmp_path / "stopped.py"
    script.write_text(STOPPED.format(running=running))
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0
    assert "leaked" not in done.stderr, done.stderr


def test_what_fits_need_is_compiled_before_somebody_fits(monkeypatch):
    """The settings of these searches were refused, without a word, and the first fit compiled everything."""
    pipe, _ = multiprocessing.Pipe()
    patients = []
    monkeypatch.setattr("eclsim.identification.fit.fit", lambda case, **_: patients.append(case.as_mapping()))
    _prepare(pipe)
    assert ["crrt" in case for case in patients] == [True, False]
