"""`eclsim benchmark`: how fast it is on this machine."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from eclsim.validation.timing import Measurement


def benchmark(
    json_file: Annotated[
        str | None,
        typer.Option(
            "--json", metavar="FILE", help="Write the figures as JSON; - writes to standard output."
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that exists.")] = False,
) -> None:
    """Measure speed and memory on the paper's patient, beside the bars and the published code's numbers.

    Takes one to two minutes. Exit status: 0 all bars hold, 1 a bar is missed, 2 bad input.
    """
    from eclsim.cli.messages import SOME_DID_NOT_CONVERGE, say
    from eclsim.cli.output_option import destination

    target = destination("--json", json_file, force)
    from eclsim.validation import timing
    from eclsim.validation.timing import machine

    found = []
    for measurement in timing.measurements():
        found.append(measurement)
        say(f"measured: {measurement.name}")
    about = machine()
    if target is not None:
        from eclsim.files import write_json

        write_json({"machine": about, "measurements": [_plain(one) for one in found]}, target)
    if target != "-":
        typer.echo(table(found))
        typer.echo("\n" + ", ".join(f"{key} {value}" for key, value in about.items()))
    if not all(one.holds for one in found):
        raise typer.Exit(SOME_DID_NOT_CONVERGE)


def table(found: list[Measurement]) -> str:
    """The figures as text."""
    from eclsim.cli.tables import columns

    head = ("figure", "elapsed", "processor", "bar", "verdict", "published code", "times faster")
    rows = [
        (
            one.name,
            *(_with_unit(number, one) for number in (one.value, one.processor, one.bar)),
            "ok" if one.holds else "MISS",
            _with_unit(one.published, one),
            f"{one.ratio:.0f}" if one.ratio else "",
        )
        for one in found
    ]  # fmt: skip
    remarks = "\n".join(f"  {one.name}: {one.remark}" for one in found)
    return f"{columns(head, rows, numeric=(1, 2, 3, 5, 6))}\n{remarks}"


def _with_unit(value: float | None, one: Measurement) -> str:
    return "" if value is None else f"{value:.3g} {one.unit}" if value < 1000 else f"{value:,.0f} {one.unit}"


def _plain(one: Measurement) -> dict[str, object]:
    return {
        "name": one.name, "value": one.value, "unit": one.unit, "processor_time": one.processor,
        "bar": one.bar,
        "holds": one.holds, "published_code": one.published, "times_faster": one.ratio, "remark": one.remark,
    }  # fmt: skip
