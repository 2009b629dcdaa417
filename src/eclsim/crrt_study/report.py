"""The CRRT study for people: a page that a clinician can read, print and pass on; tables in the terminal."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from eclsim.crrt_study.beats import not_known
from eclsim.crrt_study.limits import KEPT_TO_THE_END, kept
from eclsim.crrt_study.one_housing import beside_schemes
from eclsim.crrt_study.ranking import choice, choice_elsewhere, place
from eclsim.devices.ecmo import POSITIONS
from eclsim.orbit.model import AS_PUBLISHED, POLICY_WORDS
from eclsim.reporting.html import Table, render, svg_text
from eclsim.reporting.numbers import number

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.crrt_study.study import CrrtStudy

PAGE = "crrt_study.html"
"""What the end of the name of a file with the page is."""
MEAN_COLUMNS = (
    ("Psart", "Arterial [mmHg]", 1),
    ("Ppart", "Pulm. artery [mmHg]", 1),
    ("Psvn", "Venous [mmHg]", 1),
    ("Pcrrttuin", "Access [mmHg]", 0),
    ("Pcrrttuout", "Return [mmHg]", 0),
    ("Pecmodrain", "Drainage [mmHg]", 0),
    ("PF", "ECMO flow [L/min]", 2),
    ("CO", "Native output [L/min]", 2),
    ("EDVRV", "RV EDV [mL]", 0),
    ("ESVRV", "RV ESV [mL]", 0),
)


def main_policy(study: CrrtStudy, policy: str | None) -> str:
    """The blood volume policy that a report is about: the one asked for, else the first studied.

    Raises:
        ValueError: If the study does not have it.
    """
    if policy is None:
        return study.policies[0]
    if policy not in study.policies:
        studied = ", ".join(study.policies)
        raise ValueError(f"blood volume policy '{policy}' was not studied; studied: {studied}")
    return policy


def study_page(study: CrrtStudy, drawings: Mapping[str, str], policy: str | None = None) -> str:
    """The page.

    Args:
        study: results.
        drawings: figures as SVG text, from `eclsim.crrt_study.report.drawings` for the same policy.
        policy: blood volume policy that answer, ranking and figures are for; left out, the first studied.
    """
    main = main_policy(study, policy)
    case, known = study.case, sum(r.known for r in study.ranking[main])
    nodes = {node for scheme in study.schemes for node in scheme.nodes}
    return render(
        "crrt_study/report.html",
        title=f"CRRT on ECMO: {case.patient.id}",
        patient=case.patient,
        ecmo=case.ecmo,
        case_speed=number(study.case_speed, 0),
        crrt_flow=f"{study.crrt_flow_ml_min:g}",
        schemes=study.schemes,
        speeds=study.means.sizes["speed"],
        answer=[*choice(study, main), *filter(None, [choice_elsewhere(study, main)])],
        not_known=not_known(study),
        known=known,
        ranking=_ranking_table(study, main),
        order=[criterion.sentence for criterion in study.rule.criteria],
        rule=study.rule.name,
        exchange=_exchange_tables(study, main),
        renox=_renox_tables(study, main),
        notes=[f"Scheme {scheme.letter}: {scheme.note}." for scheme in study.schemes if scheme.note],
        policy_means=[
            (POLICY_WORDS[r], _means_table(study, r)) for r in sorted(study.policies, key=lambda r: r != main)
        ],
        summary=_summary_table(study, main),
        beats_missing=int(study.summary["schemes_known"].sel(policy=main).min()) < len(study.schemes),
        limits=_limits_table(study, main),
        uncertainty=_uncertainty(study, main),
        volume=None if study.uptake is None else _volume_words(study, study.uptake),
        policies=[label for policy, label in POLICY_WORDS.items() if policy in study.policies],
        published_policy=AS_PUBLISHED in study.policies,
        assumed=study.assumed,
        lines_on_patient=not nodes <= set(POSITIONS.values()),
        gas="SaO2" in study.means,
        drawings=drawings,
        captions=_captions(study, main, known),
    )


def _captions(study: CrrtStudy, main: str, known: int) -> dict[str, str]:
    from eclsim.crrt_study.figures import MOST_DRAWN

    drawn = f" The {MOST_DRAWN} that rank best are drawn." if len(study.schemes) > MOST_DRAWN else ""
    result = "" if known == len(study.schemes) else " whose beat was found"
    policy = POLICY_WORDS[main]
    return {
        "schemes": (
            "The schemes. Blood flows from the drainage cannula (DC) through pump (P) and oxygenator (Oxy) "
            "to the return cannula (RC); access line solid with a dot, return line dashed with a square."
            + drawn
        ),
        "beat": f"Two beats of every scheme{result}; {policy}.",
        "speeds": f"Cycle means over the ECMO flow; {policy}.",
        "limits": f"ECMO flow at which each limit is reached; {policy}.",
        "uptake": "Arterial pressure under the blood volume policies, and its causes.",
    }


def _ranking_table(study: CrrtStudy, policy: str) -> Table:
    names = {s.letter: s.name for s in study.schemes}
    rows = [
        (
            place(r), r.letter, names[r.letter], kept(r.largest_flow, r.flow_at_most, r.throughout),
            r.decided_by or "–",
            "; ".join([r.why_no_rank] * bool(r.known and r.why_no_rank) + list(r.reasons)),
        )
        for r in study.ranking[policy]
    ]  # fmt: skip
    head = [
        "Rank",
        "Scheme",
        "Access – return",
        "Limits kept up to [L/min]",
        "Behind the one above by",
        "Why",
    ]
    return Table(head, rows, numeric=(0, 3))


EXCHANGE_COLUMNS = (
    (
        ("recirculated_fraction", "Recirculation [%]", 100.0, 0),
        ("past_oxygenator", "Blood past the oxygenator [%]", 100.0, 1),
    ),
    (
        ("effective_clearance_urea", "Urea cleared [mL/min]", 1.0, 1),
        ("effective_clearance_creatinine", "Creatinine [mL/min]", 1.0, 1),
        ("effective_clearance_potassium", "Potassium [mL/min]", 1.0, 1),
        ("filtration_fraction", "Filtration fraction [%]", 100.0, 0),
        ("effluent_pressure", "Effluent pressure [mmHg]", 1.0, 0),
    ),
    (
        ("SreturnO2", "SO2 from the ECMO [%]", 1.0, 1),
        ("PreturnCO2", "PCO2 from the ECMO [mmHg]", 1.0, 1),
        ("SaO2", "SaO2 [%]", 1.0, 1),
        ("PaCO2", "PaCO2 [mmHg]", 1.0, 1),
    ),
)
"""What the CRRT does to the blood, a table each: name, head, factor and decimals, of what a study has."""


def _exchange_tables(study: CrrtStudy, policy: str) -> list[Table]:
    """Ways of the blood, clearances (recirculation taken off) and gases, as far as the study has them."""
    means = study.means.sel(policy=policy, speed=study.case_speed)
    tables = []
    for order, group in enumerate(EXCHANGE_COLUMNS):
        columns = [column for column in group if column[0] in means]
        if order and not columns:
            continue
        rows = []
        for ranked in study.ranking[policy]:
            of_scheme = means.sel(scheme=ranked.letter)
            before = "before" if of_scheme["return_site"].item() in POSITIONS else "on the patient"
            where = "behind" if bool(of_scheme["behind_oxygenator"]) else before
            numbers = (number(factor * float(of_scheme[name]), digits) for name, _, factor, digits in columns)
            rows.append([ranked.letter, where, *numbers])
        head = ["Scheme", "Returns: oxygenator", *(title for _, title, _, _ in columns)]
        tables.append(Table(head, rows, numeric=range(2, len(head))))
    return tables


RENOX_COLUMNS = (
    (
        ("access_mmhg", "Access [mmHg]", 1.0, 0), ("return_mmhg", "Return [mmHg]", 1.0, 0),
        ("blood_taken_up_ml", "Blood taken up [mL]", 1.0, 0),
        ("effluent_pressure_mmhg", "Effluent pressure [mmHg]", 1.0, 0),
        ("open_effluent_l_h", "Filtered with an open effluent [L/h]", 1.0, 1),
    ),
    (
        ("urea_ml_min", "Urea cleared [mL/min]", 1.0, 1),
        ("filtration_fraction", "Filtration fraction [%]", 100.0, 1), ("SaO2", "SaO2 [%]", 1.0, 1),
        ("PaCO2", "PaCO2 [mmHg]", 1.0, 1),
    ),
)  # fmt: skip
"""What is set beside RenOx, a table each that fits a page: key, head, factor and decimals."""
KEPT_WORDS = {True: "kept", False: "broken", None: "not known"}


def _renox_tables(study: CrrtStudy, policy: str) -> list[Table]:
    """One housing for oxygenator and dialyzer against every scheme, at the case's speed."""
    compared = beside_schemes(study, policy)
    return [
        _beside(compared, [c for c in group if c[0] in compared["RenOx"]])
        for group in RENOX_COLUMNS
        if compared
    ]


