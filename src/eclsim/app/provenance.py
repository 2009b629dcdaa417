"""Origin of the page's numbers, in words: read, simulated, fitted, or changed by hand."""

from __future__ import annotations

from collections.abc import Collection
from copy import deepcopy
from functools import reduce
from types import MappingProxyType
from typing import Any

from eclsim.app.display import group_name
from eclsim.app.fit_remarks import reason_of
from eclsim.app.knobs import (
    ASSUMED_SHUNTS,
    START_PRESSURES,
    VOLUME,
    cached_by_case,
    connect,
    connected,
    controls,
    knobs_of,
    switchable,
    value_of,
)
from eclsim.app.state import PageState
from eclsim.app.texts import text
from eclsim.cases.case import Case
from eclsim.cases.fit_mark import FitMark
from eclsim.cases.presets import PRESETS
from eclsim.cases.quantities import section_and_key, stated
from eclsim.cases.reading import read_mapping
from eclsim.cases.sections import PATIENT_SECTIONS, POLICIES
from eclsim.devices.registry import devices
from eclsim.inputs.mistakes import CaseError, shown
from eclsim.inputs.sections import MAXIMUM_ID_LENGTH
from eclsim.outputs.registry import first_name
from eclsim.parameters.thiel2025 import BOUNDS

LONGEST_SOURCE = 60
MOST_NAMED = 4
"""Largest number of changed knobs that are named; further ones are counted."""


def title_of(state: PageState) -> str:
    """Return the title of a state's numbers; that of a changed patient or preset says that it was changed."""
    origin = state.start.origin
    name = PRESETS[origin].name if origin in PRESETS else state.case.patient.id
    return text("provenance_title_changed", name=name) if state.changed else name


def provenance(state: PageState) -> dict[str, Any]:
    """Return the origin of the numbers as plain data.

    Returns:
        `title`, a `badge` of one or two words, a `level` ("ok" or "warning"), a sentence as `text`, and the
        `circuit`.
    """
    kind, measured = kind_of(state), state.start.case.measurements
    badge = kind
    source = state.source or text("provenance_no_file")
    if len(state.source) > LONGEST_SOURCE:  # so that the text after it stays visible
        source = f"{source[:30]}…{source[-29:]}"
    sentences = [text(f"provenance_{kind}", source=source)]
    if kind == "fit" and state.verdict:
        badge = f"fit_{state.verdict}"
        key, why = "provenance_verdict", reason_of(state)
        said = text(f"verdict_{state.verdict}")
        sentences[0] += " " + (text(f"{key}_why", verdict=said, why=why) if why else text(key, verdict=said))
    before, not_stated = _read(state.start.case.patient.id)[2], kind == "parameters" and measured is not None
    if kind == "fit" and (others := held_parameters(state.start.case, state.start.free)):
        sentences[0] += " " + text("provenance_held", what=", ".join(others))
    if kind == "fit" and state.source:
        sentences[0] += " " + text("provenance_read", source=source)
    if not_stated:
        sentences.append(text("provenance_not_stated"))
    if before:
        sentences.append(text("provenance_changed_before"))
    if state.changed:
        sentences.append(text("provenance_changed", what=", ".join(changes(state))))
    doubted = kind in ("unfitted", "posterior") or (kind == "fit" and state.verdict != "good")
    doubted |= not_stated or before
    return {
        "title": title_of(state), "badge": _badge(badge, state.changed),
        "level": "warning" if doubted or state.changed else "ok", "text": " ".join(sentences),
        "circuit": fitted_with(state),
    }  # fmt: skip


def _badge(kind: str, changed: bool) -> str:
    """Return the text of the badge; a change by hand does not hide a doubt about the original."""
    if not changed:
        return text(f"badge_{kind}")
    if kind in ("preset", "paper", "parameters", "fit_good"):
        return text("badge_changed")
    return text("badge_doubt_changed", doubt=text(f"badge_{kind}"))


def measured_values(state: PageState) -> dict[str, Any]:
    """Return the patient's measurements, to be sent with the beat of the state beside which they are shown.

    Returns:
        `measured`: values by the name of every output that they measure [mmHg, L/min]; `measured_before`:
        whether the settings were changed since, so that the beat is not that of the measurements.
    """
    start = state.start
    known = start.case.measurements
    values = known.model_dump(exclude_none=True) if known else {}
    values |= {first_name(name): value for name, value in values.items()}
    at_start = state.case.model_copy(update={"events": start.case.events}), state.policy
    changed = at_start != (start.case, start.policy) or _read(start.case.patient.id)[2]
    return {"measured": values, "measured_before": changed}


def kind_of(state: PageState) -> str:
    """Return the parameters' origin: "preset", "paper", "fit", "posterior", "parameters" or "unfitted"."""
    start = state.start
    if start.origin in PRESETS:
        return "paper" if start.origin == "paper" else "preset"
    if start.origin in ("fit", "posterior", "unfitted"):
        return start.origin
    return "parameters" if start.case.parameters else "unfitted"


def circuit_text(case: Case) -> str:
    """Return the devices of a case with their speeds and flows, on one line."""
    summaries = [
        f"{instance.label} {instance.device.summary(instance.section)}" for instance in case.instances()
    ]
    return ", ".join(summaries) or text("provenance_no_device")


