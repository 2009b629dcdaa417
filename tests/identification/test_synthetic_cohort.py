"""The full multi-start on points of the synthetic cohort, whose true parameters are known."""

import csv
from pathlib import Path

import pytest

from eclsim.patients.cohort import read_cohort
from eclsim.studies.identification import fit_cases

EXAMPLES = Path(__file__).parents[2] / "examples"
OUTPUTS = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO", "PF")
CHOSEN = ("P02/2",)


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
