"""`eclsim parameters`: list, explain and export the model's parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from eclsim.parameters import Parameter

SetName = Literal["thiel2025", "shi_hose2009"]
_FIELDS = ("key", "value", "unit", "minimum", "maximum", "group", "description", "source")
_SetOption = Annotated[SetName, typer.Option("--set", help="Published set of parameters.")]

app = typer.Typer(
    help="List, explain and export the model's parameters with unit, source and allowed range.",
    no_args_is_help=False,
    invoke_without_command=True,
    rich_markup_mode=None,
)


@app.callback()
def _default(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        list_parameters()


@app.command("list")
def list_parameters(
    set_name: _SetOption = "thiel2025",
    group: Annotated[
        str | None,
        typer.Option(help="Only this group: blood, systemic, pulmonary, heart, ecmo, crrt or initial."),
    ] = None,
) -> None:
    """Show every parameter on a line: key, value, allowed range, unit, description."""
    from eclsim.cli.tables import columns

    chosen = _of_group(_set(set_name), group)
    rows = [
        (p.key, f"{p.value:g}", f"{p.minimum:g}", f"{p.maximum:g}", p.unit, p.description) for p in chosen
    ]
    typer.echo(columns(("key", "value", "lowest", "highest", "unit", "description"), rows, numeric=(1, 2, 3)))


@app.command("explain")
def explain(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Key such as Rmc, or its description.")],
) -> None:
    """Show all that is known of one parameter, and its bounds when it is fitted."""
    from eclsim.cli.messages import fail
    from eclsim.parameters import UnknownParameterError, find
    from eclsim.parameters.identification import BOUNDS

    try:
        parameter = find(name)
    except UnknownParameterError as error:
        fail(f"{error} (eclsim parameters lists all)")
    lines = [
        f"{parameter.key}: {parameter.description}",
        f"  default   {parameter.value:g} {parameter.unit}",
        f"  allowed   {parameter.allowed}",
        f"  group     {parameter.group}",
        f"  source    {parameter.source}",
    ]
    if parameter.key in BOUNDS:
        bounds = BOUNDS[parameter.key]
        lines.append(f"  fitted    from {bounds.start:g}, between {bounds.lower:g} and {bounds.upper:g}")
    typer.echo("\n".join(lines))


@app.command("export")
def export(
    format_name: Annotated[
        Literal["csv", "toml", "json"],
        typer.Option("--format", help="Format that is written to standard output."),
    ] = "csv",
    set_name: _SetOption = "thiel2025",
) -> None:
    """Write all parameters with all their fields to standard output."""
    writers = {"csv": _as_csv, "toml": _as_toml, "json": _as_json}
    typer.echo(writers[format_name](list(_set(set_name).values())), nl=False)


def _set(name: SetName) -> dict[str, Parameter]:
    from eclsim.parameters import shi_hose2009, thiel2025

    return dict({"thiel2025": thiel2025, "shi_hose2009": shi_hose2009}[name].PARAMETERS)


def _of_group(parameters: dict[str, Parameter], group: str | None) -> list[Parameter]:
    from eclsim.cli.messages import fail
    from eclsim.parameters import did_you_mean

    groups = list(dict.fromkeys(parameter.group for parameter in parameters.values()))
    if group is not None and group not in groups:
        hint = did_you_mean(group, groups)
        fail(
            f"--group {group}: unknown; allowed: {', '.join(groups)}"
            + (f"; did you mean {hint}?" if hint else "")
        )
    return [parameter for parameter in parameters.values() if group in (None, parameter.group)]


def _as_csv(parameters: Sequence[Parameter]) -> str:
    from eclsim.files import csv_text

    rows = ([getattr(parameter, name) for name in _FIELDS] for parameter in parameters)
    return csv_text(_FIELDS, rows, digits=None)


def _as_json(parameters: Sequence[Parameter]) -> str:
    from eclsim.files import json_text

    rows = [{name: getattr(parameter, name) for name in _FIELDS} for parameter in parameters]
    return json_text({"parameters": rows})


def _as_toml(parameters: Sequence[Parameter]) -> str:
    """A [parameters] section that a case file can take over, with unit and meaning as comments."""
    lines = ["[parameters]"]
    for parameter in parameters:
        lines.append(f"{parameter.key} = {parameter.value!r}  # {parameter.description} [{parameter.unit}]")
    return "\n".join(lines) + "\n"
