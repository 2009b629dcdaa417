"""Two commands and one folder, and what an interrupted command says."""

import errno
import os
import signal
import subprocess
import sys
import time

import pytest

from eclsim.cli.destination import LOCK, explaining_resume, locked

COMMANDS = {
    "sensitivity": ("sensitivity", "{case}", "--out", "{out}"),
    "identify": ("identify", "{case}", "--out", "{out}"),
    "crrt-study": ("crrt-study", "{case}", "--out", "{out}"),
    "track": ("track", "{case}", "--out", "{out}"),
    "reproduce": ("reproduce", "{out}"),
    "reproduce --out": ("reproduce", "--out", "{out}"),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_second_command_on_one_folder_is_refused_and_told_who_has_it(shell, name):
    out = shell.folder / "out"
    out.mkdir()
    arguments = [word.format(case=shell.case(more=shell.ecmo), out=out) for word in COMMANDS[name]]
    with locked(out):
        done = shell.run(*arguments)
    assert done.exit_code == 2
    assert f"--out {out}: in use by process {os.getpid()}" in done.stderr
    assert list(out.iterdir()) == []


def test_what_a_process_that_died_left_behind_is_taken_over(tmp_path):
    (tmp_path / LOCK).write_text("process 1 (eclsim sensitivity, since 00:00:00)")
    with locked(tmp_path):
        assert str(os.getpid()) in (tmp_path / LOCK).read_text()
    assert list(tmp_path.iterdir()) == []


def test_a_lock_ends_with_its_process_however_that_ends(tmp_path):
    code = (
        "import os, signal, sys\nfrom eclsim.cli.destination import locked\n"
        "with locked(sys.argv[1]):\n    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert (tmp_path / LOCK).exists()
    with locked(tmp_path):
        pass


def test_shards_of_one_analysis_run_side_by_side(tmp_path):
    with locked(tmp_path, "1/4"), locked(tmp_path, "2/4"):
        pass
    with locked(tmp_path, "1/4"), pytest.raises(SystemExit), locked(tmp_path, "1/4"):
        pass


def test_a_folder_made_for_the_lock_alone_goes_again(shell):
    out = shell.folder / "new"
    assert shell.run("sensitivity", shell.folder / "missing.toml", "--out", out).exit_code == 2
    assert not out.exists()


@pytest.mark.parametrize("made", [True, False])
def test_a_full_disk_is_named_with_its_folder_and_no_lock_stays(tmp_path, monkeypatch, capsys, made):
    """It was called a full standard output, and an empty lock stayed."""

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    out = tmp_path / "out"
    if not made:
        out.mkdir()
    monkeypatch.setattr(os, "write", full)
    with pytest.raises(SystemExit) as ended, locked(out):
        pytest.fail("the command would run")
    assert ended.value.code == 2
    assert capsys.readouterr().err == f"error: --out {out}: cannot be written: No space left on device\n"
    assert out.exists() is not made
    assert list(tmp_path.rglob("*")) == [out] * (not made)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_command_says_how_to_go_on(number):
    code = (
        "import os, sys, time\n"
        "from eclsim.cli import application\nfrom eclsim.cli.destination import explaining_resume\n"
        "application._stop_cleanly_on_signals()\n"
        "with explaining_resume('out'):\n    os.kill(os.getpid(), int(sys.argv[1]))\n    time.sleep(20)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(int(number))], capture_output=True, text=True)
    assert done.returncode == 128 + number
    assert "out: finished results are kept; the same command with --resume goes on" in done.stderr


def test_a_command_that_ends_by_itself_says_nothing_of_going_on(capsys):
    with pytest.raises(SystemExit), explaining_resume("out"):
        raise SystemExit(1)
    assert capsys.readouterr().err == ""


CLEANING_UP = """
import os, sys, time
from pathlib import Path
from eclsim.cli import application
from eclsim.cli.destination import explaining_resume
from eclsim.files import whole_file
application.SECONDS_TO_CLEAN_UP = float(sys.argv[2])

def work(**_):
    with explaining_resume('out'), whole_file(Path(sys.argv[1]) / 'result') as partial:
        partial.write_text('half')
        try:
            print('running', flush=True)
            time.sleep(60)
        finally:
            print('cleaning up', flush=True)
            time.sleep(float(sys.argv[3]))

application.app = work
application.run([])
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize(("kept_for", "cleans_for"), [(20.0, 0.5), (0.1, 20.0)], ids=["cleans up", "at once"])
def test_a_second_signal_ends_the_clean_up_only_after_some_seconds(tmp_path, kept_for, cleans_for):
    """The second broke off the clean-up: a partial file could stay, and how to go on was not said."""
    command = [sys.executable, "-c", CLEANING_UP, str(tmp_path), str(kept_for), str(cleans_for)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "running\n"
        process.send_signal(signal.SIGTERM)
        if kept_for > cleans_for:
            time.sleep(0.005)
        else:
            assert process.stdout.readline() == "cleaning up\n"
            time.sleep(0.5)
        process.send_signal(signal.SIGTERM)
        _, message = process.communicate(timeout=15)
    assert process.returncode == 128 + signal.SIGTERM
    if kept_for > cleans_for:
        assert message.splitlines() == [
            "stopped by SIGTERM", "out: finished results are kept; the same command with --resume goes on"
        ]  # fmt: skip
        assert list(tmp_path.iterdir()) == []
    else:
        assert message.splitlines()[-1] == "stopped by SIGTERM again, without cleaning up"
