"""`eclsim devices`: what can be connected, with ranges and how well each is known."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from eclsim.devices.device import AnyDevice


def devices(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="Show all that is known of this device.")
    ] = None,
) -> None:
    """List devices, and the pumps, cannulae, oxygenators and filters they are made of, or explain one."""
    typer.echo("\n".join(_overview() if name is None else _details(name)))


def _overview() -> Iterator[str]:
    from eclsim.cli.tables import columns
    from eclsim.devices.registry import devices, products

    yield "Devices (sections of a case file)"
    rows = [(f"[{key}]", one.name, ", ".join(one.section.fields())) for key, one in devices().items()]
    yield columns(("section", "device", "keys"), rows)
    kinds = {type(product): type(product) for product in products().values()}
    for kind in kinds:
        yield f"\n{kind.title}"
        yield columns(kind.head, [p.row() for p in products().values() if type(p) is kind], kind.numeric)
        if kind.remark:
            yield kind.remark


def _details(name: str) -> Iterator[str]:
    from eclsim.cli.messages import fail
    from eclsim.devices.products import makers_names
    from eclsim.devices.registry import devices, products
    from eclsim.parameters import did_you_mean

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
        hint = did_you_mean(name, [*devices(), *products(), *others])
        allowed = ", ".join((*devices(), *products()))
        fail(f"unknown device {name!r}; allowed: {allowed}" + (f"; did you mean {hint}?" if hint else ""))


def _section(device: AnyDevice) -> Iterator[str]:
    """The section of a device and its parameters."""
    yield f"[{device.key}]: {device.name}"
    for field in device.section.fields().values():
        needed = "" if field.required else " (may be left out)"
        yield f"  {field.name:<18} {field.description}; allowed: {field.allowed}{needed}"
    for parameter in device.parameters:
        yield f"  {parameter.key:<18} {parameter.description}: {parameter.value:g} {parameter.unit}"