def _beside(
    compared: Mapping[str, Mapping[str, float | bool | None]], columns: Sequence[tuple[str, str, float, int]]
) -> Table:
    rows = []
    for name, values in compared.items():
        cells = [values.get(key) for key, *_ in columns]
        shown = (
            "none"
            if cell is None and name == "RenOx"
            else number(np.nan if cell is None else factor * cell, digits)
            for cell, (_, _, factor, digits) in zip(cells, columns, strict=True)
        )
        alarms = "no lines" if name == "RenOx" else KEPT_WORDS[values["alarms_kept"]]  # type: ignore[index]
        rows.append([name, alarms, *shown])
    head = ["", "Alarms of the lines", *(title for _, title, _, _ in columns)]
    return Table(head, rows, numeric=range(2, len(head)))


def _means_table(study: CrrtStudy, policy: str) -> Table:
    means = study.means.sel(policy=policy, speed=study.case_speed)
    alone = study.without_crrt.sel(policy=policy, speed=study.case_speed)
    summary = study.summary.sel(policy=policy, speed=study.case_speed)
    rows = []
    for letter in means["scheme"].values.astype(str):
        rows.append([letter, *(number(float(means[n].sel(scheme=letter)), d) for n, _, d in MEAN_COLUMNS)])
    rows.append(["no CRRT", *(number(float(alone[n]), d) if n in alone else "" for n, _, d in MEAN_COLUMNS)])
    of = _of_schemes(study, summary)
    rows.append([f"median{of}", *(number(float(summary[f"{n}_median"]), d) for n, _, d in MEAN_COLUMNS)])
    rows.append(
        [f"variation{of}", *(number(float(summary[f"{n}_variation"]), d) for n, _, d in MEAN_COLUMNS)]
    )
    rows.append(
        ["variation [%]", *(number(float(summary[f"{n}_variation_percent"]), 1) for n, _, _ in MEAN_COLUMNS)]
    )
    head = ["Scheme", *(title for _, title, _ in MEAN_COLUMNS)]
    return Table(head, rows, numeric=range(1, len(head)), foot=3)


