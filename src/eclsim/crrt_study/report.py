"""Report of the CRRT study: a printable page for clinicians, and tables in the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eclsim.cases.fit_mark import untrusted
from eclsim.crrt_study.assumptions import assumptions_in_words
from eclsim.crrt_study.beats import missing_beats_text
from eclsim.crrt_study.limits import CRRT_LIMITS, KEPT_TO_THE_END, limit_flow_text
from eclsim.crrt_study.ranking import choice_in_other_policy, choice_text, place
from eclsim.crrt_study.renox import compared_with_schemes
from eclsim.crrt_study.study import CrrtStudy
from eclsim.devices.ecmo import POSITIONS
from eclsim.orbit.model import POLICY_WORDS
from eclsim.patient.sites import AFTER_LUNGS
from eclsim.reporting.html import Table, render, svg_text
from eclsim.reporting.numbers import number, show_table, show_text

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.crrt_study.limits import Limit

PAGE = "crrt_study.html"
"""End of the file name of the page."""


class Column(NamedTuple):
    """A column of numbers: variable of the study, header, decimals, and factor."""

    name: str
    head: str
    decimals: int = 0
    factor: float = 1.0

    def cell(self, value: float | xr.DataArray) -> str:
        """A number as text."""
        return number(self.factor * float(value), self.decimals)


MEAN_COLUMNS = (
    Column("Psart", "Arterial [mmHg]", 1), Column("Ppart", "Pulm. artery [mmHg]", 1),
    Column("Psvn", "Venous [mmHg]", 1), Column("Pcrrttuin", "Access [mmHg]"),
    Column("Pcrrttuout", "Return [mmHg]"), Column("Pecmodrain", "Drainage [mmHg]"),
    Column("PF", "ECMO flow [L/min]", 2), Column("CO", "Native output [L/min]", 2),
    Column("EDVRV", "RV EDV [mL]"), Column("ESVRV", "RV ESV [mL]"),
)  # fmt: skip


def _cells(data: Mapping[Any, Any], columns: Sequence[Column], suffix: str = "", none: str = "") -> list[str]:
    """Numbers of a row as text; `none` if the data lack them."""
    values = [data.get(column.name + suffix) for column in columns]
    return [none if v is None else c.cell(v) for c, v in zip(columns, values, strict=True)]


def _table(heads: Sequence[str], columns: Sequence[Column], rows: list[list[str]], foot: int = 0) -> Table:
    """Return a table with text columns followed by number columns."""
    numeric = range(len(heads), len(heads) + len(columns))
    return Table([*heads, *(column.head for column in columns)], rows, numeric, foot)


def _tables(
    heads: Sequence[str],
    groups: Sequence[Sequence[Column]],
    rows: Sequence[tuple[list[str], Mapping[Any, Any], str]],
) -> list[Table]:
    """Return a table for each group of columns that the first row has, and always for the first group.

    Each row has its texts, its data by column name, and the text for missing numbers.
    """
    known = rows[0][1] if rows else {}
    chosen = [[column for column in group if column.name in known] for group in groups if rows]
    return [
        _table(heads, columns, [[*texts, *_cells(data, columns, none=none)] for texts, data, none in rows])
        for k, columns in enumerate(chosen)
        if columns or k == 0
    ]


def study_page(study: CrrtStudy, drawings: Mapping[str, str]) -> str:
    """Return the page; answer, ranking and figures (SVG text by name) are for the first policy studied."""
    main = study.policies[0]
    case, known = study.case, sum(r.known for r in study.ranking[main])
    return render(
        "crrt_study/report.html",
        title=f"CRRT on ECMO: {case.patient.id}",
        patient=case.patient,
        ecmo=case.ecmo,
        case_speed=number(study.case_speed, 0),
        crrt_flow=f"{study.crrt_flow_ml_min:g}",
        schemes=study.schemes,
        speeds=study.means.sizes["speed"],
        answer=[*choice_text(study, main), *filter(None, [choice_in_other_policy(study, main)])],
        doubts=untrusted(study.warnings),
        not_known=missing_beats_text(study),
        known=known,
        ranking=_ranking_table(study, main),
        order=[criterion.sentence for criterion in study.rule.criteria],
        rule=study.rule.name,
        exchange=_exchange_tables(study, main),
        renox=_renox_tables(study, main),
        notes=[f"Scheme {scheme.letter}: {scheme.note}." for scheme in study.schemes if scheme.note],
        policy_means=[(POLICY_WORDS[policy], _means_table(study, policy)) for policy in study.policies],
        summary=_summary_table(study, main),
        beats_missing=int(study.summary["schemes_known"].sel(policy=main).min()) < len(study.schemes),
        limits=_limits_table(study, main),
        uncertainty=_uncertainty(study, main),
        volume=None if study.uptake is None else _volume_sentences(study, study.uptake),
        assumed=assumptions_in_words(study),
        warnings=study.warnings,
        drawings=drawings,
        captions=_captions(study, main, known),
    )


def _captions(study: CrrtStudy, main: str, known: int) -> dict[str, str]:
    from eclsim.crrt_study.figures import MOST_DRAWN

    drawn = f" The {MOST_DRAWN} that rank best are drawn." if len(study.schemes) > MOST_DRAWN else ""
    limited = "" if known == len(study.schemes) else " whose beat was found"
    policy = POLICY_WORDS[main]
    return {
        "schemes": (
            "The schemes. Blood flows from the drainage cannula (DC) through pump (P) and oxygenator (Oxy) "
            "to the return cannula (RC); access line solid with a dot, return line dashed with a square."
            + drawn
        ),
        "beat": f"Two beats of every scheme{limited}; {policy}.",
        "speeds": f"Cycle means over the ECMO flow; {policy}.",
        "limits": f"ECMO flow at which each limit is reached; {policy}.",
        "uptake": "Arterial pressure under the blood volume policies, and its causes.",
    }


def _ranking_table(study: CrrtStudy, policy: str) -> Table:
    names = {s.letter: s.name for s in study.schemes}
    rows = [
        (
            place(r), r.letter, names[r.letter],
            limit_flow_text(r.largest_flow, r.flow_at_most, r.throughout, study.rule.limited),
            KEPT_LABELS[r.usual_alarms_kept], r.decided_by or "–",
            "; ".join([r.why_no_rank] * bool(r.known and r.why_no_rank) + list(r.reasons)),
        )
        for r in study.ranking[policy]
    ]  # fmt: skip
    head = [
        "Rank", "Scheme", "Access – return", "Limits kept up to [L/min]", "Usual alarms",
        "What the one above does better", "Why",
    ]  # fmt: skip
    return Table(head, rows, numeric=(0, 3))


EXCHANGE_COLUMNS = (
    (
        Column("recirculated_fraction", "Recirculation [%]", 0, 100.0),
        Column("past_oxygenator", "Blood past the oxygenator [%]", 1, 100.0),
    ),
    (
        Column("effective_clearance_urea", "Urea cleared [mL/min]", 1),
        Column("effective_clearance_creatinine", "Creatinine [mL/min]", 1),
        Column("effective_clearance_potassium", "Potassium [mL/min]", 1),
        Column("filtration_fraction", "Filtration fraction [%]", 0, 100.0),
        Column("effluent_pressure", "Effluent pressure [mmHg]", 0),
    ),
    (
        Column("SreturnO2", "SO2 from the ECMO [%]", 1), Column("PreturnCO2", "PCO2 from the ECMO [mmHg]", 1),
        Column("SaO2", "SaO2 [%]", 1), Column("PaCO2", "PaCO2 [mmHg]", 1),
    ),
)  # fmt: skip
"""Columns for the effect of the CRRT on the blood, one table for each group that a study has."""


def _exchange_tables(study: CrrtStudy, policy: str) -> list[Table]:
    """Blood paths, clearances (less recirculation) and gases, as far as the study has them."""
    means = study.means.sel(policy=policy, speed=study.case_speed)
    rows = []
    for ranked in study.ranking[policy]:
        of_scheme = means.sel(scheme=ranked.letter)
        where = "behind" if bool(of_scheme["behind_oxygenator"]) else "before"
        if (site := of_scheme["return_site"].item()) not in POSITIONS:
            where = "patient, after the lungs" if site in AFTER_LUNGS else "patient, before the lungs"
        rows.append(([ranked.letter, where], of_scheme, ""))
    return _tables(["Scheme", "Returns: oxygenator"], EXCHANGE_COLUMNS, rows)


RENOX_COLUMNS = (
    (
        Column("access_mmhg", "Access [mmHg]"), Column("return_mmhg", "Return [mmHg]"),
        Column("blood_taken_up_ml", "Blood taken up [mL]"),
        Column("effluent_pressure_mmhg", "Effluent pressure [mmHg]"),
        Column("open_effluent_l_h", "Filtered with an open effluent [L/h]", 1),
    ),
    (
        Column("urea_ml_min", "Urea cleared [mL/min]", 1),
        Column("filtration_fraction", "Filtration fraction [%]", 1, 100.0),
        Column("SaO2", "SaO2 [%]", 1), Column("PaCO2", "PaCO2 [mmHg]", 1),
    ),
)  # fmt: skip
"""Quantities compared with RenOx, in tables that fit a page; names are keys in JSON."""
KEPT_LABELS: dict[float | bool | None, str] = {True: "kept", False: "broken", None: "not known"}


def _renox_tables(study: CrrtStudy, policy: str) -> list[Table]:
    """Tables of one housing for oxygenator and dialyzer and every scheme, at the case's speed."""
    rows = []
    for name, values in compared_with_schemes(study, policy).items():
        no_lines = name == "RenOx" and values["alarms_kept"] is not None  # otherwise its beat was not found
        alarms = "no lines" if no_lines else KEPT_LABELS[values["alarms_kept"]]
        rows.append(([name, alarms], values, "none" if no_lines else number(None)))
    return _tables(["", "Alarms of the lines"], RENOX_COLUMNS, rows)


