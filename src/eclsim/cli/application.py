"""The command-line application: its commands, start and end."""

from __future__ import annotations

import io
import os
import signal
import sys
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread
from types import FrameType
from typing import Annotated, TextIO

import typer

from eclsim._version import __version__
from eclsim.cli.app import app as bedside_page
from eclsim.cli.catalogue import ListOptions, devices, explain, export, list_parameters, outputs
from eclsim.cli.console import fail, open_closed_streams, say
from eclsim.cli.course import course
from eclsim.cli.crrt_study import crrt_study
from eclsim.cli.identify import identify, import_data
from eclsim.cli.options import MERGE, Command, argument, as_command, option
from eclsim.cli.paper import demo, reproduce
from eclsim.cli.plan import plan, settings
from eclsim.cli.record import COMMAND
from eclsim.cli.sensitivity import identifiability, sensitivity
from eclsim.cli.simulate import simulate
from eclsim.cli.track import track
from eclsim.cli.validate import benchmark, validate
from eclsim.execution.folder import ExecutionError, read_inputs

_DISTRIBUTED = (course, crrt_study, identify, reproduce, sensitivity, track, validate)
_COMMANDS = {function.__name__: function for function in _DISTRIBUTED}


@dataclass(frozen=True, kw_only=True)
class MergeOptions:
    """Options of `eclsim merge`."""

    folder: str = argument(..., "DIR", "Folder --out of the shards.")
    json: str | None = option(None, "Write results as JSON; - for standard output.", "--json", metavar="FILE")


def merge(options: MergeOptions) -> None:
    """Finish a command whose shards are all done; results equal those of a single run.

    Uses the command and options of the shards; the input files must still have the same paths.
    Exit status: that of the command, 2 if a shard is missing.
    """
    try:
        recorded = read_inputs(Path(options.folder) / COMMAND)
    except ExecutionError as error:
        fail(error)
    name, own_options = (recorded or {}).get("command"), (recorded or {}).get("options")
    if not isinstance(own_options, dict) or name not in _COMMANDS:
        reason = (
            f"holds no shards (none are recorded in {COMMAND}): they are merged already, not yet run, or "
            "ended before they stored anything"
        )
        fail(f"{options.folder}: {reason}; allowed: a folder filled with --shard k/n")
    shards = (recorded or {}).get("shards")
    merged = f"{MERGE}/{shards}" if isinstance(shards, int) else MERGE
    where = {"out": options.folder, "json": options.json, "shard": merged}
    local_options = {"workers": None, "dask": None, "resume": False, "force": False}
    as_command(_COMMANDS[str(name)])(**own_options, **where, **local_options)


_HELP = """Simulate a patient's circulation on extracorporeal life support.

Give patients as case files (TOML); `eclsim devices` lists what can be connected. Pressures are in mmHg, flows
in L/min or mL/s, volumes in mL.
"""
_SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 110}
_STOPPED_BY = {"SIGINT": "stopped by Ctrl-C", "SIGTERM": "stopped by SIGTERM"}
_STREAMS = {"stdout": "standard output", "stderr": "standard error"}
_NO_READER = 128 + 13
"""Exit status if the reader of the output ended early (`| head`): that of a process stopped by SIGPIPE."""
SECONDS_TO_CLEAN_UP = 3.0
"""Time after a signal in which others are ignored, so that they cannot break off the clean-up."""

app = typer.Typer(
    help=_HELP, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False,
    rich_markup_mode=None, context_settings=_SETTINGS,
)  # fmt: skip
parameters = typer.Typer(
    help="List, explain and export the model's parameters with unit, source and allowed range.",
    no_args_is_help=False, invoke_without_command=True, rich_markup_mode=None,
)  # fmt: skip
for name, function, summary in (
    ("simulate", simulate, "Simulate the steady heartbeat of each case."),
    ("course", course, "Follow a case over hours, with its events."),
    ("crrt-study", crrt_study, "Compare the ways of connecting CRRT to a patient's ECMO circuit."),
    ("reproduce", reproduce, "Recompute the numbers of the paper."),
    ("sensitivity", sensitivity, "Find the parameters that outputs depend on (Sobol indices)."),
    ("identifiability", identifiability, "Find the parameters that measurements can tell apart."),
    ("merge", merge, "Finish a command whose shards (--shard k/n) are all done."),
    ("identify", identify, "Fit the model to a patient's measurements."),
    ("import", import_data, "Convert clinical data to a cohort for identify."),
    ("track", track, "Follow a patient's parameters from measurement to measurement."),
    ("settings", settings, "Find the smallest settings that reach goals."),
    ("plan", plan, "Plan fluid removal or weaning."),
    ("devices", devices, "List devices and their ranges, or explain one."),
    ("outputs", outputs, "List the outputs of a beat with units, or explain one."),
    ("demo", demo, "Simulate the paper's patient, with figures and the printed numbers."),
    ("validate", validate, "Compare eclsim with published results."),
    ("app", bedside_page, "Serve the bedside page to a browser."),
    ("benchmark", benchmark, "Measure speed and memory on this machine."),
):
    app.command(name, cls=Command, short_help=summary)(as_command(function))
for name, function in (("list", list_parameters), ("explain", explain), ("export", export)):
    parameters.command(name)(as_command(function))
app.add_typer(parameters, name="parameters", short_help="List, explain and export parameters.")


