"""What `eclsim identify` does with --posterior and --predict."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from eclsim.cli.messages import fail, say

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.identification.fit import FitResult
    from eclsim.identification.settings import FitSettings


CHAINS = (4, 600, 1500)
"""Chains, draws thrown away and draws kept where the options are left out."""


@dataclass(frozen=True, slots=True)
class PosteriorRequest:
    """The options, as they were written."""

    sample: bool
    method: Literal["nuts", "importance"]
    predict: tuple[str, ...]
    predict_with: Literal["importance", "gaussian"]
    prior: Literal["log-uniform", "log-normal"]
    chains: int
    warmup: int
    draws: int

    @property
    def wanted(self) -> bool:
        """Whether there is anything to do."""
        return self.sample or bool(self.predict)

    def check_in_vain(self) -> None:
        """Options that nothing would read are refused; left at their defaults they say nothing."""
        wrong = []
        if (self.chains, self.warmup, self.draws) != CHAINS and not (self.sample and self.method == "nuts"):
            wrong.append("--chains, --warmup, --draws: of --posterior with --posterior-method nuts")
        if self.method != "nuts" and not self.sample:
            wrong.append("--posterior-method: without --posterior nothing is sampled by it")
        if self.prior != "log-uniform" and not self.wanted:
            wrong.append("--prior: of --posterior and --predict; the fit itself has none")
        if self.predict_with != "importance" and (self.sample or not self.predict):
            wrong.append("--predict-with: of --predict without --posterior")
        if wrong:
            fail(*wrong)

    def cases(self, file: str, settings: Sequence[str], free: Collection[str]) -> list[tuple[str, Case]]:
        """The case at the settings of every --predict; all mistakes are told before anything is computed."""
        from eclsim.cases import CaseError, read_case
        from eclsim.cases.settings import parse_settings

        if self.sample and self.method == "nuts" and find_spec("numpyro") is None:
            fail("--posterior: needs NumPyro: pip install 'eclsim[bayes]', or --posterior-method importance")
        found, wrong = [], []
        for written in self.predict:
            changes = [part.strip() for part in written.split(",") if part.strip()]
            if not changes:
                wrong.append("--predict: empty; allowed: KEY=VALUE,... such as ecmo.speed_rpm=4000")
                continue
            try:
                case = read_case(file, [*settings, *changes]).case
                wrong += [
                    f"--predict {written}: {name} is free, so every draw has its own; predict a setting, or "
                    "fix it with --bounds"
                    for section, name in parse_settings(changes)
                    if section == "parameters" and name in free
                ]
                if case.ecmo is not None and case.ecmo.flow_l_min is not None:
                    wrong.append(f"--predict {written}: a target flow; predictions hold ecmo.speed_rpm")
                found.append((written, case))
            except CaseError as error:
                wrong += [f"--predict: {mistake.at('', None)}" for mistake in error.mistakes]
        if wrong:
            fail(*wrong)
        return found


def add_posterior(
    request: PosteriorRequest,
    fit: FitResult,
    predictions: Sequence[tuple[str, Case]],
    settings: FitSettings,
    folder: Path,
    report: Callable[[str], None] | None,
) -> dict[str, Any]:
    """Sample, write the files, and hand back what belongs into the JSON."""
    from eclsim.identification.nuts import Sampling
    from eclsim.identification.posterior import PosteriorSettings, as_object, sample_posterior
    from eclsim.identification.posterior_files import write_posterior

    chosen = PosteriorSettings(
        method=request.method if request.sample else request.predict_with,
        prior=request.prior,
        uncertainties=settings.uncertainties,
        sampling=Sampling(request.chains, request.warmup, request.draws, settings.multi_start.seed),
        policy=settings.policy,
    )
    fitted = {n: v for n, v in fit.case.parameters.items() if n in settings.parameters}
    cases = [
        (written, case.model_copy(update={"parameters": {**case.parameters, **fitted}}))
        for written, case in predictions
    ]
    result = sample_posterior(fit, chosen, cases, report)
    write_posterior(folder / "posterior", result)
    say(f"posterior: {folder / 'posterior'}")
    return as_object(result)


def posterior_table(content: Mapping[str, Any]) -> str:
    """Parameters and predictions with intervals, and beside each of them whether to trust it."""
    lines = [
        "",
        f"{content['kind']}, {_quality(content)}, prior {content['prior']}, {content['seconds']:.0f} s",
    ]
    lines += [*_verdict(content["verdict"], content["doubts"]), _parameters(content)]
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
    from eclsim.cli.tables import columns

    of_chains = ("r_hat", "effective_bulk", "effective_tail") if content["method"] == "nuts" else ()
    rows = [
        (n, *(_text(p[q]) for q in ("median", "lower", "upper", *of_chains)))
        for n, p in content["parameters"].items()
    ]
    more = ("R-hat", "effective draws", "in the tails") if of_chains else ()
    head = ("parameter", "median", "5 %", "95 %", *more)
    return columns(head, rows, range(1, len(head)))


def _prediction(content: Mapping[str, Any], prediction: Mapping[str, Any]) -> Iterator[str]:
    from eclsim.cli.tables import columns

    yield f"{prediction['settings']}: {content['kind']}, without the noise of a measurement"
    verdict = content["verdict"] or ("NOT TO BE TRUSTED" if prediction["doubts"] else "")
    yield from _verdict(verdict, prediction["doubts"])
    rows = [
        (n, _text(p["median"]), _text(p["lower"]), _text(p["upper"]))
        for n, p in prediction["outputs"].items()
    ]
    yield columns(("output", "median", "5 %", "95 %"), rows, range(1, 4))
    lost = prediction["draws_without_steady_beat"]
    if lost:
        yield f"{lost} of {prediction['draws']} draws have no steady heartbeat there and are not counted"


def _verdict(verdict: str, doubts: Sequence[str]) -> list[str]:
    return [f"{verdict}:", *(f"  {doubt}" for doubt in doubts)] if doubts else []


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
