"""What the tests of reports share: a small study, and a fit."""

import pytest

from small_study import HOSTILE, hostile_study

__all__ = ["hostile_study"]


@pytest.fixture
def fitted_point() -> dict:
    """A data point as in identification.json: a doubtful fit, one of two parameters determined."""
    known = {"value": 0.8, "lower": 0.7, "upper": 0.9, "profile": [0.69, 0.91], "at_bound": False}
    doubt = {
        "aspect": "plausibility of the fitted patient", "level": "doubtful", "about": "EDVRV",
        "sentence": "right ventricle of 17 mL",
    }  # fmt: skip
    remark = {"aspect": "agreement", "level": "good", "about": "", "sentence": "no test of the model"}
    return {
        "id": HOSTILE,
        "verdict": {
            "level": "doubtful", "reasons": [doubt, remark],
            "goodness": {"differences": {"MAP": -0.04, "CO": 1.5}, "chi_square": 2.25,
                         "degrees_of_freedom": 1.0, "probability": 0.13},
        },
        "cost": 0.01,
        "outputs": {
            "MAP": {"measured": 70.0, "simulated": 69.88}, "CO": {"measured": 2.0, "simulated": 2.3},
            "PCWP": {"measured": None, "simulated": 9.0},
        },
        "uncertainties": {"MAP": 3.0, "CO": 0.2},
        "implied": {"EDVRV": {"value": 17.0, "words": "volume", "unit": "mL", "healthy": [78.0, 218.0],
                              "source": "a source"}},
        "parameters": {
            "Rmc": {**known, "identifiable": True, "reason": ""},
            "Edla": {**known, "identifiable": False, "reason": "too little effect"},
        },
        "correlation": {"Rmc": {"Rmc": 1.0, "Edla": -0.95}, "Edla": {"Rmc": -0.95, "Edla": 1.0}},
        "starts_agreeing": 3, "starts_refined": 12, "explored": 2000, "explored_without_steady_beat": 7,
        "explored_one_of_many": 3,
        "seconds": 1.0, "status": "fitted", "message": "optimum found",
    }  # fmt: skip
