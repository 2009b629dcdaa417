"""The CRRT connection scheme as a categorical input, and the effect of drawing it over the finished design.

    python benchmarks/scheme_as_input.py CASE.toml [--samples 512] [--policy as_published] [--drawn]

Prints first and total order of the groups R, C, L, E, the pump speed and the scheme for a case with ECMO and
CRRT. With --drawn the scheme of every run is drawn anew over the finished Saltelli matrix, as the published
code did.
"""

import argparse
from dataclasses import dataclass, replace

import numpy as np

from eclsim.cases import read_case
from eclsim.sensitivity.analysis import SobolSettings, plan_analysis
from eclsim.sensitivity.inputs import Categorical
from eclsim.sensitivity.results import indices_of_runs
from eclsim.sensitivity.runs import Evaluator, Runs


@dataclass(frozen=True)
class DrawnOver:
    """An evaluator that ignores the schemes of the design and draws its own."""

    evaluator: Evaluator
    choices: tuple[Categorical, ...]
    random: np.random.Generator

    def __call__(self, settings, count: int) -> Runs:
        for choice in self.choices:
            settings = settings | choice.settings(self.random.random(count))
        return self.evaluator(settings, count)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("case")
    parser.add_argument("--samples", type=int, default=512)
    parser.add_argument("--policy", default="as_published")
    parser.add_argument("--drawn", action="store_true")
    parser.add_argument("--sites", action="store_true", help="access and return as two inputs")
    chosen = parser.parse_args()
    settings = SobolSettings(
        samples=chosen.samples,
        groups=("R", "C", "L", "E"),
        include=(
            "ecmo.speed_rpm",
            *(("crrt.access_site", "crrt.return_site") if chosen.sites else ("crrt.scheme",)),
        ),
        volume_policy=chosen.policy,
    )
    plan = plan_analysis(read_case(chosen.case).case, settings)
    if chosen.drawn:
        choices = tuple(i for i in plan.design.inputs if isinstance(i, Categorical))
        drawn = DrawnOver(plan.evaluator, choices, np.random.default_rng(7))
        plan = replace(plan, evaluator=drawn)
    runs = Runs.joined([plan.block(number) for number in range(plan.design.blocks)])
    result = indices_of_runs(plan.design, plan.evaluator.outputs, runs).indices
    print(
        f"{chosen.policy}, {result.evaluations} runs, {len(result.failed)} failed, drawn over: {chosen.drawn}"
    )
    print("output  " + "".join(f"{f:>22}" for f in result.factors))
    for k, output in enumerate(result.outputs):
        e = result.estimates
        pairs = zip(e.S1[k], e.S1_conf[k], e.ST[k], e.ST_conf[k], strict=True)
        print(f"{output:8}" + "".join(f"{a:7.3f}±{b:.3f}{c:7.3f}±{d:.3f}" for a, b, c, d in pairs))
    if result.estimates.S2 is not None:
        for k, output in enumerate(result.outputs):
            pairs = [
                (
                    result.estimates.S2[k, i, j],
                    result.estimates.S2_conf[k, i, j],
                    result.factors[i],
                    result.factors[j],
                )
                for i, j in zip(*np.triu_indices(len(result.factors), 1), strict=True)
            ]
            strongest = sorted(pairs, reverse=True)[:3]
            print(output, "; ".join(f"{a} x {b} {s:.3f}±{c:.3f}" for s, c, a, b in strongest))


if __name__ == "__main__":
    main()