def _means_table(study: CrrtStudy, policy: str) -> Table:
    at_case = {"policy": policy, "speed": study.case_speed}
    means, summary = study.means.sel(at_case), study.summary.sel(at_case)
    of, percent = _of_schemes(study, summary), [column._replace(decimals=1) for column in MEAN_COLUMNS]
    rows = [
        *([k, *_cells(means.sel(scheme=k), MEAN_COLUMNS)] for k in means["scheme"].values.astype(str)),
        ["no CRRT", *_cells(study.without_crrt.sel(at_case), MEAN_COLUMNS)],
        [f"median{of}", *_cells(summary, MEAN_COLUMNS, "_median")],
        [f"variation{of}", *_cells(summary, MEAN_COLUMNS, "_variation")],
        ["variation [%]", *_cells(summary, percent, "_variation_percent")],
    ]
    return _table(["Scheme"], MEAN_COLUMNS, rows, foot=3)


def _of_schemes(study: CrrtStudy, summary: xr.Dataset) -> str:
    """Number of schemes that a median is taken over, in words; empty if over all."""
    known, total = int(summary["schemes_known"]), len(study.schemes)
    return "" if known == total else f" of {known} of {total}"


def _summary_table(study: CrrtStudy, policy: str) -> Table:
    """Table of medians and variations over the schemes at a few speeds."""
    speeds = study.means["speed"].values
    step = math.ceil(len(speeds) / 8)
    shown = sorted({*speeds[::step], speeds[-1]})
    names = ("PF", "Psart", "Ppart", "Psvn", "Pecmodrain", "Pcrrttuin", "Pcrrttuout")
    titles = {column.name: column.head for column in MEAN_COLUMNS}
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
    unbounded = {limit.name for limit in study.rule.limits if limit.unbounded}
    unbounded |= set() if study.rule.limited else {CRRT_LIMITS}
    rows = []
    for ranked in study.ranking[policy]:
        cells = []
        for name in ("access_alarm", "return_alarm", "access_190", "suction", "crrt"):
            data = limits.sel(scheme=ranked.letter, limit=name)
            flow, at_most = float(data["largest_flow"]), float(data["flow_at_most"])
            to_the_end = data["state"].item() == KEPT_TO_THE_END
            cells.append(limit_flow_text(flow, at_most, to_the_end, name not in unbounded))
        margin = limits["margin"].sel(scheme=ranked.letter, limit="crrt")
        rows.append([ranked.letter, *cells, number(float(margin), 0)])
    of = {limit.name: limit for limit in study.rule.limits}
    head = [
        "Scheme",
        _limit_head("Access alarms", of["access_alarm"]),
        _limit_head("Return alarms", of["return_alarm"]),
        _limit_head("Access", of["access_190"]),
        _limit_head("Drainage", of["suction"]),
        "All of the CRRT lines",
        "Margin at this speed [mmHg]",
    ]
    return Table(head, rows, numeric=range(1, len(head)))


