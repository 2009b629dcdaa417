"""The application: its commands, and how it starts and stops."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from types import FrameType
from typing import Annotated, Any

import typer

from eclsim._version import __version__
from eclsim.cli import (
    app as bedside,
)
from eclsim.cli import (
    benchmark,
    crrt_study,
    demo,
    devices,
    identifiability,
    identify,
    importing,
    parameters,
    reproduce,
    sensitivity,
    simulate,
    track,
    validate,
)
from eclsim.cli.folder_lock import holding
from eclsim.cli.messages import fail, say

_HELP = """Simulate a patient's circulation on ECMO, CRRT and LVAD.

Give patients as case files (TOML). Pressures are in mmHg, flows in L/min or mL/s, volumes in mL.
"""
_SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 110}
_STOPPED_BY = {"SIGINT": "stopped by Ctrl-C", "SIGTERM": "stopped by SIGTERM"}

app = typer.Typer(
    help=_HELP,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings=_SETTINGS,
)
app.command("simulate", short_help="Simulate the steady heartbeat of each case.")(simulate.simulate)
app.command("crrt-study", short_help="Compare all ways of connecting CRRT to a patient's ECMO circuit.")(
    holding(crrt_study.crrt_study)
)
app.command("reproduce", short_help="Recompute the numbers of the paper.")(
    holding(reproduce.reproduce, "folder")
)
app.command("sensitivity", short_help="Sobol indices: what the outputs of a case depend on.")(
    holding(sensitivity.sensitivity)
)
app.command("identifiability", short_help="Which parameters measurements can tell apart.")(
    identifiability.identifiability
)
app.command("identify", short_help="Fit a patient's own model to what was measured.")(
    holding(identify.identify)
)
app.command("import", short_help="Turn clinical data into a cohort to identify.")(importing.import_data)
app.command("track", short_help="Follow a patient's parameters from measurement to measurement.")(
    holding(track.track)
)
app.add_typer(parameters.app, name="parameters", short_help="List, explain and export parameters.")
app.command("devices", short_help="List devices and their ranges, or explain one.")(devices.devices)
app.command("demo", short_help="Simulate the paper's patient, with figures and its numbers.")(demo.demo)
app.command("validate", short_help="Hold eclsim against published results.")(validate.validate)
app.command("app", short_help="Open the bedside page in a browser.")(bedside.app)
app.command("benchmark", short_help="Measure speed and memory on this machine.")(benchmark.benchmark)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"eclsim {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and leave."),
    ] = False,
) -> None:
    """Options before the command."""


def run(arguments: Sequence[str] | None = None) -> None:
    """Run a command; always ends in SystemExit, never in a traceback for what a user did."""
    _stop_cleanly_on_signals()
    _print_any_character()
    try:
        app(args=list(arguments) if arguments is not None else None, prog_name="eclsim")
    except BrokenPipeError:
        _silence(sys.stdout)
        raise SystemExit(1) from None
    except OSError as error:
        _silence(sys.stdout)
        fail(f"{error.filename or 'standard output'}: {error.strerror or error}")
    finally:
        _flush()


def _stop_cleanly_on_signals() -> None:
    """Ctrl-C and SIGTERM unwind the stack, so that temporary files go and finished ones stay."""

    def stop(number: int, _frame: FrameType | None) -> None:
        say(_STOPPED_BY[signal.Signals(number).name])
        raise SystemExit(128 + number)

    for name in _STOPPED_BY:
        try:
            signal.signal(getattr(signal, name), stop)
        except ValueError:  # not in the main thread: whoever started the thread handles signals
            return


def _print_any_character() -> None:
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # pyright: ignore[reportAttributeAccessIssue]


def _flush() -> None:
    """Write what is left; a reader that is gone (`| head`) is no error, a full disk is."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except BrokenPipeError:
            _silence(stream)
        except OSError as error:
            _silence(stream)
            fail(f"cannot write: {error.strerror}")
        except ValueError:
            continue


def _silence(stream: Any) -> None:
    """Send what a stream still holds nowhere, so that the interpreter's last flush cannot fail."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    except (OSError, ValueError):
        return
