"""What `eclsim identify` does with --posterior and --predict."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from eclsim.cli.messages import fail, say

if TYPE_CHECKING:
    from eclsim.patients.case import Case
    from eclsim.studies.fit_settings import FitSettings
    from eclsim.studies.identification import Fit


@dataclass(frozen=True, slots=True)
class PosteriorRequest:
    """The options, as they were written."""

    sample: bool
    method: Literal["nuts", "importance"]
    predict: tuple[str, ...]
    prior: Literal["log-uniform", "log-normal"]
    chains: int
    warmup: int
    draws: int

    @property
    def wanted(self) -> bool:
        """Whether there is anything to do."""
        return self.sample or bool(self.predict)

    def cases(self, file: str, settings: Sequence[str]) -> list[tuple[str, Case]]:
        """The case at the settings of every --predict; all mistakes are told before anything is computed."""
        from eclsim.patients import CaseError, read_case

        if self.sample and self.method == "nuts" and find_spec("numpyro") is None:
            fail("--posterior: needs NumPyro: pip install 'eclsim[bayes]', or --posterior-method importance")
        found, wrong = [], []
        for written in self.predict:
            changes = [part.strip() for part in written.split(",") if part.strip()]
            if not changes:
                wrong.append("--predict: empty; allowed: KEY=VALUE,... such as ecmo.speed_rpm=4000")
                continue
            try:
                found.append((written, read_case(file, [*settings, *changes]).case))
            except CaseError as error:
                wrong += [f"--predict {mistake}" for mistake in error.mistakes]
        if wrong:
            fail(*wrong)
        return found


def add_posterior(
    request: PosteriorRequest,
    fit: Fit,
    predictions: Sequence[tuple[str, Case]],
    settings: FitSettings,
    folder: Path,
    report: Callable[[str], None] | None,
) -> dict[str, Any]:
    """Sample, write the files, and hand back what belongs into the JSON."""
    from eclsim.report.posterior_files import write_posterior
    from eclsim.studies.posterior import PosteriorSettings, as_object, sample_posterior
    from eclsim.uncertainty.nuts import Sampling

    chosen = PosteriorSettings(
        method=request.method if request.sample else "gaussian",
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
    """Parameters and predictions with intervals, and whether to trust them."""
    from eclsim.cli.tables import columns

    by_gaussian = content["method"] == "gaussian"
    kind = "Gaussian approximation" if by_gaussian else f"posterior ({content['method']})"
    lines = ["", f"{kind}, {content['draws']} draws, prior {content['prior']}, {content['seconds']:.0f} s"]
    if not content["trusted"]:
        lines += ["NOT TO BE TRUSTED:", *(f"  {doubt}" for doubt in content["doubts"])]
    rows = [
        (n, _text(p["median"]), _text(p["lower"]), _text(p["upper"]), _text(p.get("r_hat")),
         _text(p.get("effective_bulk")))
        for n, p in content["parameters"].items()
    ]  # fmt: skip
    lines.append(
        columns(("parameter", "median", "5 %", "95 %", "R-hat", "effective draws"), rows, range(1, 6))
    )
    for prediction in content["predictions"]:
        rows = [
            (n, _text(p["median"]), _text(p["lower"]), _text(p["upper"]), _text(p["gaussian"]["lower"]),
             _text(p["gaussian"]["upper"]))
            for n, p in prediction["outputs"].items()
        ]  # fmt: skip
        head = (prediction["settings"], "median", "5 %", "95 %", "Gaussian 5 %", "Gaussian 95 %")
        lines += ["", columns(head, rows, range(1, 6))]
        if prediction["without_steady_beat"] > 0.0:
            share = f"{100 * prediction['without_steady_beat']:.1f} %"
            lines.append(f"{share} of the draws have no steady heartbeat there and are not counted")
    return "\n".join(lines)


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
