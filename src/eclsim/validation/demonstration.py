"""The paper's patient: what `eclsim demo` simulates and compares."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eclsim.validation.cases import PAPER_PATIENT, reference_model
from eclsim.validation.paper import beat_value, paper_rows
from eclsim.validation.reference_cases import expected_results
from eclsim.validation.rows import Row, near

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.orbit.model import Model

RELATIVE = 0.02
NEAR_THE_MEDIAN = ("PF", "Psart", "Psvn")
PUBLISHED_CODE = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO", "PF", "EDVRV", "ESVRV", "EDVLV", "ESVLV")


def demo_model() -> Model:
    """Table S-4, 3425 rpm, CRRT connected after and before the oxygenator (scheme g)."""
    return reference_model(PAPER_PATIENT)


def demo_rows(result: xr.Dataset) -> list[Row]:
    """The result beside the paper's text and beside a run of the published code.

    The text gives the ECMO flow and the CRRT pressures of scheme g; its arterial and venous pressures are
    medians over all nine schemes, so those of scheme g alone lie near them and not on them.
    """
    rows = []
    for row in paper_rows():
        of_scheme_g = row["statistic"] == "of scheme g" or row["quantity"] in NEAR_THE_MEDIAN
        if float(row["speed_rpm"]) == 3425 and of_scheme_g and row["statistic"] != "variation":
            expected, quantity = float(row["value"]), row["quantity"]
            tolerance = max(10.0 ** -len(row["value"].partition(".")[2]), RELATIVE * expected)
            source = f"paper, {row['where']}" + (
                ", median of nine schemes" if row["statistic"] == "median" else ""
            )
            rows.append(
                near(quantity, expected, beat_value(result, quantity), tolerance, row["unit"], source=source)
            )
    for name in PUBLISHED_CODE:
        expected = expected_results()[PAPER_PATIENT]["outputs"][name]
        unit = str(result[name].attrs["units"])
        rows.append(
            near(name, expected, float(result[name]), 0.005 * expected, unit, source="published code, 120 s")
        )
    return rows
