"""The CRRT study of a cohort: page, JSON, tables and figure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eclsim.cases.fit_mark import DOUBTS
from eclsim.crrt_study.assumptions import models_in_words
from eclsim.crrt_study.cohort import conclusion, summaries
from eclsim.crrt_study.ranking import place
from eclsim.files import csv_text, json_text, write_texts
from eclsim.orbit.model import POLICY_WORDS
from eclsim.reporting.html import Table, render, svg_text
from eclsim.reporting.numbers import number, show_table, show_text
from eclsim.reporting.style import GREY, OKABE_ITO, PAGE_WIDTH_MM, figure_style, new_figure, plain_text

if TYPE_CHECKING:
    from eclsim.crrt_study.cohort import CohortStudy, PointResult


_MOST_NAMES = 10
"""Largest number of data points that a line of the terminal names."""


def write_cohort(study: CohortStudy, folder: Path) -> list[Path]:
    """Write all files to a folder, which is created if necessary, and return their paths."""
    drawn = svg_text(_figure(study))
    schemes = [{"policy": p, **asdict(each)} for p in study.policies for each in summaries(study, p)]
    texts = {
        "report.html": _page(study, drawn), "cohort.json": cohort_json(study),
        "points.csv": _csv(_point_rows(study)), "schemes.csv": _csv(schemes), "ranks.svg": drawn,
    }  # fmt: skip
    return write_texts(folder, texts)


def cohort_json(study: CohortStudy) -> str:
    """The study as JSON text."""
    policies = {
        policy: {"answer": conclusion(study, policy), "schemes": list(map(asdict, summaries(study, policy)))}
        for policy in study.policies
    }
    content = {
        "policies": policies,
        "first_not_known": {policy: list(study.undecided(policy)) for policy in study.policies},
        "points": _point_rows(study),
        "parameters": study.fitted.description,
        "lost": dict(study.lost),
    }
    return json_text(content)


def show(study: CohortStudy) -> None:
    """Print the schemes over the cohort, those most often best first, for each blood volume policy."""
    heads = ("scheme", "access – return", *_with_bound(_SHORT_HEAD, study))
    for policy in study.policies:
        rows = [list(map(str, row)) for row in _scheme_rows(study, policy)]
        unbroken = [column for column in range(len(heads)) if column != 1]
        show_table(POLICY_WORDS[policy], heads, rows, range(2, len(heads)), unbroken)
        show_text(conclusion(study, policy) + "\n")
    for line in doubtful_points(study):
        show_text(line + "\n")


_HEAD = (
    "Scheme", "Access – return", "First in", "Median place", "Worst place", "Alarms kept in",
    "Access ≤ {} in", "No air drawn in", "Limits kept up to [L/min], median", "smallest",
)  # fmt: skip

# Columns in a terminal after scheme and sites; headers have at most two short lines.
_SHORT_HEAD = (
    "first\nin", "median\nplace", "worst\nplace", "alarms\nkept in", "access\n≤ {} in", "no air\ndrawn in",
    "limits kept to\nL/min, median", "at\nleast",
)  # fmt: skip


def _with_bound(heads: Sequence[str], study: CohortStudy) -> list[str]:
    """Headers with the rule's limit of the access pressure."""
    return [head.format(f"{study.rule.access_mmhg:g}") for head in heads]


def _scheme_rows(study: CohortStudy, policy: str) -> list[list[object]]:
    names, total = {scheme.letter: scheme.name for scheme in study.schemes}, len(study.points)
    rows: list[list[object]] = []
    for summary in summaries(study, policy):
        result = _of(summary.known, total)
        ranked, flows = ("" if n == total else f" (n = {n})" for n in (summary.ranked, summary.flow_known))
        decided = _of(total - len(study.undecided(policy)), total)
        worst = "–" if summary.worst_rank is None else summary.worst_rank
        median = "–" if math.isnan(summary.median_rank) else f"{summary.median_rank:g}"
        may_be_larger = (summary.smallest_flow_may_be_larger, summary.median_flow_may_be_larger)
        smallest_more, median_more = ("+" if more else "" for more in may_be_larger)
        rows.append(
            [
                summary.letter, names[summary.letter], f"{summary.first}{decided}",
                f"{median}{ranked}", f"{worst}{ranked}", f"{summary.alarms_kept}{result}",
                f"{summary.access_190_kept}{result}", f"{summary.above_atmosphere}{result}",
                f"{number(summary.median_flow, 1)}{median_more}{flows}",
                f"{number(summary.smallest_flow, 1)}{smallest_more}{flows}",
            ]
        )  # fmt: skip
    return rows


def _of(known: int, total: int) -> str:
    """Number of data points in which a number is known, as text; empty if in all."""
    return "" if known == total else f" of {known}"


