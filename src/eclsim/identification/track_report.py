"""Terminal text and HTML page of followed patients, from their JSON data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill

from eclsim.identification.quantities import BEAT_OUTPUTS, unit_of, unit_of_parameter
from eclsim.identification.report import Data, names_in
from eclsim.identification.verdict import Level, headline
from eclsim.reporting.html import Table, render
from eclsim.reporting.numbers import MISSING, dashed, interval, number, text_table

_WIDTH = 110
TRACKED = {
    "outputs": (
        "Outputs. Pale bars: where 90 % of measurements were expected beforehand. Diamonds: measured. Dark "
        "bars: the model afterwards, median and 90 %. Open circles: doubtful."
    ),
    "parameters": "Parameters after each measurement, median and 90 %. Open circles: doubtful.",
}
"""Figures of a followed patient, in order, with their captions."""


def doubts_of_point(point: Data, output: str = "") -> str:
    """Why the numbers of a followed point are not to be trusted; empty where they are.

    Args:
        point: as in track.json.
        output: that the numbers are of: doubts about another one are left out; empty for parameters.
    """
    verdict = point["verdict"]
    fit = headline(verdict) if verdict is not None and verdict["level"] != Level.GOOD else ""
    others = tuple(f"{name}: " for name in point["doubtful"] if output and name != output)
    doubts = (doubt for doubt in point["doubts"] if not doubt.startswith(others))
    return "; ".join(filter(None, (f"not used: {point['message']}" * point["failed"], fit, *doubts)))


def doubts_of_first(series: Data) -> list[str]:
    """The verdict on the first estimate of a followed patient where it is not good, as sentences."""
    first = [(p["id"], p["verdict"]) for p in series["points"] if p["verdict"] is not None]
    return [f"first estimate ({name}): {headline(v)}" for name, v in first if v["level"] != Level.GOOD]


# --- terminal text of followed patients ---------------------------------------------------------------


def series_text(series: Data) -> str:
    """Text of medians after each measurement, remarks, and the current parameters."""
    points = series["points"]
    names = names_in(points, "parameters")
    rows = [
        (
            p["id"], *(dashed(p["parameters"].get(n, {}).get("median"), 3) for n in names),
            dashed(p["probability"], 3),
        )
        for p in points
    ]  # fmt: skip
    head = ("id", *names, "p")
    lines = [
        f"{series['id']}: medians after each measurement, and the probability p of deviations this large"
    ]
    lines.append(text_table(head, rows, numeric=range(1, len(head))))
    lines += [_remark_line(f"{p['id']}: {p['message']}") for p in points if p["message"]]
    lines += [
        _remark_line(f"the patient after {points[-1]['id']}: {warning}")
        for warning in points[-1].get("warnings", ())
    ]
    lines += _outputs_now(points)
    if not names:
        return "\n".join(lines)
    known = [p for p in points if p["parameters"]][-1]
    now = [
        (n, *(dashed(i[q], 3) for q in ("median", "lower", "upper")), unit_of_parameter(n))
        for n, i in known["parameters"].items()
    ]
    head = (f"after {known['id']}", "median", "5 %", "95 %", "unit")
    return "\n".join([*lines, "", text_table(head, now, numeric=range(1, 4))]) + "\n"


def _remark_line(text: str) -> str:
    """A remark in lines of the width of the tables."""
    return fill(text, _WIDTH, initial_indent="  !  ", subsequent_indent="     ", break_long_words=False)


def _outputs_now(points: Sequence[Data]) -> list[str]:
    """Table of the outputs after the last update: the usual ones, and those that were ever measured."""
    known = [p for p in points if p["outputs"]]
    if not known:
        return []
    now, ever = known[-1], {*BEAT_OUTPUTS, *names_in(points, "measurements")}
    rows = [
        (
            n, dashed(now["measurements"].get(n, {}).get("measured"), 3),
            *(dashed(i[q], 3) for q in ("median", "lower", "upper")), unit_of(n), _remark_on_output(now, n),
        )
        for n, i in now["outputs"].items()
        if n in ever
    ]  # fmt: skip
    head = (f"after {now['id']}", "measured", "estimate", "5 %", "95 %", "unit", "")
    return ["", text_table(head, rows, numeric=range(1, 5))]


# --- the page of followed patients --------------------------------------------------------------------


def track_page(content: Data, drawings: Mapping[tuple[str, str], str]) -> str:
    """Return the page of followed patients: current state, unusual measurements, course, assumptions.

    Args:
        content: data as in track.json.
        drawings: figures as SVG text, by id of the patient and key of `TRACKED`.
    """
    ids = [series["id"] for series in content["series"]]
    return render(
        "identification/track.html",
        title=f"Following {ids[0]}" if len(ids) == 1 else f"Following {len(ids)} patients",
        refused=content["refused"],
        patients=[_patient(series) for series in content["series"]],
        rates=", ".join(f"{drift:g}" for drift in content["settings"]["drifts"]),
        drawings=drawings,
        captions=TRACKED,
    )


def _patient(series: Data) -> dict[str, object]:
    points = series["points"]
    state = _state(points)
    course = [
        (p["id"], number(p["hours_since_last"]), number(p["probability"], digits=3),
         p["message"] or ("fits" if p["probability"] is not None else "first estimate"))
        for p in points
    ]  # fmt: skip
    head = ("Measurement", "Hours since the last", "Probability", "Remark")
    return {
        "id": series["id"],
        "last": points[-1]["id"],
        "state": state,
        "doubtful": len(state) > 1 or points[-1]["failed"],
        "warnings": points[-1].get("warnings", ()),
        "outputs": _tracked_outputs(points[-1]),
        "parameters": _tracked_parameters(points),
        "course": Table(head, course, numeric=(0, 1, 2)),
        "notes": series.get("notes", ()),
    }


def _state(points: Sequence[Data]) -> list[str]:
    """State whether the last measurement fits, and earlier remarks."""
    last = points[-1]
    if last["failed"]:
        first = f"{last['id']} could not be used: the estimate is that of the previous measurement"
    elif last["probability"] is None:
        first = f"{last['id']} is the only measurement: there is nothing to compare it with yet"
    elif last["unusual"]:
        first = f"{last['id']} does not fit the patient so far"
    elif misfits := [n for n, m in last["measurements"].items() if _remark(m)]:
        first = f"{last['id']} fits the patient so far as a whole, but not in {', '.join(misfits)}"
    else:
        first = f"{last['id']} fits the patient so far (probability {last['probability']:.2g})"
    return [first, *(f"{p['id']}: {p['message']}" for p in points if p["message"])]


def _remark(measurement: Data) -> str:
    """What is wrong with a measurement of a followed patient; empty if it fits."""
    if not measurement.get("used", True):
        return "not used"
    if not measurement.get("met", True):
        return "not met"
    return "unusual" if measurement.get("unusual") else ""


def _remark_on_output(point: Data, name: str) -> str:
    """What is wrong with an output of a followed patient, measured or not; empty if nothing is."""
    remark = _remark(point["measurements"].get(name, {}))
    doubtful = "doubtful" if name in point.get("doubtful", ()) else ""
    return ", ".join(filter(None, (remark, doubtful)))


def _tracked_outputs(point: Data) -> Table:
    rows = []
    for name in dict.fromkeys([*point["outputs"], *point["measurements"]]):
        measurement = point["measurements"].get(name, {})
        off = measurement.get("deviation")
        remark = _remark_on_output(point, name)
        remark += ": see above" * remark.endswith("doubtful")
        rows.append(
            (f"{name} [{unit_of(name)}]", number(measurement.get("measured")),
             _range(point["expected"].get(name)), MISSING if off is None else f"{off:+.1f}",
             _median(point["outputs"].get(name)), remark)
        )  # fmt: skip
    head = ("Output", "Measured", "Expected", "Deviation [SD]", "Model afterwards", "Remark")
    return Table(head, rows, numeric=(1, 2, 3, 4))


def _tracked_parameters(points: Sequence[Data]) -> Table | None:
    known = [p for p in points if p["parameters"]]
    if not known:
        return None
    first, last = known[0], known[-1]
    rows = []
    for name, now in last["parameters"].items():
        before, after = first["parameters"][name]["median"], now["median"]
        ratio = f"{after / before:.2f}" if min(before, after) > 0.0 else MISSING
        rows.append((name, unit_of_parameter(name), _median(first["parameters"][name]), _median(now), ratio))
    head = ("Parameter", "Unit", f"After {first['id']}", f"After {last['id']}", "Ratio of medians")
    return Table(head, rows, numeric=(2, 3, 4))


def _median(limits: Mapping[str, float] | None) -> str:
    return MISSING if limits is None else f"{number(limits['median'], digits=3)} ({_range(limits)})"


def _range(limits: Mapping[str, float] | None) -> str:
    return MISSING if limits is None else interval(limits["lower"], limits["upper"])
