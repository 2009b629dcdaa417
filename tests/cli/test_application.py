"""The command as a process: start-up, help, misspelt names, signals, closed pipes."""

import os
import shlex
import signal
import subprocess
import sys

import pytest

from eclsim import __version__

ECLSIM = [sys.executable, "-m", "eclsim"]
HEAVY = ("jax", "xarray", "pandas", "scipy", "matplotlib", "numpy")


@pytest.mark.parametrize(
    ("written", "suggestion"),
    [(["simulat"], "simulate"), (["parametres"], "parameters"), (["simulate", "--forc", "x"], "--force")],
)
def test_misspelt_names_get_a_suggestion(shell, written, suggestion):
    done = shell.run(*written)
    assert done.exit_code == 2
    assert suggestion in done.stderr


def test_version(shell):
    assert shell.run("--version").stdout == f"eclsim {__version__}\n"


def test_help_explains_every_option_with_unit_and_default(shell):
    text = shell.run("simulate", "--help").stdout
    for words in ("--set", "[rpm]", "--json", "--transient", "[s]", "default: semi-implicit", "--force"):
        assert words in text
    for command in ([], ["parameters"], ["parameters", "list"], ["parameters", "export"], ["devices"]):
        assert shell.run(*command, "--help").exit_code == 0


@pytest.mark.slow
def test_help_and_bad_input_load_nothing_heavy(tmp_path):
    bad = tmp_path / "bad.toml"
    bad.write_text("format = 1\n[patient]\nage_years = -3\n")
    script = (
        "import sys\nfrom eclsim.cli import main\n"
        "try:\n    main(sys.argv[1:])\n"
        "except SystemExit as stop:\n"
        f"    print(stop.code, [name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)\n"
    )
    for arguments, code in (
        (["--help"], 0),
        (["simulate", str(bad)], 2),
        (["parameters", "explain", "Rmc"], 0),
    ):
        done = subprocess.run(
            [sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=False
        )
        assert done.stderr.splitlines()[-1] == f"{code} []"


@pytest.mark.slow
def test_simulating_does_not_load_dask(shell):
    """xarray imports all of Dask at the first difference of two numbers that carry labels: 0.7 s of 2.8."""
    script = "import sys\nfrom eclsim.cli import main\ntry:\n    main()\n"
    script += "finally:\n    print('dask' in sys.modules)"
    command = [sys.executable, "-c", script, "simulate", shell.case()]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "MAP" in done.stdout
    assert done.stdout.splitlines()[-1] == "False"


def test_mistakes_are_one_line_each_without_a_traceback(tmp_path):
    bad = tmp_path / "bad.toml"
    bad.write_text('format = 1\n[patient]\nid = "P1"\nsex = "female"\nage_years = -3\nheart_rate_bpm = 1.2\n')
    done = subprocess.run([*ECLSIM, "simulate", bad], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.splitlines() == [
        f"error: {bad}:5: patient.age_years = -3: must be above 0; allowed: 18 to 100 years",
        f"error: {bad}:6: patient.heart_rate_bpm = 1.2: outside the allowed range; allowed: 20 to 250 bpm; "
        "did you mean 1.2 Hz = 72 bpm?",
    ]


ASLEEP = "def read_all(*_):\n    print('running', flush=True)\n    time.sleep(60)\n"
IN_A_CALLBACK = """
def asleep(*_):
    gc.callbacks.remove(asleep)
    print('running', flush=True)
    time.sleep(60)

def read_all(*_):
    gc.callbacks.append(asleep)
    gc.collect()
    time.sleep(60)
"""

WITHIN_THE_HOOK = f"""{IN_A_CALLBACK}
class Late(application.Thread):
    def start(self):
        super().start()
        time.sleep(0.5)

application.Thread = Late
"""
"""The signal that is sent again comes while it is still being sent, as on a busy machine."""


@pytest.mark.skipif(sys.platform == "win32", reason="signals and pipes of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    "reading",
    [ASLEEP, IN_A_CALLBACK, WITHIN_THE_HOOK],
    ids=["asleep", "in a callback of the collector", "again within the hook"],
)
def test_signals_stop_without_a_traceback(number, reading):
    code = (
        f"import gc, time\nfrom eclsim.cli import application, simulate\n{reading}"
        "simulate.read_all = read_all\napplication.run(['simulate', 'case.toml'])\n"
    )
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", code], **pipes) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "running\n"
        process.send_signal(number)
        _, message = process.communicate(timeout=20)
    assert process.returncode == 128 + number
    assert message.startswith("stopped by")
    assert message.count("stopped") == 1
    assert "Traceback" not in message


UNFLUSHED = (
    "from eclsim.cli import application\napplication.app = lambda **_: print('text')\napplication.run([])\n"
)
"""A command whose text is written when it has ended."""


@pytest.mark.skipif(sys.platform == "win32", reason="signals and pipes of POSIX")
@pytest.mark.parametrize(
    "command", [(*ECLSIM, "parameters", "export"), (*ECLSIM, "--help"), (sys.executable, "-c", UNFLUSHED)]
)
def test_a_reader_that_ended_is_no_error(command):
    reader, writer = os.pipe()
    os.close(reader)
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, env=buffered)
    os.close(writer)
    assert done.returncode == 128 + signal.SIGPIPE, "not 1, which means that something did not converge"
    assert done.stderr == ""


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs the device that is always full")
def test_a_full_disk_is_told():
    with open("/dev/full", "w") as full:
        command = [*ECLSIM, "parameters", "export"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert "No space left on device" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_package_of_an_extra_that_is_missing_is_named(tmp_path, shell):
    case = shell.case()
    program = (
        "import sys\nsys.modules['diffrax'] = None\nfrom eclsim.cli import main\n"
        f"main(['simulate', {case!r}, '--solver', 'adaptive'])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "error: the adaptive solver needs diffrax: pip install 'eclsim[verify]'\n"


def test_text_that_the_terminal_cannot_show_is_no_error():
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run([*ECLSIM, "devices"], capture_output=True, env=environment, check=False)
    assert done.returncode == 0
    assert b"Rotaflow" in done.stdout
    assert done.stderr == b""


def test_a_full_disk_under_a_folder_of_results_is_not_blamed_on_standard_output(tmp_path):
    """The writer of every command's files names the file, and the command says it."""
    program = (
        "import errno, pathlib\n"
        "from eclsim.files import write_json\n"
        "def full(*_, **__): raise OSError(errno.ENOSPC, 'No space left on device')\n"
        "pathlib.Path.write_text = full\n"
        "from eclsim.cli import application\n"
        f"devices_file = pathlib.Path({str(tmp_path)!r}) / 'identification.json'\n"
        "application.app = lambda **_: write_json({}, devices_file)\n"
        "application.run([])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == f"error: {tmp_path / 'identification.json'}: No space left on device\n"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize("arguments", [("devices",), ("parameters", "export", "--format", "json")])
def test_a_full_standard_output_is_named_as_such(arguments):
    with open("/dev/full", "w") as full:
        done = subprocess.run([*ECLSIM, *arguments], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert done.stderr == "error: standard output: No space left on device\n"


@pytest.mark.skipif(sys.platform == "win32", reason="file descriptors of POSIX")
@pytest.mark.parametrize("closed", [">&-", ">&- 2>&-"])
def test_a_closed_standard_output_is_no_error(closed):
    """It ended in tracebacks and status 1, as if a course had ended early, with all files written."""
    command = shlex.join([*ECLSIM, "parameters", "list"])
    done = subprocess.run(["sh", "-c", f"{command} {closed}"], stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(sys.platform == "win32", reason="file descriptors of POSIX")
def test_json_for_a_closed_standard_output_is_refused(shell):
    command = shlex.join([*ECLSIM, "simulate", shell.case(), "--json", "-"])
    done = subprocess.run(["sh", "-c", f"{command} >&-"], stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert done.stderr == "error: --json -: standard output is closed; give a file\n"


def test_an_error_without_a_file_is_not_blamed_on_standard_output():
    program = (
        "import errno\n"
        "from eclsim.cli import application\n"
        "def full(**_): raise OSError(errno.ENOSPC, 'No space left on device')\n"
        "application.app = full\n"
        "application.run([])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == "error: cannot read or write: No space left on device\n"