def _of_schemes(study: CrrtStudy, summary: xr.Dataset) -> str:
    """Of how many schemes a median is; empty if of all."""
    known, total = int(summary["schemes_known"]), len(study.schemes)
    return "" if known == total else f" of {known} of {total}"


def _summary_table(study: CrrtStudy, policy: str) -> Table:
    """Medians and variations over the schemes at a handful of speeds."""
    speeds = study.means["speed"].values
    step = math.ceil(len(speeds) / 8)
    shown = sorted({*speeds[::step], speeds[-1]})
    names = ("PF", "Psart", "Ppart", "Psvn", "Pecmodrain", "Pcrrttuin", "Pcrrttuout")
    titles = {n: w for n, w, _ in MEAN_COLUMNS}
    rows = []
    for speed in shown:
        data = study.summary.sel(policy=policy, speed=speed)
        cells = [
            f"{number(float(data[f'{n}_median']), 1)} ± {number(0.5 * float(data[f'{n}_variation']), 1)}"
            for n in names
        ]
        order = f"{data['Psart_highest'].item()} / {data['Psart_lowest'].item()}"
        rows.append([f"{speed:.0f}{_of_schemes(study, data)}", *cells, order if order != " / " else "–"])
    head = ["Speed [rpm]", *(titles[n] for n in names), "Highest / lowest arterial"]
    return Table(head, rows, numeric=range(len(head) - 1))


