"""The comparison with the paper as one HTML page: an index, every figure and table, and what they come to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from eclsim.crrt_study.page import number
from eclsim.paper.names import Item, items_of
from eclsim.paper.rows import YES_NO, Row, Verdict
from eclsim.reporting.html import box, bullets, figure, heading, page, paragraph, table, text

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
    return page("The paper, recomputed", _pieces(result, drawn))


def counts(rows: Sequence[Row]) -> str:
    """In one sentence: how many numbers agree."""
    found = Counter(row.verdict for row in rows)
    return (
        f"{found[Verdict.AS_PRINTED]} of {len(rows)} printed numbers and statements come out as printed, "
        f"{found[Verdict.EXPLAINED]} more once what the paper does not say is filled in, "
        f"{found[Verdict.OTHER_DATA]} were measured on other patients or circuits, "
        f"{found[Verdict.DIFFERS]} differ"
    )


def _pieces(result: Reproduction, drawn: Mapping[str, Sequence[str]]) -> Iterator[str]:
    yield heading("The paper, recomputed", 1)
    yield paragraph(
        "Every numbered figure and table of Thiel et al. 2025, and the numbers of its text.", "lead"
    )
    yield box([f"{counts(result.rows)}.", *_found(result)])
    yield heading("Contents")
    yield _contents(result)
    yield heading("What was assumed")
    yield bullets(_assumptions(result))
    for title, _, figures in CHAPTERS:
        rows = [row for row in result.rows if chapter_of(row) == title]
        items = [item for item in items_of(result.parts) if item.title in figures and item.drawings]
        if not rows and not items:
            continue
        yield heading(title)
        for item in items:
            yield from _drawn(item, drawn[item.key])
        yield from _rows(rows)
    yield from _tables(result)


def chapter_of(row: Row) -> str:
    """The chapter of the page that a row stands in: that of the longest beginning of its section."""
    fitting = [
        (len(start), title)
        for title, starts, _ in CHAPTERS
        for start in starts
        if row.section.startswith(start)
    ]
    return max(fitting)[1]


def _found(result: Reproduction) -> list[str]:
    unstated = result.crrt.unstated
    return [
        f"Section 3.3: {unstated.blood_volume_ml:.0f} mL of blood, {unstated.heart_rate_bpm:.0f} beats/min, "
        "neither of them printed, explain its numbers: the root mean square difference falls from "
        f"{unstated.assumed_misfit:.1f} to {unstated.misfit:.2f} of the printing's own tolerance."
    ]


def _contents(result: Reproduction) -> str:
    lines = []
    for item in items_of(result.parts):
        links = ", ".join(f'<a href="{name}">{name}</a>' for name in item.files)
        place = f'<a href="#{item.key}">{text(item.title)}</a>'
        lines.append(f"<tr><td>{place}</td><td>{text(item.words)}</td><td>{links}</td></tr>")
    files = (
        '<a href="reproduction.csv">reproduction.csv</a>, <a href="reproduction.json">reproduction.json</a>'
    )
    lines.append(f"<tr><td>Numbers</td><td>all rows of this page</td><td>{files}</td></tr>")
    head = "<thead><tr><th>In the paper</th><th>Ours</th><th>File</th></tr></thead>"
    return f'<div class="scroll"><table>{head}<tbody>{"".join(lines)}</tbody></table></div>'


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


def _drawn(item: Item, svgs: Sequence[str]) -> Iterator[str]:
    yield f'<div id="{item.key}">'
    for k, (svg, name) in enumerate(zip(svgs, item.drawings, strict=True)):
        part = f" ({'abcdefgh'[k]}, {name})" if len(svgs) > 1 else ""
        yield figure(svg, f"{item.title}{part}: {item.words}.", f"{item.key}{k}")
    yield "</div>"


def _rows(rows: Sequence[Row]) -> Iterator[str]:
    """A table for each section, in the order of the rows."""
    if rows:
        yield paragraph(f"{counts(rows)}.")
    for section in dict.fromkeys(row.section for row in rows):
        cells = [_cells(row) for row in rows if row.section == section]
        yield heading(section if section.startswith("Table") else f"Section {section}", 3)
        yield table(HEAD, cells, numeric=(1, 2, 3, 4))


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


def _tables(result: Reproduction) -> Iterator[str]:
    yield heading("Tables")
    for item in items_of(result.parts):
        if item.kind != "Table":
            continue
        rows = table_rows(item, result)
        same = sum(row.as_printed for row in rows)
        yield f'<div id="{item.key}">'
        yield paragraph(f"{item.title}: {item.words}. {same} of {len(rows)} values are the same.")
        cells = [[row.quantity, f"{row.paper:g}", f"{row.ours:.4g}", row.unit, row.verdict] for row in rows]
        yield table(["Parameter", "Paper", "Ours", "Unit", "Verdict"], cells, numeric=(1, 2))
        yield "</div>"


def table_rows(item: Item, result: Reproduction) -> list[Row]:
    """Rows of a numbered table."""
    return [row for row in (*result.rows, *result.tables) if row.section == item.title]
