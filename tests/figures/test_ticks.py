"""Ticks of logarithmic axes."""

import numpy as np
import pytest

from eclsim.reporting.ticks import PlainLogLocator, plain_log_ticks


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.5, 1.3), (1.9, 2.4), (0.001, 0.1), (0.03, 2.0), (3.1, 3.3), (0.9, 40.0), (2.01, 2.02)],
)
def test_a_few_numbers_far_enough_apart(low, high):
    ticks = PlainLogLocator(0.25).tick_values(low, high)
    assert 2 <= len(ticks) <= 5
    assert low <= min(ticks)
    assert max(ticks) <= high
    assert (np.diff(np.log(ticks)) >= 0.25 * np.log(high / low) - 1e-12).all()


def test_labels_are_plain_numbers():
    """Not 2.6 times 10 to the power of 0, which a logarithmic axis shorter than a decade has otherwise."""
    from matplotlib.figure import Figure

    ax = Figure().subplots()
    ax.plot([1, 2], [2.4, 2.9])
    ax.set_yscale("log")
    plain_log_ticks(ax.yaxis)
    ax.figure.draw_without_rendering()
    labels = [t.get_text() for t in ax.get_yticklabels(which="both") if t.get_text()]
    assert len(labels) >= 2
    assert all("10^" not in label and 2.3 < float(label) < 3.0 for label in labels)