def fitted_with(state: PageState) -> str:
    """Return what a fit holds fixed, on one line: devices, sections with settings, and parameters."""
    case = fitted_case(state)
    sections = []
    for kind in PATIENT_SECTIONS:
        if (section := getattr(case, kind.section)) is not None:
            settings = section.model_dump(exclude_none=True, exclude_defaults=True)
            assumed = []
            if (shunt := getattr(section, "shunt_fraction", None)) in ASSUMED_SHUNTS:
                settings.pop("shunt_fraction", None)
                assumed = [text("assumed_shunt", value=shown(shunt))]
            words = ", ".join([*(f"{name} {_rounded(value)}" for name, value in settings.items()), *assumed])
            if words or not any(name.startswith(f"{kind.section}.") for name in state.start.free):
                name = group_name(kind.section)
                sections.append(f"{name} ({words})" if words else name)
    policy = [f"{text('policy')} {text(state.policy)}"] if state.policy != POLICIES[0] else []
    return "; ".join([circuit_text(case), *sections, *held_parameters(case), *policy])


def _rounded(value: object) -> str:
    """Return a setting with few digits: a larger number is one of a count, such as a speed."""
    is_long = isinstance(value, float) and 0.0 < abs(value) < 10_000.0
    return f"{value:.4g}" if is_long else shown(value)


def fitted_case(state: PageState) -> Case:
    """Return the case from which a fit starts.

    A preset's parameters of heart and vessels are left out, and those that an earlier fit of this patient
    gave, unless they were set to other values since: they are to be fitted again, not taken as known.
    """
    case = _without_fitted(state)
    if state.start.origin not in PRESETS:
        return case
    own = {entry.key for instance in case.instances() for entry in instance.device.parameters}
    of_devices = {name: value for name, value in case.parameters.items() if "." in name or name in own}
    return case.model_copy(update={"parameters": of_devices})


def _without_fitted(state: PageState) -> Case:
    """Return the case without what its own fit gave."""
    case, opened = state.case, state.start
    own = [name for name in opened.free if stated(case, name) == stated(opened.case, name) is not None]
    if not own:
        return case
    plain = deepcopy(case.as_mapping())  # which shares parts with the case
    for section, key in filter(None, map(section_and_key, own)):
        plain.get(section, {}).pop(key, None)
    return read_mapping(plain).case


def held_parameters(case: Case, free: Collection[str] = ()) -> list[str]:
    """Return the parameters of a case that fits do not vary, except those that one freed, in words."""
    others = {n: value for n, value in case.parameters.items() if n not in BOUNDS and n not in free}
    start = [others.pop(name) for name in START_PRESSURES if name in others]
    given = [f"{text(VOLUME)} {value_of(case, VOLUME):.0f} mL"] if start else []
    return [*given, *(f"{name} {value:g}" for name, value in others.items())]


def changes(state: PageState) -> list[str]:
    """Return what was changed since the patient was opened: names of knobs and devices."""
    start, result, sections = state.start, [], {section.section for section in PATIENT_SECTIONS}
    parts_before, parts_now = (_parts(case) for case in (start.case, state.case))
    for there, others, device, section in (
        (parts_before, parts_now, "provenance_removed", "provenance_switched_off"),
        (parts_now, parts_before, "provenance_connected", "provenance_switched_on"),
    ):
        gone = {key: label for key, label in there.items() if key not in others}
        result += [text(section if key in sections else device, device=name) for key, name in gone.items()]
    opened, shown_now = knobs_of(start.case), knobs_of(state.case)
    usual = _usual_knobs(start.case, state.case)
    devices_now = {instance.key: instance.label for instance in state.case.instances()}
    for control in controls(state.case):
        before = [opened] if control.key in opened else usual
        values = [knobs[control.key] for knobs in before if control.key in knobs]
        if values and shown_now[control.key] not in values:
            result.append(f"{devices_now.get(control.group, '')} {control.label}".strip())
    if start.case.events != state.case.events:
        result.append(text("course_events"))
    if start.policy != state.policy:
        result.append(text("group_model"))
    if len(result) > MOST_NAMED:
        return [*result[:MOST_NAMED], text("provenance_more", count=len(result) - MOST_NAMED)]
    return result


def _usual_knobs(start: Case, now: Case) -> list[dict[str, float | str | None]]:
    """Return the knobs of the start with each device and section added since in its usual form, and with all.

    The usual values of one may depend on the others, and the order in which they were added is not kept.
    """
    added = tuple(key for key in connected(now) if key not in connected(start) and key in switchable())
    known = _known_usual_knobs(start)
    if added not in known:
        cases = [*(_with_usual(start, key) for key in added), reduce(_with_usual, added, start)]
        known[added] = [knobs_of(case) for case in cases]
    return known[added]


@cached_by_case
def _known_usual_knobs(start: Case) -> dict[tuple[str, ...], list[dict[str, float | str | None]]]:
    """Return the results of `_usual_knobs` for a start, by what was added: every turn needs one of them."""
    return {}


def _with_usual(case: Case, key: str) -> Case:
    try:
        return connect(case, key)
    except CaseError:  # it cannot be added without another one
        return case


def _parts(case: Case) -> dict[str, str]:
    """Return the labels of the devices and optional sections of a case."""
    labels = {instance.key: instance.label for instance in case.instances()}
    return labels | {key: group_name(key) for key in connected(case) if key not in devices()}


# --- marks after a patient's id -------------------------------------------------------------------
# In files written by the page they keep how the patient was fitted, and manual changes; the marks of `eclsim
# identify` are in `eclsim.cases.fit_mark`.

_WORDS = MappingProxyType({
    "not fitted": ("unfitted", ""), "fitted": ("fit", "good"), "doubtful fit": ("fit", "doubtful"),
    "poor fit": ("fit", "poor"), "fit without a verdict": ("fit", ""), "central draw": ("posterior", ""),
})  # fmt: skip
"""Origin and verdict of a `PageState`, by the words of the mark."""
_BY_STATE = MappingProxyType({meant: word for word, meant in _WORDS.items()})
_CHANGED = "changed"


def marked_id(state: PageState) -> str:
    """Return the id of a state's patient for files, such as "P01 (poor fit, changed)"."""
    kind = kind_of(state)
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
