"""The table that `eclsim sensitivity` shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from eclsim.sensitivity.indices import Indices


def show(indices: Indices, state: str = "") -> None:
    """Total orders with their half widths, factors by their sums, what is selected marked."""
    from eclsim.cli.tables import columns

    title = "Total order indices" + (f", {state} state" if state else "")
    runs = f"{indices.samples} rows, {indices.evaluations} runs in {indices.seconds:.0f} s"
    typer.echo(f"{title} ({runs}; * among those that make up 90 %)")
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
    typer.echo(f"union: {', '.join(indices.union())}")
