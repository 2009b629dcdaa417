"""Results of an analysis: labelled indices of every output, quantities derived from them, and files.

Convergence: an aligned part of 2^k rows of a scrambled Sobol sequence is itself a design of 2^k rows. A
design of N rows therefore contains N/n designs of n rows, which are repeats without additional runs (the
paper's Figure S-1).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.cases.fit_mark import with_doubts
from eclsim.devices.description import placed_sentence
from eclsim.files import ORIGIN, csv_text, write_json, write_text
from eclsim.orbit.model import CASE
from eclsim.outputs.alarms import IMPOSSIBLE_BEAT
from eclsim.reporting.numbers import text_table
from eclsim.sensitivity.design import Design, Estimates, sobol_indices, varies
from eclsim.sensitivity.failed_region import FailedRegion, failed_region
from eclsim.sensitivity.inputs import RANGE_OF, Input
from eclsim.sensitivity.ranges import input_object, input_rows, range_text, ranges_text
from eclsim.sensitivity.runs import Runs, gas_words, status_word

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

SHARE = 0.9
"""Share of the sum of an output's total-order indices that the selected factors account for."""
FEWEST_ROWS = 64
"""Factors are ranked and selected only from at least this number of rows, and half of the design's rows."""
SMALLEST_SIZE = 1.0
"""Smallest size of an output, in its unit, with which its standard deviation is compared."""
FIRST_CONVERGENCE_ROWS = 16
MOST_PAIRS = 20
LINE = 110
"""Letters of a line of the terminal text."""
NO_CENTRAL_BEAT = "the case itself has no definite steady beat"
"""Start of the warning about a case whose beat at the base values is none, or one of many."""
SMALLEST_PAIR_INDEX = 0.005
"""Smaller second-order indices are rounding of the first orders and not shown."""


@dataclass(frozen=True)
class FailedRun:
    """One run without a result.

    Args:
        run: position in the design.
        row: row of the design, which is left out.
        point: kind of the point: A, B, AB or BA with the factor exchanged.
        status: how the run ended.
        inputs: value or choice of each input.
    """

    run: int
    row: int
    point: str
    status: str
    inputs: dict[str, float | str]


