"""A patient whose veins collapse, with two steady beats at the same settings of the pump."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from eclsim.cases import read_case
from eclsim.cases.case import Case
from eclsim.cases.quantities import with_values

EXAMPLE = Path(__file__).parents[1] / "examples" / "femoral_va_ecmo.toml"
TWO_BEATS = {
    "Emaxlv": 0.398, "Emaxrv": 0.214, "Rmc": 1.14, "Rpmc": 0.0277, "Csart": 0.744, "Csvn": 8.29, "Cpvn": 13.3,
    "Rsvn": 0.00866, "Edla": 0.103, "P0svn": 15.3, "ecmo.speed_rpm": 3120.0,
}  # fmt: skip


def collapsible(values: Mapping[str, float]) -> Case:
    """The example with veins that collapse, and with these values."""
    case = with_values(read_case(EXAMPLE, ["physiology.collapsible_veins=true"]).case, dict(values))
    return case.model_copy(update={"blood_volume_policy": "as_published"})