def _limits_table(study: CrrtStudy, policy: str) -> Table:
    limits = study.limits.sel(policy=policy)
    rows = []
    for ranked in study.ranking[policy]:
        cells = []
        for name in ("access_alarm", "return_alarm", "access_190", "suction", "crrt"):
            data = limits.sel(scheme=ranked.letter, limit=name)
            to_the_end = data["state"].item() == KEPT_TO_THE_END
            cells.append(kept(float(data["largest_flow"]), float(data["flow_at_most"]), to_the_end))
        rows.append(
            [
                ranked.letter,
                *cells,
                number(float(limits["margin"].sel(scheme=ranked.letter, limit="crrt")), 0),
            ]
        )
    bounds = {limit.name: (f"{limit.low:g}", f"{limit.high:g}") for limit in study.rule.limits}
    head = [
        "Scheme",
        f"Access alarms {' to '.join(bounds['access_alarm'])} mmHg",
        f"Return alarms {' to '.join(bounds['return_alarm'])} mmHg",
        f"Access ≤ {bounds['access_190'][1]} mmHg",
        f"Drainage ≥ {bounds['suction'][0]} mmHg",
        "All of the CRRT lines",
        "Margin at this speed [mmHg]",
    ]
    return Table([h.replace("-", "−") for h in head], rows, numeric=range(1, len(head)))


def _uncertainty(study: CrrtStudy, policy: str) -> dict[str, object] | None:
    result = study.uncertainty
    if result is None:
        return None
    rows = []
    for ranked in study.ranking[policy]:
        data = result.sel(scheme=ranked.letter)
        spread = []
        for name in ("Psart", "Pcrrttuin", "Pcrrttuout"):
            low, middle, high = (number(v, 0) for v in data[f"{name}_quantiles"].values.tolist())
            spread.append(f"{middle} ({low} to {high})")
        shares = [_share(data.sel(limit=k)) for k in ("access_alarm", "return_alarm", "access_190", "crrt")]
        rows.append([ranked.letter, f"{percent(float(data['settled']))} %", *spread, *shares])
    high = next(limit.high for limit in study.rule.limits if limit.name == "access_190")
    head = ["Scheme", "Beat found in", "Arterial [mmHg]", "Access [mmHg]", "Return [mmHg]"]
    head += ["Access alarms kept", "Return alarms kept", f"Access ≤ {high:g} mmHg", "All of the CRRT lines"]
    return {
        "samples": result.attrs["samples"],
        "policy": POLICY_WORDS[result.attrs["blood_volume_policy"]],
        "table": Table(head, rows, numeric=range(1, len(head))),
    }


def _share(data: xr.Dataset) -> str:
    """Share of the samples in which a limit is kept; a range where some have no beat."""
    low, high = (percent(float(data[f"probability_at_{word}"])) for word in ("least", "most"))
    return f"{low} %" if low == high else f"{low} to {high} %"


def percent(share: float) -> str:
    """A share in whole percent; 0 and 100 only where it is none and all."""
    if 0.0 < share < 0.005:
        return "< 1"
    return "> 99" if 0.995 <= share < 1.0 else number(100.0 * share, 0)


def _volume_words(study: CrrtStudy, uptake: xr.Dataset) -> list[str]:
    volumes, total, flow = (
        values[np.isfinite(values)]
        for values in (uptake["blood_taken_up"].values, *(abs(uptake[f"Psart_{w}"].values) for w in _PARTS))
    )
    if not len(volumes):
        return ["Not known: no steady beat of the patient without CRRT, or of any scheme, was found"]
    of = f", of the {len(volumes)} of {len(study.schemes)} schemes whose beat was found"
    lines = [
        f"The CRRT tubing takes up {number(volumes.min(), 0)} to {number(volumes.max(), 0)} mL of blood"
        + (of if len(volumes) < len(study.schemes) else "")
    ]
    if len(flow) < len(study.schemes):
        result = f"known for {len(flow)} of {len(study.schemes)} schemes"
        lines.append(f"What is left with the patient's blood volume kept is {result}; a beat was not found.")
    if len(flow):
        lines.append(
            f"As published, schemes change the mean arterial pressure by up to {total.max():.1f} mmHg. "
            f"With the patient's blood volume kept, what is left is at most {flow.max():.1f} mmHg. A circuit "
            "that is primed, or a patient who is given that volume, does not show the difference."
        )
    return lines


