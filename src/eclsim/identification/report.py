"""Terminal text and HTML pages of fits and posteriors, from their JSON data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eclsim.cases.quantities import quantity
from eclsim.files import write_text
from eclsim.identification.posterior_text import posterior_text
from eclsim.identification.quantities import axis_label, unit_of, unit_of_parameter
from eclsim.identification.settings import INFORMATIVE_MEASUREMENTS
from eclsim.identification.verdict import Aspect, Level, headline, signed
from eclsim.orbit.model import POLICY_WORDS
from eclsim.reporting.html import Table, render
from eclsim.reporting.numbers import MISSING, dashed, interval, number, text_table

if TYPE_CHECKING:
    from eclsim.cases.case import Case

Data = Mapping[str, Any]
"""Part of a JSON file."""
REPORT = "report.html"
CORRELATED = 0.9
"""Estimates with a larger absolute correlation are reported as correlated."""
_SIGNS = {"poor": "!!", "doubtful": "! ", "good": "- "}
ONE_FIT = {
    "residuals": (
        "Differences from the measurements, in standard uncertainties. Beyond the dashed lines a fit is "
        "doubtful, beyond the solid ones it is poor."
    ),
    "profiles": (
        "How far each parameter can move. Chi-square with the others refitted (dots) and held (grey); "
        "where the dots stay below the dashed line, the value is within the 90 % interval. A flat profile is "
        "a parameter that the measurements do not determine."
    ),
    "correlation": (
        "Correlation of the estimates. Near +1 or -1 the measurements fix a combination of the two "
        "parameters, not each."
    ),
    "starts": (
        "The search. Every start before and after its refinement, and where between the bounds it ended."
    ),
    "slices": (
        "What was minimised, along each parameter with the others held at the optimum (dot). Crosses: no "
        "steady heartbeat."
    ),
}
"""Figures of one fit, in order, with their captions."""
COHORT = {
    "scatter": "Simulated against measured values of all data points, poor fits included.",
    "boxes": "Distributions of measured and simulated values.",
}


def names_in(points: Sequence[Data], key: str) -> list[str]:
    """Names of the parameters or outputs of several points, without repetition."""
    return list(dict.fromkeys(name for point in points for name in point[key]))


def differences_of(point: Data) -> Mapping[str, float]:
    """Differences of a fit from its measurements, in standard uncertainties; empty without a fit."""
    goodness = point["verdict"]["goodness"]
    return {} if goodness is None else goodness["differences"]


# --- terminal text of fits ----------------------------------------------------------------------------


def fits_text(content: Data) -> str:
    """Text of one fit in detail or a row for each of several, with draws and R2 if there are any."""
    points = content["points"]
    lines = [_one_fit(points[0]) if len(points) == 1 else _several_fits(points)]
    if "posterior" in content:
        lines.append(posterior_text(content["posterior"]))
    if len(points) > 1:
        poor = any(p["verdict"]["level"] == Level.POOR for p in points)
        over = " over all fits, the poor ones included" * poor
        r2 = {k: v for k, v in content["r2"].items() if v is not None}
        lines += [f"R2 of {k}{over}: {v:.4f}{_about_r2(v)}" for k, v in r2.items()]
    return "\n".join(lines)


def _about_r2(value: float) -> str:
    """Explain a value of R2, which may be negative."""
    if value >= 0.0:
        return " (share of the variation among the measured values that the fits explain; 1: all of it)"
    return " (below 0: the fits miss the measured values by more than those deviate from their mean)"


def _one_fit(point: Data) -> str:
    off = differences_of(point)
    outputs = [
        (
            n, unit_of(n), dashed(c["measured"]), bracketed(c["simulated"], c.get("determined", True)),
            *(dashed(c.get(end), 3) for end in ("lower", "upper")), signed(off[n]) if n in off else "-",
        )
        for n, c in point["outputs"].items()
    ]  # fmt: skip
    rows = [
        (
            n, *map(dashed, (p["value"], *wider_interval(p))), unit_of_parameter(n),
            "yes" if p["identifiable"] else "no: " + p["reason"],
        )
        for n, p in point["parameters"].items()
    ]  # fmt: skip
    head = ("parameter", "value", "5 %", "95 %", "unit", "determined by the measurements")
    profiled = any(p["profile"] for p in point["parameters"].values())
    share = f"{point['starts_agreeing']} of {point['starts_refined']} starts agree"
    return "\n".join((
        f"{point['id']}: {headline(point['verdict'])}",
        *(f"  {_SIGNS[r['level']]} {r['sentence']}" for r in point["verdict"]["reasons"]),
        "",
        f"Search: {point['message']} ({share}, {point['seconds']:.1f} s)",
        f"Sum of squared residuals: {dashed(point['cost'])}",
        text_table(_FITTED_OUTPUTS, outputs, range(2, len(_FITTED_OUTPUTS))),
        *([BRACKETS] if _has_open_outputs(point) else []),
        "",
        text_table(head, rows, numeric=(1, 2, 3)),
        *(["(the wider of the Gaussian approximation and the profile likelihood)"] * profiled),
    ))  # fmt: skip


_FITTED_OUTPUTS = ("output", "unit", "measured", "fitted", "5 %", "95 %", "standard uncertainties off")
BRACKETS = "(in brackets: the measurements do not determine it; it is one of many values that fit as well)"


def _has_open_outputs(point: Data) -> bool:
    """Whether any output of a fit is not determined."""
    return not all(cell.get("determined", True) for cell in point["outputs"].values())


def bracketed(value: float | None, determined: bool) -> str:
    """A number as text, in brackets if the measurements do not determine it."""
    text = dashed(value)
    return text if determined or value is None else f"({text})"


def wider_interval(parameter: Data) -> tuple[float | None, float | None]:
    """Smallest interval that contains both 90 % intervals, the Gaussian and the profile likelihood's."""
    both = [ends for ends in ((parameter["lower"], parameter["upper"]), parameter["profile"]) if ends]
    if any(None in ends for ends in both):
        return parameter["lower"], parameter["upper"]
    return min(low for low, _ in both), max(high for _, high in both)


