"""Fits as a page: the verdict, measured against fitted, parameters and what cannot be told apart, figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eclsim.files import write_text
from eclsim.identification.verdict import Aspect, Level, headline, signed
from eclsim.orbit.model import POLICY_WORDS
from eclsim.parameters import thiel2025
from eclsim.reporting.html import Table, render
from eclsim.reporting.numbers import MISSING, interval, number

if TYPE_CHECKING:
    from eclsim.cases.case import Case

REPORT = "report.html"
FLOWS = ("CO", "PF")
CORRELATED = 0.9
"""Two estimates with a larger correlation, of either sign, move together."""
ONE_FIT = {
    "residuals": (
        "Differences from the measurements, in standard uncertainties. Beyond the dashed lines a fit is "
        "doubtful, beyond the solid ones it is poor."
    ),
    "profiles": (
        "How far each parameter can move. Chi-square with the others fitted again (dots) and held (grey); "
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


def write_fit_page(
    folder: Path, content: Mapping[str, Any], case: Case | None = None, drawings: Path | None = None
) -> Path:
    """Write the page of a fit, or of a cohort's fits.

    Args:
        folder: for the page.
        content: as in identification.json.
        case: of a single fit; None for a cohort.
        drawings: folder with the figures as SVG; None without.
    """
    captions = COHORT if case is None else ONE_FIT
    drawn = {} if drawings is None else {n: drawings / f"{n}.svg" for n in captions}
    svgs = {n: path.read_text(encoding="utf-8") for n, path in drawn.items() if path.exists()}
    text = cohort_page(content, svgs) if case is None else fit_page(content, case, svgs)
    write_text(text, folder / REPORT)
    return folder / REPORT


def fit_page(content: Mapping[str, Any], case: Case, drawings: Mapping[str, str]) -> str:
    """The page of one fit; `drawings` are SVG texts by name."""
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
        parameters=_parameters_table(point, posterior),
        undetermined=[
            f"{n}: {p['reason']}." for n, p in point["parameters"].items() if not p["identifiable"]
        ],
        correlated=_correlated(point["correlation"]),
        implied=_implied_table(point) if point["implied"] else None,
        posterior=posterior,
        predictions=[(p, _prediction_table(p)) for p in posterior["predictions"]] if posterior else [],
        method=_method(content["settings"], point),
        drawings=drawings,
        captions=ONE_FIT,
    )


def _about(case: Case) -> str:
    patient, ecmo, lvad, crrt = case.patient, case.ecmo, case.lvad, case.crrt
    said = [f"{patient.sex}, {patient.age_years:g} years, {patient.heart_rate_bpm:g} beats/min"]
    if ecmo is not None:
        speed = "" if ecmo.speed_rpm is None else f" at {ecmo.speed_rpm:.0f} rpm"
        pump = ecmo.pump if isinstance(ecmo.pump, str) else "roller pump"
        said.append(
            f"ECMO: {pump}{speed}, {ecmo.oxygenator}, from {ecmo.drainage_site} to {ecmo.return_site}"
        )
    if lvad is not None:
        said.append(f"LVAD: {lvad.pump} at {lvad.speed_rpm:.0f} rpm")
    if crrt is not None:
        said.append(f"CRRT: {crrt.flow_ml_min:g} mL/min, from {crrt.access_site} to {crrt.return_site}")
    return ". ".join(said) + "."


def _outputs_table(point: Mapping[str, Any]) -> Table:
    goodness = point["verdict"]["goodness"]
    off = {} if goodness is None else goodness["differences"]
    rows = []
    for name, cell in point["outputs"].items():
        known = point["uncertainties"].get(name)
        measured = "not measured" if known is None else f"{cell['measured']:.4g} ± {known:.2g}"
        apart = signed(off[name]) if name in off else ""
        rows.append((name, _unit(name), measured, number(cell["simulated"]), apart))
    head = (
        "output",
        "unit",
        "measured ± standard uncertainty",
        "fitted",
        "difference in standard uncertainties",
    )
    return Table(head, rows, numeric=(2, 3, 4))


def _parameters_table(point: Mapping[str, Any], posterior: Mapping[str, Any] | None) -> Table:
    after = {} if posterior is None else posterior["parameters"]
    head = ["parameter", "unit", "value", "90 % interval (Gaussian)"]
    profiled = any(p["profile"] for p in point["parameters"].values())
    head += ["by the profile likelihood"] * profiled + ["by the posterior"] * bool(after)
    rows = []
    for name, p in point["parameters"].items():
        known = thiel2025.PARAMETERS[name]
        row = [f"{name}: {known.description}", known.unit, number(p["value"])]
        row.append(interval(p["lower"], p["upper"]))
        low, high = p["profile"] or (None, None)
        row += [interval(low, high)] * profiled
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


def _implied_table(point: Mapping[str, Any]) -> Table:
    flagged = {
        r["about"] for r in point["verdict"]["reasons"] if r["aspect"] == Aspect.PLAUSIBILITY and r["about"]
    }
    rows = []
    for name, cell in point["implied"].items():
        low, high = cell["healthy"]
        inside = low <= cell["value"] <= high
        remark = "implausible" if name in flagged else "" if inside else "outside of health"
        measured = " (measured)" if name in point["uncertainties"] else ""
        rows.append(
            (f"{name}: {cell['words']}{measured}", cell["unit"], number(cell["value"], digits=3),
             interval(low, high), remark, cell["source"])
        )  # fmt: skip
    head = ("output", "unit", "fitted patient", "in health", "", "source of the range")
    return Table(head, rows, numeric=(2, 3))


def _prediction_table(prediction: Mapping[str, Any]) -> Table:
    rows = [
        (name, _unit(name), number(o["median"]), interval(o["lower"], o["upper"]))
        for name, o in prediction["outputs"].items()
    ]
    return Table(("output", "unit", "median", "90 % interval"), rows, numeric=(2, 3))


def _unit(output: str) -> str:
    return "L/min" if output in FLOWS else "mmHg"


def _method(settings: Mapping[str, Any], point: Mapping[str, Any] | None = None) -> list[str]:
    said = []
    if point is not None:
        agree = f"{point['starts_agreeing']} of {point['starts_refined']} refined starts agree"
        said += [
            f"Search: {point['message']} ({agree}; {point['explored']:,} sets of parameters explored, "
            f"{point['explored_without_steady_beat']:,} of them without a steady heartbeat).",
            f"Sum of squared residuals: {number(point['cost'])}.",
        ]
    divided = "the measured value" if settings["weights"] == "relative" else "its standard uncertainty"
    policy = settings["blood_volume_policy"]
    volume = "that of each case" if policy is None else f"{POLICY_WORDS[policy]} ({policy})"
    said += [
        f"Differences were divided by {divided}.",
        f"Free parameters: {', '.join(dict.fromkeys([*settings['parameters'], *settings['shared']]))}.",
        f"Blood volume: {volume}.",
        f"Seed {settings['seed']}.",
        "The 90 % intervals speak of measurement error alone, not of what the model leaves out.",
    ]
    return said


def cohort_page(content: Mapping[str, Any], drawings: Mapping[str, str]) -> str:
    """The page of a cohort's fits; `drawings` are SVG texts by name."""
    points = content["points"]
    levels = [p["verdict"]["level"] for p in points]
    return render(
        "identification/cohort.html",
        title=f"Fits of {len(points)} data points",
        counted=", ".join(f"{levels.count(level)} {level}" for level in Level),
        doubtful=set(levels) != {Level.GOOD},
        refused=[r["message"] for r in content["refused"]],
        verdicts=_verdicts_table(points),
        parameters=_cohort_parameters_table(points),
        r2=content["r2"],
        captions=COHORT,
        drawings=drawings,
        method=_method(content["settings"]),
    )


def _verdicts_table(points: Sequence[Mapping[str, Any]]) -> Table:
    rows = []
    for point in points:
        level, reasons = point["verdict"]["level"], point["verdict"]["reasons"]
        rows.append((point["id"], level, "" if level == Level.GOOD else reasons[0]["sentence"]))
    return Table(("data point", "verdict", "chief reason"), rows)


def _cohort_parameters_table(points: Sequence[Mapping[str, Any]]) -> Table:
    names = list(dict.fromkeys(n for p in points for n in p["parameters"]))
    units = [thiel2025.PARAMETERS[n].unit for n in names]
    rows = [[p["id"], *(_cell(p["parameters"].get(n)) for n in names)] for p in points]
    return Table(["data point", *(f"{n} [{u}]" for n, u in zip(names, units, strict=True))], rows)


def _cell(parameter: Mapping[str, Any] | None) -> str:
    if parameter is None or parameter["value"] is None:
        return MISSING
    value = number(parameter["value"], digits=3)
    if not parameter["identifiable"]:
        return f"({value})"
    return f"{value}, {interval(parameter['lower'], parameter['upper'])}"
