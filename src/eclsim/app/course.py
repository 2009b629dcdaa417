"""Courses over hours for the displayed case: its events, the results, and the beat at any minute."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eclsim.app.display import compared_of, figures_of, named_specs, panel_of, unit_of, waves_of, written_unit
from eclsim.app.fit_remarks import with_remarks
from eclsim.app.knobs import (
    VOLUME,
    ambiguous_number,
    as_written,
    controls,
    is_whole,
    knobs_of,
    turned_value,
    value_of,
)
from eclsim.app.provenance import provenance
from eclsim.app.state import START, Moment, PageState, key_of
from eclsim.app.texts import ENGLISH, in_page_words, text, with_minus
from eclsim.cases.events import KEYS
from eclsim.cases.reading import read_mapping
from eclsim.cases.regulation import Drugs
from eclsim.course.alarms import clock_time, finding_after_arrest
from eclsim.course.drug import drug_in_words
from eclsim.course.result import impossible_moments
from eclsim.course.timeline import case_with_settings
from eclsim.devices.description import CAUTION, Knob, Picker
from eclsim.devices.registry import own_files
from eclsim.files import finite
from eclsim.fluid.dialysed_drug import UNBOUND
from eclsim.fluid.law import INTERSTITIUM, PLASMA, RED_CELLS, REFILLED, REMOVED
from eclsim.fluid.solutes import TISSUE_PCO2
from eclsim.inputs.mistakes import CaseError, Mistake
from eclsim.inputs.numbers import is_number
from eclsim.outputs.uncertainty import NOT_THE_MEASURED
from eclsim.parameters.fluid import sets_initial_value
from eclsim.parameters.regulation import DRUG_DOSES, DRUGS
from eclsim.slow import DOSE, INFLOWS

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.app.beat import Beat
    from eclsim.app.engine import Engine
    from eclsim.app.state import PageState
    from eclsim.cases.case import Case
    from eclsim.course.beats import BeatByBeatCourse
    from eclsim.course.course import SteadyBeatCourse


BEATS = (2, 10, 30)
"""Durations offered for a course computed beat by beat [min]."""
HOURS = (60, 360, 720, 1440, 4320)
"""Durations offered for a course of steady beats [min]."""
LENGTHS = (*BEATS, *HOURS)
MOST_EVENTS = 60
MOST_ALARMS = 40
MOST_LATE_EVENTS = 4
SAME_FIGURE, MOST_FIGURES = 0.01, 4
"""Relative difference up to which two beats have the same key figure, and the most that are named."""


@dataclass(frozen=True)
class PageCourse:
    """A computed course of a state."""

    state: PageState
    computed: SteadyBeatCourse | BeatByBeatCourse

    @property
    def times(self) -> list[float]:
        """Times of the course's moments [min], rounded as in the browser."""
        return [float(f"{minute:.7g}") for minute in np.asarray(self.computed.result["time_min"])]

    @property
    def end(self) -> float:
        """Last computed minute; earlier than requested if the course stopped."""
        return max(self.times, default=0.0)

    def beat(self, minute: float) -> Beat:
        """Return the beat at a minute up to the end: steady, or the current one of a course beat by beat."""
        from eclsim.app.beat import beat_of, transient_beat
        from eclsim.course.beats import TransientBeat

        moment = self.computed.at(minute)
        if isinstance(moment, TransientBeat):
            beat = transient_beat(self.state, moment)
        else:
            beat = beat_of(self.state, moment.circuit, moment.values, blood=moment.blood)
        alarms, pressure = str(self.computed.result.attrs["alarms"]), beat.outputs.get("MAP", math.nan)
        ended = finding_after_arrest(alarms, minute, pressure)
        return replace(beat, findings=(*ended, *beat.findings)) if ended else beat


def usual_length(case: Case) -> int:
    """Return the shortest offered duration [min], from 6 h on, that is after all events; else the longest."""
    last = max((event.at_min for event in case.events), default=0.0)
    return next((m for m in HOURS[1:] if m > last), HOURS[-1])


def compute_course(state: PageState, minutes: float) -> PageCourse:
    """Compute the course of a state, beat by beat if the duration is one of `BEATS`.

    Raises:
        CaseError: An event is after the end, or changes the circuit during a course beat by beat.
    """
    from eclsim.course.beats import beat_by_beat_course
    from eclsim.course.course import steady_beat_course

    if events_too_late := [event.at_min for event in state.case.events if event.at_min >= minutes]:
        beats = minutes in BEATS
        times = ", ".join(clock_time(at, beats) for at in events_too_late[:MOST_LATE_EVENTS])
        raise CaseError([Mistake("", text("timeline_late", times=times, end=clock_time(minutes, beats)))])
    compute = beat_by_beat_course if minutes in BEATS else steady_beat_course
    return PageCourse(state, compute(state.computed_case, minutes, state.policy))