_PARTS = ("difference", "flow")


# --- figures of the page --------------------------------------------------------------------------


def drawings(study: CrrtStudy, policy: str | None = None) -> dict[str, str]:
    """All figures by name.

    Args:
        study: results.
        policy: blood volume policy of the figures that show one; left out, the first studied.
    """
    from eclsim.crrt_study.figures import (
        draw_schemes,
        plot_crrt_beat,
        plot_crrt_limits,
        plot_crrt_speeds,
        plot_crrt_uptake,
    )

    policy, speed = main_policy(study, policy), study.case_speed
    means = study.means.sel(policy=policy)
    ranked, judged = study.ranking[policy], study.rule.limits
    best_first = [r.letter for r in ranked]
    flow = float(study.without_crrt["PF"].sel(policy=policy, speed=speed))
    figures = {
        "schemes": draw_schemes(study.schemes, {r.letter: place(r) for r in ranked}),
        "beat": plot_crrt_beat(study.waveforms.sel(policy=policy), means.sel(speed=speed), judged),
        "speeds": plot_crrt_speeds(means, speed, judged),
        "limits": plot_crrt_limits(study.limits.sel(policy=policy), flow, best_first, judged),
    }
    if study.uptake is not None:
        figures["uptake"] = plot_crrt_uptake(
            study.uptake, study.means.sel(speed=speed), study.without_crrt.sel(speed=speed)
        )
    return {name: svg_text(drawing) for name, drawing in figures.items()}


# --- terminal -------------------------------------------------------------------------------------


_WIDTH_OF_PIPES = 140
_COLUMNS = (
    ("Psart", "arterial\nmmHg", 1),
    ("Psvn", "venous\nmmHg", 1),
    ("Pcrrttuin", "access\nmmHg", 0),
    ("Pcrrttuout", "return\nmmHg", 0),
    ("Pecmodrain", "drainage\nmmHg", 0),
    ("PF", "ECMO\nL/min", 2),
    ("patient_volume_change", "blood volume\nmL", 0),
)


def show(study: CrrtStudy) -> None:
    """Show the schemes, best first, for each blood volume policy."""
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if sys.stdout.isatty() else _WIDTH_OF_PIPES, highlight=False)
    names = {scheme.letter: scheme.name for scheme in study.schemes}
    for policy, ranked in study.ranking.items():
        known = sum(r.known for r in ranked)
        among = "" if known == len(ranked) else f"; ranked: the {known} of {len(ranked)} whose beat was found"
        title = f"CRRT schemes at {study.case_speed:.0f} rpm, {POLICY_WORDS[policy]}{among}"
        table = Table(title=title, title_justify="left", box=None, pad_edge=False)
        for head in ("rank", "scheme", "access – return"):
            table.add_column(head)
        for _, head, _ in _COLUMNS:
            table.add_column(head, justify="right")
        table.add_column("limits kept\nto L/min", justify="right")
        means = study.means.sel(policy=policy, speed=study.case_speed)
        for r in ranked:
            cells = [number(float(means[name].sel(scheme=r.letter)), digits) for name, _, digits in _COLUMNS]
            flow = kept(r.largest_flow, r.flow_at_most, r.throughout)
            table.add_row(place(r), r.letter, names[r.letter], *cells, flow)
        console.print(table)
        console.print("\n  ".join(choice(study, policy)) + "\n", markup=False)
    for sentence in study.assumed:
        console.print(f"{sentence[0].upper()}{sentence[1:]}", markup=False)