def _several_fits(points: Sequence[Data]) -> str:
    names, rows, lines = names_in(points, "parameters"), [], []
    for p in points:
        level, cells = p["verdict"]["level"], (p["parameters"][n] for n in names)
        values = (
            bracketed(cell["value"], cell["identifiable"]) + ("*" if cell["at_bound"] else "")
            for cell in cells
        )
        rows.append((p["id"], level, dashed(p["cost"]), *values, str(p["starts_agreeing"]), p["status"]))
        if level != Level.GOOD:
            lines.append(f"{p['id']}: {level}: {p['verdict']['reasons'][0]['sentence']}")
    head = ("id", "verdict", "cost", *names, "agree", "status")
    table = text_table(head, rows, numeric=range(2, len(head) - 1))
    starred = any(p["parameters"][n]["at_bound"] for p in points for n in names)
    legend = ["* at a bound"] if starred else []
    if not all(p["parameters"][n]["identifiable"] for p in points for n in names):
        legend.append(BRACKETS)
    counted = f"{_counted(points)} of {len(points)} fits"
    return "\n".join((table, *legend, "", counted, *lines, *_what_to_free(points)))


def _what_to_free(points: Sequence[Data]) -> list[str]:
    """Parameters that missed measurements ask to free, which chief reasons lack, with the number of fits."""
    lines = []
    for key, (meaning, _) in INFORMATIVE_MEASUREMENTS.items():
        asking = [
            point["id"]
            for point in points
            if any(f"free {key} as well" in reason["sentence"] for reason in point["verdict"]["reasons"])
        ]
        if asking:
            lines.append(
                f"in {len(asking)} of {len(points)} fits a measurement is missed that tells {meaning}, which "
                f"they do not vary: free {key} as well (--free)"
            )
    return lines


def _counted(points: Sequence[Data]) -> str:
    """Number of fits with each verdict, as text."""
    levels = [p["verdict"]["level"] for p in points]
    return ", ".join(f"{levels.count(level)} {level}" for level in Level)


# --- the page of a fit --------------------------------------------------------------------------------


def write_fit_page(folder: Path, content: Data, drawings: Path, case: Case | None = None) -> Path:
    """Write the page of a fit, or of a cohort's fits.

    Args:
        folder: folder of the page.
        content: data as in identification.json.
        drawings: folder with the figures as SVG; those that it lacks are left out.
        case: case of a single fit; None for a cohort.
    """
    drawn = {n: drawings / f"{n}.svg" for n in (COHORT if case is None else ONE_FIT)}
    svgs = {n: path.read_text(encoding="utf-8") for n, path in drawn.items() if path.exists()}
    text = cohort_page(content, svgs) if case is None else fit_page(content, case, svgs)
    write_text(text, folder / REPORT)
    return folder / REPORT


