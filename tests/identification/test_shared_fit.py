"""Data points of one patient with parameters in common: the joint search, and what it says of each point."""

from dataclasses import replace

import numpy as np
import pytest

from eclsim.cases.case import Case, Measurements, Patient
from eclsim.cases.cohort import CohortPoint
from eclsim.cases.sections import Gas
from eclsim.execution import Distribution
from eclsim.identification.cohort import fit_cohort, patients_of_several_circuits
from eclsim.identification.multi_start import MultiStart, refine_shared
from eclsim.identification.objective import Box, Objective, SharedObjective, Target
from eclsim.identification.settings import FitSettings
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate
from eclsim.parameters.thiel2025 import BOUNDS

MEASURED = ("SP", "DP", "MAP", "MPAP", "CO")
TRUTH = ({"Csart": 1.4, "Rmc": 0.8}, {"Csart": 1.4, "Rmc": 0.5})


@pytest.fixture(scope="module")
def cases() -> list[Case]:
    """Two measurements of one patient whose resistance has changed and whose compliance has not."""
    made = []
    for rate, true in zip((80, 95), TRUTH, strict=True):
        patient = Patient(id="T", sex="male", age_years=50, heart_rate_bpm=rate)
        beat = simulate(model_of(Case(patient=patient, parameters=true)))
        made.append(Case(patient=patient, measurements=Measurements(**{n: float(beat[n]) for n in MEASURED})))
    return made


@pytest.fixture(scope="module")
def objective(cases: list[Case]) -> Objective:
    targets = []
    for case in cases:
        assert case.measurements is not None
        measured = {n: getattr(case.measurements, n) for n in MEASURED}
        targets.append(Target(model_of(case), measured, measured))
    return Objective(targets, ("Csart", "Rmc"))


@pytest.fixture(scope="module")
def box() -> Box:
    return Box.of({n: BOUNDS[n] for n in ("Csart", "Rmc")})


def test_joint_residuals_and_derivatives_are_those_of_the_points(objective: Objective, box: Box):
    joint = SharedObjective(objective, [0])
    x = np.log([[1.2, 0.7, 0.6]])
    assert joint.box(box).names == ("Csart", "Rmc of point 1", "Rmc of point 2")
    result = joint.evaluate(np.zeros(1, dtype=int), x)
    single = objective.evaluate(np.arange(2), np.log([[1.2, 0.7], [1.2, 0.6]]))
    np.testing.assert_allclose(result.residuals.ravel(), single.residuals.ravel())
    jacobian = joint.linearise(result, [0], x)[0][0]
    step = np.array([[1e-4, 0.0, 0.0]])
    ends = [joint.evaluate(np.zeros(1, dtype=int), x + s).outputs[0] for s in (step, -step)]
    np.testing.assert_allclose(jacobian[:, 0], (ends[0] - ends[1]) / 2e-4, atol=0.5)
    height = len(objective.outputs)
    assert np.all(jacobian[:height, 2] == 0.0)
    assert np.all(jacobian[height:, 1] == 0.0)


def test_what_is_shared_is_found_together(objective: Objective, box: Box):
    own = np.log([[1.1, 0.8], [1.9, 0.5]])
    joint, result = refine_shared(objective, box, [0], own)
    np.testing.assert_allclose(np.exp(joint.rows(result.x)), [[1.4, 0.8], [1.4, 0.5]], rtol=2e-3)


def test_patients_whose_points_have_different_circuits_are_known(cases: list[Case]):
    gas = cases[0].model_copy(update={"gas": Gas()})
    points = [
        CohortPoint(who, str(k), line, case)
        for line, (who, k, case) in enumerate(
            (("A", 1, cases[0]), ("B", 1, cases[0]), ("A", 2, gas), ("B", 2, cases[1])), start=2
        )
    ]
    assert patients_of_several_circuits(points) == {"A": [2, 4]}


@pytest.mark.slow
def test_a_cohort_shares_within_a_patient_only(cases: list[Case], tmp_path):
    points = [CohortPoint(who, str(k), k, c) for who in "AB" for k, c in enumerate(cases)]
    quick = MultiStart(points_per_parameter=10, refined_share=0.2, round_size=4, rediscoveries=2)
    settings = FitSettings(("Rmc",), multi_start=quick, shared=("Csart",))
    with Distribution().running() as executor:
        results = fit_cohort(points, settings, digest="abc", folder=tmp_path, executor=executor)
    assert [r["id"] for r in results] == ["A/0", "A/1", "B/0", "B/1"]
    values = [r["parameters"]["Csart"]["value"] for r in results]
    assert values[0] == values[1]
    assert values[0] == pytest.approx(1.4, rel=5e-3)
    assert results[0]["parameters"]["Rmc"]["value"] != results[1]["parameters"]["Rmc"]["value"]
    single = replace(settings, shared=())
    assert single.as_object() != settings.as_object()
