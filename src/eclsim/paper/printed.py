"""Numbers printed by Thiel et al. 2025 for comparison: tables, and numbers of sections 3.3 and 4."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from eclsim.files import read_table

AT_CASE, LOW, HIGH = 3425.0, 1750.0, 5000.0
"""Speeds in the text [rpm]: the patient's own, and the grid points nearest to 1.2 and 6 L/min."""
NEAR_ZERO = "relative to a median near zero"
MEDIAN = "median"

QUANTITIES = {
    "PF": "ECMO flow",
    "Psart": "arterial pressure",
    "Psvn": "venous pressure",
    "Ppart": "pulmonary arterial pressure",
    "Pcrrttuin": "access pressure",
    "Pcrrttuout": "return pressure",
    "Pecmodrain": "drainage pressure",
    "EDVRV": "right ventricle's end-diastolic volume",
    "ESVRV": "right ventricle's end-systolic volume",
}


class OverSchemes(NamedTuple):
    """Median, variation (largest less smallest value) or variation_percent of a quantity over all schemes."""

    quantity: str
    statistic: str
    speed: float


class OfScheme(NamedTuple):
    """A quantity of one scheme at a speed."""

    quantity: str
    scheme: str
    speed: float


class FlowAtLimit(NamedTuple):
    """ECMO flow at which a limit is reached: the mean of some schemes, or the first of all schemes."""

    limit: str
    schemes: str = ""
    low_alarm: bool = False


@dataclass(frozen=True, slots=True)
class Printed:
    """A printed number.

    Args:
        section: section where the number is printed.
        description: description of the number.
        value: value as printed.
        unit: unit of the value.
        decimals: number of printed decimals.
        what: definition for computing it.
        remark: explanation if the computed number differs.
        other_data: whether it was measured on other patients or circuits than the paper's model.
    """

    section: str
    description: str
    value: float
    unit: str
    decimals: int
    what: OverSchemes | OfScheme | FlowAtLimit
    remark: str = ""
    other_data: bool = False


def _printed(row: Mapping[str, str]) -> Printed:
    what: OverSchemes | OfScheme | FlowAtLimit
    if row["limit"]:
        what = FlowAtLimit(row["limit"], row["schemes"], row["low_alarm"] == "yes")
    elif row["scheme"]:
        what = OfScheme(row["quantity"], row["scheme"], float(row["speed"]))
    else:
        what = OverSchemes(row["quantity"], row["statistic"], float(row["speed"]))
    return Printed(
        row["section"], row["description"], float(row["value"]), row["unit"], int(row["decimals"]), what,
        row["remark"], row["other_data"] == "yes",
    )  # fmt: skip


_DATA = Path(__file__).parent / "data"
TEXT = tuple(map(_printed, read_table(_DATA / "text.csv")))
"""All numbers of sections 3.3 and 4."""

TABLE_1 = {
    "SP": (111.0, 70.0, 183.0), "DP": (69.5, 42.0, 88.0), "MAP": (79.0, 55.0, 113.0),
    "MPAP": (19.5, 6.0, 30.0), "PCWP": (11.0, 7.0, 15.0), "CO": (3.4, 1.5, 7.5), "PF": (2.5, 1.2, 3.8),
}  # fmt: skip
"""Median, smallest and largest measured value [mmHg, L/min], with one decimal each."""
POINTS, PATIENTS, FEMALE_POINTS = 30, 8, 17
R2 = {"pressures": 0.99, "flows": 0.98}

TABLE_2 = {
    "Rmc": 3.80, "Emaxlv": 1.60, "Rpmc": 0.60, "Emaxrv": 0.32, "Csart": 0.25, "Edla": 0.19, "Rsvn": 0.14,
}  # fmt: skip
"""Sum of the total orders over the seven outputs, for the parameters selected for the fits."""
SAMPLES, RUNS = 2048, 102400
"""Number of rows N of the sensitivity analysis, and of its runs."""

PARAMETER_TABLES = read_table(_DATA / "parameters.csv")
"""Values of Tables S-1 to S-4 as printed: table, parameter, value."""
