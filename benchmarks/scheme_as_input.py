"""The CRRT connection scheme as a categorical input, and what drawing it over the finished design does.

    python benchmarks/scheme_as_input.py CASE.toml [--samples 512] [--policy as_published] [--drawn]

Prints first and total order of the groups R, C, L, E, the pump speed and the scheme for a case with ECMO and
CRRT. With --drawn the scheme of every run is drawn anew over the finished Saltelli matrix, as the published
code did.
"""

import argparse
from dataclasses import dataclass

import numpy as np

from eclsim.cases import read_case
from eclsim.sensitivity.analysis import conclude, plan_analysis
from eclsim.sensitivity.case_inputs import ACCESS, RETURN, SCHEME
from eclsim.sensitivity.evaluation import Evaluated, evaluate_block
from eclsim.sensitivity.inputs import Categorical


@dataclass(frozen=True)
class DrawnOver:
    """An evaluator that throws the choices of the design away and draws its own."""

    evaluator: object
    choices: tuple[Categorical, ...]
    random: np.random.Generator

    def __call__(self, settings, count: int) -> Evaluated:
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
    plan = plan_analysis(
        read_case(chosen.case).case,
        samples=chosen.samples,
        groups=("R", "C", "L", "E"),
        include=("ecmo.speed_rpm", *((ACCESS, RETURN) if chosen.sites else (SCHEME,))),
        policy=chosen.policy,
    )
    evaluator, design = plan.evaluator, plan.design
    if chosen.drawn:
        choices = tuple(i for i in design.inputs if isinstance(i, Categorical))
        evaluator = DrawnOver(plan.evaluator, choices, np.random.default_rng(7))
    parts = [evaluate_block(design, evaluator, b) for b in range(design.blocks)]
    names = ("values", "status", "beats", "residual")
    found = Evaluated(*(np.concatenate([getattr(p, n) for p in parts]) for n in names))
    result = conclude(design, plan.evaluator.outputs, found).indices
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