def replay_command(case: Case, stem: str, minutes: int) -> str:
    """Return the command that computes the course of the page from its exported case file."""
    how = "--beats" if minutes in BEATS else "--steady-only"
    length = minutes or usual_length(case)
    return f"eclsim{device_options(case)} course {stem}.toml --until {length} {how} --out {stem}"


def device_options(case: Case) -> str:
    """Return the options that name the files of the user's own devices in a case, without their folders."""
    files = own_files({one.device.key for one in case.instances()})
    return "".join(f" --device {shlex.quote(Path(path).name)}" for path in files)


def another_start(case: Case, shown: Beat | None, outputs: Mapping[str, float]) -> str:
    """Return a sentence if the page shows another beat than one computed anew at the same settings.

    Args:
        case: case of both.
        shown: beat of the page, whose search started from that of earlier settings; None if there is none.
        outputs: outputs of the beat computed anew.
    """
    if shown is None or not shown.converged:
        return ""
    figures = [one for one in figures_of(case) if {one.output} <= outputs.keys() & shown.outputs.keys()]
    both = [(one, shown.outputs[one.output], outputs[one.output]) for one in figures]
    apart = [trio for trio in both if abs(trio[1] - trio[2]) > SAME_FIGURE * max(map(abs, trio[1:]))]
    if not any(one.unit in ("mmHg", "L/min") for one, *_ in apart):
        return ""

    def words(which: int) -> str:
        return ", ".join(f"{t[0].label} {t[which]:.{t[0].digits}f} {t[0].unit}" for t in apart[:MOST_FIGURES])

    return with_minus(text("another_start", shown=words(1), anew=words(2)))


def first_outputs(result: xr.Dataset) -> dict[str, float]:
    """Return the outputs of the first moment of a course."""
    return {
        str(name): float(column[0]) for name, column in result.items()
        if column.dims == ("time_min",) and column.dtype.kind == "f" and column.size
    }  # fmt: skip


def plain_course(course: PageCourse, minutes: float, shown: Beat | None = None) -> dict[str, Any]:
    """Return a course for the browser: key figures over time, alarms, balance; null for non-finite numbers.

    Curves shown by default have gaps where the beat is impossible in a patient.

    Args:
        course: the course.
        minutes: its length [min].
        shown: the beat of the page at the start.
    """
    result = course.computed.result
    alarms = json.loads(result.attrs["alarms"])
    impossible = impossible_moments(result)
    broken = [one | {"sentence": with_minus(one["sentence"])} for one in alarms if one["kind"] != CAUTION]
    rows = [
        lane._asdict() | {"values": finite(np.where(lane.usual & impossible, np.nan, lane.values), digits=5)}
        for lane in lanes_of(course.state.case, result)
    ]
    return {
        "of": key_of(course.state), "minutes": minutes, "time": course.times,
        "rows": rows, "message": in_page_words(str(result.attrs["message"])),
        "alarms": finite(broken[:MOST_ALARMS]),
        "balance": finite(json.loads(result.attrs["balance"]), digits=5),
        "drug": drug_in_words(result),
        "approximations": [
            *filter(None, [another_start(course.state.case, shown, first_outputs(result))]),
            *(
                with_minus(str(one)) for kind in ("approximations", "cautions") for one in result.attrs[kind]
                if NOT_THE_MEASURED not in one  # measurements stand beside the tiles
            ),
        ],
        "seconds": round(float(result.attrs["seconds"]), 2),
    }  # fmt: skip


def plain_events(case: Case) -> list[dict[str, Any]]:
    """Return the events of a case as described on the page."""
    known = {one["key"]: one for one in possible_events(case)} if case.events else {}
    groups = {one.key: one.label for one in case.instances()}
    pickers = {one.key: one for one in controls(case) if isinstance(one, Picker)} if case.events else {}

    def described(key: str, value: object) -> str:
        if (picker := pickers.get(key)) is not None:
            written = str(value).lower() if isinstance(value, bool) else value
            words = dict(picker.options).get(str(written), written)
            return f"{groups.get(picker.group, '')} {picker.label}: {words}".strip()
        one = known.get(key, {"label": key, "unit": ""})
        return f"{one['label']} {f'{value:g}' if isinstance(value, float) else value} {one['unit']}".strip()

    return [
        {
            "at": event.at_min, "lasts": event.over_min if event.give else event.ramp_min,
            "words": ", ".join(described(*each) for each in (*event.set.items(), *event.give.items())),
        }
        for event in case.events
    ]  # fmt: skip


