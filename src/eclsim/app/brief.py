"""Limits that a beat exceeds in few words, for places of the page too narrow for their sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from eclsim.app.texts import ENGLISH, in_knob_labels, text, with_minus
from eclsim.devices.description import Finding, KeyFigure
from eclsim.outputs.registry import output


def brief_findings(findings: Iterable[Finding], figures: Sequence[KeyFigure]) -> list[str]:
    """Return each finding in few words: "Wedge 28 mmHg, too high".

    Args:
        findings: findings of a beat.
        figures: tiles of the page, whose labels and decimals are used.
    """
    tiles = {figure.output: figure for figure in figures}
    return [_brief(finding, tiles.get(finding.quantity)) for finding in findings]


def _brief(finding: Finding, tile: KeyFigure | None) -> str:
    """Return the label of an output, its value and the side; the subject of a finding on no table's limit."""
    if not finding.source or finding.limit is None:
        return with_minus(in_knob_labels(finding.sentence.split(": ")[0]))
    entry = output(finding.quantity)
    label = tile.label if tile else ENGLISH.get(f"short_{entry.name}", entry.long_name)
    digits = tile.digits if tile else 2 if entry.unit in ("L/min", "1") else 0
    unit = "" if entry.unit == "1" else f" {entry.unit}"
    side = "brief_above" if finding.value > finding.limit else "brief_below"
    return with_minus(text(side, what=f"{label} {finding.value:.{digits}f}{unit}"))
