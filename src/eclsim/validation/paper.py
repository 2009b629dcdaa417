"""The numbers in the text of Thiel et al.: nine CRRT schemes at three speeds, in the patient of Table S-4.

The paper gives, for each pressure, the median over the nine schemes and the "absolute variation", the largest
minus the smallest. Its arterial, venous and pulmonary pressures are those of the compartments sart, svn and
part, and its low flow of 1.2 L/min is reached at 1750 rpm. The patient's sex, age, height, weight and
cannulae are not printed; those of the reference cases are taken.
"""

from __future__ import annotations

import csv
from functools import lru_cache

import numpy as np
import xarray as xr

from eclsim.haemodynamics.dataset import simulate
from eclsim.validation.cases import DATA, reference_model
from eclsim.validation.rows import Check, Row, near

SCHEMES = "abcdefghi"
RELATIVE = 0.02
WORDS = {
    "PF": "ECMO flow",
    "Psart": "arterial pressure",
    "Psvn": "venous pressure",
    "Ppart": "pulmonary arterial pressure",
    "Pecmodrain": "drainage cannula pressure",
    "Pcrrttuin": "CRRT access pressure",
    "Pcrrttuout": "CRRT return pressure",
    "EDVRV": "end-diastolic volume of the right ventricle",
    "ESVRV": "end-systolic volume of the right ventricle",
}
PATIENT_UNKNOWN = (
    "the published code, run on this patient, gives eclsim's number; the paper does not print the sex, age, "
    "size and cannulae of its patient"
)


def paper_rows() -> tuple[dict[str, str], ...]:
    """The embedded table: quantity, speed, statistic over the schemes, value."""
    with (DATA / "paper.csv").open(encoding="utf-8", newline="") as file:
        return tuple(csv.DictReader(file))


@lru_cache(maxsize=64)
def scheme_result(letter: str, speed_rpm: float) -> xr.Dataset:
    """The patient with one of the nine schemes, as the published code ran it, at a pump speed."""
    return simulate(reference_model(f"s4_crrt_{letter}_3425").with_values({"ecmo.speed_rpm": speed_rpm}))


def beat_value(result: xr.Dataset, quantity: str) -> float:
    """An output, or the mean of a waveform over the beat."""
    if result[quantity].ndim == 0:
        return float(result[quantity])
    return float(np.trapezoid(result[quantity].values, result["phase"].values))


def paper_row(row: dict[str, str]) -> Row:
    """One number of the text beside eclsim's."""
    expected, statistic, speed = float(row["value"]), row["statistic"], float(row["speed_rpm"])
    letters = SCHEMES if statistic in ("median", "variation") else statistic[-1]
    values = np.array([beat_value(scheme_result(letter, speed), row["quantity"]) for letter in letters])
    got = float(np.ptp(values) if statistic == "variation" else np.median(values))
    digit = 10.0 ** -len(row["value"].partition(".")[2])
    label = f"{WORDS[row['quantity']]}, {speed:g} rpm, {statistic}"
    source = f"Thiel et al., {row['where']}"
    tolerance = max(digit, RELATIVE * abs(expected))
    return near(label, expected, got, tolerance, row["unit"], source=source, explanation=PATIENT_UNKNOWN)


def checks() -> list[Check]:
    """Every number of the text that follows from the nine schemes."""
    rows = tuple(paper_row(row) for row in paper_rows())
    title = "Numbers in the text of the paper: nine CRRT schemes, patient of Table S-4"
    return [Check("paper", title, "last printed digit, or 2 %; compared, not required", rows, required=False)]
