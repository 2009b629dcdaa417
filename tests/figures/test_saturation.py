"""The scale of saturations reads the same with any colour vision, and letters on it can be read."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from eclsim.reporting.saturation import COLOUR_STOPS, DARK_LETTERS, LIGHT_LETTERS, colour_of, text_colour_on

# Severe deuteranopia and protanopia on linear colours: Machado, Oliveira and Fernandes 2009.
SEEN = {
    "any": np.eye(3),
    "deuteranope": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "protanope": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
}


def linear(colour: str) -> np.ndarray:
    parts = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def luminance(colour: str, eyes: str = "any") -> float:
    return float(np.array([0.2126, 0.7152, 0.0722]) @ np.clip(SEEN[eyes] @ linear(colour), 0.0, 1.0))


@pytest.mark.parametrize("eyes", SEEN)
def test_more_oxygen_is_lighter_to_all_eyes(eyes):
    seen = [luminance(colour_of(percent), eyes) for percent in np.linspace(40.0, 100.0, 61)]
    assert all(low < high for low, high in pairwise(seen))


@pytest.mark.parametrize("percent", np.linspace(0.0, 100.0, 41))
def test_letters_stand_out(percent):
    pair = sorted((luminance(colour_of(percent)), luminance(text_colour_on(percent))))
    assert (pair[1] + 0.05) / (pair[0] + 0.05) >= 4.5


def test_the_ends_hold_beyond_the_scale():
    assert colour_of(3.0) == COLOUR_STOPS[0][1]
    assert colour_of(100.0) == COLOUR_STOPS[-1][1]
    assert {text_colour_on(40.0), text_colour_on(100.0)} == {LIGHT_LETTERS, DARK_LETTERS}
