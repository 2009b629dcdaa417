"""The 90 % interval that a profile of chi-square gives."""

import numpy as np
import pytest

from eclsim.identification.profiles import interval_90

VALUES = np.exp(np.array([-2.0, -0.6, -0.33, -0.14, 0.0, 0.14, 0.33, 0.6, 2.0]))


def test_a_parabola_gives_the_interval_of_a_normal_distribution():
    lower, upper = interval_90(VALUES, 3.0 + (np.log(VALUES) / 0.2) ** 2)
    assert lower == pytest.approx(np.exp(-1.6448536 * 0.2), rel=1e-6)
    assert upper == pytest.approx(np.exp(1.6448536 * 0.2), rel=1e-6)


def test_a_flat_profile_reaches_its_ends():
    assert interval_90(VALUES, np.full(9, 5.0)) == (VALUES[0], VALUES[-1])
    one_sided = np.where(VALUES < 1.0, 100.0, 5.0)
    lower, upper = interval_90(VALUES, one_sided)
    assert VALUES[3] < lower < 1.0
    assert upper == VALUES[-1]


def test_an_interval_ends_where_there_is_no_steady_beat():
    costs = np.full(9, 5.0)
    costs[7] = np.nan
    assert interval_90(VALUES, costs) == (VALUES[0], VALUES[6])
