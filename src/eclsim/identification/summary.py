"""What the command line shows of fits, of draws and of a series, as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from eclsim.identification.verdict import Level, headline, signed
from eclsim.parameters import thiel2025
from eclsim.reporting.text_table import text_table

_SIGNS = {"poor": "!!", "doubtful": "! ", "good": "- "}


def fits_text(content: Mapping[str, Any]) -> str:
    """One fit at length, or a row for each of several; draws where there are any; how much fits explain."""
    points = content["points"]
    lines = [_one_fit(points[0]) if len(points) == 1 else _several_fits(points)]
    if "posterior" in content:
        lines.append(posterior_text(content["posterior"]))
    if len(points) > 1:
        lines += [f"R2 of {k}: {v:.4f}{_about_r2(v)}" for k, v in content["r2"].items() if v is not None]
    return "\n".join(lines)


def _about_r2(value: float) -> str:
    """What the number means: it is no square, and below zero it does not speak for the fits."""
    if value >= 0.0:
        return " (share of the variation among the measured values that the fits explain; 1: all of it)"
    return " (below 0: the fits miss the measured values by more than these differ from their mean)"


def _one_fit(point: Mapping[str, Any]) -> str:
    goodness = point["verdict"]["goodness"]
    off = {} if goodness is None else goodness["differences"]
    outputs = [
        (n, _number(c["measured"]), _number(c["simulated"]), signed(off[n]) if n in off else "-")
        for n, c in point["outputs"].items()
    ]
    rows = [
        (
            n, *(_number(p[q]) for q in ("value", "lower", "upper")), thiel2025.PARAMETERS[n].unit,
            "yes" if p["identifiable"] else "no: " + p["reason"],
        )
        for n, p in point["parameters"].items()
    ]  # fmt: skip
    head = ("parameter", "value", "5 %", "95 %", "unit", "determined by the measurements")
    share = f"{point['starts_agreeing']} of {point['starts_refined']} starts agree"
    return "\n".join((
        f"{point['id']}: {headline(point['verdict'])}",
        *(f"  {_SIGNS[r['level']]} {r['sentence']}" for r in point["verdict"]["reasons"]),
        "",
        f"Search: {point['message']} ({share}, {point['seconds']:.1f} s)",
        f"Sum of squared residuals: {_number(point['cost'])}",
        text_table(("output", "measured", "fitted", "standard uncertainties off"), outputs, (1, 2, 3)),
        "",
        text_table(head, rows, numeric=(1, 2, 3)),
    ))  # fmt: skip


def _several_fits(points: Sequence[Mapping[str, Any]]) -> str:
    names = list(dict.fromkeys(n for p in points for n in p["parameters"]))
    rows = []
    for p in points:
        cells = (p["parameters"][n] for n in names)
        values = (_number(cell["value"]) + ("*" if cell["at_bound"] else "") for cell in cells)
        agree = str(p["starts_agreeing"])
        rows.append((p["id"], p["verdict"]["level"], _number(p["cost"]), *values, agree, p["status"]))
    head = ("id", "verdict", "cost", *names, "agree", "status")
    table = text_table(head, rows, numeric=range(2, len(head) - 1))
    return "\n".join((table, "* at a bound", *_doubts(points)))


def _doubts(points: Sequence[Mapping[str, Any]]) -> list[str]:
    """How many fits are good, and the chief reason of each that is not."""
    levels = [p["verdict"]["level"] for p in points]
    lines = ["", ", ".join(f"{levels.count(level)} {level}" for level in Level) + f" of {len(levels)} fits"]
    for p in points:
        if p["verdict"]["level"] != Level.GOOD:
            lines.append(f"{p['id']}: {p['verdict']['level']}: {p['verdict']['reasons'][0]['sentence']}")
    return lines


# --- draws ----------------------------------------------------------------------------------------


def posterior_text(content: Mapping[str, Any]) -> str:
    """Parameters and predictions with intervals, and beside each of them whether to trust it."""
    lines = [
        "",
        f"{content['kind']}, {_quality(content)}, prior {content['prior']}, {content['seconds']:.0f} s",
    ]
    lines += [*_doubted(content["verdict"], content["doubts"]), _parameters(content)]
    for prediction in content["predictions"]:
        lines += ["", *_prediction(content, prediction)]
    for counted, of, what in (
        ("weighted_draws_without_steady_beat", "weighted_draws", "weighted draws"),
        ("evaluations_without_steady_beat", "evaluations", "points that the chains tried"),
    ):
        if content[counted]:
            share = f"{content[counted]} of the {content[of]} {what}"
            lines.append(f"{share} have no steady heartbeat: excluded as impossible")
    return "\n".join(lines)


def _quality(content: Mapping[str, Any]) -> str:
    """How many draws, and what they are worth where they are weighted."""
    if content["method"] != "importance":
        return f"{content['draws']} draws"
    shape = "not known" if content["pareto_k"] is None else f"{content['pareto_k']:.2f}"
    return f"{content['effective_draws']:.0f} effective draws, Pareto k {shape}"


def _parameters(content: Mapping[str, Any]) -> str:
    chains = content["method"] == "nuts"
    shown = ("median", "lower", "upper", *(("r_hat", "effective_bulk", "effective_tail") if chains else ()))
    rows = [(n, *(_number(p[q]) for q in shown)) for n, p in content["parameters"].items()]
    more = ("R-hat", "effective draws", "in the tails") if chains else ()
    head = ("parameter", "median", "5 %", "95 %", *more)
    return text_table(head, rows, range(1, len(head)))


def _prediction(content: Mapping[str, Any], prediction: Mapping[str, Any]) -> Iterator[str]:
    yield f"{prediction['settings']}: {content['kind']}, without the noise of a measurement"
    verdict = content["verdict"] or ("NOT TO BE TRUSTED" if prediction["doubts"] else "")
    yield from _doubted(verdict, prediction["doubts"])
    rows = [
        (n, *(_number(p[q]) for q in ("median", "lower", "upper"))) for n, p in prediction["outputs"].items()
    ]
    yield text_table(("output", "median", "5 %", "95 %"), rows, range(1, 4))
    lost = prediction["draws_without_steady_beat"]
    if lost:
        yield f"{lost} of {prediction['draws']} draws have no steady heartbeat there and are not counted"


def _doubted(verdict: str, doubts: Sequence[str]) -> list[str]:
    return [f"{verdict}:", *(f"  {doubt}" for doubt in doubts)] if doubts else []


# --- a series of measurements ---------------------------------------------------------------------


def series_text(series: Mapping[str, Any]) -> str:
    """Medians after each measurement, what is to be said of it, and the parameters as they are now."""
    points = series["points"]
    names = list(dict.fromkeys(n for p in points for n in p["parameters"]))
    rows = [
        (
            p["id"],
            *(_number(p["parameters"].get(n, {}).get("median"), 3) for n in names),
            _number(p["probability"], 3),
        )
        for p in points
    ]
    head = ("id", *names, "p")
    lines = [f"{series['id']}: medians after each measurement, and how probable its deviations were"]
    lines.append(text_table(head, rows, numeric=range(1, len(head))))
    lines += [f"  !  {p['id']}: {p['message']}" for p in points if p["message"]]
    if not names:
        return "\n".join(lines)
    known = [p for p in points if p["parameters"]][-1]
    now = [
        (n, *(_number(i[q], 3) for q in ("median", "lower", "upper")), thiel2025.PARAMETERS[n].unit)
        for n, i in known["parameters"].items()
    ]
    head = (f"after {known['id']}", "median", "5 %", "95 %", "unit")
    return "\n".join([*lines, "", text_table(head, now, numeric=range(1, 4))]) + "\n"


def _number(value: float | None, digits: int = 4) -> str:
    return "-" if value is None else f"{value:.{digits}g}"
