"""Marks after a patient's id in files written by the page: how the patient was fitted, and manual changes.

They keep this information when numbers are saved and opened again; the marks of `eclsim identify` are in
`eclsim.cases.fit_mark`.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

from eclsim.app.state import PageState
from eclsim.inputs.sections import MAXIMUM_ID_LENGTH

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.cases.fit_mark import FitMark

_WORDS = MappingProxyType({
    "not fitted": ("unfitted", ""), "fitted": ("fit", "good"), "doubtful fit": ("fit", "doubtful"),
    "poor fit": ("fit", "poor"), "fit without a verdict": ("fit", ""), "central draw": ("posterior", ""),
})  # fmt: skip
"""Origin and verdict of a `PageState`, by the words of the mark."""
_BY_STATE = MappingProxyType({meant: word for word, meant in _WORDS.items()})
_CHANGED = "changed"


def marked_id(state: PageState, kind: str) -> str:
    """Return the id of a state's patient for files, such as "P01 (poor fit, changed)".

    Args:
        state: state that is saved.
        kind: origin of its parameters, from `eclsim.app.provenance.kind_of`.
    """
    name, _, changed_before = _read(state.case.patient.id)
    marks: list[str] = []
    if kind != "unfitted" or state.changed or state.case.parameters:
        marks += [word] if (word := _BY_STATE.get((kind, state.verdict))) else []
    marks += [_CHANGED] if state.changed or changed_before else []
    mark = f" ({', '.join(marks)})" if marks else ""
    return name[: MAXIMUM_ID_LENGTH - len(mark)] + mark


def bare_id(case: Case) -> str:
    """Return the patient's id without marks."""
    return _read(case.patient.id)[0]


def was_changed(case: Case) -> bool:
    """Whether a case was changed by hand before the page wrote it."""
    return _read(case.patient.id)[2]


def opened_state(case: Case, source: str, fit: FitMark | None = None) -> PageState:
    """Return the state of a case read from a file; a fitted case keeps its origin and verdict.

    Args:
        case: case of the file.
        source: name of the file.
        fit: verdict written by `eclsim identify`; None for that of the case. The page itself writes the
            verdict after the id.
    """
    fit, case = fit or case.fit_mark, case.model_copy(update={"fit_mark": None})
    name, word, changed = _read(case.patient.id)
    state = PageState(case, case.volume_policy, origin="file", source=source)
    if fit is not None and not word:
        word, changed = _BY_STATE["fit", fit.level], changed or fit.is_changed
    if not word:
        return state
    origin, verdict = _WORDS[word]
    person = case.patient.model_copy(update={"id": f"{name} ({_CHANGED})" if changed else name})
    bare = case.model_copy(update={"patient": person})
    return PageState(bare, case.volume_policy, origin=origin, source=source, verdict=verdict)


def _read(written: str) -> tuple[str, str, bool]:
    """Return the name without marks, the words on its fit (or an empty text), and whether it was changed."""
    name, _, rest = written.rpartition(" (")
    marks = rest.removesuffix(")").split(", ")
    fits = [mark for mark in marks if mark in _WORDS]
    known = rest.endswith(")") and len(fits) <= 1 and {*marks} <= {*fits, _CHANGED}
    if not name or not known:
        return written, "", False
    return name, "".join(fits), _CHANGED in marks
