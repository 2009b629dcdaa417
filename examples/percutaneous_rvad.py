"""A device that is not in the package: a percutaneous right ventricular assist device.

    right atrium --(cannula)--> rvadin --(centrifugal pump)--> rvadout --(cannula)--> pulmonary artery

Use it with

    eclsim --device examples/percutaneous_rvad.py simulate examples/percutaneous_rvad.toml

The pump's curve and the laws of the cannulae are those of the package (published code of Thiel et al. 2025).
The compliance of the short tubes and the limit of suction are assumptions of this example: do not read
clinical conclusions off them.
"""

from typing import Annotated

import eclsim
from eclsim.devices import (
    Curve,
    Device,
    KeyFigure,
    Limit,
    Mark,
    Parameter,
    Section,
    Sweep,
    Trace,
    Views,
    check_sites,
    check_speed,
    lowest,
    mean,
    mean_flow,
    number,
    one_of,
    patient_site,
    pump_values,
)
from eclsim.devices.cannulae import CANNULAE
from eclsim.devices.ecmo_parts import PUMPS

SIZE = "19 to 29 Fr"


class Rvad(Section):
    """The section `[rvad]` of a case file: its keys, their units and what they may be."""

    section = "rvad"
    pump: Annotated[str, one_of("Blood pump", tuple(PUMPS))]
    speed_rpm: Annotated[float, number("Pump speed", "rpm", 0, 10000, 3000)]
    inlet_site: Annotated[str, patient_site("Compartment that is drained")]
    outlet_site: Annotated[str, patient_site("Compartment that receives")]
    cannula_fr: Annotated[float, number("Size of both cannulae", "Fr", 19, 29, 23, allowed=SIZE)]


class RvadDevice(Device[Rvad]):
    """What the package needs to know of the device."""

    key, name, section = "rvad", "RVAD", Rvad
    compartments = {"rvadin": "before RVAD pump", "rvadout": "after RVAD pump"}
    connections = {"rvadin": "drainage cannula", "rvadpump": "RVAD pump", "rvadreturn": "return cannula"}
    marks = {
        "rvadin": Mark("cannula", "drainage cannula"),
        "rvadpump": Mark("pump", "pump"),
        "rvadreturn": Mark("cannula", "return cannula"),
    }
    products = tuple(PUMPS.values())
    parameters = (
        Parameter(
            "Crvadin", 0.1, "mL/mmHg", "Compliance before RVAD pump", "assumed here", 1e-4, 5.0, "rvad"
        ),
        Parameter(
            "Crvadout", 0.1, "mL/mmHg", "Compliance after RVAD pump", "assumed here", 1e-4, 5.0, "rvad"
        ),
    )
    nominal = {"rvad.speed_rpm": 1500.0, "rvad.cannula_fr": 23.0, **pump_values("rvad", PUMPS["Rotaflow"])}
    usual = {
        "pump": "Rotaflow",
        "speed_rpm": 1500.0,
        "inlet_site": "ra",
        "outlet_site": "part",
        "cannula_fr": 23.0,
    }
    outputs = (
        mean_flow("rvad_flow", "mean RVAD flow", "Qrvadpump"),
        mean("rvad_head", "mean RVAD head", "Prvadpump"),
        lowest("rvad_inlet_pressure", "lowest pressure before the RVAD pump", "Prvadin"),
    )
    limits = (
        Limit(
            "rvad_flow", "alarm", "below", 0.0, "blood runs back through the RVAD: raise its speed", "physics"
        ),
        Limit("rvad_inlet_pressure", "warning", "below", -50.0, "suction: lower the speed", "example"),
    )
    views = Views(
        traces=(
            Trace("Qrvadpump", "RVAD flow", "RVAD flow", "flow", ("rvad_flow",), ((0.0, 8.0), (-4.0, 12.0))),
        ),
        figures=(KeyFigure("rvad_flow", "RVAD", "rvad_flow", "L/min", 2),),
        curves=(Curve("rvad_flow", "RVAD flow", "flow"),),
        compared=("rvad_flow",),
        flow_outputs={"rvadpump": "rvad_flow"},
    )

    def circuit(self, section):
        """Two compartments and three connections between the sites."""
        from eclsim import Circuit, Compartment, Connection
        from eclsim.components import Cannula, ElasticVessel, RotaryPump

        cannula = Cannula("rvad.cannula_fr", CANNULAE["venous"].coefficients)
        pump = RotaryPump("rvad.speed_rpm", "rvad.pump.")
        compartments = tuple(
            Compartment(name, ElasticVessel("C" + name), "rvad") for name in self.compartments
        )
        connections = (
            Connection("rvadin", cannula, section.inlet_site, "rvadin", "rvad"),
            Connection("rvadpump", pump, "rvadin", "rvadout", "rvad"),
            Connection("rvadreturn", cannula, "rvadout", section.outlet_site, "rvad"),
        )
        return Circuit(compartments, connections)

    def values(self, section):
        """Numbers that the section stands for."""
        return pump_values("rvad", PUMPS[section.pump]) | {
            "rvad.speed_rpm": section.speed_rpm,
            "rvad.cannula_fr": section.cannula_fr,
        }

    def check(self, values, case, key, remarks):
        """Mistakes and doubts about the section: the messages of `eclsim simulate`."""
        check_sites(key, values, "inlet_site", "outlet_site", remarks)
        check_speed(key, values, PUMPS, remarks)

    def sweep(self, section):
        """The speed that the page can sweep."""
        return Sweep("speed_rpm", section.speed_rpm, *PUMPS[section.pump].speed_range_rpm)


eclsim.register_device(RvadDevice)
