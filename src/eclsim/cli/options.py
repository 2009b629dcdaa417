"""Options of commands: each command takes one frozen object, whose fields are its options.

A command is a function of one dataclass. `as_command` turns the fields into what the command line offers, so
that an option is written once, with its type, default, bounds and help. Commands share options by sharing
the classes at the end.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field, fields
from types import EllipsisType
from typing import TYPE_CHECKING, Literal, TypeVar, get_type_hints

import typer
from typer import Context
from typer.core import TyperCommand, TyperOption

from eclsim.cli.console import say
from eclsim.cli.destination import locked
from eclsim.execution import ShardDone

if TYPE_CHECKING:
    from eclsim.execution import Distribution

Value = TypeVar("Value")
VolumePolicy = Literal["as_published", "patient_held"]
_SHOWN = "shown on the command line as"
MERGE, COMMAND = "merge", "command.json"
EXECUTION_OPTIONS = ("out", "folder", "json", "workers", "dask", "shard", "resume", "force")
"""Options that change no result: each shard has its own."""


def option(
    default: Value | EllipsisType,
    help: str,
    *names: str,
    metavar: str | None = None,
    minimum: float | None = None,
    maximum: float | None = None,
    show_default: bool = True,
) -> Value:
    """A field that is an option.

    Args:
        default: value where the option is left out, None or an empty list for none; `...`: it must be given.
        help: what it is, with its unit.
        names: such as "--json"; left out, the field's own name.
        metavar: what stands for the value in the help, such as "FILE".
        minimum: smallest number allowed.
        maximum: largest number allowed.
        show_default: whether the help names the default.
    """
    shown = typer.Option(
        default, *names,
        help=help, metavar=metavar, min=minimum, max=maximum, show_default=show_default,
    )  # fmt: skip
    return _field(default, shown)


def argument(default: Value | EllipsisType, metavar: str, help: str, *, show_default: bool = True) -> Value:
    """A field that is an argument, in the order of the fields."""
    return _field(default, typer.Argument(default, metavar=metavar, help=help, show_default=show_default))


def _field(default: Value | EllipsisType, shown: object) -> Value:
    metadata = {_SHOWN: shown}
    if isinstance(default, EllipsisType):
        return field(metadata=metadata)
    if isinstance(default, list):
        return field(default_factory=lambda: default, metadata=metadata)
    return field(default=default, metadata=metadata)


class Command(TyperCommand):
    """A command whose help gets its examples of keys from the registry of devices when it is shown."""

    def get_help(self, ctx: Context) -> str:
        """The help, with keys of devices for {setting}, {target} and {lines}."""
        from eclsim.devices.registry import example_setting, example_target, line_keys

        keys = {
            "{setting}": example_setting(),
            "{target}": example_target(),
            "{lines}": ", ".join(line_keys()),
        }
        for shown in self.params:
            if isinstance(shown, TyperOption) and shown.help:
                for placeholder, key in keys.items():
                    shown.help = shown.help.replace(placeholder, key)
        return super().get_help(ctx)


def as_command(function: Callable[..., None]) -> Callable[..., None]:
    """A function of one options object as a function of single options, from which Typer builds the command.

    Where the options name a folder of results, it is held while the command runs.
    """
    kind: type = get_type_hints(function)["options"]
    types, shown = get_type_hints(kind), {item.name: item.metadata[_SHOWN] for item in fields(kind)}

    def command(**written: object) -> None:
        options = kind(**written)
        with locked(*options.locked_folder) if isinstance(options, ResultsFolder) else nullcontext():
            if not isinstance(options, Distributed):
                function(options)
                return
            try:
                function(options)
            except ShardDone as done:
                say(f"{done}; when all shards are done: eclsim merge {options.locked_folder[0]}")
            options.record(function.__name__)

    only = inspect.Parameter.KEYWORD_ONLY
    listed = [inspect.Parameter(n, only, default=shown[n], annotation=types[n]) for n in _own_first(kind)]
    vars(command)["__signature__"] = inspect.Signature(listed)
    command.__name__, command.__doc__, command.__annotations__ = function.__name__, function.__doc__, types
    return command


def _own_first(kind: type) -> list[str]:
    """Names of the fields: those of the class itself before those it shares with others."""
    return list(
        dict.fromkeys(name for ancestor in kind.__mro__ for name in inspect.get_annotations(ancestor))
    )


# --- options that commands share ------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ResultsFolder:
    """Option of a command that locks the folder of its results while it runs."""

    out: str | None

    @property
    def locked_folder(self) -> tuple[str | None, str]:
        """The folder, and the shard where several commands may run side by side."""
        return self.out, ""


@dataclass(frozen=True, kw_only=True)
class Force:
    """Whether files may be overwritten."""

    force: bool = option(False, "Overwrite files that exist.", "--force")


@dataclass(frozen=True, kw_only=True)
class Json(Force):
    """File of the JSON output."""

    json: str | None = option(None, "Write results as JSON; - for standard output.", "--json", metavar="FILE")


@dataclass(frozen=True, kw_only=True)
class CaseChanges:
    """Options that win over a case file."""

    settings: list[str] = option(
        [],
        "Override a value of the case file, such as {setting}=3000 [rpm], patient.heart_rate_bpm=90 or "
        "Rmc=0.8 [mmHg s/mL]. May be repeated.",
        "--set",
        metavar="KEY=VALUE",
    )
    volume_policy: VolumePolicy | None = option(
        None,
        "as_published: the patient's blood fills the circuits; patient_held: the circuits are primed and the "
        "patient keeps the stressed volume. Default: as in the case file, else as_published.",
    )


REASON_FOR_FURTHER_FREE = "blood gases, CVP or pressures of the CRRT were measured"
"""Why others than the paper's seven parameters are free where nobody named any."""


