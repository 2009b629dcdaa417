"""Every field of a case file: meaning, unit, allowed range or names. One table, read by all checks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

from eclsim.devices.constants import CANNULAE, OXYGENATORS, PUMP_ALIASES, pumps_for
from eclsim.devices.positions import ECMO_POSITIONS
from eclsim.patient.anthropometry import MAXIMUM_AGE_YEARS, MINIMUM_AGE_YEARS

PATIENT_SITES: MappingProxyType[str, str] = MappingProxyType(
    {
        "ao": "aorta",
        "sart": "systemic artery",
        "svn": "systemic vein",
        "ra": "right atrium",
        "rv": "right ventricle",
        "pas": "pulmonary aortic sinus",
        "part": "pulmonary artery",
        "pvn": "pulmonary vein",
        "la": "left atrium",
        "lv": "left ventricle",
    }
)
"""Compartments of the patient that a device can be connected to."""

ARTERIAL_SITES = ("ao", "sart")
VENOUS_SITES = ("svn", "ra")

_NODE_ALIASES = MappingProxyType({node: position for position, node in ECMO_POSITIONS.items()})


@dataclass(frozen=True, slots=True)
class Field:
    """One key of a section of a case file.

    Attributes:
        name: The key.
        description: What it is.
        kind: "number", "text", "name" (one of `names`) or "pump" (a name or a roller pump).
        unit: Unit of a number.
        minimum: Smallest allowed number.
        maximum: Largest allowed number.
        typical: A usual value; tells which other unit an impossible number may be in.
        required: Whether the section needs it.
        may_be_missing: Whether "NA", nan and the like stand for "not measured".
        names: Allowed names.
        aliases: Other spellings that are read, and the name they become.
    """

    name: str
    description: str
    kind: Literal["number", "text", "name", "pump"] = "number"
    unit: str = ""
    minimum: float = 0.0
    maximum: float = 0.0
    typical: float = 1.0
    required: bool = True
    may_be_missing: bool = False
    names: tuple[str, ...] = ()
    aliases: Mapping[str, str] = field(default_factory=dict)

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        if self.unit == "Fr":
            spans = (f"{key} {c.sizes_fr[0]} to {c.sizes_fr[-1]} Fr" for key, c in CANNULAE.items())
            return ", ".join(spans)
        if self.kind == "number":
            return f"{self.minimum:g} to {self.maximum:g} {self.unit}"
        if self.kind == "pump" and "Rotaflow" in self.names:
            return ", ".join(self.names) + ", { roller_l_min = 4.0 }"
        return ", ".join(self.names) or "text of 1 to 64 characters"


def _measured(name: str, description: str, unit: str, low: float, high: float, typical: float) -> Field:
    return Field(name, description, "number", unit, low, high, typical, required=False, may_be_missing=True)


def _site(name: str, description: str, required: bool = True, positions: bool = False) -> Field:
    names = (*ECMO_POSITIONS, *PATIENT_SITES) if positions else tuple(PATIENT_SITES)
    aliases = _NODE_ALIASES if positions else {}
    return Field(name, description, "name", required=required, names=names, aliases=aliases)


def _size(name: str, description: str) -> Field:
    return Field(name, description, "number", "Fr", 3, 60, 19, required=False)


def _cannula(name: str, description: str) -> Field:
    return Field(name, description, "name", required=False, names=tuple(CANNULAE))


ROLLER_FIELD = Field("roller_l_min", "Flow of a roller pump", "number", "L/min", 0, 10, 4)
"""The one key of a roller pump, `pump = { roller_l_min = 4.0 }`."""

POLICY_FIELD = Field(
    "blood_volume_policy", "Whose blood fills the circuits: the patient's, or patient_held: they are primed",
    "name", required=False, names=("as_published", "patient_held"),
)  # fmt: skip
"""The blood volume policy, which stands above the sections; left out, "as_published"."""

SECTIONS: MappingProxyType[str, tuple[Field, ...]] = MappingProxyType(
    {
        "patient": (
            Field("id", "Pseudonym of the patient", "text"),
            Field("sex", "Sex", "name", names=("female", "male")),
            Field("age_years", "Age", "number", "years", MINIMUM_AGE_YEARS, MAXIMUM_AGE_YEARS, 60),
            Field("height_cm", "Height", "number", "cm", 50, 250, 170, required=False, may_be_missing=True),
            Field("weight_kg", "Weight", "number", "kg", 25, 350, 75, required=False, may_be_missing=True),
            Field("heart_rate_bpm", "Heart rate", "number", "bpm", 20, 250, 80),
        ),
        "measurements": (
            _measured("SP", "Systolic arterial pressure", "mmHg", 20, 300, 110),
            _measured("DP", "Diastolic arterial pressure", "mmHg", 10, 200, 70),
            _measured("MAP", "Mean arterial pressure", "mmHg", 15, 250, 80),
            _measured("MPAP", "Mean pulmonary artery pressure", "mmHg", 1, 120, 20),
            _measured("PCWP", "Pulmonary capillary wedge pressure", "mmHg", 0, 60, 11),
            _measured("CO", "Cardiac output: native, through the lungs", "L/min", 0, 20, 4),
            _measured("PF", "ECMO pump flow", "L/min", 0, 10, 3),
        ),
        "ecmo": (
            Field("pump", "Blood pump", "pump", names=pumps_for("ECMO"), aliases=PUMP_ALIASES),
            Field("speed_rpm", "Speed of a rotary pump", "number", "rpm", 0, 10000, 3400, required=False),
            Field(
                "flow_l_min",
                "Pump flow that the speed is solved for",
                "number",
                "L/min",
                0.1,
                10,
                4,
                required=False,
            ),
            Field("oxygenator", "Oxygenator", "name", names=tuple(OXYGENATORS)),
            _site("drainage_site", "Compartment that is drained", required=False),
            _cannula("drainage_cannula", "Type of drainage cannula"),
            _size("drainage_fr", "Size of drainage cannula"),
            _site("return_site", "Compartment that receives", required=False),
            _cannula("return_cannula", "Type of return cannula"),
            _size("return_fr", "Size of return cannula"),
            Field("mode", "Fills in usual sites and cannulae", "name", required=False, names=("VA", "VV")),
        ),
        "crrt": (
            Field("flow_ml_min", "Blood flow of the CRRT pump", "number", "mL/min", 10, 600, 200),
            _site("access_site", "Where the access line drains", positions=True),
            _site("return_site", "Where the return line ends", positions=True),
        ),
        "lvad": (
            Field("pump", "Blood pump", "pump", names=pumps_for("LVAD"), aliases=PUMP_ALIASES),
            Field("speed_rpm", "Speed", "number", "rpm", 0, 15000, 5000),
            _site("inlet_site", "Compartment that is drained"),
            _site("outlet_site", "Compartment that receives"),
        ),
    }
)
"""Sections of a case file and their fields, in the order in which they are written."""

USUAL: MappingProxyType[str, MappingProxyType[str, str | float]] = MappingProxyType(
    {
        "VA": MappingProxyType(
            {
                "drainage_site": "ra",
                "drainage_cannula": "venous",
                "drainage_fr": 21.0,
                "return_site": "ao",
                "return_cannula": "arterial",
                "return_fr": 17.0,
            }
        ),
        "VV": MappingProxyType(
            {
                "drainage_site": "svn",
                "drainage_cannula": "venous",
                "drainage_fr": 25.0,
                "return_site": "ra",
                "return_cannula": "venous",
                "return_fr": 21.0,
            }
        ),
    }
)
"""Sites and cannulae that `mode` fills in where they are left out."""
