"""What the tables of the terminal say beside the numbers."""

import numpy as np
import pytest

from eclsim.sensitivity.design import Estimates
from eclsim.sensitivity.results import Indices


def test_the_sensitivity_table_says_what_its_stars_and_its_last_line_mean():
    from eclsim.sensitivity.results import indices_text

    total = np.array([[0.7, 0.25, 0.02], [0.01, 0.02, 0.9]])
    width = np.full_like(total, 0.001)
    estimates = Estimates(total, width, total, width)
    lines = indices_text(
        Indices(("Rmc", "Emaxlv", "Csvn"), ("SP", "CO"), estimates, 64, 320, (), 64)
    ).splitlines()
    assert lines[1].startswith("* the largest, which together make up 90 %")
    assert sorted(lines[-1].partition(": ")[2].split(", ")) == ["Csvn", "Emaxlv", "Rmc"]
    assert lines[-1].startswith("marked * for at least one output: ")


@pytest.mark.parametrize(
    ("stored", "words"),
    [
        (0, "64 rows, 320 runs in 25 s"),
        (300, "64 rows, 320 runs, 300 of them stored earlier, the others in 25 s"),
        (320, "64 rows, 320 runs, all of them stored earlier"),
    ],
)
def test_the_time_of_a_sensitivity_analysis_is_that_of_the_runs_computed_now(stored: int, words: str):
    """After a restart, "102400 runs in 25 s" gave the time of the last part only."""
    from eclsim.sensitivity.results import indices_text

    total = np.full((1, 2), 0.5)
    estimates = Estimates(total, 0.01 * total, total, 0.01 * total)
    known = {"seconds": 25.0, "stored": stored}
    indices = Indices(("Rmc", "Csvn"), ("SP",), estimates, 64, 320, (), 64, **known)
    assert indices_text(indices).splitlines()[0] == f"Total order indices ({words})"


@pytest.mark.parametrize(
    ("value", "text"), [(0.98, "share of the variation"), (-3.3, "below 0: the fits miss")]
)
def test_r2_of_a_cohort_is_explained_and_a_negative_one_is_called_bad(value: float, text: str):
    from eclsim.identification.report import fits_text

    point = {"id": "P01", "cost": 1.0, "parameters": {}, "starts_agreeing": 1, "status": "fitted"}
    point["verdict"] = {"level": "good", "reasons": []}
    content = {"points": [point, point | {"id": "P02"}], "r2": {"pressures": None, "flows": value}}
    (line,) = [line for line in fits_text(content).splitlines() if line.startswith("R2")]
    assert line.startswith(f"R2 of flows: {value:.4f} (")
    assert text in line


def test_r2_says_where_poor_fits_are_in_it():
    """The report said it, the terminal did not."""
    from eclsim.identification.report import fits_text

    fits = [
        {"id": level, "cost": 1.0, "parameters": {}, "starts_agreeing": 1, "status": "fitted",
         "verdict": {"level": level, "reasons": [{"sentence": "why"}]}}
        for level in ("good", "poor")
    ]  # fmt: skip
    lines = fits_text({"points": fits, "r2": {"flows": 0.9}}).splitlines()
    assert lines[-1].startswith("R2 of flows over all fits, the poor ones included: 0.9000 (")


@pytest.mark.slow
def test_identifiability_says_where_nothing_is_determined(shell):
    """It proposed an empty table with "collinearity index nan"."""
    result = shell.run("identifiability", shell.case(), "--parameters", "Rmc", "--outputs", "CVP")
    assert result.exit_code == 0, result.stderr
    assert "nan" not in result.stdout
    assert "None is proposed: these measurements determine none of the parameters" in result.stdout
    assert "too little effect" in result.stdout
    result = shell.run("identifiability", shell.case(), "--parameters", "Rmc", "--outputs", "MAP")
    assert "Left out" not in result.stdout
