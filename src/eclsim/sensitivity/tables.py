"""The files of a finished analysis besides its samples: indices, pairs, failed runs and convergence."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eclsim.sensitivity.convergence import Convergence
from eclsim.sensitivity.indices import Indices
from eclsim.sensitivity.store import write_whole


def write_results(folder: Path, indices: Indices, settled: Convergence | None = None) -> None:
    """Write indices.json, indices.csv, second_order.csv, failed.csv and convergence.csv."""
    write_json(folder / "indices.json", indices.as_object(second_order=True))
    head = ("output", "factor", "S1", "S1_conf", "ST", "ST_conf", "selected")
    _write(folder / "indices.csv", head, _index_rows(indices))
    if indices.estimates.S2 is not None:
        head = ("output", "factor", "other_factor", "S2", "S2_conf")
        _write(folder / "second_order.csv", head, _pair_rows(indices))
    head = ("run", "row", "point", "status", *(indices.failed[0].inputs if indices.failed else ()))
    _write(
        folder / "failed.csv",
        head,
        ((f.run, f.row, f.point, f.status, *f.inputs.values()) for f in indices.failed),
    )
    if settled is not None:
        head = ("rows", "repeats", "output", "factor", "index", "mean", "spread", "mean_conf")
        _write(folder / "convergence.csv", head, _convergence_rows(settled))


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write an object as JSON."""
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    write_whole(path, lambda partial: partial.write_text(text, encoding="utf-8"))


def _index_rows(indices: Indices) -> Iterable[Sequence[object]]:
    e, chosen = indices.estimates, indices.selected()
    for k, output in enumerate(indices.outputs):
        for j, factor in enumerate(indices.factors):
            numbers = (e.S1[k, j], e.S1_conf[k, j], e.ST[k, j], e.ST_conf[k, j])
            yield output, factor, *map(_text, numbers), int(factor in chosen[output])


def _pair_rows(indices: Indices) -> Iterable[Sequence[object]]:
    e = indices.estimates
    assert e.S2 is not None
    assert e.S2_conf is not None
    for k, output in enumerate(indices.outputs):
        for i, j in zip(*np.triu_indices(len(indices.factors), 1), strict=True):
            pair = indices.factors[i], indices.factors[j]
            yield output, *pair, _text(e.S2[k, i, j]), _text(e.S2_conf[k, i, j])


def _convergence_rows(settled: Convergence) -> Iterable[Sequence[object]]:
    for s, rows in enumerate(settled.rows):
        for k, output in enumerate(settled.outputs):
            for j, factor in enumerate(settled.factors):
                for name in ("S1", "ST"):
                    numbers = (settled.mean[name], settled.spread[name], settled.width[name])
                    texts = (_text(n[s, k, j]) for n in numbers)
                    yield int(rows), int(settled.repeats[s]), output, factor, name, *texts


def _text(number: float) -> str:
    return "" if np.isnan(number) else f"{number:.8g}"


def _write(path: Path, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    def write(partial: Path) -> None:
        with partial.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(head)
            writer.writerows(rows)

    write_whole(path, write)