def _limit_head(label: str, limit: Limit) -> str:
    """Header of a limit with its bounds, as far as it has any."""
    if limit.unbounded:
        return f"{label}: no limit"
    low, high = (number(bound, digits=6) for bound in (limit.low, limit.high))
    if math.isinf(limit.low):
        return f"{label} ≤ {high} mmHg"
    return f"{label} ≥ {low} mmHg" if math.isinf(limit.high) else f"{label} {low} to {high} mmHg"


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
    head = ["Scheme", "Beat found in", "Arterial [mmHg]", "Access [mmHg]", "Return [mmHg]"]
    access = next(limit for limit in study.rule.limits if limit.name == "access_190")
    head += ["Access alarms kept", "Return alarms kept", _limit_head("Access", access)]
    head.append("All of the CRRT lines")
    return {
        "samples": result.attrs["samples"],
        "policy": POLICY_WORDS[result.attrs["blood_volume_policy"]],
        "table": Table(head, rows, numeric=range(1, len(head))),
    }


def _share(data: xr.Dataset) -> str:
    """Share of the samples in which a limit is kept, as text; a range if some have no beat."""
    low, high = (percent(float(data[f"probability_at_{word}"])) for word in ("least", "most"))
    return f"{low} %" if low == high else f"{low} to {high} %"


