"""The full multi-start on points of the synthetic cohort, whose true parameters are known."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from eclsim.cases.cohort import read_cohort
from eclsim.identification.fit import fit_cases
from eclsim.identification.least_squares import EXACT, polish, refine
from eclsim.identification.multi_start import MultiStart
from eclsim.identification.objective import Box, Objective, Target
from eclsim.identification.settings import FitSettings, checked_fit
from eclsim.orbit.model import model_of

EXAMPLES = Path(__file__).parents[2] / "examples"
TWINS = Path(__file__).parents[2] / "benchmarks" / "data"
OUTPUTS = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO", "PF")
CHOSEN = ("P01/2",)


def truth() -> dict[str, dict[str, float]]:
    with (EXAMPLES / "synthetic_cohort_truth.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    names = [name for name in rows[0] if name not in ("patient_id", "measurement")]
    return {f"{r['patient_id']}/{r['measurement']}": {n: float(r[n]) for n in names} for r in rows}


def test_the_example_cohort_is_read_whole():
    reading = read_cohort(EXAMPLES / "synthetic_cohort.csv")
    assert len(reading.points) == 30
    assert not reading.refused
    assert {p.name for p in reading.points} == set(truth())


@pytest.mark.slow
def test_a_noise_free_point_is_reproduced():
    known = truth()
    cases = []
    for point in read_cohort(EXAMPLES / "synthetic_cohort.csv").points:
        if point.name in CHOSEN:
            exact = {n: known[point.name][f"{n}_noise_free"] for n in OUTPUTS}
            assert point.case.measurements is not None
            measured = point.case.measurements.model_copy(update=exact)
            cases.append((point.name, point.case.model_copy(update={"measurements": measured})))
    for fit in fit_cases(cases):
        assert fit.status == "fitted"
        assert fit.optimum.agreeing >= 2, fit.name
        for name, value in fit.measured.items():
            assert fit.simulated[name] == pytest.approx(value, rel=0.01), (fit.name, name)


@pytest.mark.slow
def test_twins_are_found_again_and_what_is_called_identifiable_is_right():
    """Outputs by the adaptive path; the full count is in benchmarks/identification_twins.py."""
    points = read_cohort(TWINS / "identification_twins.csv").points[:2]
    with (TWINS / "identification_twins_truth.csv").open(encoding="utf-8", newline="") as file:
        known = {row["patient_id"]: row for row in csv.DictReader(file)}
    search = MultiStart(points_per_parameter=100, refined_share=0.1)
    for point, fit in zip(
        points, fit_cases([(p.name, p.case) for p in points], FitSettings(multi_start=search)), strict=True
    ):
        for name, value in fit.measured.items():
            assert fit.simulated[name] == pytest.approx(value, rel=0.01), (fit.name, name)
        called = {n: p.value for n, p in fit.parameters.items() if p.identifiable}
        assert called, fit.name
        for name, value in called.items():
            assert value == pytest.approx(float(known[point.patient_id][name]), rel=0.05), (fit.name, name)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["P01/1", "P07/1"])
def test_seven_parameters_end_where_scipys_trust_region_does_or_lower(name: str):
    """From the same start, on the same grid, with the same derivatives."""
    case = next(p.case for p in read_cohort(EXAMPLES / "synthetic_cohort.csv").points if p.name == name)
    checked = checked_fit(case, FitSettings())
    box = Box.of(checked.free)
    objective = Objective([Target(model_of(case), checked.targets, checked.targets)], box.names)
    here, exact = np.zeros(1, dtype=int), replace(EXACT, resolution=1)

    def residuals(x: np.ndarray) -> np.ndarray:
        return objective.evaluate(here, x[None], exact.orbits, 1).residuals[0]

    def jacobian(x: np.ndarray) -> np.ndarray:
        result = objective.evaluate(here, x[None], exact.orbits, 1)
        return objective.linearise(result, [0], x[None])[0][0] * objective.weights[0][:, None]

    theirs = least_squares(
        residuals, box.start, jacobian, bounds=(box.lower, box.upper), xtol=1e-12, ftol=1e-12, gtol=1e-12,
        max_nfev=200,
    )  # fmt: skip
    ours = polish(objective, 0, refine(objective, here, box.start[None], box, exact), box, exact)
    assert ours.costs[0] <= 2.0 * theirs.cost * (1.0 + 1e-6)