def fit_page(content: Data, case: Case, drawings: Mapping[str, str]) -> str:
    """Return the page of one fit; `drawings` are SVG texts by name."""
    (point,) = content["points"]
    verdict, posterior = point["verdict"], content.get("posterior")
    sentences = {good: [r["sentence"] for r in verdict["reasons"] if (r["level"] == Level.GOOD) is good]
                 for good in (True, False)}  # fmt: skip
    return render(
        "identification/fit.html",
        title=f"{point['id']}: fit to measurements",
        about=_about(case),
        headline=headline(verdict),
        level=verdict["level"],
        doubts=sentences[False],
        remarks=sentences[True],
        outputs=_outputs_table(point),
        brackets=BRACKETS if _has_open_outputs(point) else "",
        parameters=_parameters_table(point, posterior),
        undetermined=[
            f"{n}: {p['reason']}." for n, p in point["parameters"].items() if not p["identifiable"]
        ],
        correlated=_correlated(point["correlation"]),
        implied=_implied_table(point) if point["implied"] else None,
        warnings=point.get("warnings", ()),
        posterior=posterior,
        predictions=[(p, _prediction_table(p)) for p in posterior["predictions"]] if posterior else [],
        method=_method(content["settings"], point),
        drawings=drawings,
        captions=ONE_FIT,
    )


def _about(case: Case) -> str:
    """Text about the patient and every device with the keys of its section."""
    patient = case.patient
    lines = [f"{patient.sex}, {patient.age_years:g} years, {patient.heart_rate_bpm:g} beats/min"]
    for instance in case.instances():
        written = instance.section.model_dump(exclude_none=True, exclude_defaults=True)
        keys = (f"{key} {_written(value)}" for key, value in written.items())
        lines.append(
            f"{instance.device.name}{f' ({instance.name})' if instance.name else ''}: {', '.join(keys)}"
        )
    return ". ".join(lines) + "."


def _written(value: object) -> str:
    if isinstance(value, Mapping):
        return " ".join(f"{key} {_written(each)}" for key, each in value.items())
    return f"{value:g}" if isinstance(value, float) else str(value)


def _outputs_table(point: Data) -> Table:
    off, rows = differences_of(point), []
    for name, cell in point["outputs"].items():
        known = point["uncertainties"].get(name)
        measured = "not measured" if known is None else f"{number(cell['measured'])} ± {known:.2g}"
        apart = signed(off[name]) if name in off else ""
        fitted = number(cell["simulated"])
        fitted = fitted if cell.get("determined", True) else f"({fitted})"
        rows.append(
            (name, unit_of(name), measured, fitted, interval(cell.get("lower"), cell.get("upper")), apart)
        )
    measured, off = "measured ± standard uncertainty", "difference in standard uncertainties"
    head = ("output", "unit", measured, "fitted", "90 % interval", off)
    return Table(head, rows, numeric=(2, 3, 4, 5))


def _parameters_table(point: Data, posterior: Data | None) -> Table:
    after = {} if posterior is None else posterior["parameters"]
    head = ["parameter", "unit", "value", "90 % interval (Gaussian)"]
    profiled = any(p["profile"] for p in point["parameters"].values())
    head += ["by the profile likelihood"] * profiled + ["by the posterior"] * bool(after)
    rows = []
    for name, p in point["parameters"].items():
        known = quantity(name)
        label = name if known is None else f"{name}: {known.description}"
        row = [label, unit_of_parameter(name), number(p["value"])]
        low, high = p["profile"] or (None, None)
        row += [interval(p["lower"], p["upper"]), *[interval(low, high)] * profiled]
        if after:
            row.append(interval(after[name]["lower"], after[name]["upper"]) if name in after else "")
        rows.append([*row, "yes" if p["identifiable"] else "no"])
    return Table([*head, "determined"], rows, numeric=range(2, len(head)))


def _correlated(correlation: Mapping[str, Mapping[str, float | None]]) -> list[str]:
    names = list(correlation)
    return [
        f"{a} and {b} move together (correlation {correlation[a][b]:+.2f})."
        for k, a in enumerate(names)
        for b in names[:k]
        if abs(correlation[a][b] or 0.0) > CORRELATED
    ]


