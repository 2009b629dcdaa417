import pytest

from eclsim.patient.anthropometry import (
    body_mass_index,
    body_surface,
    body_water_ml,
    delivery_limits,
    mean_height_weight,
    oxygen_consumption,
    total_blood_volume_ml,
)

AGES = (18, 20, 25, 30, 35, 40, 45, 50, 55, 60, 65, 70, 75)
GERMANY = {
    "female": (
        (167.6, 167.5, 167.3, 167.2, 167.3, 167.5, 167.1, 167.1, 166.9, 165.4, 164.5, 163.9, 162.6),
        (62.6, 64.1, 66.0, 68.2, 68.3, 69.3, 70.9, 71.0, 71.5, 71.2, 70.9, 71.0, 67.9),
    ),
    "male": (
        (181.7, 181.4, 180.4, 180.4, 180.2, 180.2, 180.2, 179.9, 179.4, 178.4, 177.4, 176.0, 174.6),
        (77.9, 80.5, 83.3, 85.6, 86.7, 88.1, 89.8, 89.0, 88.8, 87.9, 86.7, 85.3, 81.0),
    ),
}
"""Heights [cm] and weights [kg] from these ages on, of 2021, by column."""


@pytest.mark.parametrize("sex", GERMANY)
def test_every_age_has_the_means_of_its_group(sex):
    ends = [*AGES[1:], 101]
    for first, end, height, weight in zip(AGES, ends, *GERMANY[sex], strict=True):
        for age in (first, end - 0.01 if end <= 100 else 100):
            assert mean_height_weight(sex, age) == (height, weight)


def test_surface_consumption_and_water_by_their_regressions():
    assert body_surface(180.0, 80.0) == pytest.approx(2.0)
    assert oxygen_consumption(180.0, 80.0) == pytest.approx(252.0)
    # 2.447 - 0.09516 x 60 + 0.1074 x 180 + 0.3362 x 80, and -2.097 + 0.1069 x 165 + 0.2466 x 60 litres
    assert body_water_ml("male", 60, 180.0, 80.0) == pytest.approx(42965.4)
    assert body_water_ml("female", 60, 165.0, 60.0) == pytest.approx(30337.5)
    # (90 - 0.4 x 60) / sqrt(24.691 / 22) x 80
    assert total_blood_volume_ml("male", 60, 180.0, 80.0) == pytest.approx(4983.9, abs=0.1)


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


def test_limits_of_oxygen_delivery_are_those_of_the_size():
    """sqrt(195 x 120 / 3600) = 2.5495 m2; at the size of the table there are no others."""
    assert delivery_limits(195.0, 120.0) == (714.0, 427.0)
    assert delivery_limits(174.0, 67.0) is None
    assert delivery_limits(150.0, 45.0) == (383.0, 229.0), "a small patient needs less than the table says"


def test_critical_delivery_goes_with_consumption_in_every_build():
    """At 165 cm and 190 kg the critical limit lay above the low one; at 175 cm and 45 kg nearly at VO2."""
    for height, weight in ((165.0, 190.0), (165.0, 130.0), (175.0, 45.0)):
        low, critical = delivery_limits(height, weight) or (0.0, 0.0)
        consumed = oxygen_consumption(height, weight)
        assert low / consumed == pytest.approx(280.0 / 126.0, rel=0.01)
        assert critical / consumed == pytest.approx(1.33, rel=0.01)