def possible_events(case: Case) -> list[dict[str, Any]]:
    """Return what an event can give or set: volumes, knobs, and fluids of devices and drugs even if now 0."""
    gifts = [
        {"key": kind, "give": True, "label": text(f"give_{kind}"), "unit": "mL", "value": 300.0}
        for kind in INFLOWS
    ]
    if case.dialysed_drug is not None:
        gifts.append({"key": DOSE, "give": True, "label": text(f"give_{DOSE}"), "unit": "mg", "value": 500.0})
    knobs = [
        k for k in controls(case) if isinstance(k, Knob) and k.key != VOLUME and not sets_initial_value(k.key)
    ]
    known = {knob.key for knob in knobs}
    labels = {one.key: one.label for one in case.instances()}
    entries = [
        (k.key, f"{labels.get(k.group, '')} {k.label}".strip(), unit_of(k), value_of(case, k.key))
        for k in knobs
    ]
    for one in case.instances():
        fields = ((f"{one.key}.{name}", field) for name, field in one.device.section.fields().items())
        entries += [
            (key, f"{one.label} {field.description}", field.unit, 0.0)
            for key, field in fields
            if key.endswith("_ml_h") and key not in known
        ]
    for drug in DRUG_DOSES:
        if (key := f"{Drugs.section}.{drug}") not in known:
            field = Drugs.fields()[drug]
            entries.append((key, ENGLISH.get(key, field.description), written_unit(field.unit), 0.0))
    return gifts + [
        {"key": key.removeprefix("parameters."), "give": False, "label": label, "unit": unit, "value": value}
        for key, label, unit, value in entries
    ]


def with_event(case: Case, event: object) -> Case:
    """Return the case with an additional event, inserted in order of time.

    Args:
        case: the case before.
        event: event as in a case file; amounts and minutes may be texts as typed.

    Raises:
        CaseError: The event is invalid, with the same messages as for a case file.
    """
    raw = case.as_mapping()
    events = list(raw.get("events", []))
    if not isinstance(event, dict) or len(events) >= MOST_EVENTS:
        raise CaseError([Mistake("events", text("course_full", most=MOST_EVENTS))])
    added = _with_numbers(case, {key: event[key] for key in KEYS if key in event})
    at = added.get("at_min")
    minute = float(at) if is_number(at) else 0.0
    raw["events"] = sorted([*events, added], key=lambda one: minute if one is added else one["at_min"])
    return read_mapping(raw).case


def _with_numbers(case: Case, event: Mapping[str, Any]) -> dict[str, Any]:
    """Convert typed texts in an event to numbers; durations of 0 min are removed (immediate, or a bolus)."""
    read = dict(event)
    for key in ("set", "give"):
        if isinstance(changes := read.get(key), dict):
            read[key] = {
                one: _number(one, value, "timeline_no_amount", key == "give" or is_whole(case, str(one)))
                for one, value in changes.items()
            }
    for key in ("ramp_min", "over_min"):
        if key in read:
            read[key] = _number(key, read[key], "timeline_no_minutes", True)
            if read[key] == 0.0 and not isinstance(read[key], bool):
                del read[key]
    return read


def _number(key: str, value: object, missing: str, whole: bool) -> object:
    """Convert a typed text to a number if it is one; other texts are returned for the check to refuse."""
    if value is None or (isinstance(value, str) and not value.strip()):
        raise CaseError([Mistake(key, text(missing))])
    if suggestion := ambiguous_number(value, whole):
        raise CaseError([Mistake(key, suggestion)])
    return as_written(value)


def with_turn(case: Case, key: str, value: object, minute: float) -> Case:
    """Return the case with an event that turns a knob at a minute, replacing one for the same knob then.

    Raises:
        CaseError: The value is invalid.
    """
    if key == VOLUME:
        raise CaseError([Mistake(key, text("timeline_volume"))])
    key, value = key.removeprefix("parameters."), turned_value(case, key, value)
    at = math.floor(1000.0 * minute) / 1000.0  # not after the displayed minute
    same = [
        k for k, e in enumerate(case.events) if list(e.set) == [key] and e.at_min == at and not e.ramp_min
    ]
    bare = without_event(case, same[0]) if same else case
    return with_event(bare, {"at_min": at, "set": {key: value}})


def case_at(case: Case, minute: float) -> Case:
    """Return the case, without events, as its events have changed it by a given minute."""
    start = now = case.model_copy(update={"events": ()})
    for event in case.events:
        if event.set and event.at_min <= minute + 1e-6:
            now = case_with_settings(now, event.set, start)
    return now


def case_at_minute(case: Case, minute: float) -> Case:
    """Return the case of a displayed minute: at 0 the case itself, later as events have changed it."""
    return case_at(case, minute) if minute else case