@dataclass(frozen=True, kw_only=True)
class FreeParameters:
    """Free parameters, their bounds, and uncertainties of measurements."""

    parameters: str | None = option(
        None,
        "Free parameters. Default: the paper's Csart,Edla,Emaxlv,Emaxrv,Rmc,Rpmc,Rsvn; with measured blood "
        "gases those that they determine; with CVP also the blood volume (fluid.extra_volume_ml), with "
        "pressures of a CRRT its lines and filter (Dcrrttuin,Dcrrttuout,Rcrrtfil).",
        "--parameters",
        "--free",
        metavar="NAMES",
    )
    bounds: str | None = option(
        None,
        "Bounds in the parameter's unit; equal bounds fix it. Default: the table in the documentation, "
        "else the published value / 10 to * 10. A value of the case outside them gives a warning.",
        metavar="NAME=LOWER:UPPER,...",
    )
    uncertainty: str | None = option(
        None,
        "Standard uncertainties of the measurements, for intervals and weights: SP=4,CO=10% [mmHg, L/min or "
        "%]. Defaults: SP=4,DP=4,MAP=3,MPAP=2,PCWP=2,CVP=2 mmHg, CO=10 %, PF=5 %, both at least 0.03 L/min.",
        metavar="NAME=VALUE,...",
    )


@dataclass(frozen=True, kw_only=True)
class Resumable(Json):
    """Options of a command whose finished tasks are kept."""

    resume: bool = option(False, "Continue from the results in --out.", "--resume")


@dataclass(frozen=True, kw_only=True)
class Distributed(Resumable, ResultsFolder):
    """Where tasks run, and which."""

    workers: int | None = option(None, "Threads, or local Dask workers; default: all processors.", minimum=1)
    dask: str | None = option(
        None, "Run on the workers of this Dask scheduler; local: on local workers.", metavar="ADDRESS"
    )
    shard: str | None = option(
        None,
        "Run only part k of n (from 1); finish with `eclsim merge DIR` when all parts are done.",
        metavar="k/n",
    )

    @property
    def locked_folder(self) -> tuple[str | None, str]:
        """Shards run side by side."""
        return self.out, "" if self.merges else self.shard or ""

    @property
    def merges(self) -> bool:
        """Whether it only joins what shards left; what `eclsim merge` sets."""
        return self.shard == MERGE

    @property
    def continues(self) -> bool:
        """Whether results that are there are kept."""
        return self.resume or self.shard is not None

    def distribution(self, mistakes: list[str]) -> Distribution:
        """Where tasks run, and which; adds to the mistakes what cannot be."""
        from eclsim.execution import Distribution, ExecutionError, Shard

        if self.locked_folder[0] is None and self.continues:
            mistakes.append("--resume and --shard need --out DIR")
        try:
            if self.merges:
                return Distribution(merge=True)
            shard = Shard.parse(self.shard) if self.shard else None
            return Distribution(
                workers=self.workers, dask=self.dask, shard=shard, resume=self.resume, force=self.force
            )
        except ExecutionError as error:
            mistakes.append(str(error))
            return Distribution()

    def record(self, command: str) -> None:
        """Leave with the results of a shard the command that `eclsim merge` finishes; it goes when it has."""
        from pathlib import Path

        from eclsim.files import write_json

        folder, _ = self.locked_folder
        if folder is None or self.shard is None:
            return
        file = Path(folder) / COMMAND
        if self.merges:
            file.unlink(missing_ok=True)
            return
        own_options = {name: value for name, value in asdict(self).items() if name not in EXECUTION_OPTIONS}
        write_json({"command": command, "options": own_options}, file)
