"""Components: the physical laws, one class each. `all_storages` and `all_paths` list them for the tests."""

from eclsim.components.base import (
    Activation,
    Complement,
    Controller,
    ControlState,
    Derived,
    Enclosure,
    Exchanger,
    Path,
    Scaled,
    Storage,
)
from eclsim.components.chambers import (
    AtrialBump,
    Atrium,
    Balloon,
    LinearChamber,
    Pericardium,
    Ventricle,
    VentricularSystole,
)
from eclsim.components.exchangers import GasExchanger, MembraneLung, NativeLung, Tissue
from eclsim.components.pumps import RollerPump, RotaryPump
from eclsim.components.valves import HeartValve, LeakingValve, OpenOrifice, Orifice
from eclsim.components.vessels import (
    Artery,
    Cannula,
    CollapsibleChamber,
    CollapsibleVein,
    ElasticVessel,
    Resistance,
    Tube,
    TubeVolume,
)

all_storages = (
    ElasticVessel, CollapsibleVein, Atrium, CollapsibleChamber, Ventricle, LinearChamber, Balloon,
)  # fmt: skip
all_paths = (Resistance, Artery, Tube, HeartValve, LeakingValve, OpenOrifice, Cannula, RotaryPump, RollerPump)

__all__ = [
    "Activation", "Artery", "AtrialBump", "Atrium", "Balloon", "Cannula", "CollapsibleChamber",
    "CollapsibleVein", "Complement", "ControlState", "Controller", "Derived", "ElasticVessel", "Enclosure",
    "Exchanger", "GasExchanger", "HeartValve", "LeakingValve", "LinearChamber",
    "MembraneLung", "NativeLung", "OpenOrifice", "Orifice", "Path", "Pericardium", "Resistance", "RollerPump",
    "RotaryPump", "Scaled", "Storage", "Tissue", "Tube", "TubeVolume", "Ventricle",
    "VentricularSystole", "all_paths", "all_storages",
]  # fmt: skip