def without_event(case: Case, number: int) -> Case:
    """Return the case without one of its events."""
    raw = case.as_mapping()
    raw["events"] = [one for k, one in enumerate(raw.get("events", [])) if k != number]
    return read_mapping(raw).case


# --- curves over the minutes --------------------------------------------------------------------


class Lane(NamedTuple):
    """A curve over the minutes of a course.

    Attributes:
        name: name of the output, slow state or sum.
        label: displayed name.
        unit: displayed unit.
        digits: number of decimals.
        values: value at each moment, in the displayed unit.
        usual: whether the curve is shown by default.
    """

    name: str
    label: str
    unit: str
    digits: int
    values: np.ndarray
    usual: bool


_OUTPUTS = (
    ("heart_rate", "1/min", 0), ("DO2", "mL/min", 0), ("drainage_pressure", "mmHg", 0),
    ("unstressed_volume", "mL", 0), ("systemic_resistance_factor", "", 2), ("contractility_lv_factor", "", 2),
    (TISSUE_PCO2, "mmHg", 0), ("haematocrit", "%", 1), ("plasma_protein", "g/dL", 1),
    ("oncotic_pressure", "mmHg", 1), ("urea", "mmol/L", 1), ("creatinine", "umol/L", 0),
    ("potassium", "mmol/L", 2), (UNBOUND, "mg/L", 1), ("bicarbonate", "mmol/L", 1),
    ("hypoxic_resistance_factor", "", 2),
    (INTERSTITIUM, "mL", 0), (REFILLED, "mL", 0), (REMOVED, "mL", 0),
)  # fmt: skip
"""Name, displayed unit and decimals of the curves offered in addition to the key figures."""


def lanes_of(case: Case, result: xr.Dataset) -> list[Lane]:
    """Return the curves that can be drawn for a course; drugs are included if they have any effect."""
    rows = [
        Lane(one.output, one.label, one.unit, one.digits, result[one.output].to_numpy(), not one.unlike)
        for one in figures_of(case)
        if one.output in result
    ]
    blood = (result[PLASMA] + result[RED_CELLS]).to_numpy()
    rows.append(Lane("blood_volume", text("lane_blood_volume"), "mL", 0, blood, True))
    for drug in DRUG_DOSES:
        dose = result.get(f"{DRUGS}.{drug}_in_effect")
        if dose is not None and np.nanmax(dose.to_numpy(), initial=0.0) > 0.0:
            words = text("lane_drug", drug=drug)
            rows.append(
                Lane(str(dose.name), words, written_unit(dose.attrs["units"]), 2, dose.to_numpy(), True)
            )
    for name, unit, digits in _OUTPUTS:
        if name in result:
            values = result[name].to_numpy() * (100.0 if unit == "%" else 1.0)
            usual = name == UNBOUND
            rows.append(Lane(name, text(f"lane_{name}"), written_unit(unit), digits, values, usual))
    return [lane for lane in rows if np.isfinite(lane.values).any()]


# --- a pinned or saved beat -----------------------------------------------------------------------


class ShownBeat(NamedTuple):
    """A beat as displayed.

    Attributes:
        state: state from which it was computed.
        beat: the steady beat of the state, or that of a later minute of its course.
        moment: minute and length of the course.
    """

    state: PageState
    beat: Beat
    moment: Moment = START

    def plain(self) -> dict[str, Any]:
        """Return the beat with everything in which it can differ from others, for the browser."""
        from eclsim.app.beat import plain

        minute, origin = self.moment.minute, provenance(self.state)
        case = case_at_minute(self.state.case, minute)
        key = f"{key_of(self.state)}@{minute:g}" if minute else key_of(self.state)
        return {
            **plain(with_remarks(self.beat, self.state), waves_of(case), figures_of(case)),
            "of": key, "name": origin["title"], "minute": minute,
            "badge": origin["badge"], "level": origin["level"],
            "values": knobs_of(case), "panel": panel_of(case), "policy": self.state.policy,
            "events": plain_events(self.state.case), "compared": compared_of(case),
            "specs": named_specs(case),
        }  # fmt: skip


def knobs_at(case: Case, minute: float) -> dict[str, Any]:
    """Return the values of the knobs as events have left them at a minute of the course."""
    return knobs_of(case_at_minute(case, minute))


async def recomputed(engine: Engine, state: PageState, moment: Moment) -> ShownBeat:
    """Recompute a beat that was stored before the page was reloaded.

    Raises:
        CaseError: The course of the state cannot be computed.
    """
    if not moment.minute:
        return ShownBeat(state, await engine.beat(state, None))

    def work() -> Beat:
        return compute_course(state, moment.length).beat(moment.minute)

    return ShownBeat(state, await engine.study(work), moment)