def _point_rows(study: CohortStudy) -> list[dict[str, object]]:
    rows = []
    for point in study.points:
        row: dict[str, object] = {
            "id": point.name, "speed_rpm": point.speed, "ecmo_flow_l_min": point.flow,
            "MAP_mmhg": point.pressure, "blood_taken_up_ml": point.taken_up,
            "unsettled": point.beats_not_found, "not_known": "; ".join(point.unsettled),
            "impossible": "; ".join(point.impossible),
            "relative_misfit": study.fitted.misfits.get(point.name),
            DOUBTS: "; ".join(study.doubts.get(point.name, ())),
        }  # fmt: skip
        for policy in study.policies:
            row[f"first_{policy}"] = point.first(policy)
            row[f"order_{policy}"] = _order(point, policy)
            row[f"MAP_variation_{policy}_mmhg"] = point.variation[policy]
        rows.append(row)
    return rows


def _order(point: PointResult, policy: str) -> str:
    """Schemes from best to worst, with ranks that are not certain in brackets; empty without an order."""
    if point.impossible:
        return ""
    return " ".join(
        ranked.letter if ranked.rank is not None else f"{ranked.letter}({place(ranked)})"
        for ranked in point.ranking[policy]
    )


def _csv(rows: Sequence[dict[str, object]]) -> str:
    return csv_text(list(rows[0]), (row.values() for row in rows), digits=6)


def _figure(study: CohortStudy) -> Figure:
    policy = study.policies[0]
    letters = [ranked.letter for ranked in summaries(study, policy)]
    places, limits = np.full((2, len(study.points), len(letters)), np.nan)
    for (row, column), _ in np.ndenumerate(places):
        if study.points[row].impossible:
            continue
        ranked = study.points[row].ranked(policy, letters[column])
        places[row, column] = np.nan if ranked.rank is None else ranked.rank
        if ranked.flow_known:
            limits[row, column] = 0.0 if math.isnan(ranked.largest_flow) else ranked.largest_flow
    points = study.points
    return plot_cohort_ranks(places, letters, [p.name for p in points], [p.flow for p in points], limits)


def _page(study: CohortStudy, drawn: str) -> str:
    main, *others = study.policies
    heads, numeric = _with_bound(_HEAD, study), range(2, len(_HEAD))
    answers = [f"Does one scheme win for all? {conclusion(study, main)}"]
    answers += [f"When the circuits are primed: {conclusion(study, policy)}" for policy in others]
    return render(
        "crrt_study/cohort.html",
        title="CRRT on ECMO: a cohort",
        points=len(study.points),
        schemes=len(study.schemes),
        answer=[*answers, _differences(study)],
        doubts=_doubts(study),
        policy_summaries=[
            (POLICY_WORDS[p], Table(heads, _scheme_rows(study, p), numeric)) for p in study.policies
        ],
        beats_missing=bool(study.unsettled),
        main=POLICY_WORDS[main],
        ranks=drawn,
        order=[criterion.sentence for criterion in study.rule.criteria],
        rule=study.rule.name,
        point_table=_points_table(study),
        parameters=study.fitted.description,
        models=models_in_words(study.fitted.cases),
    )


def _differences(study: CohortStudy) -> str:
    messages = []
    for policy in study.policies:
        result = [v for point in study.points if math.isfinite(v := point.variation[policy])]
        policy_label = POLICY_WORDS[policy].partition(":")[0]
        if not result:
            messages.append(f"an unknown amount {policy_label}")
            continue
        of = "" if len(result) == len(study.points) else f", known for {len(result)} data points"
        median, largest = number(float(np.median(result)), 1), number(max(result), 1)
        messages.append(f"{median} mmHg (largest {largest}{of}) {policy_label}")
    return f"Between schemes the mean arterial pressure differs by a median of {', '.join(messages)}."


def _doubts(study: CohortStudy) -> list[str]:
    lines = [f"{name}: {reason}" for name, reason in study.lost.items()]
    lines += impossible_points(study)
    lines += [f"{name}: {doubt}" for name, doubts in study.doubts.items() for doubt in doubts]
    for point in study.unsettled:
        lines.append(f"{point.name}: {'; '.join(point.unsettled)}")
    for policy in study.policies:
        names = study.undecided(policy)
        if names:
            policy_label = POLICY_WORDS[policy].partition(":")[0]
            lines.append(f"Which scheme is first is not known, {policy_label}: {', '.join(names[:40])}")
    if len(lines) > 40:
        lines = [*lines[:40], f"and {len(lines) - 40} more, see cohort.json"]
    return lines


def doubtful_points(study: CohortStudy) -> list[str]:
    """A line for each doubt about the fits of data points that count, with the points that it concerns."""
    points: dict[str, list[str]] = {}
    for point in study.counted:
        for doubt in study.doubts.get(point.name, ()):
            points.setdefault(doubt, []).append(point.name)
    total, lines = len(study.points), []
    for doubt, names in points.items():
        listed = ", ".join(names[:_MOST_NAMES]) + (", ..." if len(names) > _MOST_NAMES else "")
        lines.append(f"Counted although doubtful, {len(names)} of {total} data points ({listed}): {doubt}")
    return lines


def impossible_points(study: CohortStudy) -> list[str]:
    """A line for each data point whose beats no patient can have, so that its ranks do not count."""
    lines = []
    for point in study.points:
        if point.impossible:
            first, more = point.impossible[0], len(point.impossible) - 1
            also = f" (and {more} more)" if more else ""
            lines.append(
                f"{point.name}: no patient can have its beats, so its schemes have no order: {first}{also}"
            )
    return lines


