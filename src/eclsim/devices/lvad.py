"""Ventricular assist device: one connection with inertia, no compartment of its own.

    inlet site --(pump, graft)--> outlet site

Source: Boes et al. 2019 for the pump's equation; Thiel et al. 2025 for the constants.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

from eclsim.devices.description import (
    Control,
    Curve,
    Finding,
    KeyFigure,
    Knob,
    Limit,
    Look,
    Mark,
    Panel,
    Sweep,
    Trace,
    Views,
    mean,
    mean_flow,
    picker,
)
from eclsim.devices.device import CaseValues, Device, Naming
from eclsim.devices.plausibility import (
    VENTRICLES,
    check_sites,
    check_speed,
    drained_ventricles,
    ejection_fraction_findings,
    patient_site,
)
from eclsim.devices.products import UNVALIDATED, PumpCurve, by_key, makers_names, pump_values
from eclsim.inputs.fields import number, one_of
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.sections import Raw, Section
from eclsim.patient.sites import ARTERIAL_SITES, LEFT_HEART, PATIENT_SITES, RIGHT_HEART, VENOUS_SITES

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit, Site

GROUP = "lvad"
SUCTION_LVEDP_MMHG, SUCTION_ML = 4.0, 30.0
"""End-diastolic pressure of a drained left ventricle [mmHg] and smallest volume of any drained ventricle [mL]
below which suction is likely; a convention of this project. A right ventricle fills at lower pressures."""
_SPEEDS = "the speed range is the usual clinical one, not part of the published constants"

PUMPS = by_key(
    (
        PumpCurve(
            key="HMII", name="HeartMate II", use="LVAD", a=9.5356e-7, R1=-3.2085e-4, R2=0.8643, Rrec=3.0701,
            kinf=3.5925e-4, L=22.9733, Rper=0.3833, Lper=20.3038, speed_range_rpm=(6000, 15000),
            evidence=f"2 to 19 mmHg above another published fit, which may include cannulae; {_SPEEDS}",
        ),
        PumpCurve(
            key="HM3", name="HeartMate 3", use="LVAD", a=3.4578e-6, R1=-7.2946e-4, R2=2.2453, Rrec=3.3580,
            kinf=2.5962e-4, L=17.0010, Rper=0.1244, Lper=13.3873, speed_range_rpm=(3000, 9000),
            evidence="37 points of the maker's chart, 3000 to 9000 rpm: root mean square 5.4 mmHg; "
            f"{_SPEEDS}", other_names=("HeartMate III",),
        ),
        PumpCurve(
            key="HVAD", name="HVAD", use="LVAD", a=1.3307e-5, R1=3.8732e-4, R2=0.7667, Rrec=4.7622,
            kinf=1.4703e-4, L=18.7352, Rper=0.1093, Lper=14.1544, speed_range_rpm=(1800, 4000),
            evidence=f"{UNVALIDATED}; {_SPEEDS}",
        ),
        PumpCurve(
            key="Incor", name="Incor", use="LVAD", a=2.7737e-6, R1=0.0010, R2=1.7742, Rrec=3.7529,
            kinf=3.9814e-5, L=32.4690, Rper=0.3154, Lper=18.3543, speed_range_rpm=(5000, 10000),
            evidence=f"{UNVALIDATED}; {_SPEEDS}",
        ),
    )
)  # fmt: skip
"""Pumps with the inertia and resistance of their grafts, by key (the name in case files)."""


class Lvad(Section):
    """Section [lvad]: pump, speed in rpm and sites."""

    section = GROUP
    pump: Annotated[str, one_of("Blood pump", tuple(PUMPS), aliases=makers_names(PUMPS.values()))]
    speed_rpm: Annotated[float, number("Speed", "rpm", 0, 15000, 5000)]
    inlet_site: Annotated[str, patient_site("Compartment that is drained")]
    outlet_site: Annotated[str, patient_site("Compartment that receives")]


def lvad(inlet_site: Site = "lv", outlet_site: Site = "ao") -> Circuit:
    """A ventricular assist device between two compartments.

    Args:
        inlet_site: compartment from which blood is drained.
        outlet_site: compartment to which blood is pumped.
    """
    from eclsim.circuit.network import Circuit, Connection
    from eclsim.components import RotaryPump

    pump = RotaryPump("lvad.speed_rpm", "lvad.pump.", periphery=True)
    return Circuit((), (Connection("lvadpump", pump, inlet_site, outlet_site, GROUP),))


class LvadDevice(Device[Lvad]):
    """A left (or, between other sites, right) ventricular assist device."""

    key, name, section = GROUP, "LVAD", Lvad
    connections = {"lvadpump": "LVAD pump"}
    marks = {"lvadpump": Mark("pump", "LVAD pump")}
    tabled = ()
    look = Look("#A84A00", "#FBF1EA", 2.0, (0, (6, 1.3, 1.2, 1.3)), "D")
    products = tuple(PUMPS.values())
    nominal = {"lvad.speed_rpm": 2600.0, **pump_values(GROUP, PUMPS["HVAD"])}
    outputs = (
        mean_flow("lvad_flow", "mean LVAD flow", "Qlvadpump"),
        mean("lvad_head", "mean LVAD head", "Plvadpump"),
    )
    limits = (
        Limit(
            "lvad_flow", "alarm", "below", 0.0,
            "blood runs back through the LVAD into the heart: raise its speed", "physics",
        ),
    )  # fmt: skip
    usual = {"pump": "HM3", "speed_rpm": 5000.0, "inlet_site": "lv", "outlet_site": "ao"}
    carries_circulation = True
    assist_flow = "lvad_flow"
    adjusted = ("speed_rpm",)
    views = Views(
        traces=(
            Trace(
                "Qlvadpump", "LVAD flow", "LVAD flow", "flow", ("lvad_flow",),
                ((0.0, 8.0), (-4.0, 12.0), (-10.0, 20.0)),
            ),
        ),
        figures=(KeyFigure("lvad_flow", "LVAD", "lvad_flow", "L/min", 2),),
        curves=(Curve("lvad_flow", "LVAD flow", "flow"),),
        compared=("lvad_flow",),
        flow_outputs={"lvadpump": "lvad_flow"},
    )  # fmt: skip

    def circuit(self, section: Lvad) -> Circuit:
        """Circuit of the pump between its sites."""
        return lvad(section.inlet_site, section.outlet_site)

    def values(self, section: Lvad) -> dict[str, float]:
        """Constants of the pump curve, and speed."""
        return pump_values(GROUP, PUMPS[section.pump]) | {"lvad.speed_rpm": section.speed_rpm}

    def panels_of(self, section: Lvad) -> tuple[Panel, ...]:
        """Pressures at its sites, its head and flow, and flow out of and volume of what it drains."""
        drained, given = section.inlet_site, section.outlet_site
        return (
            Panel("Pressures", "mmHg", (f"P{drained}", f"P{given}")),
            Panel("Pump head", "mmHg", ("Plvadpump",)),
            Panel("Flows", "L/min", ("Qlvadpump", f"Q{drained}")),
            Panel(PATIENT_SITES.get(drained, drained).capitalize(), "mL", (f"V{drained}",)),
        )

    def summary(self, section: Lvad) -> str:
        """Pump and speed."""
        return f"{section.pump} {section.speed_rpm:g} rpm"

    def controls(self, section: Lvad, sites: Mapping[str, str]) -> list[Control]:
        """Controls of pump and speed."""
        low, high = PUMPS[section.pump].speed_range_rpm
        step = 25 if high < 5000 else 50
        return [picker("pump", "Pump", PUMPS), Knob("speed_rpm", "Pump speed", "rpm", low, high, step)]

    def turned(self, raw: dict[str, Any], key: str, value: object) -> dict[str, Any]:
        """Change a control; a new pump starts at its usual speed."""
        changed = {**raw, key: value}
        if key == "pump" and isinstance(value, str) and value in PUMPS:
            changed["speed_rpm"] = PUMPS[value].usual_speed_rpm
        return changed

    def sweep(self, section: Lvad) -> Sweep:
        """Speed of the pump and its usual range."""
        low, high = PUMPS[section.pump].speed_range_rpm
        return Sweep("speed_rpm", section.speed_rpm, low, high)

    def check(self, values: Raw, case: CaseValues, key: str, remarks: Remarks) -> None:
        """Check sites and speed, and note a simultaneous ECMO."""
        check_sites(key, values, "inlet_site", "outlet_site", remarks)
        inlet, outlet = values.get("inlet_site"), values.get("outlet_site")
        if inlet in (*VENOUS_SITES, *RIGHT_HEART) and outlet in (*ARTERIAL_SITES, *LEFT_HEART):
            message = f"drains {PATIENT_SITES[inlet]}: blood bypasses the lungs without an oxygenator"
            remarks.warning(f"{key}.inlet_site", message, shown(inlet), "lv or la")
        check_speed(key, values, PUMPS, remarks)
        if any(
            ecmo.get("return_site") not in (*VENOUS_SITES, *RIGHT_HEART) for ecmo in case.of("ecmo").values()
        ):
            remarks.note(key, "ECMO and LVAD work on the same circulation and may oppose each other")

    def findings(
        self, names: Naming, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
    ) -> list[Finding]:
        """Cautions on the ejection fraction of a drained ventricle, and warnings of suction."""
        result = ejection_fraction_findings(names, outputs, circuit, self.connections, "lvad_flow")
        for drained in drained_ventricles(names, circuit, self.connections):
            result += _suction(names, outputs, drained)
        return result


def _suction(names: Naming, outputs: Mapping[str, float], drained: str) -> list[Finding]:
    """Warning for a ventricle so empty that the pump's inlet would be occluded by its wall."""
    quantity, smallest = f"end_diastolic_pressure_{drained}", f"ESV{drained.upper()}"
    pressure, volume = outputs.get(quantity, math.inf), outputs.get(smallest, math.inf)
    lowest = SUCTION_LVEDP_MMHG if drained == "lv" else -math.inf
    if pressure >= lowest and volume >= SUCTION_ML:
        return []
    flow = names.output("lvad_flow")
    filling = f" (end-diastolic pressure {pressure:.1f} mmHg)" if math.isfinite(pressure) else ""
    behind = outputs.get("right_atrial_pressure", 0.0) if drained == "rv" else 0.0
    filling = f" (right atrial pressure {behind:.1f} mmHg)" if behind < 0.0 else filling
    sucked = ("right_atrial_pressure", "EDVRV", "EDVRA") if behind < 0.0 else ()
    text = (
        f"the {names.label} empties the {VENTRICLES[drained][0]} to {volume:.0f} mL{filling}: suction is "
        "likely, and the flow too high, as the model's ventricle does not collapse; lower the speed or give "
        "blood"
    )
    about = (quantity, pressure, lowest) if pressure < lowest else (smallest, volume, SUCTION_ML)
    return [Finding("warning", *about, text, concerns=(flow, smallest, quantity, *sucked))]


LVAD = LvadDevice()