@parameters.callback()
def _list_by_default(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        list_parameters(ListOptions())


def _show_version(requested: bool) -> None:
    if requested:
        typer.echo(f"eclsim {__version__}")
        raise typer.Exit


def _load_devices(files: list[str] | None) -> None:
    """Run the files with the user's own devices; processes started later run them as well."""
    if not files:
        return
    from eclsim.devices.registry import FILES, DeviceError, load_device_file
    from eclsim.outputs.registry import all_outputs

    os.environ[FILES] = os.pathsep.join(map(os.path.abspath, files))
    try:
        for file in files:
            load_device_file(file)
            all_outputs()  # refuses outputs with the name of one of the patient's
    except DeviceError as error:
        fail(f"--device {error}")


@app.callback()
def _options(
    device: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE.py",
            callback=_load_devices,
            help="Python file that registers your own device; the file is executed. May be given more than "
            "once.",
        ),
    ] = None,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit."),
    ] = False,
) -> None:
    """Process the options that precede the command."""


def run(arguments: Sequence[str] | None = None) -> None:
    """Run a command; always ends in SystemExit, without a traceback for user errors."""
    open_closed_streams()
    _stop_cleanly_on_signals()
    _print_any_character()
    try:
        app(args=list(arguments) if arguments is not None else None, prog_name="eclsim")
    except _StoppedError as stopped:
        # Skip the interpreter's shutdown, in which a compiler that is still running crashes.
        try:
            _flush()
        finally:
            os._exit(stopped.status)
    except SystemExit as ended:
        if isinstance(ended.__context__, BrokenPipeError):  # Typer turns it into status 1
            raise SystemExit(_NO_READER) from None
        raise
    except BrokenPipeError:
        _redirect_to_null(sys.stdout)
        raise SystemExit(_NO_READER) from None
    except ImportError as error:
        if "pip install" not in str(error):
            raise
        fail(error)
    except OSError as error:
        _redirect_to_null(sys.stdout)
        fail(f"{_place_of(error)}: {error.strerror or error}")
    except Exception as error:
        fault = _fault_of_own_device(error)
        if not fault:
            raise
        fail(f"--device{fault}")
    finally:
        _flush()


def _place_of(error: OSError) -> str:
    """File that an error of the system names; else standard output, if Typer was writing text to it."""
    if error.filename is not None:
        return str(error.filename)
    innermost = traceback.extract_tb(error.__traceback__)[-1]
    return "standard output" if innermost.name == typer.echo.__name__ else "cannot read or write"


def _fault_of_own_device(error: Exception) -> str:
    """Text for an error that a user's device causes; empty for one of the package."""
    from eclsim.circuit.own_laws import cause
    from eclsim.circuit.validation import CircuitError
    from eclsim.devices.registry import DeviceError, own_files
    from eclsim.orbit.model import UnknownValueError

    if isinstance(error, DeviceError):
        return f": {error}"
    files = own_files()
    if files and isinstance(error, (CircuitError, UnknownValueError)):
        return f" {', '.join(files)}: {error}"
    run_through = {at.filename for at in traceback.extract_tb(error.__traceback__)}
    return next((f" {file}: {cause(error, file)}" for file in files if file in run_through), "")


class _StoppedError(SystemExit):
    """A signal stopped the command."""

    def __init__(self, number: int):
        self.status = 128 + number
        super().__init__(self.status)


def _stop_cleanly_on_signals() -> None:
    """Make Ctrl-C and SIGTERM unwind the stack, which removes temporary files and keeps finished ones.

    While it unwinds, further signals are ignored for some seconds; after that, one ends the process at once.
    """
    usual, raised, raised_at, reported = sys.unraisablehook, Event(), 0.0, False

    def stop(number: int, frame: FrameType | None) -> None:
        nonlocal raised_at, reported
        if raised.is_set():
            if time.monotonic() - raised_at > SECONDS_TO_CLEAN_UP:
                say(f"{_STOPPED_BY[signal.Signals(number).name]} again, without cleaning up")
                os._exit(128 + number)
            return
        if not reported:
            reported = True
            say(_STOPPED_BY[signal.Signals(number).name])
        while frame is not None and frame.f_code is not raise_again.__code__:
            frame = frame.f_back
        if frame is None:
            raised_at = time.monotonic()
            raised.set()
            raise _StoppedError(number)

    def raise_again(ignored: sys.UnraisableHookArgs) -> None:
        # An exception raised in a callback of the garbage collector, or here, is not propagated.
        if isinstance(ignored.exc_value, _StoppedError):
            raised.clear()
            Thread(target=send_again, args=(ignored.exc_value.status - 128,), daemon=True).start()
        else:
            usual(ignored)

    def send_again(number: int) -> None:
        while not raised.wait(0.05):  # on a busy machine a signal may come too early
            os.kill(os.getpid(), number)

    sys.unraisablehook = raise_again

    for name in _STOPPED_BY:
        try:
            signal.signal(getattr(signal, name), stop)
        except ValueError:  # not in the main thread: the owner of the main thread handles signals
            return


def _print_any_character() -> None:
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _flush() -> None:
    """Flush the standard streams; exit with a status of its own if the reader ended or the disk is full."""
    for name in _STREAMS:
        stream = getattr(sys, name)
        try:
            stream.flush()
        except BrokenPipeError:
            _redirect_to_null(stream)
            raise SystemExit(_NO_READER) from None
        except OSError as error:
            _redirect_to_null(stream)
            fail(f"{_STREAMS[name]}: {error.strerror}")
        except ValueError:
            continue


def _redirect_to_null(stream: TextIO) -> None:
    """Redirect a stream to the null device, so that the interpreter's last flush cannot fail."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    except (OSError, ValueError):
        return