def _points_table(study: CohortStudy) -> Table:
    head = ["Data point", "Pump [rpm]", "ECMO flow [L/min]", "MAP [mmHg]", "Blood taken up, at most [mL]"]
    for policy in study.policies:
        policy_label = POLICY_WORDS[policy].partition(":")[0]
        head += [f"Best to worst, {policy_label}", f"MAP varies by [mmHg], {policy_label}"]
    rows = []
    for point in sorted(study.points, key=lambda point: point.flow):
        taken = number(point.taken_up, 0)
        cells = [point.name, f"{point.speed:.0f}", number(point.flow, 2), number(point.pressure, 0), taken]
        for policy in study.policies:
            cells += [_order(point, policy), number(point.variation[policy], 1)]
        rows.append(cells)
    return Table(head, rows, numeric=(1, 2, 3, 4, 6, 8))


# --- figure ---------------------------------------------------------------------------------------


MOST_NAMED = 60


@figure_style()
def plot_cohort_ranks(
    ranks: np.ndarray,
    letters: Sequence[str],
    names: Sequence[str],
    flows: Sequence[float],
    limits: np.ndarray,
) -> Figure:
    """Plot the ranks of schemes by data point, sorted by ECMO flow, and the flow that each scheme allows.

    Args:
        ranks: rank of each scheme (columns) in each data point (rows), 1 is best; NaN if not known.
        letters: letters of the schemes.
        names: names of the data points.
        flows: ECMO flow of each data point [L/min]; NaN if not known, sorted last.
        limits: flow up to which each scheme keeps all limits of its lines [L/min], same shape as the ranks; 0
            if it keeps them at no speed, NaN if not known.
    """
    order = np.argsort(flows, kind="stable").tolist()
    height = max(34 + min(4.2 * len(names), 190.0), 85.0)
    fig = new_figure(PAGE_WIDTH_MM, height)
    left, right = fig.subplots(1, 2, width_ratios=(1.25, 1.0))
    shown = [f"{flow:.1f}" if np.isfinite(flow) else "–" for flow in flows]
    labels = [f"{plain_text(names[k], 18)}  {shown[k]}" for k in order]
    _draw_places(left, ranks[order], letters, labels)
    _draw_flows(right, limits, letters, flows)
    return fig


def _draw_places(ax: Axes, ranks: np.ndarray, letters: Sequence[str], labels: Sequence[str]) -> None:
    image = ax.imshow(ranks, cmap="Blues_r", aspect="auto", vmin=1, vmax=max(len(letters), 2) + 2)
    image.set_rasterized(True)
    if len(labels) <= MOST_NAMED:
        for (row, column), place in np.ndenumerate(ranks):
            colour = "white" if place <= 0.4 * len(letters) else "black"
            weight = "bold" if place == 1 else "normal"
            look = {"ha": "center", "va": "center", "fontsize": 6, "color": colour, "fontweight": weight}
            ax.text(column, row, f"{place:.0f}" if np.isfinite(place) else "–", fontdict=look)
        ax.set_yticks(range(len(labels)), labels, fontsize=6.5)
    ax.set_xticks(range(len(letters)), [plain_text(letter, 12) for letter in letters])
    ax.tick_params(length=0)
    ax.set_xlabel("Scheme")
    ax.set_ylabel("Data point and its ECMO flow [L/min]")
    doubt = " (–: not known)" if np.isnan(ranks).any() else ""
    ax.set_title(f"a) Place of each scheme{doubt}", loc="left")


def _draw_flows(ax: Axes, limits: np.ndarray, letters: Sequence[str], flows: Sequence[float]) -> None:
    columns = np.arange(len(letters))
    ax.plot(columns, limits.T, "o", color=OKABE_ITO["blue"], markersize=3, alpha=0.45, markeredgewidth=0.0)
    known = [(k, column[np.isfinite(column)]) for k, column in enumerate(limits.T)]
    middle = [(k, np.median(values)) for k, values in known if len(values)]
    ax.plot(*np.array(middle).reshape(-1, 2).T, "_", color="black", markersize=13, markeredgewidth=1.6)
    shown = [flow for flow in flows if np.isfinite(flow)]
    if shown:
        ax.axhspan(min(shown), max(shown), color=GREY, alpha=0.15, linewidth=0)
        ax.annotate(
            "flows of the data points", (0.985, min(shown)), xycoords=("axes fraction", "data"), ha="right",
            va="bottom", xytext=(0, 2), textcoords="offset points", fontsize=7, color=GREY,
        )  # fmt: skip
    missing = int(np.isnan(limits).sum())
    if missing:
        ax.annotate(
            f"not known, not shown: {missing} of {limits.size}", (0.985, 0.985), xycoords="axes fraction",
            ha="right", va="top", fontsize=7,
        )  # fmt: skip
    ax.set_xticks(columns, [plain_text(letter, 12) for letter in letters])
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel("Scheme")
    ax.set_ylabel("Limits of the lines kept up to [L/min]")
    ax.set_title("b) ECMO flow kept (dash: median)", loc="left")