@dataclass(frozen=True)
class Indices:
    """Sobol indices of some outputs with respect to some factors.

    Args:
        factors: names of the inputs or groups.
        outputs: names of the outputs.
        estimates: values of the indices.
        samples: number of rows of the design.
        evaluations: number of model runs.
        failed: runs without a result; their rows are left out of the estimates.
        rows_used: number of rows that the estimates are based on.
        seconds: wall clock time [s]; None if unknown, after a merge of shards.
        warnings: warnings about the ranges, and about the beat at the base values of the inputs.
        constant: outputs that vary by no more than rounding, whose indices are zero.
        impossible: number of runs in these rows with a beat that no patient can have, with a chamber without
            blood or a vein sucked shut.
        where_failed: region that holds most of the failed runs; None if no input separates them.
        until: half width that every total order was to reach; None if the number of rows was fixed.
        inputs: the inputs with their ranges.
        stored: number of the runs that an earlier start had stored, for which `seconds` does not count.
        state: name of the state of `eclsim sensitivity --states`; empty for the case's own values.
    """

    factors: tuple[str, ...]
    outputs: tuple[str, ...]
    estimates: Estimates
    samples: int
    evaluations: int
    failed: tuple[FailedRun, ...]
    rows_used: int
    seconds: float | None = None
    warnings: tuple[str, ...] = ()
    constant: tuple[str, ...] = ()
    impossible: int = 0
    where_failed: FailedRegion | None = None
    until: float | None = None
    inputs: tuple[Input, ...] = ()
    stored: int = 0
    state: str = ""

    @property
    def ranked(self) -> bool:
        """Whether there are enough rows to rank and select factors."""
        return self.rows_used >= max(FEWEST_ROWS, self.samples / 2)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Doubts about the runs: failures, too few rows, outputs that do not vary."""
        return tuple(_doubts(self))

    @property
    def sums(self) -> dict[str, float]:
        """Total order summed over the outputs; largest first if factors are ranked (Table 2)."""
        total = self.estimates.ST.sum(axis=0)
        order = np.argsort(-total, kind="stable") if self.ranked else range(len(total))
        return {self.factors[k]: float(total[k]) for k in order}

    @property
    def sums_conf(self) -> dict[str, float]:
        """Half widths of the 95 % intervals of the sums; empty if they were not computed."""
        widths = self.estimates.sum_conf()
        return {} if widths is None else {n: float(widths[self.factors.index(n)]) for n in self.sums}

    @property
    def open_orders(self) -> list[tuple[str, str]]:
        """Neighbours by their sums, the first of them selected, whose order the intervals leave open."""
        names, chosen, known = list(self.sums), self.union(), self.estimates.order_of_sums_known
        at = self.factors.index
        return [(a, b) for a, b in pairwise(names) if a in chosen and not known(at(a), at(b))]

    @property
    def rows_lost(self) -> int:
        """Rows with a failed run, which are left out."""
        return self.samples - self.rows_used

    @property
    def domain(self) -> str:
        """What part of the ranges the indices describe, in words; empty if no run failed."""
        if not self.rows_lost:
            return ""
        has = "a steady beat"
        if any(run.status in gas_words() for run in self.failed):
            has += " and steady blood gases"
        lost = f"{self.rows_lost} of {self.samples} rows are lost"
        region = self.where_failed
        where = "" if region is None else f", most of them where {region.where}"
        return f"the indices describe only the part of the ranges where the case has {has}: {lost}{where}"

    def ranking(self, output: str) -> list[str]:
        """Factors by total order, largest first; none with too few rows or if the output does not vary."""
        if not self.ranked or output in self.constant:
            return []
        total = self.estimates.ST[self.outputs.index(output)]
        return [self.factors[k] for k in np.argsort(-total, kind="stable")]

    def selected(self, share: float = SHARE) -> dict[str, list[str]]:
        """For each output, the fewest factors whose total orders reach a share of the sum of all.

        Only those whose half width is below their total order are returned; none if nothing is ranked.
        """
        chosen = {}
        for output, total, width in zip(self.outputs, self.estimates.ST, self.estimates.ST_conf, strict=True):
            order = np.argsort(-total, kind="stable")
            summed = np.cumsum(total[order])
            some = self.ranked and summed[-1] > 0
            needed = int(np.searchsorted(summed, share * summed[-1])) + 1 if some else 0
            chosen[output] = [self.factors[k] for k in order[:needed] if width[k] < total[k]]
        return chosen

    def union(self, share: float = SHARE) -> list[str]:
        """Factors selected for any output, those with the largest sums first."""
        chosen = {name for names in self.selected(share).values() for name in names}
        return [name for name in self.sums if name in chosen]

    @property
    def dataset(self) -> xr.Dataset:
        """All indices, with half widths of their 95 % intervals (`_conf`), by output and factor."""
        import xarray as xr

        numbers = {n: v for n, v in vars(self.estimates).items() if v is not None}
        dims = ("output", "factor", "other_factor")
        chosen = self.selected()
        numbers.pop("sum_covariance", None)
        numbers["selected"] = np.array([[f in chosen[o] for f in self.factors] for o in self.outputs])
        data = {name: (dims[: values.ndim], values, {"units": "1"}) for name, values in numbers.items()}
        for name, sums in (("ST_sum", self.sums), ("ST_sum_conf", self.sums_conf)):
            if sums:
                data[name] = (("factor",), np.array([sums[f] for f in self.factors]), {"units": "1"})
        factors = list(self.factors)
        names = {"output": list(self.outputs), "factor": factors, "other_factor": factors}
        about = {
            **ORIGIN, "samples": self.samples, "evaluations": self.evaluations, "failed": len(self.failed),
            "rows_used": self.rows_used, "impossible": self.impossible, "domain": self.domain,
            "warnings": [*self.warnings, *self.doubts], "constant": list(self.constant),
            "inputs": [range_text(chosen) for chosen in self.inputs],
        }  # fmt: skip
        used = dims[: 3 if "S2" in numbers else 2]
        return xr.Dataset(data, {dim: names[dim] for dim in used}, about)

    @property
    def table(self) -> pd.DataFrame:
        """Table with one row for each output and factor."""
        names = ["S1", "S1_conf", "ST", "ST_conf", "selected"]
        return self.dataset[names].to_dataframe().reset_index().astype({"selected": int})

    @property
    def pairs(self) -> pd.DataFrame | None:
        """Table with one row for each output and pair of factors; None without second order."""
        if self.estimates.S2 is None:
            return None
        table = self.dataset[["S2", "S2_conf"]].to_dataframe()
        return table[table["S2"].notna()].reset_index()  # each pair of factors once

    def as_object(self, second_order: bool = False) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            **({"state": self.state} if self.state else {}),
            "samples": self.samples, "evaluations": self.evaluations, "failed": len(self.failed),
            "where_failed": None if self.where_failed is None else self.where_failed.as_object(),
            "rows_used": self.rows_used, "rows_lost": self.rows_lost, "domain": self.domain,
            "impossible": self.impossible, "seconds": self.seconds and round(self.seconds, 3),
            "inputs": {chosen.name: input_object(chosen) for chosen in self.inputs},
            "warnings": [*self.warnings, *self.doubts], "constant": list(self.constant),
            "outputs": {o: self._output_object(k, second_order) for k, o in enumerate(self.outputs)},
            "sum_ST": self.sums, "sum_ST_conf": self.sums_conf, "order_not_known": self.open_orders,
            "selected": self.selected(), "union": self.union(),
        }  # fmt: skip

    def _output_object(self, k: int, second_order: bool) -> dict[str, dict[str, Any]]:
        e = self.estimates
        single = {"S1": e.S1, "S1_conf": e.S1_conf, "ST": e.ST, "ST_conf": e.ST_conf}
        content: dict[str, dict[str, Any]] = {
            name: dict(zip(self.factors, values[k].tolist(), strict=True)) for name, values in single.items()
        }
        if second_order and e.S2 is not None and e.S2_conf is not None:
            for name, pairs in (("S2", e.S2), ("S2_conf", e.S2_conf)):
                content[name] = {
                    factor: {self.factors[j]: float(pairs[k, i, j]) for j in range(i + 1, len(self.factors))}
                    for i, factor in enumerate(self.factors[:-1])
                }
        return content


@dataclass(frozen=True)
class SensitivityResult:
    """A finished analysis: its indices, and the runs they come from.

    Args:
        design: design of the runs.
        indices: the indices.
        runs: results of the runs.
        case_json: the case, with the pump speed that its flow needs, for `Case.model_validate_json`; empty
            if it is not known, as after merging shards.
    """

    design: Design
    indices: Indices
    runs: Runs
    case_json: str = ""

    def __repr__(self) -> str:
        of, to = ", ".join(self.indices.outputs), ", ".join(self.indices.factors)
        return f"<SensitivityResult of {self.design.samples} rows: {of} by {to}>"

    @property
    def values(self) -> np.ndarray:
        """Outputs of all rows without a failed run, shape (rows, runs per row, outputs)."""
        rows, good = self.runs.complete_rows(self.design)
        return rows[good]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the beat at the base values of the inputs, and doubts about the runs."""
        return (*self.indices.warnings, *self.indices.doubts)

    @property
    def dataset(self) -> xr.Dataset:
        """The indices, labelled, with the attribute `case`: see `Indices.dataset`."""
        return self.indices.dataset.assign_attrs({CASE: self.case_json} if self.case_json else {})

    @cached_property
    def convergence(self) -> xr.Dataset:
        """Indices at 16, 32, 64 ... up to all rows, by index, rows, output and factor.

        `mean` and `spread` (standard deviation) are those over the repeats of a size, and `mean_conf` is the
        mean half width of their bootstrap intervals. Lost rows are left out; `repeats` is the number of
        repeats with at least two rows left, and `rows_used` the mean number of rows left in these.
        """
        import xarray as xr

        design, outputs = self.design, self.indices.outputs
        factors = len(design.factors)
        values, good = self.runs.complete_rows(design)
        # The BA points are used for second order only.
        values = np.concatenate([values[:, : factors + 1], values[:, -1:]], axis=1)
        least = min(FIRST_CONVERGENCE_ROWS, design.samples)
        sizes = [design.samples >> k for k in range(20, -1, -1) if design.samples >> k >= least]
        names = ("S1", "ST")
        shape = (len(sizes), len(names), len(outputs), factors)
        mean, spread, width = np.full((3, *shape), np.nan)
        count, used = np.zeros(len(sizes), dtype=int), np.zeros(len(sizes))
        for s, size in enumerate(sizes):
            pieces = [slice(k, k + size) for k in range(0, design.samples, size)]
            pieces = [p for p in pieces if good[p].sum() > 1]
            if not pieces:
                continue
            repeats = [
                sobol_indices(values[p][good[p]], factors, seed=design.seed, size=SMALLEST_SIZE)
                for p in pieces
            ]
            count[s], used[s] = len(pieces), np.mean([good[p].sum() for p in pieces])
            for k, name in enumerate(names):
                each = np.stack([getattr(r, name) for r in repeats])
                mean[s, k] = each.mean(axis=0)
                width[s, k] = np.mean([getattr(r, f"{name}_conf") for r in repeats], axis=0)
                if len(each) > 1:
                    spread[s, k] = each.std(axis=0, ddof=1)
        dims = ("rows", "index", "output", "factor")
        data = {"mean": (dims, mean), "spread": (dims, spread), "mean_conf": (dims, width)}
        about = {"repeats": ("rows", count), "rows_used": ("rows", used)}
        labels = (sizes, list(names), list(outputs), list(design.factors))
        coordinates = dict(zip(dims, labels, strict=True))
        return xr.Dataset({**data, **about}, coordinates, ORIGIN)


