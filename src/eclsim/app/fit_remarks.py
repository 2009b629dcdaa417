"""What a fit says against reading numbers off its patient; kept with the patient, shown at the numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from eclsim.app.state import LONGEST_REMARK, FitRemark, PageState
from eclsim.app.texts import in_page_words, text, with_minus
from eclsim.outputs.alarms import CAUTION, Finding, gravest_first
from eclsim.outputs.registry import find_output, first_name
from eclsim.parameters.regulation import EXTRA_VOLUME

if TYPE_CHECKING:
    from eclsim.app.beat import Beat

EJECTION, CONTRACTILITY, FLOW = "ejection_fraction_lv", "Emaxlv", "CO"
FOLLOWING = {
    "SP": ("pulse_pressure",), "DP": ("pulse_pressure",), "MPAP": ("SPAP", "DPAP"),
    FLOW: ("LVO", "pulmonary_flow", "stroke_volume_lv", "stroke_volume_rv"),
}  # fmt: skip
"""Outputs that are as undetermined as another."""
_OF_VENTRICLE = tuple(
    tuple(f"{what}{side.upper()}" for what in ("EDV", "ESV"))
    + tuple(f"{what}_{side}" for what in ("ejection_fraction", "stroke_work", "pressure_volume_area"))
    for side in ("lv", "rv")
)
"""Outputs of each ventricle that depend on its volumes: an implausible one is a doubt about all."""
OF_VOLUME = ("PCWP", "MPAP", "CVP")
MOST_IMPLAUSIBLE = 4
"""Largest number of remarks on implausible outputs; the last one is about all further ones."""
HEART_VOLUMES = ("EDVLV", "ESVLV", "EDVRV", "ESVRV")


def remarks_of(fit: Mapping[str, Any]) -> tuple[FitRemark, ...]:
    """Return what a fit says against its numbers: the first reason of its verdict, then those of outputs.

    These are what it does not determine, missed measurements, and implausible outputs that it implies.

    Args:
        fit: "verdict", "outputs" and "parameters" of `plain_fit`.
    """
    outputs = fit.get("outputs") or {}
    missing = [n for n, cell in outputs.items() if cell.get("determined") is False]
    remarks = [FitRemark(why)] if (why := _first_reason(fit)) else []
    if missing:
        each = ", ".join(f"{name} {_value_and_interval(name, outputs[name])}" for name in missing)
        remarks.append(FitRemark(text("remark_undetermined", each=each), _with_followers(missing)))
    parameters = fit.get("parameters") or {}
    causes = [FLOW] if FLOW in missing else []
    causes += [] if parameters.get(CONTRACTILITY, {}).get("identifiable") else [CONTRACTILITY]
    if causes and outputs:
        what = " and ".join(causes)
        remarks.append(FitRemark(text("remark_ejection", what=what), (EJECTION,)))
    held = [r for r in (fit.get("verdict") or {}).get("reasons", ()) if r["about"] == EXTRA_VOLUME]
    unmeasured = [name for name in OF_VOLUME if outputs.get(name, {}).get("measured") is None]
    names = (*_with_followers(unmeasured), *HEART_VOLUMES)
    remarks += [FitRemark(_sentence(reason["sentence"]), names) for reason in held]
    remarks += [*_missed(fit), *_implausible(fit)]
    return tuple(FitRemark(remark.sentence[:LONGEST_REMARK], remark.outputs) for remark in remarks)


def _missed(fit: Mapping[str, Any]) -> list[FitRemark]:
    """Return the remark on the measurements that a fit does not meet, if there are any."""
    from eclsim.identification.verdict import Aspect

    reasons = _about_outputs(fit, Aspect.AGREEMENT)
    if not reasons:
        return []
    names = _with_followers([reason["about"] for reason in reasons])
    return [FitRemark(_sentence("; ".join(reason["sentence"] for reason in reasons)), names)]


def _implausible(fit: Mapping[str, Any]) -> list[FitRemark]:
    """Return remarks on implausible outputs of the fitted patient, and those that depend on them."""
    from eclsim.identification.verdict import Aspect

    by_names: dict[tuple[str, ...], list[str]] = {}
    for reason in _about_outputs(fit, Aspect.PLAUSIBILITY):
        name = reason["about"]
        own = next((names for names in _OF_VENTRICLE if name in names), ())
        by_names.setdefault(own or _with_followers([name]), []).append(reason["sentence"])
    alone = [FitRemark(_sentence("; ".join(said)), names) for names, said in by_names.items()]
    if len(alone) <= MOST_IMPLAUSIBLE:
        return alone
    first, rest = alone[: MOST_IMPLAUSIBLE - 1], alone[MOST_IMPLAUSIBLE - 1 :]
    names = tuple(dict.fromkeys(name for remark in rest for name in remark.outputs))
    return [*first, FitRemark(" ".join(remark.sentence for remark in rest), names)]


def _about_outputs(fit: Mapping[str, Any], aspect: str) -> list[Mapping[str, str]]:
    """Return the doubts of a verdict about single outputs."""
    reasons = (fit.get("verdict") or {}).get("reasons") or ()
    return [
        r for r in reasons
        if r.get("aspect") == aspect and r["level"] != "good" and find_output(r["about"]) is not None
    ]  # fmt: skip


def judged_again(remarks: Iterable[FitRemark], fit: Mapping[str, Any]) -> tuple[FitRemark, ...]:
    """Return the remarks with the first reason of a later verdict; that on outputs stays."""
    why = _first_reason(fit)
    return (*([FitRemark(why[:LONGEST_REMARK])] if why else []), *(r for r in remarks if r.outputs))


def reason_of(state: PageState) -> str:
    """Return the first reason of the verdict on the patient's fit; empty if it is unknown."""
    return next((remark.sentence for remark in state.start.remarks if not remark.outputs), "")


def with_remarks(beat: Beat, state: PageState) -> Beat:
    """Return a beat of a fitted patient, turned or not, with cautions on what the fit left open."""
    about = [remark for remark in state.start.remarks if remark.outputs]
    if not about:
        return beat
    found = []
    for sentence, outputs in about:
        said = text("remark_at_fit", remark=sentence) if state.changed else sentence
        found.append(Finding.without_limit(CAUTION, "", 0.0, said, *outputs))
    return replace(beat, findings=tuple(gravest_first([*beat.findings, *found])))


def _first_reason(fit: Mapping[str, Any]) -> str:
    """Return the first reason of a verdict, without the advice after it."""
    reasons = (fit.get("verdict") or {}).get("reasons") or ()
    return with_minus(in_page_words(str(reasons[0]["sentence"])).partition("; ")[0]) if reasons else ""


def _sentence(reason: str) -> str:
    """Return a reason as a sentence of the fit that is now in use."""
    return text("remark_of_fit", reason=in_page_words(reason))


def _value_and_interval(name: str, cell: Mapping[str, Any]) -> str:
    low, high, value = (cell.get(key) for key in ("lower", "upper", "simulated"))
    number, known = "" if value is None else f"{value:.3g}", find_output(name)
    if low is None or high is None:
        return with_minus(number)
    unit = known.unit if known else ""
    return with_minus(text("remark_interval", value=number, low=low, high=high, unit=unit)).replace(" )", ")")


def _with_followers(names: Sequence[str]) -> tuple[str, ...]:
    """Return outputs with the other names by which they are shown, and those that follow from them."""
    first = [first_name(name) for name in names]
    return tuple(dict.fromkeys([*first, *names, *(one for name in names for one in FOLLOWING.get(name, ()))]))
