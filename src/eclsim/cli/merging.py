"""`eclsim merge`: what shards left in a folder becomes the result that one run would have had."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from eclsim.cli.console import fail
from eclsim.cli.course import course
from eclsim.cli.crrt_study import crrt_study
from eclsim.cli.identify import identify
from eclsim.cli.options import COMMAND, MERGE, argument, as_command, option
from eclsim.cli.paper import reproduce
from eclsim.cli.sensitivity import sensitivity
from eclsim.cli.validate import validate

_DISTRIBUTED = (course, crrt_study, identify, reproduce, sensitivity, validate)
_COMMANDS = {function.__name__: function for function in _DISTRIBUTED}


@dataclass(frozen=True, kw_only=True)
class MergeOptions:
    """Options of `eclsim merge`."""

    folder: str = argument(..., "DIR", "Folder --out of the shards.")
    json: str | None = option(None, "Write results as JSON; - for standard output.", "--json", metavar="FILE")


def merge(options: MergeOptions) -> None:
    """Finish a command whose shards are all there: the same results as of one run.

    The command, with its options, is the one that the shards were of; its inputs have to be where they were.
    Exit status: that of the command, 2 if a shard is missing.
    """
    from eclsim.execution.folder import ExecutionError, read_inputs

    try:
        recorded = read_inputs(Path(options.folder) / COMMAND)
    except ExecutionError as error:
        fail(error)
    name, own = (recorded or {}).get("command"), (recorded or {}).get("options")
    if not isinstance(own, dict) or name not in _COMMANDS:
        fail(f"{options.folder}: holds no shards ({COMMAND} is missing); run them first, with --shard k/n")
    where = {"out": options.folder, "json": options.json, "shard": MERGE}
    here = {"workers": None, "dask": None, "resume": False, "force": False}
    as_command(_COMMANDS[str(name)])(**own, **where, **here)
