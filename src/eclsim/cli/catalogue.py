"""Commands `eclsim parameters`, `devices` and `outputs`: what there is, with units, ranges and sources."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import typer

from eclsim.cli.console import fail
from eclsim.cli.options import argument, option
from eclsim.files import csv_text, json_text
from eclsim.reporting.numbers import text_table
from eclsim.spelling import spelling_hint

if TYPE_CHECKING:
    from eclsim.devices.device import AnyDevice
    from eclsim.parameters import Parameter

SetName = Literal["all", "thiel2025", "physiology", "regulation", "shi_hose2009"]
_FIELDS = ("key", "value", "unit", "minimum", "maximum", "group", "description", "source")


@dataclass(frozen=True, kw_only=True)
class ParameterSet:
    """Options of the commands of `eclsim parameters`."""

    set_name: SetName = option("thiel2025", "Set of parameters.", "--set")


@dataclass(frozen=True, kw_only=True)
class ListOptions(ParameterSet):
    """Options of `eclsim parameters list`."""

    set_name: SetName = option("all", "Set of parameters; all: every one that a case file may set.", "--set")

    group: str | None = option(
        None,
        "Only this group, such as systemic, heart or the section of a device; an unknown one lists them all.",
    )


@dataclass(frozen=True, kw_only=True)
class ExplainOptions:
    """Options of `eclsim parameters explain`."""

    name: str = argument(..., "NAME", "Key such as Rmc, or its description.")


@dataclass(frozen=True, kw_only=True)
class ExportOptions(ParameterSet):
    """Options of `eclsim parameters export`."""

    format_name: Literal["csv", "toml", "json"] = option(
        "csv", "Format written to standard output.", "--format"
    )


def list_parameters(options: ListOptions) -> None:
    """Show one parameter per line: key, value, allowed range, unit, description."""
    parameters = _set(options.set_name).values()
    groups = list(dict.fromkeys(parameter.group for parameter in parameters))
    group = options.group
    if group is not None and group not in groups:
        fail(f"--group {group}: unknown; allowed: {', '.join(groups)}{spelling_hint(group, groups)}")
    rows = [
        (p.key, f"{p.value:g}", f"{p.minimum:g}", f"{p.maximum:g}", p.unit, p.description)
        for p in parameters
        if group in (None, p.group)
    ]
    head = ("key", "value", "lowest", "highest", "unit", "description")
    typer.echo(text_table(head, rows, numeric=(1, 2, 3)))


def explain(options: ExplainOptions) -> None:
    """Show everything known about one parameter, and its bounds in a fit."""
    from eclsim.devices.registry import UnknownParameterError, find_parameter

    try:
        parameter = find_parameter(options.name)
    except UnknownParameterError as error:
        fail(f"{error} (eclsim parameters lists all)")
    lines = [
        f"{parameter.key}: {parameter.description}",
        f"  default   {parameter.value:g} {parameter.unit}",
        f"  allowed   {parameter.allowed}",
        f"  group     {parameter.group}",
        f"  source    {parameter.source}",
    ]
    if (bounds := parameter.bounds) is not None:
        lines.append(f"  fitted    from {bounds.start:g}, between {bounds.lower:g} and {bounds.upper:g}")
    typer.echo("\n".join(lines))


def export(options: ExportOptions) -> None:
    """Write all parameters with all their fields to standard output."""
    parameters = list(_set(options.set_name).values())
    rows = [{name: getattr(parameter, name) for name in _FIELDS} for parameter in parameters]
    if options.format_name == "csv":
        text = csv_text(_FIELDS, (row.values() for row in rows), digits=None)
    elif options.format_name == "json":
        text = json_text({"parameters": rows})
    else:  # sections that can be copied into a case file, with unit and meaning as comments
        lines: dict[str, list[str]] = {}
        for p in parameters:
            section, _, key = p.key.rpartition(".")
            line = f"{key} = {p.value!r}  # {p.description} [{p.unit}]"
            lines.setdefault(section or "parameters", []).append(line)
        text = "\n".join(line for name, items in lines.items() for line in (f"[{name}]", *items)) + "\n"
    typer.echo(text, nl=False)


def _set(name: str) -> Mapping[str, Parameter]:
    from eclsim.devices.registry import parameters
    from eclsim.parameters import physiology, regulation, shi_hose2009

    if name == "all":
        return parameters()
    if name == "thiel2025":  # Tables S-1 to S-3, devices included, the initial state last
        published = (p for p in parameters().values() if "Thiel et al. 2025" in p.source)
        return {p.key: p for p in sorted(published, key=lambda p: p.group == "initial")}
    sets = {"physiology": physiology, "regulation": regulation, "shi_hose2009": shi_hose2009}
    return sets[name].PARAMETERS


# --- devices --------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class DevicesOptions:
    """Options of `eclsim devices`."""

    name: str | None = argument(None, "[NAME]", "Show everything known about this device.")


def devices(options: DevicesOptions) -> None:
    """List devices, and the pumps, cannulae, oxygenators and filters they are made of, or explain one."""
    typer.echo("\n".join(_overview() if options.name is None else _details(options.name)))


def _overview() -> Iterator[str]:
    from eclsim.devices.registry import devices, products

    yield "Devices (sections of a case file)"
    rows = [(f"[{key}]", entry.name, ", ".join(entry.section.fields())) for key, entry in devices().items()]
    yield text_table(("section", "device", "keys"), rows)
    kinds = {type(product): type(product) for product in products().values()}
    for kind in kinds:
        yield f"\n{kind.title}"
        yield text_table(kind.head, [p.row() for p in products().values() if type(p) is kind], kind.numeric)
        if kind.remark:
            yield kind.remark


def _details(name: str) -> Iterator[str]:
    from eclsim.devices.products import makers_names
    from eclsim.devices.registry import devices, products

    written = name.strip().lower()
    known = {key.lower(): product for key, product in products().items()}
    others = makers_names(products().values())
    known |= {other.lower(): products()[key] for other, key in others.items()}
    if written in devices():
        yield from _section(devices()[written])
    elif written in known:
        product = known[written]
        yield f"{product.key}: {product.full_name}"
        yield from product.details()
        yield f"  checked against    {product.evidence}"
        yield f"  source             {product.source}"
    else:
        hint = spelling_hint(name, [*devices(), *products(), *others])
        allowed = ", ".join((*devices(), *products()))
        fail(f"unknown device {name!r}; allowed: {allowed}{hint}")


def _section(device: AnyDevice) -> Iterator[str]:
    """Yield the lines that describe a device's section and parameters."""
    yield f"[{device.key}]: {device.name}"
    for field in device.section.fields().values():
        needed = "" if field.required else " (may be left out)"
        yield f"  {field.name:<18} {field.description}; allowed: {field.allowed}{needed}"
    for parameter in device.parameters:
        if parameter.key in device.section.parameters:
            continue
        yield f"  {parameter.key:<18} {parameter.description}: {parameter.value:g} {parameter.unit}"


