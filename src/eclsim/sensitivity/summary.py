"""What the command line shows of indices and of identifiability, as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eclsim.reporting.text_table import text_table

if TYPE_CHECKING:
    from eclsim.sensitivity.identifiability import Identifiability
    from eclsim.sensitivity.results import Indices

MOST_PAIRS = 20
FAINTEST = 0.005
"""Pairs below it are rounding of the first orders and not shown."""


def indices_text(indices: Indices, state: str = "") -> str:
    """Total orders with their half widths, factors by their sums, what is selected marked."""
    title = "Total order indices" + (f", {state} state" if state else "")
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
    return "\n".join((
        f"{title} ({indices.samples} rows, {indices.evaluations} runs in {indices.seconds:.0f} s)",
        "* the largest, which together make up 90 % of the sum of the total orders of that output",
        text_table(head, rows, numeric=range(1, len(head))),
        f"marked * for at least one output: {', '.join(indices.union())}",
    ))  # fmt: skip


def pairs_text(indices: Indices) -> str:
    """Second order of the pairs beyond their own half width, the largest first; empty if not computed."""
    s2, width = indices.estimates.S2, indices.estimates.S2_conf
    if s2 is None or width is None:
        return ""
    pairs = [(k, i, j) for k, i, j in zip(*(s2 > width).nonzero(), strict=True) if s2[k, i, j] > FAINTEST]
    if not pairs:
        return "second order: no pair of factors is beyond its 95 % half width"
    pairs.sort(key=lambda at: -s2[at])
    rows = [
        (
            indices.outputs[k],
            indices.factors[i],
            indices.factors[j],
            f"{s2[k, i, j]:.3f}±{width[k, i, j]:.3f}",
        )
        for k, i, j in pairs[:MOST_PAIRS]
    ]
    table = text_table(("output", "factor", "with", "S2"), rows, numeric=(3,))
    left = len(pairs) - MOST_PAIRS
    more = f"\nand {left} more, in second_order.csv with --out" if left > 0 else ""
    return f"Second order indices beyond their 95 % half width\n{table}{more}"


def failures(indices: Indices, state: str = "") -> list[str]:
    """How many runs failed, and how."""
    if not indices.failed:
        return []
    kinds = ", ".join(sorted({f.status for f in indices.failed}))
    lost = indices.samples - indices.rows_used
    line = f"{len(indices.failed)} of {indices.evaluations} runs failed ({kinds}); {lost} rows are left out"
    return [f"{state + ': ' if state else ''}{line}"]


def identifiability_text(result: Identifiability, limit: float) -> str:
    """Measurements, collinearity of all sets, the set proposed, and why others are left out."""
    p = result.proposal
    effect = dict(zip(result.scaled.parameters, result.scaled.effect, strict=True))
    chosen = [(n, f"{effect[n]:.3g}", f"{100 * p.relative_errors[n]:.3g} %") for n in p.chosen]
    return "\n".join((
        "Measurements and their standard uncertainties (a percentage is one of the measured value)",
        _measurements(result),
        *_far_off(result),
        "\nCollinearity index of all sets of a size (above the limit: cannot be told apart)",
        _subsets(result, limit),
        f"\nProposed to fit together (collinearity index {p.collinearity:.2f})",
        text_table(("parameter", "effect", "least standard error"), chosen, numeric=(1, 2)),
        "\nLeft out",
        text_table(("parameter", "reason"), list(p.excluded.items())),
    ))  # fmt: skip


def _measurements(result: Identifiability) -> str:
    rows = [
        (
            o,
            f"{result.measured[o]:.4g}" if o in result.measured else "-",
            f"{result.simulated[o]:.4g}",
            f"±{u:.3g}",
        )
        for o, u in result.uncertainties.items()
    ]
    return text_table(("output", "measured", "simulated", "uncertainty"), rows, numeric=(1, 2, 3))


def _far_off(result: Identifiability) -> list[str]:
    if not result.far_off:
        return []
    off = ", ".join(f"{o} by {abs(d):.0f}" for o, d in result.far_off.items())
    return [
        f"The model misses these measurements, in standard uncertainties: {off}. What follows holds near the "
        "model's values: fit the case first (eclsim identify) and analyse the fitted one."
    ]


def _subsets(result: Identifiability, limit: float) -> str:
    rows = [
        (
            str(s.size),
            str(s.count),
            str(s.below_limit),
            f"{s.smallest:.2f}",
            f"{s.quantiles[1]:.3g}",
            " ".join(s.best),
        )
        for s in result.subsets
    ]
    head = ("size", "sets", f"up to {limit:g}", "smallest", "median", "set with the smallest")
    return text_table(head, rows, numeric=range(5))
