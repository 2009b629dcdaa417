"""The CRRT study of a cohort: page, JSON, tables and figure."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.crrt_study.cohort import answer, summaries
from eclsim.crrt_study.ranking import ORDER
from eclsim.crrt_study.words import place
from eclsim.files import csv_text, json_text, write_text
from eclsim.orbit.model import POLICY_WORDS
from eclsim.reporting.html import Table, render, svg_text
from eclsim.reporting.numbers import number

if TYPE_CHECKING:
    from eclsim.crrt_study.cohort import CohortStudy, PointResult

_WIDTH_OF_PIPES = 140


def write_cohort(study: CohortStudy, folder: Path) -> list[Path]:
    """Write everything to a folder, which is made if it does not exist; returns the files."""
    folder.mkdir(exist_ok=True)
    drawn = svg_text(_figure(study))
    texts = {
        "report.html": _page(study, drawn),
        "cohort.json": cohort_json(study),
        "points.csv": _csv(_point_rows(study)),
        "schemes.csv": _csv(
            [{"policy": p, **asdict(one)} for p in study.policies for one in summaries(study, p)]
        ),
        "ranks.svg": drawn,
    }
    for name, content in texts.items():
        write_text(content, folder / name)
    return [folder / name for name in texts]


def cohort_json(study: CohortStudy) -> str:
    """The study as JSON text."""
    content = {
        "policies": {
            policy: {
                "answer": answer(study, policy),
                "schemes": [asdict(one) for one in summaries(study, policy)],
            }
            for policy in study.policies
        },
        "first_not_known": {policy: list(study.undecided(policy)) for policy in study.policies},
        "points": _point_rows(study),
        "parameters": study.fitted.words,
        "lost": dict(study.lost),
    }
    return json_text(content)


def write_json(study: CohortStudy, destination: Path | str) -> None:
    """Write the JSON object to a file, or to standard output for "-"."""
    write_text(cohort_json(study), destination)


def show(study: CohortStudy) -> None:
    """Show the schemes over the cohort, most often first, for each blood volume policy."""
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if sys.stdout.isatty() else _WIDTH_OF_PIPES, highlight=False)
    for policy in study.policies:
        shown = Table(title=POLICY_WORDS[policy], title_justify="left", box=None, pad_edge=False)
        shown.add_column("scheme", no_wrap=True)
        shown.add_column("access – return")
        for head in _SHORT_HEAD:
            shown.add_column(head, justify="right", no_wrap=True)
        for row in _scheme_rows(study, policy):
            shown.add_row(*map(str, row))
        console.print(shown)
        console.print(answer(study, policy) + "\n", markup=False)


_HEAD = (
    "Scheme", "Access – return", "First in", "Median place", "Worst place", "Alarms kept in",
    "Access ≤ 190 in", "No air drawn in", "Limits kept up to [L/min], median", "smallest",
)  # fmt: skip

# In a terminal, the columns after the scheme and its positions: no head wider than two short lines.
_SHORT_HEAD = (
    "first\nin", "median\nplace", "worst\nplace", "alarms\nkept in", "access\n≤ 190 in", "no air\ndrawn in",
    "limits kept to\nL/min, median", "at\nleast",
)  # fmt: skip


def _scheme_rows(study: CohortStudy, policy: str) -> list[list[object]]:
    names, total = {scheme.letter: scheme.name for scheme in study.schemes}, len(study.points)
    rows: list[list[object]] = []
    for one in summaries(study, policy):
        found = _of(one.known, total)
        ranked, flows = ("" if n == total else f" (n = {n})" for n in (one.ranked, one.flow_known))
        decided = _of(total - len(study.undecided(policy)), total)
        worst = "–" if one.worst_rank is None else one.worst_rank
        median = "–" if math.isnan(one.median_rank) else f"{one.median_rank:g}"
        rows.append(
            [
                one.letter, names[one.letter], f"{one.first}{decided}",
                f"{median}{ranked}", f"{worst}{ranked}", f"{one.alarms_kept}{found}",
                f"{one.access_190_kept}{found}", f"{one.above_atmosphere}{found}",
                f"{number(one.median_flow, 1)}{flows}", f"{number(one.smallest_flow, 1)}{flows}",
            ]
        )  # fmt: skip
    return rows


def _of(known: int, total: int) -> str:
    """In how many data points a number is known; empty if in all."""
    return "" if known == total else f" of {known}"


def _point_rows(study: CohortStudy) -> list[dict[str, Any]]:
    rows = []
    for point in study.points:
        row: dict[str, Any] = {
            "id": point.name, "speed_rpm": point.speed, "ecmo_flow_l_min": point.flow,
            "MAP_mmhg": point.pressure, "blood_taken_up_ml": point.taken_up,
            "unsettled": point.beats_not_found, "not_known": "; ".join(point.unsettled),
            "relative_misfit": study.fitted.misfits.get(point.name),
        }  # fmt: skip
        for policy in study.policies:
            row[f"first_{policy}"] = point.first(policy)
            row[f"order_{policy}"] = _order(point, policy)
            row[f"MAP_variation_{policy}_mmhg"] = point.variation[policy]
        rows.append(row)
    return rows


def _order(point: PointResult, policy: str) -> str:
    """Schemes from best to worst; the place in brackets where it is not known for sure."""
    return " ".join(
        one.letter if one.rank is not None else f"{one.letter}({place(one)})" for one in point.ranking[policy]
    )


def _csv(rows: Sequence[dict[str, Any]]) -> str:
    return csv_text(list(rows[0]), (row.values() for row in rows), digits=6)


def _figure(study: CohortStudy) -> Any:
    from eclsim.crrt_study.cohort_figure import plot_cohort_ranks

    policy = study.policies[0]
    letters = [one.letter for one in summaries(study, policy)]
    places, limits = np.full((2, len(study.points), len(letters)), np.nan)
    for (row, column), _ in np.ndenumerate(places):
        one = study.points[row].ranked(policy, letters[column])
        places[row, column] = np.nan if one.rank is None else one.rank
        if one.flow_known:
            limits[row, column] = 0.0 if math.isnan(one.largest_flow) else one.largest_flow
    points = study.points
    return plot_cohort_ranks(places, letters, [p.name for p in points], [p.flow for p in points], limits)


def _page(study: CohortStudy, drawn: str) -> str:
    main, *others = study.policies
    answers = [f"Does one scheme win for all? {answer(study, main)}"]
    answers += [f"When the circuits are primed: {answer(study, policy)}" for policy in others]
    return render(
        "crrt_study/cohort.html",
        title="CRRT on ECMO: a cohort",
        points=len(study.points),
        schemes=len(study.schemes),
        answer=[*answers, _differences(study)],
        doubts=_doubts(study),
        policy_summaries=[
            (POLICY_WORDS[policy], Table(_HEAD, _scheme_rows(study, policy), numeric=range(2, len(_HEAD))))
            for policy in study.policies
        ],
        beats_missing=bool(study.unsettled),
        main=POLICY_WORDS[main],
        ranks=drawn,
        order=ORDER,
        point_table=_points_table(study),
        parameters=study.fitted.words,
    )


def _differences(study: CohortStudy) -> str:
    said = []
    for policy in study.policies:
        found = [v for point in study.points if math.isfinite(v := point.variation[policy])]
        words = POLICY_WORDS[policy].partition(":")[0]
        if not found:
            said.append(f"an amount that is not known {words}")
            continue
        of = "" if len(found) == len(study.points) else f", known for {len(found)} data points"
        said.append(
            f"{number(float(np.median(found)), 1)} mmHg (largest {number(max(found), 1)}{of}) {words}"
        )
    return f"Between schemes the mean arterial pressure differs by a median of {', '.join(said)}."


def _doubts(study: CohortStudy) -> list[str]:
    lines = [f"{name}: {why}" for name, why in study.lost.items()]
    for point in study.unsettled:
        lines.append(f"{point.name}: {'; '.join(point.unsettled)}")
    for policy in study.policies:
        names = study.undecided(policy)
        if names:
            words = POLICY_WORDS[policy].partition(":")[0]
            lines.append(f"Which scheme is first is not known, {words}: {', '.join(names[:40])}")
    if len(lines) > 40:
        lines = [*lines[:40], f"and {len(lines) - 40} more, see cohort.json"]
    return lines


def _points_table(study: CohortStudy) -> Table:
    head = ["Data point", "Pump [rpm]", "ECMO flow [L/min]", "MAP [mmHg]", "Blood taken up, at most [mL]"]
    for policy in study.policies:
        words = POLICY_WORDS[policy].partition(":")[0]
        head += [f"Best to worst, {words}", f"MAP varies by [mmHg], {words}"]
    ordered = sorted(study.points, key=lambda point: point.flow)
    return Table(head, [_point_cells(study, point) for point in ordered], numeric=(1, 2, 3, 4, 6, 8))


def _point_cells(study: CohortStudy, point: PointResult) -> list[str]:
    taken = number(point.taken_up, 0)
    cells = [point.name, f"{point.speed:.0f}", number(point.flow, 2), number(point.pressure, 0), taken]
    for policy in study.policies:
        cells += [_order(point, policy), number(point.variation[policy], 1)]
    return cells
