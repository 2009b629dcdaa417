"""The timeline of a course: outputs over hours, events as numbered lines, alarms as bars."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from eclsim.cases.events import Event
from eclsim.cases.fit_mark import untrusted
from eclsim.cases.fluid import DialysedDrug
from eclsim.course.alarms import NO_PATIENT, clock_time
from eclsim.course.drug import dialysed_drug_of, drug_in_words
from eclsim.course.result import (
    has_standing_lung_blood,
    impossible_moments,
    spans_in_words,
    undetermined_moments,
)
from eclsim.devices.description import Panel
from eclsim.fluid.dialysed_drug import CONCENTRATION, UNBOUND
from eclsim.fluid.law import GIVEN, REFILLED, REMOVED
from eclsim.outputs.limits import consecutive_runs
from eclsim.outputs.uncertainty import NOT_THE_MEASURED
from eclsim.reporting import style
from eclsim.simulation.panels import (
    QUANTITIES,
    BrokenLimit,
    curves_of,
    draw_bar,
    draw_broken_limits,
    draw_legend_above,
    legend_of_bars,
    legend_of_care,
    legend_start,
    make_room,
    panels_of,
)

if TYPE_CHECKING:
    import xarray as xr

BLOOD = Panel("Fluid and blood", "mL", (GIVEN, REMOVED, REFILLED), ("given", "removed", "refilled"))
DISSOLVED = Panel("Dissolved", "mmol/L", ("urea", "potassium", "bicarbonate"),
                  ("urea", "potassium", "bicarbonate"))  # fmt: skip
DRUG = Panel("Drug in the plasma", "mg/L", (CONCENTRATION, UNBOUND), ("bound and unbound", "unbound"))
BLOOD_CELLS = Panel("Haematocrit", "1", ("haematocrit",), ("haematocrit",))
_NARROWEST = {"1": 0.005, "mL": 2.0}
"""Smallest span of an axis in its unit, so that rounding is not shown as a curve; 0.1 for other units."""
_NUMBER_WIDTH = 0.025
"""Width of a digit of an event's number, as a share of the time axis."""
MOST_ALARMS = 5
"""Largest number of alarms drawn for a band, the most probable ones."""


@style.figure_style()
def plot_course(result: xr.Dataset) -> Figure:
    """Pressures, flows and volumes over hours.

    Args:
        result: dataset as of `eclsim.course` or `eclsim.course_band`.
    """
    panels = (*panels_of(result), BLOOD, BLOOD_CELLS, DISSOLVED, DRUG)
    drawn = list({p.names: p for p in panels if any(_has_values(result, name) for name in p.names)}.values())
    probable = bool(result.sizes.get("alarm"))
    rows = -(-max(len(drawn) + probable, 1) // 2)
    events = [Event.model_validate(event) for event in json.loads(result.attrs["events"])]
    broken = _broken_limits(result)
    notes = (*legend_of_bars(drawn, broken), *legend_of_care(result, drawn), *_notes(result))
    legend = "\n".join((*_legend(events), *notes))
    fig = style.new_figure(style.PAGE_WIDTH_MM, 24 + 50 * rows + 4.0 * legend.count("\n"))
    axes = list(fig.subplots(rows, 2, squeeze=False, sharex=True).flat)
    impossible = impossible_spans(result)
    for ax, panel in zip(axes, drawn, strict=False):
        _draw(ax, result, panel, events)
        for begin, end in impossible:
            ax.axvspan(*np.array([begin, end]) / _time_axis_unit(result)[1], color="0.85", lw=0, zorder=-1)
        ax.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 3, 6, 10]))
        _mark_spans(ax, json.loads(result.attrs.get("spans", "[]")), _time_axis_unit(result)[1])
        draw_broken_limits(ax, panel, broken)
        if panel is DRUG:
            _mark_target(ax, dialysed_drug_of(result))
    used = len(drawn)
    if probable:
        _draw_probability(axes[used], result, events)
        used += 1
    for ax in axes[used:]:
        ax.remove()
    for ax in axes[max(used - 2, 0) : used]:
        ax.set_xlabel(f"Time from the start [{_time_axis_unit(result)[0]}]")
        ax.tick_params(labelbottom=True)
    fig.suptitle(style.fitted_title(result.attrs["id"], " – course"), x=0.01, ha="left")
    fig.supxlabel(legend, fontsize=7.5, x=0.01, ha="left", color=style.GREY)
    style.write_above(fig, [*untrusted(result.attrs["warnings"]), *_of_another_patient(result)])
    return fig


