"""The CRRT study as one HTML page that a clinician can read, print and pass on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from eclsim.crrt_study.limits import KEPT_TO_THE_END
from eclsim.crrt_study.ranking import ORDER
from eclsim.crrt_study.words import (
    choice,
    choice_elsewhere,
    kept,
    main_policy,
    not_known,
    place,
)
from eclsim.devices.constants import CRRT_ALARMS_MMHG
from eclsim.devices.ecmo import POSITIONS
from eclsim.orbit.model import AS_PUBLISHED, POLICY_WORDS
from eclsim.outputs.alarms import SANSOM_ACCESS_MMHG, SUCTION_MMHG
from eclsim.reporting.html import box, bullets, figure, heading, page, paragraph, table

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.crrt_study.study import CrrtStudy

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


def study_page(study: CrrtStudy, drawings: Mapping[str, str], policy: str | None = None) -> str:
    """The page.

    Args:
        study: results.
        drawings: figures as SVG text, from `eclsim.crrt_study.drawings.drawings` for the same policy.
        policy: blood volume policy that answer, ranking and figures are for; left out, the first studied.
    """
    title = f"CRRT on ECMO: {study.case.patient.id}"
    return page(title, _pieces(study, drawings, main_policy(study, policy)))


def _pieces(study: CrrtStudy, drawings: Mapping[str, str], main: str) -> Iterator[str]:
    from eclsim.crrt_study.connection_drawings import MOST_DRAWN

    yield heading(f"Connecting CRRT to the ECMO circuit: {study.case.patient.id}", 1)
    yield paragraph(_who(study), "lead")
    yield from _answer(study, main)
    yield heading("The schemes, ranked")
    known = sum(one.known for one in study.ranking[main])
    if known < len(study.schemes):
        at = f"{study.case_speed:.0f} rpm"
        yield paragraph(f"Places are among the {known} of {len(study.schemes)} whose beat was found at {at}:")
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
    found = "" if known == len(study.schemes) else " whose beat was found"
    yield figure(drawings["beat"], f"Two beats of every scheme{found}; {POLICY_WORDS[main]}.", "beat")
    for policy in sorted(study.policies, key=lambda one: one != main):
        yield paragraph(f"Cycle means, {POLICY_WORDS[policy]}:")
        yield _means_table(study, policy)
    yield heading("Over the range of ECMO flows")
    yield figure(drawings["speeds"], f"Cycle means over the ECMO flow; {POLICY_WORDS[main]}.", "speeds")
    yield _summary_table(study, main)
    yield heading("Limits, and the ECMO flow that keeps them")
    yield figure(
        drawings["limits"], f"ECMO flow at which each limit is reached; {POLICY_WORDS[main]}.", "limits"
    )
    yield _limits_table(study, main)
    yield from _uncertainty(study, main)
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
    yield box([*choice(study, main), *filter(None, [choice_elsewhere(study, main)])])
    missing = not_known(study)
    if missing:
        told = "They have no part in places, medians and limits (–: not known); figures leave them out."
        yield box(["Not all steady beats were found", *missing, told], warn=True)


def _ranking_table(study: CrrtStudy, policy: str) -> str:
    names = {s.letter: s.name for s in study.schemes}
    rows = [
        (
            place(r), r.letter, names[r.letter], kept(r.largest_flow, r.flow_at_most, r.throughout),
            "; ".join([r.why_no_rank] * bool(r.known and r.why_no_rank) + list(r.reasons)),
        )
        for r in study.ranking[policy]
    ]  # fmt: skip
    return table(
        ["Rank", "Scheme", "Access – return", "Limits kept up to [L/min]", "Why"], rows, numeric=(0, 3)
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
    of = _of_schemes(study, summary)
    rows.append([f"median{of}", *(number(summary[f"{n}_median"], d) for n, _, d in MEAN_COLUMNS)])
    rows.append([f"variation{of}", *(number(summary[f"{n}_variation"], d) for n, _, d in MEAN_COLUMNS)])
    rows.append(
        ["variation [%]", *(number(summary[f"{n}_variation_percent"], 1) for n, _, _ in MEAN_COLUMNS)]
    )
    head = ["Scheme", *(words for _, words, _ in MEAN_COLUMNS)]
    return table(head, rows, numeric=range(1, len(head)), foot=3)


def _of_schemes(study: CrrtStudy, summary: xr.Dataset) -> str:
    """Of how many schemes a median is; empty if of all."""
    known, every = int(summary["schemes_known"]), len(study.schemes)
    return "" if known == every else f" of {known} of {every}"


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
        rows.append([f"{speed:.0f}{_of_schemes(study, one)}", *cells, order if order != " / " else "–"])
    head = ["Speed [rpm]", *(words[n] for n in names), "Highest / lowest arterial"]
    text = "Median over the schemes ± half the distance from the lowest to the highest"
    if int(study.summary["schemes_known"].sel(policy=policy).min()) < len(study.schemes):
        text += "; where a beat was not found, of how many of the schemes stands beside the speed"
    said = paragraph(f"{text}:")
    return said + table(head, rows, numeric=range(len(head) - 1))


def _limits_table(study: CrrtStudy, policy: str) -> str:
    limits = study.limits.sel(policy=policy)
    rows = []
    for ranked in study.ranking[policy]:
        cells = []
        for name in ("access_alarm", "return_alarm", "access_190", "suction", "crrt"):
            one = limits.sel(scheme=ranked.letter, limit=name)
            to_the_end = one["state"].item() == KEPT_TO_THE_END
            cells.append(kept(float(one["largest_flow"]), float(one["flow_at_most"]), to_the_end))
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
        "Largest ECMO flow [L/min] that keeps each limit; +: kept up to the largest flow studied; ≥: not "
        "known above, as no steady beat was found there."
    )
    return said + table([h.replace("-", "−") for h in head], rows, numeric=range(1, len(head)))


def _uncertainty(study: CrrtStudy, policy: str) -> Iterator[str]:
    found = study.uncertainty
    if found is None:
        return
    rows = []
    for ranked in study.ranking[policy]:
        one = found.sel(scheme=ranked.letter)
        spread = []
        for name in ("Psart", "Pcrrttuin", "Pcrrttuout"):
            low, middle, high = (number(v, 0) for v in one[f"{name}_quantiles"].values)
            spread.append(f"{middle} ({low} to {high})")
        shares = [_share(one.sel(limit=k)) for k in ("access_alarm", "return_alarm", "access_190", "crrt")]
        rows.append([ranked.letter, f"{percent(float(one['settled']))} %", *spread, *shares])
    yield heading("How sure this is")
    yield paragraph(
        f"{found.attrs['samples']} samples of the patient's parameters at {study.case_speed:.0f} rpm, "
        f"{POLICY_WORDS[found.attrs['blood_volume_policy']]}. The share of them whose steady beat was "
        "found; of these, median and 5th to 95th percentile of the means; and the share of all samples in "
        "which each limit is kept, as a range where a sample without a beat may break or keep it."
    )
    head = ["Scheme", "Beat found in", "Arterial [mmHg]", "Access [mmHg]", "Return [mmHg]"]
    head += ["Access alarms kept", "Return alarms kept", "Access ≤ 190 mmHg", "All of the CRRT lines"]
    yield table(head, rows, numeric=range(1, len(head)))


def _share(one: xr.Dataset) -> str:
    """Share of the samples in which a limit is kept; a range where some have no beat."""
    low, high = (percent(float(one[f"probability_at_{word}"])) for word in ("least", "most"))
    return f"{low} %" if low == high else f"{low} to {high} %"


def percent(share: float) -> str:
    """A share in whole percent; 0 and 100 only where it is none and all."""
    if 0.0 < share < 0.005:
        return "< 1"
    return "> 99" if 0.995 <= share < 1.0 else number(100.0 * share, 0)


def _volume(study: CrrtStudy, drawings: Mapping[str, str]) -> Iterator[str]:
    if study.uptake is None:
        return
    yield heading("How much of it is blood volume")
    yield box(_volume_words(study, study.uptake), warn=True)
    yield figure(
        drawings["uptake"], "Arterial pressure under the blood volume policies, and its causes.", "uptake"
    )


def _volume_words(study: CrrtStudy, uptake: xr.Dataset) -> list[str]:
    taken, whole, flow = (
        values[np.isfinite(values)]
        for values in (uptake["blood_taken_up"].values, *(abs(uptake[f"Psart_{w}"].values) for w in _PARTS))
    )
    if not len(taken):
        return ["Not known: no steady beat of the patient without CRRT, or of any scheme, was found"]
    of = f", of the {len(taken)} of {len(study.schemes)} schemes whose beat was found"
    lines = [
        f"The CRRT tubing takes up {number(taken.min(), 0)} to {number(taken.max(), 0)} mL of blood"
        + (of if len(taken) < len(study.schemes) else "")
    ]
    if len(flow) < len(study.schemes):
        found = f"known for {len(flow)} of {len(study.schemes)} schemes"
        lines.append(f"What is left with the patient's blood volume kept is {found}; a beat was not found.")
    if len(flow):
        lines.append(
            f"As published, schemes change the mean arterial pressure by up to {whole.max():.1f} mmHg. "
            f"With the patient's blood volume kept, what is left is at most {flow.max():.1f} mmHg. A circuit "
            "that is primed, or a patient who is given that volume, does not show the difference."
        )
    return lines


_PARTS = ("difference", "flow")


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
    if AS_PUBLISHED not in study.policies:
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
