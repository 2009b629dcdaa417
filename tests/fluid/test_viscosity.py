"""Viscosity against haematocrit, and resistances that follow it."""

import numpy as np
import pytest

from eclsim.cases.reading import read_mapping
from eclsim.fluid.viscosity import relative_viscosity
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.results import derivatives
from eclsim.outputs.steady_beat import steady_beat
from eclsim.parameters.fluid import HAEMATOCRIT

CASE = {
    "format": 1,
    "patient": {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75},
    "ecmo": {
        "pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult", "drainage_site": "ra",
        "drainage_cannula": "venous", "drainage_fr": 21, "return_site": "ao", "return_cannula": "arterial",
        "return_fr": 17,
    },
    "crrt": {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy"},
}  # fmt: skip


def model(**sections):
    return model_of(read_mapping(CASE | sections).case)


@pytest.mark.parametrize(
    ("haematocrit", "diameter", "expected"),
    # At 0.45 the formula is its own constant: 3.2 in wide tubes, with the narrow term at 25 um.
    [(0.0, 1e3, 1.0), (0.45, 1e4, 3.2), (0.45, 25.0, 3.2 - 2.44 * np.exp(-0.06 * 25.0**0.645))],
)
def test_the_published_formula_at_its_fixed_points(haematocrit, diameter, expected):
    assert relative_viscosity(haematocrit, diameter) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("haematocrit", "diameter"), [(0.3, 4.0), (0.6, 8.0), (0.3, 25.0), (0.6, 100.0)])
def test_the_published_formula_term_by_term(haematocrit, diameter):
    at_45 = 220.0 / np.e ** (1.3 * diameter) + 3.2 - 2.44 / np.e ** (0.06 * diameter**0.645)
    plug = 1e11 / (1e11 + diameter**12)
    shape = plug - (1.0 - plug) * (0.8 + 1.0 / np.e ** (0.075 * diameter))
    share = (1.0 - (1.0 - haematocrit) ** shape) / (1.0 - 0.55**shape)
    assert relative_viscosity(haematocrit, diameter) == pytest.approx(1.0 + (at_45 - 1.0) * share, rel=1e-9)


def test_narrow_vessels_thicken_less():
    wide, narrow = (relative_viscosity(0.5, d) / relative_viscosity(0.3, d) for d in (1e3, 25.0))
    assert 1.0 < narrow < wide


@pytest.mark.slow
def test_at_its_own_haematocrit_a_patient_keeps_its_numbers():
    """Factors are 1; the program is another one, whose products the compiler may order in another way.

    Forty copies of the patient, apart by 2e-16 in every parameter, spread by up to 1.7e-13: no two programs
    can be asked for more.
    """
    plain, followed = (steady_beat(Batch.of(one)) for one in (model(), model(fluid={"haematocrit": 0.37})))
    assert HAEMATOCRIT in model(fluid={}).circuit.parameter_names()
    for name in plain.names:
        np.testing.assert_allclose(plain.output(name), followed.output(name), rtol=1e-12)


@pytest.mark.slow
def test_thinner_blood_drops_less_pressure_and_derivatives_are_exact():
    patient = model(fluid={})
    names = ("MAP", "PF", "CO", "oxygenator_pressure_drop", "crrt_access_pressure")
    low, high = (
        steady_beat(Batch.of(patient.with_values({HAEMATOCRIT: h})), names).outputs() for h in (0.298, 0.302)
    )
    assert low["MAP"] < high["MAP"]
    assert low["PF"] > high["PF"]
    exact = derivatives(patient, names, (HAEMATOCRIT,)).values[:, 0]
    np.testing.assert_allclose(exact, [(high[name] - low[name]) / 0.004 for name in names], rtol=2e-3)
