"""Terminal text of posteriors: parameters and predictions with intervals, and whether to trust them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from eclsim.cases.fit_mark import untrusted
from eclsim.cases.sections import MEASURED_GASES
from eclsim.identification.quantities import unit_of, unit_of_parameter
from eclsim.outputs.alarms import IMPOSSIBLE_BEAT
from eclsim.reporting.numbers import dashed, text_table

Data = Mapping[str, Any]
"""Part of a JSON file."""


def posterior_text(content: Data) -> str:
    """Text of parameters and predictions with intervals, and whether to trust each of them."""
    lines = [
        "",
        f"{content['kind']}, {_quality(content)}, prior {content['prior']}, {content['seconds']:.0f} s",
        *_doubted(content["verdict"], content["doubts"]),
        *(f"  - {note}" for note in content.get("notes", ())),
    ]
    chains = content["method"] == "nuts"
    shown = ("median", "lower", "upper", *(("r_hat", "effective_bulk", "effective_tail") if chains else ()))
    rows = [
        (n, unit_of_parameter(n), *(dashed(p[q]) for q in shown)) for n, p in content["parameters"].items()
    ]
    more = ("R-hat", "effective draws", "in the tails") if chains else ()
    head = ("parameter", "unit", "median", "5 %", "95 %", *more)
    lines.append(text_table(head, rows, range(2, len(head))))
    for prediction in content["predictions"]:
        lines += ["", *_prediction(content, prediction)]
    with_gases = not {*MEASURED_GASES}.isdisjoint(content["uncertainties"])
    gases = " or no steady state of the gases measured" if with_gases else ""
    for counted, of, what in (
        ("weighted_draws_without_steady_beat", "weighted_draws", "weighted draws"),
        ("evaluations_without_steady_beat", "evaluations", "points that the chains tried"),
    ):
        if content[counted]:
            share = f"{content[counted]} of the {content[of]} {what}"
            lines.append(f"{share} have no steady heartbeat{gases}: excluded as impossible")
    return "\n".join(lines)


def _quality(content: Data) -> str:
    """Number of draws, or effective number and Pareto k of weighted draws, as text."""
    if content["method"] != "importance":
        return f"{content['draws']} draws"
    shape = "not known" if content["pareto_k"] is None else f"{content['pareto_k']:.2f}"
    return f"{content['effective_draws']:.0f} effective draws, Pareto k {shape}"


def _prediction(content: Data, prediction: Data) -> Iterator[str]:
    yield f"{prediction['settings']}: {content['kind']}, without the noise of a measurement"
    verdict = content["verdict"] or ("NOT TO BE TRUSTED" if prediction["doubts"] else "")
    yield from _doubted(verdict, prediction["doubts"])
    quantiles = ("median", "lower", "upper")
    rows = [(n, unit_of(n), *(dashed(p[q]) for q in quantiles)) for n, p in prediction["outputs"].items()]
    yield text_table(("output", "unit", "median", "5 %", "95 %"), rows, range(2, 5))
    if without := prediction["draws_without_steady_beat"]:
        yield f"{without} of {prediction['draws']} draws have no steady heartbeat there and are not counted"
    if without := prediction.get("draws_impossible"):
        yield f"{without} of {prediction['draws']} draws are beats {IMPOSSIBLE_BEAT} and are not counted"
    if without := prediction.get("draws_without_steady_gases"):
        yield f"{without} of {prediction['draws']} draws have no steady gas state there (excluded from gases)"
    warnings = prediction.get("warnings", ())
    shown_above = untrusted(warnings)
    yield from (f"At the medians of the draws: {each}" for each in warnings if each not in shown_above)


def _doubted(verdict: str, doubts: Sequence[str]) -> list[str]:
    return [f"{verdict}:", *(f"  {doubt}" for doubt in doubts)] if doubts else []