def indices_of_runs(
    design: Design, outputs: tuple[str, ...], runs: Runs, warnings: Sequence[str] = ()
) -> SensitivityResult:
    """Indices of the runs of a whole design.

    A row with a failed run is left out as a whole, since the estimators compare runs of a row.

    Args:
        design: design of the runs.
        outputs: names of the outputs.
        runs: results of the runs.
        warnings: warnings about the beat at the base values, to explain why too few rows are left.
    """
    values, good = runs.complete_rows(design)
    if good.sum() < 2:
        raise ValueError(_too_few_rows(design, runs, good, warnings))
    estimates = sobol_indices(values[good], len(design.factors), seed=design.seed, size=SMALLEST_SIZE)
    moves = varies(values[good], SMALLEST_SIZE)
    constant = tuple(name for name, moving in zip(outputs, moves, strict=True) if not moving)
    failed = tuple(
        _failed_run(design, int(run), int(runs.status[run])) for run in np.flatnonzero(runs.status)
    )
    evaluations, used = len(runs.status), int(good.sum())
    indices = Indices(
        design.factors, outputs, estimates, len(values), evaluations, failed, used, constant=constant,
        impossible=int(runs.impossible.reshape(len(good), -1)[good].sum()),
        where_failed=failed_region(design, runs.status != 0) if failed else None, inputs=design.inputs,
    )  # fmt: skip
    return SensitivityResult(design, indices, runs)


