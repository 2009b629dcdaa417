"""Agreement of optimisers: SciPy's trust region from the same starts, and optimagic's multi-start.

    python benchmarks/identification_agreement.py [--points P01/1,P05/1,P07/1] [--starts 3] [--optimagic]

Prints, for each point of the example cohort, the sums of squares, all on the grid that the optimum needs. The
trust region gets eclsim's exact derivatives; optimagic (pip install "eclsim[optimagic]") explores and refines
with SciPy's trust region: the paper's set-up except for its derivative-free default.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from eclsim.cases.cohort import read_cohort
from eclsim.identification.least_squares import EXACT, polish, refine
from eclsim.identification.multi_start import MultiStart, identify, sobol
from eclsim.identification.objective import Box, Objective, Target
from eclsim.identification.settings import FitSettings, checked_fit
from eclsim.orbit.model import model_of

EXAMPLES = Path(__file__).parents[1] / "examples"
HERE = np.zeros(1, dtype=int)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--points", default="P01/1,P05/1,P07/1")
    options.add_argument("--starts", type=int, default=3)
    options.add_argument("--optimagic", action="store_true")
    asked = options.parse_args()
    cases = {p.name: p.case for p in read_cohort(EXAMPLES / "synthetic_cohort.csv").points}
    for name in asked.points.split(","):
        objective, box = problem(cases[name])
        print(
            json.dumps({"point": name, **compared(objective, box, asked.starts, asked.optimagic)}), flush=True
        )


def problem(case: Any) -> tuple[Objective, Box]:
    """Objective of a case, with the paper's seven parameters and weights."""
    checked = checked_fit(case, FitSettings())
    box = Box.of(checked.free)
    target = Target(model_of(case), dict(checked.targets), dict(checked.targets))
    return Objective([target], box.names), box


def functions(objective: Objective, level: int) -> tuple[Any, Any]:
    """Residuals and their exact derivatives as functions of one point."""

    def residuals(x: np.ndarray) -> np.ndarray:
        return objective.evaluate(HERE, x[None], EXACT.orbits, level).residuals[0]

    def jacobian(x: np.ndarray) -> np.ndarray:
        found = objective.evaluate(HERE, x[None], EXACT.orbits, level)
        return objective.linearise(found, [0], x[None])[0][0] * objective.weights[0][:, None]

    return residuals, jacobian


def trust_region(objective: Objective, box: Box, start: np.ndarray, level: int) -> tuple[np.ndarray, float]:
    """SciPy's optimum from a start: parameters and sum of squares."""
    residuals, jacobian = functions(objective, level)
    found = least_squares(
        residuals, start, jacobian, bounds=(box.lower, box.upper), xtol=1e-12, ftol=1e-12, gtol=1e-12,
        max_nfev=300,
    )  # fmt: skip
    return found.x, 2.0 * float(found.cost)


def compared(objective: Objective, box: Box, starts: int, with_optimagic: bool) -> dict[str, Any]:
    """Sums of squares of all methods for one point."""
    begun = time.perf_counter()
    (best,) = identify(objective, box)
    found: dict[str, Any] = {"multi_start": best.cost, "seconds": round(time.perf_counter() - begun, 1)}
    level = int(objective.resolutions(HERE, best.x[None])[0])
    _, cost = trust_region(objective, box, best.x, level)
    found["trust_region_from_our_optimum"] = cost
    begins = sobol(box, MultiStart(points_per_parameter=1))[:starts]
    rows = []
    for start in begins:
        if not np.isfinite(objective.evaluate(HERE, start[None], EXACT.orbits, level).costs[0]):
            continue
        exact = replace(EXACT, resolution=level)
        ours = polish(objective, 0, refine(objective, HERE, start[None], box, exact), box, exact)
        _, cost = trust_region(objective, box, start, level)
        rows.append(
            {"ours": float(ours.costs[0]), "trust_region": cost, "ratio": float(ours.costs[0] / cost)}
        )
    found["same_starts"] = rows
    if with_optimagic:
        found["optimagic"] = optimagic_cost(objective, box, level)
    return found


def optimagic_cost(objective: Objective, box: Box, level: int) -> dict[str, float]:
    """optimagic's TikTak with SciPy's trust region: sum of squares and seconds."""
    import optimagic as om

    residuals, jacobian = functions(objective, level)
    worst = np.full(len(objective.outputs), 10.0)

    @om.mark.least_squares
    def fun(x: np.ndarray) -> np.ndarray:
        values = residuals(x)
        return values if np.isfinite(values).all() else worst

    @om.mark.least_squares
    def jac(x: np.ndarray) -> np.ndarray:
        return jacobian(x) if np.isfinite(residuals(x)).all() else np.zeros((len(worst), len(x)))

    begun = time.perf_counter()
    found = om.minimize(
        fun, box.start, algorithm="scipy_ls_trf", jac=jac, bounds=om.Bounds(lower=box.lower, upper=box.upper),
        algo_options={"stopping_maxfun": 200},
        multistart=om.MultistartOptions(n_samples=100, stopping_maxopt=5, seed=0),
    )  # fmt: skip
    return {"cost": float(found.fun), "seconds": round(time.perf_counter() - begun, 1)}


if __name__ == "__main__":
    main()