# --- outputs --------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class OutputsOptions:
    """Options of `eclsim outputs`."""

    name: str | None = argument(None, "[NAME]", "Show everything known about this output.")


def outputs(options: OutputsOptions) -> None:
    """List the outputs of a steady beat by what a case needs for them, or explain one."""
    typer.echo(_output_list() if options.name is None else _output_details(options.name))


def _output_list() -> str:
    from eclsim.reporting.output_catalogue import output_catalogue

    catalogue = output_catalogue()
    rows = [(e.key, e.unit, e.label) for entries in catalogue.values() for e in entries]
    lines = iter(text_table(("name", "unit", "meaning"), rows).splitlines())
    text = [next(lines)]
    for needed, entries in catalogue.items():
        text += ["", f"In {needed}" if not entries[0].needs else f"With {needed}"]
        text += [next(lines) for _ in entries]
    return "\n".join(text)


def _output_details(name: str) -> str:
    from eclsim.cases.sections import MEASURED
    from eclsim.outputs.limits import limits_of
    from eclsim.outputs.registry import UnknownOutputError
    from eclsim.reporting.output_catalogue import describe

    try:
        entry = describe(name.strip())
    except UnknownOutputError as error:
        fail(f"{error} (eclsim outputs explains them)")
    lines = [
        f"{entry.key}: {entry.label}",
        f"  unit        {entry.unit}",
        f"  definition  {entry.definition}",
        f"  place       {entry.place or 'the whole patient'}",
        f"  needs       {entry.needed if entry.needs else 'nothing: every case has it'}",
        f"  measured    {'a key of [measurements]' if entry.key in MEASURED else 'no key of [measurements]'}",
    ]
    lines += [
        f"  {limit.kind:<11} {limit.side} {limit.value:g} {entry.unit}: {limit.meaning} ({limit.source})"
        for limit in limits_of(entry.key)
    ]
    return "\n".join(lines)