def _implied_table(point: Data) -> Table:
    flagged = {
        r["about"] for r in point["verdict"]["reasons"] if r["aspect"] == Aspect.PLAUSIBILITY and r["about"]
    }
    rows = []
    for name, cell in point["implied"].items():
        low, high = cell["healthy"]
        outside = "" if low <= cell["value"] <= high else "outside of health"
        measured = " (measured)" if name in point["uncertainties"] else ""
        rows.append(
            (f"{name}: {cell['words']}{measured}", cell["unit"], number(cell["value"], digits=3),
             interval(low, high), "implausible" if name in flagged else outside, cell["source"])
        )  # fmt: skip
    head = ("output", "unit", "fitted patient", "in health", "", "source of the range")
    return Table(head, rows, numeric=(2, 3))


def _prediction_table(prediction: Data) -> Table:
    rows = [
        (name, unit_of(name), number(o["median"]), interval(o["lower"], o["upper"]))
        for name, o in prediction["outputs"].items()
    ]
    return Table(("output", "unit", "median", "90 % interval"), rows, numeric=(2, 3))


def _method(settings: Data, point: Data | None = None) -> list[str]:
    lines = []
    if point is not None:
        count = point.get("explored_without_steady_gases", 0)
        without_gases = f", {count:,} without the steady gas state that is needed" if count else ""
        agree = f"{point['starts_agreeing']} of {point['starts_refined']} refined starts agree"
        lines += [
            f"Search: {point['message']} ({agree}; {point['explored']:,} sets of parameters explored, "
            f"{point['explored_without_steady_beat']:,} of them without a steady heartbeat, "
            f"{point['explored_one_of_many']:,} whose beat is one of many because valves stay shut"
            f"{without_gases}).",
            f"Sum of squared residuals: {number(point['cost'])}.",
        ]
    divided = "the measured value" if settings["weights"] == "relative" else "its standard uncertainty"
    policy = settings["blood_volume_policy"]
    volume = "that of each case" if policy is None else f"{POLICY_WORDS[policy]} ({policy})"
    return [
        *lines,
        f"Differences were divided by {divided}.",
        f"Free parameters: {', '.join(dict.fromkeys([*settings['parameters'], *settings['shared']]))}.",
        f"Blood volume: {volume}.",
        f"Seed {settings['seed']}.",
        "The 90 % intervals cover measurement error only, not what the model leaves out.",
    ]


def cohort_page(content: Data, drawings: Mapping[str, str]) -> str:
    """Return the page of a cohort's fits; `drawings` are SVG texts by name."""
    points = content["points"]
    rows = []
    for point in points:
        level, reasons = point["verdict"]["level"], point["verdict"]["reasons"]
        rows.append((point["id"], level, "" if level == Level.GOOD else reasons[0]["sentence"]))
    names = names_in(points, "parameters")
    head = ["data point", *map(axis_label, names)]
    return render(
        "identification/cohort.html",
        title=f"Fits of {len(points)} data points",
        counted=_counted(points),
        doubtful=any(level != Level.GOOD for _, level, _ in rows),
        refused=[r["message"] for r in content["refused"]],
        verdicts=Table(("data point", "verdict", "chief reason"), rows),
        parameters=Table(head, [[p["id"], *(_cell(p["parameters"].get(n)) for n in names)] for p in points]),
        r2=content["r2"],
        captions=COHORT,
        drawings=drawings,
        method=[*_method(content["settings"]), *_not_shared(content["settings"]["shared"], points)],
    )


def _not_shared(shared: Sequence[str], points: Sequence[Data]) -> Iterator[str]:
    """Patients whose points do not have the same value of a shared parameter."""
    for name in shared:
        values: dict[str, set[float | None]] = {}
        for point in points:
            values.setdefault(point["patient_id"], set()).add(point["parameters"][name]["value"])
        if several := [patient for patient, each in values.items() if len(each - {None}) > 1]:
            patients = ", ".join(several)
            yield f"{name} differs among the points of {patients}: points of the same circuit share it."


def _cell(parameter: Data | None) -> str:
    if parameter is None or parameter["value"] is None:
        return MISSING
    value = number(parameter["value"], digits=3)
    if not parameter["identifiable"]:
        return f"({value})"
    return f"{value}, {interval(parameter['lower'], parameter['upper'])}"
