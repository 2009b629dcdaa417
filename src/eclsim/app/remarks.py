"""What is said beside the knobs: mistakes, and warnings of values that are kept, as on opening a file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from eclsim.app.display import group_name
from eclsim.app.knobs import VOLUME, cached_by_case, controls
from eclsim.app.texts import beside_field, text, with_minus
from eclsim.cases.case import Case
from eclsim.cases.reading import read_mapping
from eclsim.devices.description import Control, Picker
from eclsim.inputs.mistakes import CaseError, Mistake
from eclsim.parameters.regulation import EXTRA_VOLUME, FLUID
from eclsim.slow import ALL_GIVEN

Remark = tuple[str, str]
"""Kind, "warning" or "note", and words."""
_SMALLEST_ML = 0.5
"""Smallest volume [mL] that is not written as 0."""
_GIVEN = {kind: text(f"give_{kind}") for kind in ALL_GIVEN}


def beside_knob(mistake: Mistake, case: Case) -> str:
    """Return a mistake as shown beside its knob, with labels in place of the names of a case file."""
    group = mistake.key.rpartition(".")[0]
    there = [control for control in controls(case) if control.key.rpartition(".")[0] == group]
    sentence = _chosen(beside_field(mistake), case.sites())
    for control in sorted(there, key=lambda one: one.key != mistake.key):
        sentence = _with_labels(sentence, control)
    for kind, label in _GIVEN.items():
        sentence = _labelled(sentence, kind, label)
    return sentence


def _with_labels(sentence: str, control: Control) -> str:
    """Return a sentence with the labels of a knob or picker and of what it offers."""
    if isinstance(control, Picker):
        sentence = _chosen(sentence, dict(control.options))
    return _labelled(sentence, control.key.rpartition(".")[2], control.label)


def _chosen(sentence: str, labels: Mapping[str, str]) -> str:
    """Return a sentence with the labels of what can be chosen in place of the values of a case file."""
    for value, label in labels.items():
        sentence = sentence.replace(f'"{value}"', label)
    return sentence


def _labelled(sentence: str, name: str, label: str) -> str:
    """Return a sentence with a label in place of a name; names that are plain words, such as pump, stay."""
    return re.sub(rf"\b{name}\b", f"“{label}”", sentence) if "_" in name else sentence


def remarks_of(case: Case, values: Mapping[str, Any]) -> dict[str, list[Remark]]:
    """Return the remarks by the key of a knob, or of its group if no knob sets what they are about.

    Args:
        case: the case.
        values: values of its knobs, at the displayed minute.
    """
    remarks = {key: list(said) for key, said in _warnings(case).items()}
    for key, words in _volume_notes(values).items():
        remarks.setdefault(key, []).append(("note", words))
    return remarks


@cached_by_case
def _warnings(case: Case) -> dict[str, list[Remark]]:
    """Return the warnings that turning a knob may cause or remove; others were shown on opening the file."""
    offered = controls(case)
    knobs, groups = {control.key for control in offered}, {control.group for control in offered}
    result: dict[str, list[Remark]] = {}
    with suppress(CaseError):  # of a state that the page holds; its next turn says what is wrong
        for mistake in read_mapping(case.as_mapping()).warnings:
            group = mistake.key.rpartition(".")[0]
            key = mistake.key if mistake.key in knobs else group
            if key in knobs or key in groups:
                result.setdefault(key, []).append(("warning", beside_knob(mistake, case)))
    return result


def _volume_notes(values: Mapping[str, Any]) -> dict[str, str]:
    """Return the sum of both knobs of blood volume: each alone is not all the blood there is."""
    start, given = values.get(VOLUME), values.get(EXTRA_VOLUME)
    if not isinstance(start, (int, float)) or not isinstance(given, (int, float)):
        return {}
    if not abs(given) >= _SMALLEST_ML:
        return {}
    total = f"{start + given:.0f}"
    words = text("volume_elsewhere", given=f"{given:.0f}", group=group_name(FLUID), total=total)
    return {VOLUME: with_minus(words)}
