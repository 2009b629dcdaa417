"""The files of a finished analysis besides its samples: indices, pairs, failed runs and convergence."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from eclsim.files import csv_text, write_json, write_text
from eclsim.sensitivity.convergence import Convergence
from eclsim.sensitivity.indices import Indices


def write_results(folder: Path, indices: Indices, settled: Convergence | None = None) -> None:
    """Write indices.json, indices.csv, second_order.csv, failed.csv and convergence.csv."""
    write_json(indices.as_object(second_order=True), folder / "indices.json")
    head = ("output", "factor", "S1", "S1_conf", "ST", "ST_conf", "selected")
    write_text(csv_text(head, _index_rows(indices)), folder / "indices.csv")
    if indices.estimates.S2 is not None:
        head = ("output", "factor", "other_factor", "S2", "S2_conf")
        write_text(csv_text(head, _pair_rows(indices)), folder / "second_order.csv")
    head = ("run", "row", "point", "status", *(indices.failed[0].inputs if indices.failed else ()))
    rows = ((f.run, f.row, f.point, f.status, *f.inputs.values()) for f in indices.failed)
    write_text(csv_text(head, rows, digits=None), folder / "failed.csv")
    if settled is not None:
        head = ("rows", "repeats", "output", "factor", "index", "mean", "spread", "mean_conf")
        write_text(csv_text(head, _convergence_rows(settled)), folder / "convergence.csv")


def _index_rows(indices: Indices) -> Iterable[Sequence[object]]:
    e, chosen = indices.estimates, indices.selected()
    for k, output in enumerate(indices.outputs):
        for j, factor in enumerate(indices.factors):
            numbers = (e.S1[k, j], e.S1_conf[k, j], e.ST[k, j], e.ST_conf[k, j])
            yield output, factor, *numbers, int(factor in chosen[output])


def _pair_rows(indices: Indices) -> Iterable[Sequence[object]]:
    e = indices.estimates
    assert e.S2 is not None
    assert e.S2_conf is not None
    for k, output in enumerate(indices.outputs):
        for i, j in zip(*np.triu_indices(len(indices.factors), 1), strict=True):
            pair = indices.factors[i], indices.factors[j]
            yield output, *pair, e.S2[k, i, j], e.S2_conf[k, i, j]


def _convergence_rows(settled: Convergence) -> Iterable[Sequence[object]]:
    for s, rows in enumerate(settled.rows):
        for k, output in enumerate(settled.outputs):
            for j, factor in enumerate(settled.factors):
                for name in ("S1", "ST"):
                    numbers = (settled.mean[name], settled.spread[name], settled.width[name])
                    about = (int(rows), int(settled.repeats[s]), output, factor, name)
                    yield *about, *(n[s, k, j] for n in numbers)
