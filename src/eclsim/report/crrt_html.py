"""The CRRT study as one HTML page that a clinician can read, print and pass on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from eclsim.haemodynamics.alarms import SANSOM_ACCESS_MMHG, SUCTION_MMHG
from eclsim.models import POSITIONS
from eclsim.parameters.devices import CRRT_ALARMS_MMHG
from eclsim.report.html import box, bullets, figure, heading, page, paragraph, table
from eclsim.solver.model import AS_PUBLISHED
from eclsim.studies.crrt_ranking import ORDER

if TYPE_CHECKING:
    from eclsim.studies.crrt_ranking import Ranked
    from eclsim.studies.crrt_study import CrrtStudy

POLICY_WORDS = {
    "as_published": "as published: the patient's own blood fills the circuits",
    "patient_held": "patient's volume held: the circuits are primed",
}
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


def study_page(study: CrrtStudy, drawings: Mapping[str, str]) -> str:
    """The page.

    Args:
        study: results.
        drawings: figures as SVG text, from `eclsim.report.crrt_drawings.drawings`.
    """
    title = f"CRRT on ECMO: {study.case.patient.id}"
    return page(title, _pieces(study, drawings))


def _pieces(study: CrrtStudy, drawings: Mapping[str, str]) -> Iterator[str]:
    from eclsim.plotting.crrt_schematic import MOST_DRAWN

    main = study.policies[0]
    yield heading(f"Connecting CRRT to the ECMO circuit: {study.case.patient.id}", 1)
    yield paragraph(_who(study), "lead")
    yield from _answer(study, main)
    yield heading("The schemes, ranked")
    yield _ranking_table(study, main)
    yield paragraph("Order of reasons; a later one counts only where the earlier ones tie:")
    yield bullets(ORDER, numbered=True)
    yield figure(
        drawings["schemes"],
        "The schemes. Blood flows from the drainage cannula (DC) through pump (P) and oxygenator (Oxy) "
        "to the return "
        "cannula (RC); access line solid with a dot, return line dashed with a square."
        + (f" The {MOST_DRAWN} that rank best are drawn." if len(study.schemes) > MOST_DRAWN else ""),
        "schemes",
    )
    yield from _notes(study)
    yield heading(f"One beat at {study.case_speed:.0f} rpm")
    yield figure(drawings["beat"], f"Two beats of every scheme; {POLICY_WORDS[main]}.", "beat")
    for policy in study.policies:
        yield paragraph(f"Cycle means, {POLICY_WORDS[policy]}:")
        yield _means_table(study, policy)
    yield heading("Over the range of ECMO flows")
    yield figure(drawings["speeds"], f"Cycle means over the ECMO flow; {POLICY_WORDS[main]}.", "speeds")
    yield _summary_table(study, main)
    yield heading("Limits, and the ECMO flow that keeps them")
    yield figure(
        drawings["limits"], f"ECMO flow at which each limit is reached; {POLICY_WORDS[main]}.", "limits"
    )
    yield _limits_table(study)
    yield from _uncertainty(study)
    yield from _volume(study, drawings)
    yield heading("What was assumed")
    yield bullets(_assumptions(study))


def _who(study: CrrtStudy) -> str:
    patient, ecmo = study.case.patient, study.case.ecmo
    assert ecmo is not None
    return (
        f"{patient.sex}, {patient.age_years:g} years, {patient.heart_rate_bpm:g} beats/min. ECMO: "
        f"{ecmo.pump} at "
        f"{study.case_speed:.0f} rpm, {ecmo.oxygenator}, {ecmo.drainage_fr:g} Fr from {ecmo.drainage_site}, "
        f"{ecmo.return_fr:g} Fr to {ecmo.return_site}. CRRT: {study.crrt_flow_ml_min:g} mL/min. "
        f"{len(study.schemes)} schemes at {study.means.sizes['speed']} speeds."
    )


def _answer(study: CrrtStudy, main: str) -> Iterator[str]:
    best = study.ranking[main][0]
    name = next(s.name for s in study.schemes if s.letter == best.letter)
    lines = [f"First choice for this patient: scheme {best.letter} ({name})", *best.reasons]
    if len(study.policies) > 1:
        other = study.ranking[study.policies[1]][0].letter
        agrees = other == best.letter
        lines.append(
            "It is also first when the circuits are primed and the patient's volume is held."
            if agrees
            else f"When the circuits are primed and the patient's volume is held, scheme {other} is first."
        )
    yield box(lines)
    if not study.converged:
        missing = [
            f"{p}, scheme {s}, {v:.0f} rpm"
            for p in study.policies
            for s in study.means["scheme"].values.astype(str)
            for v in study.means["speed"].values
            if not bool(study.means["converged"].sel(policy=p, scheme=s, speed=v))
        ]
        yield box(["No steady beat was found for some of it", "; ".join(missing[:20])], warn=True)


def _ranking_table(study: CrrtStudy, policy: str) -> str:
    names = {s.letter: s.name for s in study.schemes}
    rows = [
        (r.rank, r.letter, names[r.letter], _flow(r), "; ".join(r.reasons)) for r in study.ranking[policy]
    ]
    return table(
        ["Rank", "Scheme", "Access – return", "Limits kept up to [L/min]", "Why"], rows, numeric=(0, 3)
    )


def _flow(one: Ranked) -> str:
    return (
        "never" if math.isnan(one.largest_flow) else f"{one.largest_flow:.1f}{'+' if one.throughout else ''}"
    )


def _notes(study: CrrtStudy) -> Iterator[str]:
    notes = [f"Scheme {scheme.letter}: {scheme.note}." for scheme in study.schemes if scheme.note]
    if notes:
        yield bullets(notes)


def _means_table(study: CrrtStudy, policy: str) -> str:
    means = study.means.sel(policy=policy, speed=study.case_speed)
    alone = study.without_crrt.sel(policy=policy, speed=study.case_speed)
    summary = study.summary.sel(policy=policy, speed=study.case_speed)
    rows = []
    for letter in means["scheme"].values.astype(str):
        rows.append([letter, *(number(means[n].sel(scheme=letter), d) for n, _, d in MEAN_COLUMNS)])
    rows.append(["no CRRT", *(number(alone[n], d) if n in alone else "" for n, _, d in MEAN_COLUMNS)])
    rows.append(["median", *(number(summary[f"{n}_median"], d) for n, _, d in MEAN_COLUMNS)])
    rows.append(["variation", *(number(summary[f"{n}_variation"], d) for n, _, d in MEAN_COLUMNS)])
    rows.append(
        ["variation [%]", *(number(summary[f"{n}_variation_percent"], 1) for n, _, _ in MEAN_COLUMNS)]
    )
    head = ["Scheme", *(words for _, words, _ in MEAN_COLUMNS)]
    return table(head, rows, numeric=range(1, len(head)), foot=3)


def _summary_table(study: CrrtStudy, policy: str) -> str:
    """Medians and variations over the schemes at a handful of speeds."""
    speeds = study.means["speed"].values
    step = math.ceil(len(speeds) / 8)
    shown = sorted({*speeds[::step], speeds[-1]})
    names = ("PF", "Psart", "Ppart", "Psvn", "Pecmodrain", "Pcrrttuin", "Pcrrttuout")
    words = {n: w for n, w, _ in MEAN_COLUMNS}
    rows = []
    for speed in shown:
        one = study.summary.sel(policy=policy, speed=speed)
        cells = [f"{number(one[f'{n}_median'], 1)} ± {number(0.5 * one[f'{n}_variation'], 1)}" for n in names]
        order = f"{one['Psart_highest'].item()} / {one['Psart_lowest'].item()}"
        rows.append([f"{speed:.0f}", *cells, order])
    head = ["Speed [rpm]", *(words[n] for n in names), "Highest / lowest arterial"]
    said = paragraph("Median over the schemes ± half the distance from the lowest to the highest:")
    return said + table(head, rows, numeric=range(len(head) - 1))


def _limits_table(study: CrrtStudy) -> str:
    policy = study.policies[0]
    limits = study.limits.sel(policy=policy)
    rows = []
    for ranked in study.ranking[policy]:
        cells = []
        for name in ("access_alarm", "return_alarm", "access_190", "suction", "crrt"):
            one = limits.sel(scheme=ranked.letter, limit=name)
            plus = "+" if bool(one["kept_throughout"]) else ""
            cells.append(number(one["largest_flow"], 1, "never") + plus)
        rows.append(
            [ranked.letter, *cells, number(limits["margin"].sel(scheme=ranked.letter, limit="crrt"), 0)]
        )
    access, giving = CRRT_ALARMS_MMHG["access"], CRRT_ALARMS_MMHG["return"]
    head = [
        "Scheme",
        f"Access alarms {access[0]:g} to {access[1]:g} mmHg",
        f"Return alarms {giving[0]:g} to {giving[1]:g} mmHg",
        f"Access ≤ {SANSOM_ACCESS_MMHG:g} mmHg",
        f"Drainage ≥ {SUCTION_MMHG:g} mmHg",
        "All of the CRRT lines",
        "Margin at this speed [mmHg]",
    ]
    said = paragraph(
        "Largest ECMO flow [L/min] that keeps each limit; +: kept up to the largest flow studied."
    )
    return said + table([h.replace("-", "−") for h in head], rows, numeric=range(1, len(head)))


def _uncertainty(study: CrrtStudy) -> Iterator[str]:
    found = study.uncertainty
    if found is None:
        return
    rows = []
    for ranked in study.ranking[study.policies[0]]:
        one = found.sel(scheme=ranked.letter)
        spread = []
        for name in ("Psart", "Pcrrttuin", "Pcrrttuout"):
            low, middle, high = (number(v, 0) for v in one[f"{name}_quantiles"].values)
            spread.append(f"{middle} ({low} to {high})")
        kept = [
            f"{number(100.0 * one['probability_kept'].sel(limit=k).item(), 0)} %"
            for k in ("access_alarm", "return_alarm", "access_190", "crrt")
        ]
        rows.append([ranked.letter, *spread, *kept])
    yield heading("How sure this is")
    yield paragraph(
        f"{found.attrs['samples']} samples of the patient's parameters at {study.case_speed:.0f} rpm: median "
        "and 5th to 95th percentile of the means, and the share of the samples in which each limit is kept."
    )
    head = ["Scheme", "Arterial [mmHg]", "Access [mmHg]", "Return [mmHg]"]
    head += ["Access alarms kept", "Return alarms kept", "Access ≤ 190 mmHg", "All of the CRRT lines"]
    yield table(head, rows, numeric=range(1, len(head)))


def _volume(study: CrrtStudy, drawings: Mapping[str, str]) -> Iterator[str]:
    if study.uptake is None:
        return
    taken = study.uptake["blood_taken_up"].values
    flow = abs(study.uptake["Psart_flow"]).max().item()
    whole = abs(study.uptake["Psart_difference"]).max().item()
    yield heading("How much of it is blood volume")
    yield box(
        [
            f"The CRRT tubing takes up {number(taken.min(), 0)} to {number(taken.max(), 0)} mL of blood",
            f"As published, schemes change the mean arterial pressure by up to {whole:.1f} mmHg. With "
            f"the patient's "
            f"blood volume kept, what is left is at most {flow:.1f} mmHg. A circuit that is primed, or a "
            f"patient who "
            "is given that volume, does not show the difference.",
        ],
        warn=True,
    )
    yield figure(
        drawings["uptake"], "Arterial pressure under the blood volume policies, and its causes.", "uptake"
    )


def _assumptions(study: CrrtStudy) -> list[str]:
    lines = [
        "The steady heartbeat of the cardiovascular model of Thiel et al. 2025; no reflexes, no gas "
        "exchange, no "
        "fluid removal by the CRRT.",
        f"The CRRT pump gives {study.crrt_flow_ml_min:g} mL/min whatever the pressures are.",
        "Alarm limits are usual settings of CRRT machines; the limit of 190 mmHg is from Sansom et al. "
        "2023; the "
        f"drainage limit of {SUCTION_MMHG:g} mmHg is a convention.".replace("-", "−"),
        "Flows at limits are interpolated between the speeds studied.",
        "Blood that recirculates from the return to the access line is counted with complete mixing in "
        "each part "
        "of the ECMO circuit.",
        *(f"Blood volume, {words}." for policy, words in POLICY_WORDS.items() if policy in study.policies),
    ]
    if any(node not in POSITIONS.values() for scheme in study.schemes for node in scheme.nodes):
        lines.append("Lines on the patient attach without a catheter and its resistance.")
    patient = study.case.patient
    if patient.height_cm is None or patient.weight_kg is None:
        lines.append("Height and weight were not given: means for sex and age set the blood volume.")
    if study.policies[0] != AS_PUBLISHED:
        lines.append(
            "The published volume policy was not studied, so effects are not split into volume and flow."
        )
    return lines


def number(value: object, digits: int, missing: str = "–") -> str:
    """A number with so many decimals and a real minus sign."""
    found = float(value)  # pyright: ignore[reportArgumentType] - numbers and arrays of one
    if not math.isfinite(found):
        return missing
    shown = f"{found:.{digits}f}"
    return shown.replace("-", "−") if float(shown) != 0.0 else shown.replace("-", "")