def percent(share: float) -> str:
    """A share in whole percent; 0 and 100 only if the share is exactly none or all."""
    if 0.0 < share < 0.005:
        return "< 1"
    return "> 99" if 0.995 <= share < 1.0 else number(100.0 * share, 0)


def _volume_sentences(study: CrrtStudy, uptake: xr.Dataset) -> list[str]:
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
        kept = "With the patient's blood volume kept, the remaining change"
        lines.append(f"{kept} is {result}; a beat was not found.")
    if len(flow):
        lines.append(
            f"As published, schemes change the mean arterial pressure by up to {total.max():.1f} mmHg. "
            f"With the patient's blood volume kept, the remaining change is at most {flow.max():.1f} mmHg. "
            "A circuit "
            "that is primed, or a patient who is given that volume, does not show the difference."
        )
    return lines


_PARTS = ("difference", "flow")


# --- figures of the page --------------------------------------------------------------------------


def drawings(study: CrrtStudy) -> dict[str, str]:
    """All figures by name, for the first policy studied, with the patient and the doubts above each."""
    from eclsim.crrt_study import figures
    from eclsim.reporting.style import plain_text, write_above

    policy, speed = study.policies[0], study.case_speed
    means, waves = study.means.sel(policy=policy), study.waveforms.sel(policy=policy)
    ranked, rule_limits = study.ranking[policy], study.rule.limits
    best_first = [r.letter for r in ranked]
    flow = float(study.without_crrt["PF"].sel(policy=policy, speed=speed))
    drawn = {
        "schemes": figures.draw_schemes(study.schemes, {r.letter: place(r) for r in ranked}),
        "beat": figures.plot_crrt_beat(waves, means.sel(speed=speed), rule_limits),
        "speeds": figures.plot_crrt_speeds(means, speed, rule_limits),
        "limits": figures.plot_crrt_limits(study.limits.sel(policy=policy), flow, best_first, rule_limits),
    }
    if study.uptake is not None:
        at_speed = study.means.sel(speed=speed), study.without_crrt.sel(speed=speed)
        drawn["uptake"] = figures.plot_crrt_uptake(study.uptake, *at_speed)
    title = f"{plain_text(study.case.patient.id, 50)} – CRRT on ECMO"
    for drawing in drawn.values():
        write_above(drawing, untrusted(study.warnings), title)
    return {name: svg_text(drawing) for name, drawing in drawn.items()}


# --- terminal -------------------------------------------------------------------------------------


_COLUMNS = (
    Column("Psart", "arterial\nmmHg", 1), Column("Psvn", "venous\nmmHg", 1),
    Column("Pcrrttuin", "access\nmmHg"), Column("Pcrrttuout", "return\nmmHg"),
    Column("Pecmodrain", "drainage\nmmHg"), Column("PF", "ECMO\nL/min", 2),
    Column("patient_volume_change", "blood volume\nmL"),
)  # fmt: skip


def show(study: CrrtStudy) -> None:
    """Print the schemes, best first, for each blood volume policy."""
    names = {scheme.letter: scheme.name for scheme in study.schemes}
    heads = ["rank", "scheme", "access – return", *(c.head for c in _COLUMNS), "limits kept\nto L/min"]
    heads.append("usual\nalarms")
    for policy, ranked in study.ranking.items():
        known = sum(r.known for r in ranked)
        among = "" if known == len(ranked) else f"; ranked: the {known} of {len(ranked)} whose beat was found"
        title = f"CRRT schemes at {study.case_speed:.0f} rpm, {POLICY_WORDS[policy]}{among}"
        means = study.means.sel(policy=policy, speed=study.case_speed)
        rows = [
            (
                place(r), r.letter, names[r.letter], *_cells(means.sel(scheme=r.letter), _COLUMNS),
                limit_flow_text(r.largest_flow, r.flow_at_most, r.throughout, study.rule.limited),
                KEPT_LABELS[r.usual_alarms_kept],
            )
            for r in ranked
        ]  # fmt: skip
        show_table(title, heads, rows, range(3, len(heads)))
        show_text("\n  ".join(choice_text(study, policy)) + "\n")
    for sentence in study.assumed:
        show_text(f"{sentence[0].upper()}{sentence[1:]}")
