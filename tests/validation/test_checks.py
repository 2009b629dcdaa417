"""The comparisons of `eclsim validate`: bars hold, and each of them can fail."""

from dataclasses import replace

import numpy as np
import pytest

from eclsim.validation import measurements, robustness, solvers
from eclsim.validation.reference_cases import reference_model


def names(rows):
    return [row.name for row in rows]


def test_shi_hose_scalars():
    check = solvers.shi_hose_check()
    assert len(check.rows) == 42
    assert check.missed == ()


@pytest.mark.slow
def test_derivatives_agree_with_the_published_code():
    default, finer, own = solvers.gradient_checks()
    assert len(default.rows) == len(finer.rows) == len(own.rows) == 98
    assert default.missed == ()
    assert finer.missed == ()
    assert own.missed == ()


def test_periodicity_and_volume_hold_for_one_case_of_each_kind():
    assert solvers.periodicity_check(quick=True).missed == ()
    error = solvers.volume_error(reference_model("s4_crrt_g_3425"), beats=50)
    assert 0.0 < error < 1e-12


def test_the_robustness_points_fill_the_bounds():
    points = robustness.sobol_points(256)
    for name, bounds in robustness.BOUNDS.items():
        logs = np.log(points[name] / bounds.lower) / np.log(bounds.upper / bounds.lower)
        assert logs.min() >= 0.0
        assert logs.max() <= 1.0
        assert np.histogram(logs, bins=8, range=(0.0, 1.0))[0].min() >= 28


def test_all_configurations_have_their_devices():
    groups = {
        name: {c.group for c in robustness.configuration_model(name).circuit.connections}
        for name in robustness.CONFIGURATIONS
    }
    assert groups == {
        "no device": {"patient"},
        "V-A": {"patient", "ecmo"},
        "V-V": {"patient", "ecmo"},
        "V-A + CRRT g": {"patient", "ecmo", "crrt"},
        "LVAD": {"patient", "lvad"},
        "LVAD + V-A": {"patient", "lvad", "ecmo"},
        "V-A, bronchial return, veins that collapse": {"patient", "ecmo"},
    }


@pytest.mark.slow
def test_a_sweep_finds_every_ejecting_heart_and_names_the_others():
    result = robustness.sweep("V-A", robustness.sobol_points(64))
    assert (result.ejecting & ~result.converged).sum() == 0
    assert not result.false_converged.any()
    assert not result.silent_nan.any()
    assert robustness._named(result).all()


def test_a_false_steady_beat_and_a_silent_nan_are_seen():
    one = np.ones(1)
    good = robustness.Sweep("V-A", {}, np.zeros(1, dtype=int), one, one, one, 1e-9 * one)
    assert not good.false_converged.any()
    assert replace(good, moved=1e-3 * one).false_converged.all()
    assert replace(good, moved=np.nan * one).false_converged.all()
    assert replace(good, output=np.nan * one).silent_nan.all()


def test_devices_show_what_misses():
    check = measurements.devices_check()
    assert not check.required
    assert len(check.rows) == 51
    assert sorted(names(check.missed)) == [
        "HM3 head, 6000 rpm 7.4 L/min",
        "HM3 head, 8000 rpm 10 L/min",
        "HMII head, 10000 rpm 3.93 L/min",
        "HMII head, 10000 rpm 6.63 L/min",
        "HMII head, 8000 rpm 4.64 L/min",
        "HMII head, 9000 rpm 4.32 L/min",
        "HMII head, 9000 rpm 7.21 L/min",
        "Rotaflow head, 3000 rpm 4.2 L/min",
        "arterial flow, 19 Fr 200 mmHg (Biomedicus)",
    ]


def test_healthy_adult_is_within_the_norms_but_for_three():
    check = measurements.healthy_check()
    assert len(check.rows) == 23
    assert names(check.missed) == [
        "RV systolic pressure",
        "systolic pulmonary artery pressure",
        "native cardiac output",
    ]


@pytest.mark.slow
def test_signs_of_published_effects_that_are_wrong_are_those_of_the_left_ventricle_on_ecmo():
    checks = measurements.effects_checks()
    rows = [row for check in checks for row in check.rows if row.name.endswith("sign")]
    assert len(rows) == 18
    assert [row.name for row in rows if not row.holds] == [
        "Ostadal 2015: stroke work of the left ventricle: sign",
        "Hala 2020: end-diastolic pressure of the left ventricle: sign",
        "Hala 2020: end-diastolic volume of the left ventricle: sign",
        "Hala 2020: stroke work of the left ventricle: sign",
    ]
    assert not any(row.explained for check in checks for row in check.rows)
    assert checks[0].remarks


@pytest.mark.slow
def test_what_differs_from_the_text_of_the_paper_is_explained_by_its_patients_blood_volume_but_once():
    check = measurements.paper_check()
    assert len(check.rows) == 34
    assert len(check.missed) == 8
    unexplained = [row.name for row in check.missed if not row.explained]
    assert unexplained == ["return pressure, 3425 rpm, of scheme c"]
