"""Fits as a page: the verdict, measured against fitted, parameters and what cannot be told apart, figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eclsim.files import write_text
from eclsim.identification.verdict import Aspect, Level, headline, signed
from eclsim.orbit.model import POLICY_WORDS
from eclsim.parameters import thiel2025
from eclsim.reporting.html import box, bullets, figure, heading, page, paragraph, table

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
    title = f"{point['id']}: fit to measurements"
    return page(
        title, [heading(title, 1), paragraph(_who(case), "lead"), *_one_fit(content, point, drawings)]
    )


def _one_fit(
    content: Mapping[str, Any], point: Mapping[str, Any], drawings: Mapping[str, str]
) -> Iterator[str]:
    yield _verdict_box(point["verdict"])
    yield from _remarks(point["verdict"])
    yield heading("Measured and fitted")
    yield _outputs_table(point)
    yield from _drawn(drawings, "residuals")
    yield heading("Parameters, and how far they are determined")
    yield _parameters_table(point, content.get("posterior"))
    yield from _drawn(drawings, "profiles")
    yield heading("What cannot be told apart")
    yield from _not_told_apart(point)
    yield from _drawn(drawings, "correlation")
    if point["implied"]:
        yield heading("The fitted patient")
        yield from _implied(point)
    if "posterior" in content:
        yield from _posterior(content["posterior"])
    yield heading("How it was found")
    yield bullets(_how(content["settings"], point))
    yield from _drawn(drawings, "starts")
    yield from _drawn(drawings, "slices")


def _who(case: Case) -> str:
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


def _verdict_box(verdict: Mapping[str, Any]) -> str:
    doubts = [r["sentence"] for r in verdict["reasons"] if r["level"] != Level.GOOD]
    return box([headline(verdict), *doubts], warn=verdict["level"] != Level.GOOD)


def _remarks(verdict: Mapping[str, Any]) -> Iterator[str]:
    remarks = [r["sentence"] for r in verdict["reasons"] if r["level"] == Level.GOOD]
    if remarks:
        yield bullets(remarks)


def _drawn(drawings: Mapping[str, str], name: str, captions: Mapping[str, str] = ONE_FIT) -> Iterator[str]:
    if name in drawings:
        yield figure(drawings[name], captions[name], name)


def _outputs_table(point: Mapping[str, Any]) -> str:
    goodness = point["verdict"]["goodness"]
    off = {} if goodness is None else goodness["differences"]
    rows = []
    for name, cell in point["outputs"].items():
        known = point["uncertainties"].get(name)
        measured = "not measured" if known is None else f"{cell['measured']:.4g} ± {known:.2g}"
        apart = signed(off[name]) if name in off else ""
        rows.append((name, "L/min" if name in FLOWS else "mmHg", measured, _number(cell["simulated"]), apart))
    head = (
        "output",
        "unit",
        "measured ± standard uncertainty",
        "fitted",
        "difference in standard uncertainties",
    )
    return table(head, rows, numeric=(2, 3, 4))


def _parameters_table(point: Mapping[str, Any], posterior: Mapping[str, Any] | None) -> str:
    after = {} if posterior is None else posterior["parameters"]
    head = ["parameter", "unit", "value", "90 % interval (Gaussian)"]
    profiled = any(p["profile"] for p in point["parameters"].values())
    head += ["by the profile likelihood"] * profiled + ["by the posterior"] * bool(after)
    rows = []
    for name, p in point["parameters"].items():
        known = thiel2025.PARAMETERS[name]
        row = [f"{name}: {known.description}", known.unit, _number(p["value"])]
        row.append(_interval(p["lower"], p["upper"]))
        row += [_interval(*(p["profile"] or (None, None)))] * profiled
        if after:
            row.append(_interval(after[name]["lower"], after[name]["upper"]) if name in after else "")
        rows.append([*row, "yes" if p["identifiable"] else "no"])
    return table([*head, "determined"], rows, numeric=range(2, len(head)))


def _not_told_apart(point: Mapping[str, Any]) -> Iterator[str]:
    reasons = [f"{n}: {p['reason']}." for n, p in point["parameters"].items() if not p["identifiable"]]
    names = list(point["correlation"])
    pairs = [
        f"{a} and {b} move together (correlation {point['correlation'][a][b]:+.2f})."
        for k, a in enumerate(names)
        for b in names[:k]
        if abs(point["correlation"][a][b] or 0.0) > CORRELATED
    ]
    if reasons and point["verdict"]["level"] != Level.POOR:
        yield paragraph(
            "These have a value in the fitted case, but it is one of many that fit as well: do not read them "
            "off it."
        )
    yield bullets([*reasons, *pairs]) if reasons or pairs else paragraph("All parameters are told apart.")


def _implied(point: Mapping[str, Any]) -> Iterator[str]:
    flagged = {
        r["about"] for r in point["verdict"]["reasons"] if r["aspect"] == Aspect.PLAUSIBILITY and r["about"]
    }
    rows = []
    for name, cell in point["implied"].items():
        low, high = cell["healthy"]
        inside = low <= cell["value"] <= high
        said = "implausible" if name in flagged else "" if inside else "outside of health"
        measured = " (measured)" if name in point["uncertainties"] else ""
        rows.append(
            (f"{name}: {cell['words']}{measured}", cell["unit"], _number(cell["value"], 3),
             f"{low:.3g} to {high:.3g}", said, cell["source"])
        )  # fmt: skip
    yield paragraph(
        "Volumes and pressures of the fitted patient. What was not measured follows from the model alone; an "
        "ill patient is often outside the range of health. On V-A ECMO the model's right ventricle empties "
        "almost completely: do not read it."
    )
    yield table(
        ("output", "unit", "fitted patient", "in health", "", "source of the range"), rows, numeric=(2, 3)
    )


def _posterior(posterior: Mapping[str, Any]) -> Iterator[str]:
    yield heading("Outputs with 90 % intervals")
    if posterior["verdict"]:
        yield box(
            [f"The draws behind these intervals: {posterior['verdict']}", *posterior["doubts"]], warn=True
        )
    yield paragraph(f"Medians and 90 % intervals: {posterior['kind']}, prior {posterior['prior']}.")
    for prediction in posterior["predictions"]:
        rows = [
            (
                name,
                "L/min" if name in FLOWS else "mmHg",
                _number(o["median"]),
                _interval(o["lower"], o["upper"]),
            )
            for name, o in prediction["outputs"].items()
        ]
        yield heading(prediction["settings"], 3)
        yield table(("output", "unit", "median", "90 % interval"), rows, numeric=(2, 3))
        if prediction["without_steady_beat"] > 0.0:
            share = 100.0 * prediction["without_steady_beat"]
            yield paragraph(f"{share:.1f} % of the draws have no steady heartbeat there and are not counted.")
        more = [doubt for doubt in prediction["doubts"] if doubt not in posterior["doubts"]]
        if more:
            yield bullets(more)


def _how(settings: Mapping[str, Any], point: Mapping[str, Any] | None = None) -> list[str]:
    said = []
    if point is not None:
        agree = f"{point['starts_agreeing']} of {point['starts_refined']} refined starts agree"
        said += [
            f"Search: {point['message']} ({agree}; {point['explored']:,} sets of parameters explored, "
            f"{point['explored_without_steady_beat']:,} of them without a steady heartbeat).",
            f"Sum of squared residuals: {_number(point['cost'])}.",
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
    title = f"Fits of {len(content['points'])} data points"
    return page(title, [heading(title, 1), *_cohort(content, drawings)])


def _cohort(content: Mapping[str, Any], drawings: Mapping[str, str]) -> Iterator[str]:
    points = content["points"]
    levels = [p["verdict"]["level"] for p in points]
    counted = ", ".join(f"{levels.count(level)} {level}" for level in Level)
    refused = [f"{len(content['refused'])} rows were refused."] if content["refused"] else []
    yield box([f"{counted}.", *refused], warn=bool(refused) or set(levels) != {Level.GOOD})
    yield heading("Verdicts")
    rows = [
        (p["id"], p["verdict"]["level"], "" if p["verdict"]["level"] == Level.GOOD else _first_reason(p))
        for p in points
    ]
    yield table(("data point", "verdict", "chief reason"), rows)
    yield heading("Parameters")
    yield paragraph(
        "Values with 90 % intervals. In brackets: not determined by the measurements of this point."
    )
    names = list(dict.fromkeys(n for p in points for n in p["parameters"]))
    units = [thiel2025.PARAMETERS[n].unit for n in names]
    cells = [[p["id"], *(_cell(p["parameters"].get(n)) for n in names)] for p in points]
    yield table(["data point", *(f"{n} [{u}]" for n, u in zip(names, units, strict=True))], cells)
    yield heading("Measured and fitted")
    for kind, value in content["r2"].items():
        if value is not None:
            yield paragraph(f"R² of {kind}: {value:.4f} over all fits, the poor ones included.")
    for name in COHORT:
        yield from _drawn(drawings, name, COHORT)
    if content["refused"]:
        yield heading("Refused rows")
        yield bullets(r["message"] for r in content["refused"])
    yield heading("How it was found")
    yield bullets(_how(content["settings"]))


def _first_reason(point: Mapping[str, Any]) -> str:
    return point["verdict"]["reasons"][0]["sentence"]


def _cell(parameter: Mapping[str, Any] | None) -> str:
    if parameter is None or parameter["value"] is None:
        return "-"
    shown = f"{parameter['value']:.3g}"
    if not parameter["identifiable"]:
        return f"({shown})"
    return f"{shown}, {_interval(parameter['lower'], parameter['upper'])}"


def _interval(lower: float | None, upper: float | None) -> str:
    return "" if lower is None or upper is None else f"{lower:.3g} to {upper:.3g}"


def _number(value: float | None, digits: int = 4) -> str:
    return "-" if value is None else f"{value:.{digits}g}"