def _too_few_rows(design: Design, runs: Runs, good: np.ndarray, warnings: Sequence[str]) -> str:
    """Why nothing can be estimated: the case itself has no beat, or where its runs fail."""
    counts = Counter(status_word(int(status)) for status in runs.status[runs.status != 0])
    reasons = ", ".join(f"{word} {count}" for word, count in counts.most_common())
    lost = (
        f"{int((~good).sum())} of {len(good)} rows have a failed run: too few are left for an estimate "
        f"(failed runs by status: {reasons})"
    )
    if central := [text for text in warnings if text.startswith(NO_CENTRAL_BEAT)]:
        return f"{central[0]}; around it, {lost}: change the case (eclsim simulate explains its beat)"
    region = failed_region(design, runs.status != 0)
    where = "" if region is None else f"; {region}"
    return f"{lost}{where}; eclsim simulate explains it for one patient"


def _failed_run(design: Design, run: int, status: int) -> FailedRun:
    row, position = divmod(run, design.runs_per_row)
    unit = design.unit(row, row + 1)[position : position + 1]
    inputs = {i.name: i.table_column(unit[:, k])[0] for k, i in enumerate(design.inputs)}
    return FailedRun(run, row, point_name(design, position), status_word(status), inputs)


def point_name(design: Design, position: int) -> str:
    """Name of a point of a row: A, AB or BA with the factor exchanged, B."""
    if position == 0:
        return "A"
    if position == design.runs_per_row - 1:
        return "B"
    kind, factor = divmod(position - 1, len(design.factors))
    return f"{('AB', 'BA')[kind]} {design.factors[factor]}"


