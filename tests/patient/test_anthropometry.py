import pytest

from eclsim.patient.anthropometry import body_mass_index, mean_height_weight, total_blood_volume_ml


def test_means_by_sex_and_age():
    assert mean_height_weight("female", 18) == (167.6, 62.6)
    assert mean_height_weight("male", 42.5) == (180.2, 88.1)
    assert mean_height_weight("male", 75) == (174.6, 81.0)
    assert mean_height_weight("female", 100) == (162.6, 67.9)


@pytest.mark.parametrize("age", [17.9, 100.1, float("nan")])
def test_ages_outside_the_table_are_refused(age):
    with pytest.raises(ValueError, match="18 to 100"):
        mean_height_weight("male", age)


def test_blood_volume_of_the_published_patient():
    # 85 - 0.4 * 70 = 57 mL/kg at a body mass index of 22.04 kg/m^2.
    assert total_blood_volume_ml("female", 70, 165, 60) == pytest.approx(3417.0, abs=0.5)
    assert body_mass_index(165, 60) == pytest.approx(22.04, abs=0.005)


def test_blood_volume_falls_with_age_and_is_larger_in_men():
    volumes = [total_blood_volume_ml("female", age, 165, 60) for age in (20, 50, 80)]
    assert volumes == sorted(volumes, reverse=True)
    assert total_blood_volume_ml("male", 50, 165, 60) > volumes[1]
