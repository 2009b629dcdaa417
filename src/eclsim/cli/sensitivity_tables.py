"""The table that `eclsim sensitivity` shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from eclsim.sensitivity.results import Indices

MOST_PAIRS = 20
FAINTEST = 0.005
"""Pairs below it are rounding of the first orders and not shown."""


def show(indices: Indices, state: str = "") -> None:
    """Total orders with their half widths, factors by their sums, what is selected marked."""
    from eclsim.cli.tables import columns

    title = "Total order indices" + (f", {state} state" if state else "")
    runs = f"{indices.samples} rows, {indices.evaluations} runs in {indices.seconds:.0f} s"
    typer.echo(f"{title} ({runs})")
    typer.echo("* the largest, which together make up 90 % of the sum of the total orders of that output")
    selected, e = indices.selected(), indices.estimates
    rows = []
    for name, total in indices.sums.items():
        j = indices.factors.index(name)
        cells = [
            f"{e.ST[k, j]:.3f}±{e.ST_conf[k, j]:.3f}{'*' if name in selected[o] else ' '}"
            for k, o in enumerate(indices.outputs)
        ]
        rows.append((name, *cells, f"{total:.2f}"))
    head = ("factor", *indices.outputs, "sum")
    typer.echo(columns(head, rows, numeric=range(1, len(head))))
    typer.echo(f"marked * for at least one output: {', '.join(indices.union())}")


def show_pairs(indices: Indices) -> None:
    """Second order of the pairs beyond their own half width, the largest first."""
    from eclsim.cli.tables import columns

    s2, width = indices.estimates.S2, indices.estimates.S2_conf
    if s2 is None or width is None:
        return
    found = [(k, i, j) for k, i, j in zip(*(s2 > width).nonzero(), strict=True) if s2[k, i, j] > FAINTEST]
    if not found:
        typer.echo("second order: no pair of factors is beyond its 95 % half width")
        return
    found.sort(key=lambda at: -s2[at])
    rows = [
        (
            indices.outputs[k],
            indices.factors[i],
            indices.factors[j],
            f"{s2[k, i, j]:.3f}±{width[k, i, j]:.3f}",
        )
        for k, i, j in found[:MOST_PAIRS]
    ]
    typer.echo("Second order indices beyond their 95 % half width")
    typer.echo(columns(("output", "factor", "with", "S2"), rows, numeric=(3,)))
    if len(found) > MOST_PAIRS:
        typer.echo(f"and {len(found) - MOST_PAIRS} more, in second_order.csv with --out")