def write_results(folder: Path, result: SensitivityResult) -> None:
    """Write indices.json, indices.csv, second_order.csv, inputs.csv, failed.csv and convergence.csv."""
    indices = result.indices
    write_json(indices.as_object(second_order=True), folder / "indices.json")
    order = ["rows", "repeats", "rows_used", "output", "factor", "index", "mean", "spread", "mean_conf"]
    converging = result.convergence.to_dataframe(dim_order=["rows", "output", "factor", "index"])
    frames = {"indices": indices.table, "convergence": converging.reset_index().loc[:, order]}
    if (pairs := indices.pairs) is not None:
        frames["second_order"] = pairs
    for name, frame in frames.items():
        frame = with_doubts(frame, indices.warnings)
        text = csv_text(list(frame.columns), frame.itertuples(index=False))
        write_text(text, folder / f"{name}.csv")
    head = ("input", "distribution", "low", "high", "unit", "choices")
    write_text(csv_text(head, input_rows(indices.inputs), digits=None), folder / "inputs.csv")
    head = ("run", "row", "point", "status", *(indices.failed[0].inputs if indices.failed else ()))
    rows = ((f.run, f.row, f.point, f.status, *f.inputs.values()) for f in indices.failed)
    write_text(csv_text(head, rows, digits=None), folder / "failed.csv")


# --- terminal text ----------------------------------------------------------------------------------


def indices_text(indices: Indices, state: str = "") -> str:
    """Text of total orders with half widths, factors by their sums, and the selected ones marked."""
    title = "Total order indices" + (f", {state} state" if state else "")
    title += "" if indices.ranked else ", FROM TOO FEW ROWS TO RANK"
    used = "" if indices.rows_used == indices.samples else f"{indices.rows_used} of "
    selected, e = indices.selected(), indices.estimates
    rows = []
    for name, total in indices.sums.items():
        j = indices.factors.index(name)
        width = f"±{indices.sums_conf[name]:.2f}" if indices.sums_conf else ""
        cells = [
            "-" if o in indices.constant
            else f"{e.ST[k, j]:.3f}±{e.ST_conf[k, j]:.3f}{'*' if name in selected[o] else ' '}"
            for k, o in enumerate(indices.outputs)
        ]  # fmt: skip
        rows.append((name, *cells, f"{total:.2f}{width}"))
    head = ("factor", *indices.outputs, "sum")
    took = "" if indices.seconds is None else f" in {indices.seconds:.0f} s"
    if indices.stored:
        took = f", {indices.stored} of them stored earlier, the others{took}" if took else ""
        took = took if indices.stored < indices.evaluations else ", all of them stored earlier"
    lines = [
        f"{title} ({used}{indices.samples} rows, {indices.evaluations} runs{took})",
        text_table(head, rows, numeric=range(1, len(head))),
    ]
    if indices.inputs:
        lines[1:1] = wrap(f"inputs: {ranges_text(indices.inputs)}", LINE, subsequent_indent="  ")
    if indices.domain:
        lines.append(f"{indices.domain[0].upper()}{indices.domain[1:]}")
    if indices.ranked:
        lines.insert(1, "* the largest, which together make up 90 % of the total orders of that output, and")
        lines.insert(2, "  whose 95 % half width is below their own index")
        lines += _open_orders_text(indices)
        lines.append(f"marked * for at least one output: {', '.join(indices.union())}")
    return "\n".join(lines)