def _time_axis_unit(result: xr.Dataset) -> tuple[str, float]:
    """Unit of the time axis, and the number of minutes in it."""
    return ("h", 60.0) if len(result["time_min"]) and result["time_min"][-1] > 240.0 else ("min", 1.0)


def _has_values(result: xr.Dataset, name: str) -> bool:
    return name in result and bool(np.isfinite(result[name].to_numpy().astype(float)).any())


def _draw(ax: Axes, result: xr.Dataset, panel: Panel, events: list[Event]) -> None:
    minutes = _time_axis_unit(result)[1]
    hours = result["time_min"].to_numpy() / minutes
    drawn = curves_of(result, panel)
    for index, (name, label) in enumerate(drawn):
        _curve(ax, hours, result[name].to_numpy().astype(float), label, index)
    low, high = ax.get_ylim()
    short = _NARROWEST.get(panel.unit, 0.1) - (high - low)
    if short > 0.0:
        ax.set_ylim(low - 0.5 * short, high + 0.5 * short)
    _mark_events(ax, hours, events, minutes)
    ax.set_ylabel(f"{QUANTITIES.get(panel.unit, '')} [{panel.unit}]".strip())
    start = legend_start([label for _, label in drawn])
    draw_legend_above(ax, panel.title, -(-len(drawn) // 2), start=start)


def _curve(ax: Axes, hours: np.ndarray, numbers: np.ndarray, label: str, index: int) -> None:
    """Plot an output over time; for a band, the median and the 50 % and 90 % intervals of the draws."""
    look: dict[str, Any] = {**style.curve_style(index)}
    if numbers.ndim == 2:
        lowest, low, numbers, high, highest = numbers
        for (lower, upper), alpha in zip(((lowest, highest), (low, high)), (0.14, 0.24), strict=True):
            ax.fill_between(hours, lower, upper, color=look["color"], alpha=alpha, linewidth=0.0)
    ax.plot(hours, numbers, label=label, **look)


def _mark_target(ax: Axes, drug: DialysedDrug | None) -> None:
    """Name the drug, and draw the unbound concentration to be exceeded."""
    if drug is None:
        return
    if drug.name:
        ax.set_title(style.plain_text(drug.name, 40), loc="left", pad=14.5)
    if drug.target_mg_l:
        ax.axhline(drug.target_mg_l, color=style.GREY, linewidth=0.9, linestyle=(0, (4, 2)), zorder=0)
        place = (1.0, drug.target_mg_l)
        ax.annotate("target", place, xycoords=("axes fraction", "data"), xytext=(-2, 2), ha="right",
                    textcoords="offset points", fontsize=6.5, color=style.GREY)  # fmt: skip


def _mark_events(ax: Axes, hours: np.ndarray, events: list[Event], minutes: float) -> None:
    if events:
        make_room(ax, above=True)
    end = hours[-1] if len(hours) else -np.inf
    places = [at for event in events if (at := event.at_min / minutes) <= end]
    for at in places:
        ax.axvline(at, color=style.GREY, linewidth=0.7, linestyle=(0, (2, 2)), zorder=0)
    for at, numbers in joined_numbers(places, hours[-1] - hours[0] if len(hours) else 1.0):
        ax.annotate(numbers, (at, 1.0), xycoords=("data", "axes fraction"), xytext=(1.5, -7),
                    textcoords="offset points", fontsize=6.5, color=style.GREY)  # fmt: skip


def joined_numbers(places: Sequence[float], length: float) -> list[tuple[float, str]]:
    """Places and numbers of events; numbers that would overlap are joined at the first place, as "2–4".

    Args:
        places: places of the events on the time axis, in ascending order.
        length: length of the time axis, in the same unit.
    """
    groups: list[tuple[float, int, int]] = []
    for number, at in enumerate(places, start=1):
        if groups and at - groups[-1][0] < _NUMBER_WIDTH * (1 + len(_span(*groups[-1][1:]))) * length:
            groups[-1] = (*groups[-1][:2], number)
        else:
            groups.append((at, number, number))
    return [(at, _span(first, last)) for at, first, last in groups]


def _span(first: int, last: int) -> str:
    return str(first) if first == last else f"{first}–{last}"


def _mark_spans(ax: Axes, spans: list[dict[str, Any]], minutes: float) -> None:
    """Draw a grey bar at the top where every beat was followed."""
    for span in spans:
        ends = [span["from_min"] / minutes, span["until_min"] / minutes]
        draw_bar(ax, ends, 1.01, color="0.65", linewidth=2.4, solid_capstyle="projecting", clip_on=False)


def impossible_spans(result: xr.Dataset) -> list[tuple[float, float]]:
    """Spans [min] whose beats no patient can have, each up to the next moment that is possible."""
    marked, minute = impossible_moments(result), result["time_min"].to_numpy()
    runs, last = consecutive_runs(np.flatnonzero(marked).tolist()), len(minute) - 1
    return [(float(minute[run[0]]), float(minute[min(run[-1] + 1, last)])) for run in runs]


def _draw_probability(ax: Axes, result: xr.Dataset, events: list[Event]) -> None:
    """Plot the share of the draws that violate a limit over time."""
    _, minutes = _time_axis_unit(result)
    hours, gravest = result["time_min"].to_numpy() / minutes, result.isel(alarm=slice(MOST_ALARMS))
    for index, (label, share) in enumerate(
        zip(gravest["alarm"].values, gravest["alarm_probability"].to_numpy(), strict=True)
    ):
        text = style.plain_text(str(label).replace("_", " "), 60)
        ax.plot(hours, 100.0 * share, label=text, **style.curve_style(index))  # pyright: ignore[reportArgumentType] - dict of keywords
    ax.set_ylim(-3.0, 103.0)
    _mark_events(ax, hours, events, minutes)
    ax.set_ylabel("Draws [%]")
    draw_legend_above(ax, "Limits broken", gravest.sizes["alarm"], columns=1)


def _broken_limits(result: xr.Dataset) -> list[BrokenLimit]:
    """Alarms of the course on the time axis; those of a band are shares of its draws and have no bars."""
    end, minutes = (float(m) for m in (*result["time_min"][-1:], _time_axis_unit(result)[1]))
    return [
        BrokenLimit(
            alarm["quantity"], alarm["kind"], alarm["at_min"] / minutes,
            (end if alarm["until_min"] is None else alarm["until_min"]) / minutes,
        )
        for alarm in json.loads(result.attrs["alarms"])
    ]  # fmt: skip


def _legend(events: list[Event]) -> list[str]:
    lines = []
    for number, event in enumerate(events, start=1):
        how = f" over {event.over_min:g} min" if event.give else ""
        how += f" within {event.ramp_min:g} min" if event.ramp_min else ""
        words = style.plain_text(event.summary, 110)
        lines.append(f"{number}  {clock_time(event.at_min)}  {words}{how}")
    return lines


def _notes(result: xr.Dataset) -> list[str]:
    lines = []
    if "quantile" in result.dims:
        lines.append(
            f"curves: median of {result.attrs['draws']} draws; bands: 50 % and 90 % of those followed so far"
        )
    if impossible_spans(result):
        lines.append(f"grey areas: beats {NO_PATIENT}: ignore their numbers")
    if undetermined_moments(result).any():
        lines.append(
            "gaps in the curves: valves stay shut, so that the case does not determine the number; fluid and "
            "blood go on with one possible beat"
        )
    if has_standing_lung_blood(result):
        lines.append(
            "gaps in the curve of the pulmonary artery: its blood stands still and is not mixed venous"
        )
    if spans := spans_in_words(result):
        lines.append(style.plain_text(f"grey bars at the top: {spans}", 130))
    if "quantile" not in result.dims and (drug := drug_in_words(result)):
        lines += textwrap.wrap(style.plain_text(drug, 200), 110)
    warnings = result.attrs["warnings"] if "quantile" in result.dims else [result.attrs["message"]]
    above = untrusted(warnings)
    for sentence in (text for text in warnings if text and text not in above):
        lines += textwrap.wrap(style.plain_text(str(sentence), 330), 110)
    return [*lines, *_place_of_remarks(result)]


def _place_of_remarks(result: xr.Dataset) -> list[str]:
    """Return a line that names the files with the remarks on a course, for which a figure has no room."""
    count = sum(len(result.attrs.get(kind, ())) for kind in ("approximations", "cautions"))
    count -= len(_of_another_patient(result))
    if "quantile" in result.dims or not count:
        return []
    remarks = "1 remark" if count == 1 else f"{count} remarks"
    return [
        f"{remarks} on how to read this course: `warnings` in its JSON file, `approximations` and `cautions` "
        "in its NetCDF file"
    ]


def _of_another_patient(result: xr.Dataset) -> list[str]:
    """A sentence if the course does not begin with the beat that was measured: it concerns all numbers."""
    return [text for text in map(str, result.attrs.get("cautions", ())) if NOT_THE_MEASURED in text]
