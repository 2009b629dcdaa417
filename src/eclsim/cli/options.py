"""Options of commands: each command takes one frozen object, whose fields are its options.

A command is a function of one dataclass instance. `as_command` turns the fields into command-line options, so
that each option is written once, with its type, default, bounds and help. Commands share options by
inheriting from the classes at the end of this module.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field, fields
from types import EllipsisType
from typing import Literal, TypeVar, get_type_hints

import typer
from typer import Context
from typer.core import TyperCommand, TyperOption

from eclsim.cli.console import note
from eclsim.cli.destination import locked
from eclsim.cli.record import recorded
from eclsim.execution import Distribution, ExecutionError, Shard

Value = TypeVar("Value")
VolumePolicy = Literal["as_published", "patient_held"]
_SHOWN = "shown on the command line as"
MERGE = "merge"


def option(
    default: Value | EllipsisType,
    help: str,
    *names: str,
    metavar: str | None = None,
    minimum: float | None = None,
    maximum: float | None = None,
    show_default: bool = True,
) -> Value:
    """Field for an option.

    Args:
        default: value if the option is omitted; None or an empty list for no value, `...` for a required
            option.
        help: description, with the unit.
        names: names such as "--json"; if none are given, the field's own name.
        metavar: placeholder for the value in the help, such as "FILE".
        minimum: smallest number allowed.
        maximum: largest number allowed.
        show_default: whether the help states the default.
    """
    shown = typer.Option(
        default, *names,
        help=help, metavar=metavar, min=minimum, max=maximum, show_default=show_default,
    )  # fmt: skip
    return _field(default, shown)


def argument(default: Value | EllipsisType, metavar: str, help: str, *, show_default: bool = True) -> Value:
    """Field for a positional argument; arguments are in the order of the fields."""
    return _field(default, typer.Argument(default, metavar=metavar, help=help, show_default=show_default))


def _field(default: Value | EllipsisType, shown: object) -> Value:
    metadata = {_SHOWN: shown}
    if isinstance(default, EllipsisType):
        return field(metadata=metadata)
    if isinstance(default, list):
        return field(default_factory=lambda: default, metadata=metadata)
    return field(default=default, metadata=metadata)


class Command(TyperCommand):
    """A command whose help takes its example keys from the device registry when it is shown."""

    def get_help(self, ctx: Context) -> str:
        """Return the help, with keys of devices in place of {setting}, {target} and {lines}."""
        from eclsim.devices.registry import example_setting, example_target, line_keys

        lines = ", ".join(line_keys())
        keys = {"{setting}": example_setting(), "{target}": example_target(), "{lines}": lines}
        for shown in self.params:
            if isinstance(shown, TyperOption) and shown.help:
                for placeholder, key in keys.items():
                    shown.help = shown.help.replace(placeholder, key)
        return super().get_help(ctx)


def as_command(function: Callable[..., None]) -> Callable[..., None]:
    """Convert a function of an options object to one of single options, which Typer makes a command.

    If the options include a folder of results, the folder is locked while the command runs, and a command of
    many tasks is recorded in it.
    """
    kind: type = get_type_hints(function)["options"]
    types, shown = get_type_hints(kind), {item.name: item.metadata[_SHOWN] for item in fields(kind)}

    def command(**written: object) -> None:
        options = kind(**written)
        with (
            locked(*options.locked_folder) if isinstance(options, ResultsFolder) else nullcontext(),
            recorded(options, function.__name__) if isinstance(options, Distributed) else nullcontext(),
        ):
            function(options)

    only = inspect.Parameter.KEYWORD_ONLY
    own_first = dict.fromkeys(n for ancestor in kind.__mro__ for n in inspect.get_annotations(ancestor))
    listed = [inspect.Parameter(n, only, default=shown[n], annotation=types[n]) for n in own_first]
    vars(command)["__signature__"] = inspect.Signature(listed)
    command.__name__, command.__doc__, command.__annotations__ = function.__name__, function.__doc__, types
    return command


# --- options that commands share ------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ResultsFolder:
    """Option of a command that locks its folder of results while it runs."""

    out: str | None

    @property
    def locked_folder(self) -> tuple[str | None, str]:
        """The folder, and the shard if several commands may run side by side."""
        return self.out, ""


@dataclass(frozen=True, kw_only=True)
class Force:
    """Option that allows files to be overwritten."""

    force: bool = option(False, "Overwrite files that exist.", "--force")


@dataclass(frozen=True, kw_only=True)
class Json(Force):
    """Option for the file of the JSON output."""

    json: str | None = option(None, "Write results as JSON; - for standard output.", "--json", metavar="FILE")


@dataclass(frozen=True, kw_only=True)
class CaseChanges:
    """Options that override a case file."""

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


@dataclass(frozen=True, kw_only=True)
class FreeParameters:
    """Free parameters, their bounds, and uncertainties of measurements."""

    parameters: str | None = option(
        None,
        "Free parameters. Default: the paper's Csart,Edla,Emaxlv,Emaxrv,Rmc,Rpmc,Rsvn; with measured blood "
        "gases, those that these determine; with CVP, also the blood volume (fluid.extra_volume_ml); with "
        "pressures of a CRRT, also its lines and filter (Dcrrttuin,Dcrrttuout,Rcrrtfil).",
        "--parameters",
        "--free",
        metavar="NAMES",
    )
    bounds: str | None = option(
        None,
        "Bounds in the parameter's unit; equal bounds fix it. Default: the table in the documentation, else "
        "from a tenth to ten times the published value. A case value outside the bounds gives a warning.",
        metavar="NAME=LOWER:UPPER,...",
    )
    uncertainty: str | None = option(
        None,
        "Standard uncertainties of the measurements, for intervals and weights: SP=4,CO=10% [mmHg, L/min or "
        "%]. Defaults: SP=4,DP=4,MAP=3,MPAP=2,PCWP=2,CVP=2 mmHg, CO=10 %, PF=5 %, both at least 0.03 L/min.",
        metavar="NAME=VALUE,...",
    )


@dataclass(frozen=True, kw_only=True)
class Distributed(Json, ResultsFolder):
    """Options for where tasks run, and which."""

    workers: int | None = option(None, "Threads, or local Dask workers; default: all processors.", minimum=1)
    dask: str | None = option(
        None, "Run on the workers of this Dask scheduler; local: on local workers.", metavar="ADDRESS"
    )
    shard: str | None = option(
        None,
        "Run only part k of n (from 1); finish with `eclsim merge DIR` when all parts are done.",
        metavar="k/n",
    )
    resume: bool = option(False, "Continue from the results in --out.", "--resume")

    @property
    def locked_folder(self) -> tuple[str | None, str]:
        """The folder, and the shard, as shards run side by side."""
        return self.out, "" if self.merges else self.shard or ""

    @property
    def merges(self) -> bool:
        """Whether the command only merges results of shards; set by `eclsim merge`."""
        return self.shard is not None and self.shard.partition("/")[0] == MERGE

    @property
    def continues(self) -> bool:
        """Whether existing results are kept."""
        return self.resume or self.shard is not None

    def distribution(self, mistakes: list[str]) -> Distribution:
        """Return the distribution of tasks; errors are added to `mistakes`."""
        if self.locked_folder[0] is None and self.continues:
            mistakes.append("--resume and --shard need --out DIR")
        try:
            if self.merges and self.shard is not None:
                count = self.shard.partition("/")[2]
                return Distribution(merge=True, merged_shards=int(count) if count.isdigit() else None)
            shard = Shard.parse(self.shard) if self.shard else None
            return Distribution(
                workers=self.workers, dask=self.dask, shard=shard, resume=self.resume, force=self.force,
                remark=lambda text: note([text]),
            )  # fmt: skip
        except ExecutionError as error:
            mistakes.append(str(error))
            return Distribution()
