"""`eclsim devices`: what can be connected, with ranges and how well each is known."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from eclsim.devices.constants import CannulaType, Dialyzer, Oxygenator, RotaryPump

    Device = RotaryPump | CannulaType | Oxygenator | Dialyzer


def devices(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="Show all that is known of this device.")
    ] = None,
) -> None:
    """List pumps, cannulae, oxygenators and filters with their ranges, or explain one of them."""
    typer.echo("\n".join(_overview() if name is None else _details(name)))


def _overview() -> Iterator[str]:
    from eclsim.cli.tables import columns
    from eclsim.devices.constants import CANNULAE, DIALYZERS, OXYGENATORS, PUMPS

    pumps = [(p.key, p.name, p.use, _range(p.speed_range_rpm), _short(p.evidence)) for p in PUMPS.values()]
    yield "Pumps"
    yield columns(("name", "device", "use", "speed [rpm]", "checked against"), pumps)
    yield "{ roller_l_min = 4.0 } in place of a name: a roller pump with this flow [L/min]"
    yield "\nCannulae"
    cannulae = [(c.key, c.name, ", ".join(map(str, c.sizes_fr)), c.evidence) for c in CANNULAE.values()]
    yield columns(("name", "device", "sizes [Fr]", "checked against"), cannulae)
    yield "\nOxygenators"
    oxygenators = [
        (o.key, f"{o.resistance:g}", _range(o.label_flow_l_min), _number(o.priming_volume_ml), o.evidence)
        for o in OXYGENATORS.values()
    ]
    head = ("name", "R [mmHg s/mL]", "label flow [L/min]", "priming [mL]", "checked against")
    yield columns(head, oxygenators, numeric=(1, 3))
    yield "\nCRRT filters (set by the parameter Rcrrtfil)"
    filters = [
        (d.key, f"{d.resistance:g}", f"{d.priming_volume_ml:g}", d.evidence) for d in DIALYZERS.values()
    ]
    yield columns(("name", "R [mmHg s/mL]", "priming [mL]", "checked against"), filters, numeric=(1, 2))


def _details(name: str) -> Iterator[str]:
    from eclsim.cli.messages import fail
    from eclsim.devices.constants import CANNULAE, DIALYZERS, OXYGENATORS, PUMP_ALIASES, PUMPS
    from eclsim.parameters import did_you_mean

    known: dict[str, Device] = {**PUMPS, **CANNULAE, **OXYGENATORS, **DIALYZERS}
    by_lower_case = {key.lower(): key for key in known} | {k.lower(): v for k, v in PUMP_ALIASES.items()}
    key = by_lower_case.get(name.strip().lower())
    if key is None:
        hint = did_you_mean(name, [*known, *PUMP_ALIASES])
        fail(
            f"unknown device {name!r}; allowed: {', '.join(known)}"
            + (f"; did you mean {hint}?" if hint else "")
        )
    device = known[key]
    yield f"{key}: {getattr(device, 'name', key)}"
    yield from _numbers(device)
    yield f"  checked against    {device.evidence}"
    yield f"  source             {device.source}"


def _numbers(device: Device) -> Iterator[str]:
    from eclsim.devices.constants import CannulaType, Oxygenator, RotaryPump

    if isinstance(device, RotaryPump):
        yield f"  use                {device.use}"
        yield f"  speed              {_range(device.speed_range_rpm)} rpm"
        yield "  H = a n^2 - R1 n Q - R2 Q^2, and + Rrec (Q - kinf n)^2 below Q = kinf n"
        yield "  with H in mmHg, n in rpm, Q in L/min and"
        yield from (f"    {name:<6} {value:g}" for name, value in device.constants.items())
        for speed in (device.speed_range_rpm[0], sum(device.speed_range_rpm) / 2, device.speed_range_rpm[1]):
            heads = ", ".join(f"{device.head_mmhg(speed, flow):.0f} at {flow}" for flow in (0, 2, 4, 6))
            yield f"  head at {speed:g} rpm: {heads} L/min [mmHg]"
    elif isinstance(device, CannulaType):
        yield "  size [Fr], length [cm], pressure drop [mmHg] at 2 and 4 L/min"
        for size, length in device.length_cm.items():
            drops = f"{device.pressure_drop_mmhg(size, 2):5.0f} {device.pressure_drop_mmhg(size, 4):5.0f}"
            yield f"    {size:3d} {length:4g} {drops}"
    else:
        yield f"  resistance         {device.resistance:g} mmHg s/mL"
        yield f"  priming volume     {_number(device.priming_volume_ml)} mL"
        if isinstance(device, Oxygenator):
            yield f"  label flow         {_range(device.label_flow_l_min)} L/min"


def _range(limits: tuple[float, float] | None) -> str:
    return f"{limits[0]:g} to {limits[1]:g}" if limits else "not known"


def _short(evidence: str) -> str:
    return evidence.partition(";")[0]


def _number(value: float | None) -> str:
    return f"{value:g}" if value is not None else "not known"