def _open_orders_text(indices: Indices) -> list[str]:
    """A line that names the neighbours whose order the intervals of their sums leave open."""
    if not (pairs := indices.open_orders):
        return []
    named = "; ".join(f"{a} and {b}" for a, b in pairs)
    which = "sums differ" if len(pairs) == 1 else "sums, two by two, differ"
    return [f"order not known: {named} (their {which} by less than the 95 % half width of the difference)"]


def pairs_text(indices: Indices) -> str:
    """Text of second orders above their half width, largest first; empty if not computed."""
    s2, width = indices.estimates.S2, indices.estimates.S2_conf
    if s2 is None or width is None or not indices.ranked:
        return ""
    pairs = list(zip(*((s2 > width) & (s2 > SMALLEST_PAIR_INDEX)).nonzero(), strict=True))
    if not pairs:
        return "second order: no pair of factors is beyond its 95 % half width"
    pairs.sort(key=lambda at: -s2[at])
    outputs, factors = indices.outputs, indices.factors
    rows = [
        (outputs[k], factors[i], factors[j], f"{s2[k, i, j]:.3f}±{width[k, i, j]:.3f}")
        for k, i, j in pairs[:MOST_PAIRS]
    ]
    table = text_table(("output", "factor", "with", "S2"), rows, numeric=(3,))
    left = len(pairs) - MOST_PAIRS
    more = f"\nand {left} more, in second_order.csv with --out" if left > 0 else ""
    return f"Second order indices beyond their 95 % half width\n{table}{more}"


def doubts(indices: Indices, state: str = "", reported: Collection[str] = ()) -> list[str]:
    """Warnings about ranges and the base beat that are not in `reported`; number and kind of failed runs."""
    fresh = (line for line in indices.warnings if line not in reported)
    around = (
        line if line.startswith(RANGE_OF) else placed_sentence("at the central values", line)
        for line in fresh
    )
    messages = [*around, *indices.doubts]
    return [placed_sentence(state, message) for message in messages] if state else messages


def _doubts(indices: Indices) -> Iterator[str]:
    if indices.failed:
        kinds = ", ".join(sorted({f.status for f in indices.failed}))
        failed = f"{len(indices.failed)} of {indices.evaluations} runs failed ({kinds})"
        yield f"{failed}; {indices.rows_lost} rows are left out"
        yield indices.domain
        yield str(indices.where_failed or "no input sets the failed runs apart from the others")
    if indices.impossible:
        share = 100.0 * indices.impossible / (indices.rows_used * indices.evaluations / indices.samples)
        yield (
            f"{indices.impossible} of the runs that count ({share:.2g} %) are beats {IMPOSSIBLE_BEAT}: "
            "the indices include them; narrow "
            "--perturbation or --range, or lower the speed"
        )
    if not indices.ranked:
        yield (
            f"{indices.rows_used} of {indices.samples} rows are left to estimate from: nothing is ranked or "
            f"selected from fewer than {FEWEST_ROWS} or than half; raise --samples, or narrow --perturbation "
            "or --range where runs failed"
        )
    widest = float(indices.estimates.ST_conf.max())
    if indices.until is not None and widest > indices.until:
        yield (
            f"after {indices.samples} rows total orders are known to ±{widest:.2g} only, not to "
            f"±{indices.until:g}: raise --samples (--resume keeps these runs)"
        )
    if indices.constant:
        verb = "does" if len(indices.constant) == 1 else "do"
        names = ", ".join(indices.constant)
        yield f"{names} {verb} not vary: all that differs is rounding, so no index is given"
