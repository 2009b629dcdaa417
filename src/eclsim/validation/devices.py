"""Devices: the published constants against bench data that they were not fitted to.

A point passes within twice its own spread, or within 10 % or 10 mmHg where none is given; the flow of a
cannula of another maker within 30 %, which is how far makers differ at one size.
"""

from __future__ import annotations

import csv
import math

from eclsim.devices import lvad
from eclsim.devices.ecmo import CANNULAE, PUMPS
from eclsim.validation.cases import DATA
from eclsim.validation.rows import Check, Row, near

RELATIVE, ABSOLUTE_MMHG = 0.1, 10.0
OTHER_MAKER = 0.3
NOTHING_FOUND = (
    "nothing independent was found for the HLS cannulae, the pressure drops of Quadrox-i and Nautilus, and "
    "the pumps DP3, HVAD and Incor: what rests on them rests on the published constants alone"
)
WATER = (
    "cannula charts of makers are mostly measured in water; in blood the flow at one pressure is 3 to 21 % "
    "lower, 5 to 40 % for 15 and 17 Fr (Broman et al., ECMO cannulae I)"
)


def checks() -> list[Check]:
    """Pump heads and cannula flows."""
    with (DATA / "devices.csv").open(encoding="utf-8", newline="") as file:
        rows = tuple(_row(row) for row in csv.DictReader(file))
    heads = [row for row in rows if row.name.startswith("HM3")]
    error = math.sqrt(sum((row.got - (row.expected or 0.0)) ** 2 for row in heads) / len(heads))
    spread = f"HeartMate 3: root mean square difference over {len(heads)} points {error:.1f} mmHg"
    bar = "2 spreads, or 10 % or 10 mmHg; cannulae of other makers 30 %; compared, not required"
    remarks = (spread, NOTHING_FOUND, WATER)
    return [Check("devices", "Devices against bench data", bar, rows, required=False, remarks=remarks)]


def _row(row: dict[str, str]) -> Row:
    expected, label = float(row["value"]), f"{row['device']} {row['quantity']}, {row['condition']}"
    source = f"{row['source']}; {row['how_read']}; fluid: {row['fluid']}"
    if row["quantity"] == "head":
        got = (PUMPS | lvad.PUMPS)[row["device"]].head_mmhg(float(row["speed_rpm"]), float(row["flow_l_min"]))
        tolerance = max(RELATIVE * expected, ABSOLUTE_MMHG)
        tolerance = 2.0 * float(row["spread"]) if row["spread"] else tolerance
    else:
        resistance = CANNULAE[row["device"]].resistance(float(row["size_fr"]))
        got, tolerance = math.sqrt(float(row["pressure_mmhg"]) / resistance), OTHER_MAKER * expected
    return near(label, expected, got, tolerance, row["unit"], source=source)
