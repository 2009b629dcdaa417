"""The comparison with the paper as one HTML page: an index, every figure and table, and what they come to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from eclsim.paper.names import Item, items_of
from eclsim.paper.rows import YES_NO, Row, Verdict
from eclsim.reporting.html import Table, render
from eclsim.reporting.numbers import number

if TYPE_CHECKING:
    from eclsim.paper.reproduction import Reproduction

CHAPTERS = (
    ("Data and sensitivity of the circulation (sections 2.1, 2.3, 3.1)", ("2.", "3.1", "Table 2"),
     ("Figure 1", "Figure 3", "Figure S-1", "Figure S-3", "Figure S-4")),
    ("Fits of a cohort (section 3.2)", ("3.2", "Table 1"), ("Figure 4", "Figure S-2")),
    ("The nine CRRT schemes (section 3.3)", ("3.3, 3425", "3.3, 1.2", "3.3, 6", "3.3"),
     ("Figure 2", "Figure 5", "Figure 6")),
    ("Positions of the CRRT lines as inputs (section 3.3)", ("3.3, Figure",),
     ("Figure 7", "Figure S-5", "Figure S-6", "Figure S-7")),
    ("Discussion: other studies, limits, interactions (section 4)", ("4",), ()),
)  # fmt: skip
HEAD = ("Quantity", "Paper", "Ours", "Difference", "Explained", "Unit", "Verdict")


def reproduction_page(result: Reproduction, drawn: Mapping[str, Sequence[str]]) -> str:
    """The page.

    Args:
        result: the comparison.
        drawn: figures as SVG text, by key.
    """
    items = items_of(result.parts)
    return render(
        "paper/report.html",
        title="The paper, recomputed",
        summary=[f"{counts(result.rows)}.", _unstated_words(result)],
        items=items,
        assumptions=_assumptions(result),
        chapters=[c for name, _, numbers in CHAPTERS if (c := _chapter(result, name, numbers, drawn))],
        tables=[
            (item, sum(row.as_printed for row in rows), _parameter_table(rows))
            for item in items
            if item.kind == "Table" and (rows := table_rows(item, result)) is not None
        ],
    )


def counts(rows: Sequence[Row]) -> str:
    """In one sentence: how many numbers agree."""
    found = Counter(row.verdict for row in rows)
    return (
        f"{found[Verdict.AS_PRINTED]} of {len(rows)} printed numbers and statements come out as printed, "
        f"{found[Verdict.EXPLAINED]} more once what the paper does not say is filled in, "
        f"{found[Verdict.OTHER_DATA]} were measured on other patients or circuits, "
        f"{found[Verdict.DIFFERS]} differ"
    )


def _chapter(
    result: Reproduction, title: str, numbers: Sequence[str], drawn: Mapping[str, Sequence[str]]
) -> dict[str, object] | None:
    """A chapter with its figures and rows; None where no part of it was computed."""
    rows = [row for row in result.rows if chapter_of(row) == title]
    items = [item for item in items_of(result.parts) if item.title in numbers and item.drawings]
    if not rows and not items:
        return None
    sections = dict.fromkeys(row.section for row in rows)
    return {
        "title": title,
        "figures": [(item, _captioned(item, drawn[item.key])) for item in items],
        "counts": counts(rows),
        "sections": [
            (name if name.startswith("Table") else f"Section {name}",
             Table(HEAD, [_cells(row) for row in rows if row.section == name], numeric=(1, 2, 3, 4)))
            for name in sections
        ],
    }  # fmt: skip


def _captioned(item: Item, svgs: Sequence[str]) -> list[tuple[str, str]]:
    letters = [f" ({'abcdefgh'[k]}, {name})" if len(svgs) > 1 else "" for k, name in enumerate(item.drawings)]
    return [(svg, f"{item.title}{part}: {item.words}.") for svg, part in zip(svgs, letters, strict=True)]


def chapter_of(row: Row) -> str:
    """The chapter of the page that a row stands in: that of the longest beginning of its section."""
    fitting = [
        (len(start), title)
        for title, starts, _ in CHAPTERS
        for start in starts
        if row.section.startswith(start)
    ]
    return max(fitting)[1]


def _unstated_words(result: Reproduction) -> str:
    unstated = result.crrt.unstated
    return (
        f"Section 3.3: {unstated.blood_volume_ml:.0f} mL of blood, {unstated.heart_rate_bpm:.0f} beats/min, "
        "neither of them printed, explain its numbers: the root mean square difference falls from "
        f"{unstated.assumed_misfit:.1f} to {unstated.misfit:.2f} of the printing's own tolerance."
    )


def _assumptions(result: Reproduction) -> list[str]:
    patient, found = result.crrt.study.case.patient, result.crrt.unstated
    lines = [
        f"Section 3.3, ours: {patient.sex}, {patient.age_years:g} years, {patient.height_cm:g} cm, "
        f"{patient.weight_kg:g} kg, {patient.heart_rate_bpm:g} beats/min; cannulae 21 and 17 Fr. The paper "
        f"prints sex, age (69) and Table S-4. Explained: {found.blood_volume_ml:.0f} mL of blood, "
        f"{found.heart_rate_bpm:.0f} beats/min; the figures show this patient.",
        "Scheme h has both lines at pre pump, as the published code ran it: the printed variation of the "
        "access pressure, 296.6 mmHg, needs it (as drawn in Figure 2 it is 297.2 mmHg).",
        "1.2 and 6 L/min are 1750 and 5000 rpm: points of a grid of 250 rpm that give the printed pressures.",
        "Medians and variations are over the cycle means of the nine schemes; artery is the systemic artery.",
        "Blood volume as published: the patient's blood fills the circuits.",
    ]
    if result.sensitivity is not None:
        lines.append(
            f"Sensitivity: N = {result.sensitivity.samples} rows (the paper: 2048), ±25 %, first and total "
            "order. Ours: the woman of section 3.3 with the parameters of Table S-1; explained and shown: a "
            "man of 170 cm, 70 kg."
        )
    if result.positions is not None:
        lines.append(
            f"Positions: N = {result.positions.samples} rows with pairs. Ours and shown: both positions are "
            "inputs of the design (all 36 pairs); explained: drawn at random over the finished design, as "
            "the published code did."
        )
    if result.cohort is not None:
        part = result.cohort
        whose = "synthetic, as the clinical data are not public" if part.synthetic else "the table given"
        lines.append(
            f"Cohort: {whose}. {part.explore} explored sets of parameters for each free one (eclsim "
            "identify: 1000; the paper: 70 local optimisations)."
        )
    return lines


def _cells(row: Row) -> list[str]:
    verdict = str(row.verdict) + (f": {row.why}" if row.why else "")
    if row.unit == YES_NO:
        said = ["" if v is None else ("yes" if v else "no") for v in (row.paper, row.ours, row.explained)]
        return [row.quantity, *said[:2], "", said[2], "", verdict]
    more = row.digits + (row.unit not in ("", "1") or row.digits > 0)
    explained = "" if row.explained is None else number(row.explained, more)
    percent = f"{number(row.difference_percent, 1)} %"
    unit = "" if row.unit == "1" else row.unit
    paper, ours = number(row.paper, row.digits), number(row.ours, more)
    return [row.quantity, paper, ours, percent, explained, unit, verdict]


def _parameter_table(rows: Sequence[Row]) -> Table:
    cells = [[row.quantity, f"{row.paper:g}", f"{row.ours:.4g}", row.unit, row.verdict] for row in rows]
    return Table(["Parameter", "Paper", "Ours", "Unit", "Verdict"], cells, numeric=(1, 2))


def table_rows(item: Item, result: Reproduction) -> list[Row]:
    """Rows of a numbered table."""
    return [row for row in (*result.rows, *result.tables) if row.section == item.title]
