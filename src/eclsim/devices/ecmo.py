"""ECMO circuit: six compartments in flow direction, connected to any two sites.

    drainage site --(cannula)--> ecmodrain ==tube==> ecmotudp --(pump)--> ecmotupo ==tube==> ecmooxy
        --(oxygenator)--> ecmotuor ==tube==> ecmoreturn --(cannula)--> return site

Sources: Thiel et al. 2025, Figure 1 and Table S-2; pump curves after the method of Boes et al. (2019),
cannulae and oxygenators from the makers' data sheets, as published with the code of Thiel et al.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict

from eclsim.arguments import OneOf
from eclsim.devices.cannulae import (
    BACKWARD_L_MIN,
    CANNULAE,
    CONNECTIONS,
    DUAL_LUMEN,
    MARKS,
    NO_SITE,
    NOMINAL,
    SECOND_SITES,
    TWO,
    SecondCannulae,
    cannulae_picker,
    caution_on_chart,
    check_lumens,
    check_second,
    check_vessels,
    chosen_cannulae,
    fits_line,
    second_controls,
    with_dual_lumen,
    with_second,
)
from eclsim.devices.cannulae import LIMITS as SECOND_LIMITS
from eclsim.devices.cannulae import OUTPUTS as SECOND_OUTPUTS
from eclsim.devices.description import (
    CAUTION,
    COLLAPSE_MMHG,
    GASES,
    BeatMeasures,
    Box,
    Columns,
    Control,
    Curve,
    Finding,
    KeyFigure,
    Knob,
    Limit,
    Look,
    Mark,
    Numbers,
    Output,
    Panel,
    Picker,
    Sample,
    Sweep,
    Target,
    Trace,
    Views,
    difference,
    gas_sample,
    lowest,
    mean,
    mean_flow,
    organ_flow,
    picker,
)
from eclsim.devices.device import CaseValues, Device, Naming, UnsolvedFlowError
from eclsim.devices.plausibility import (
    check_cannula,
    check_sites,
    check_speed,
    ejection_fraction_findings,
    patient_site,
)
from eclsim.devices.products import (
    LABEL_FLOWS,
    UNVALIDATED,
    Membrane,
    Oxygenator,
    PumpCurve,
    beyond_label,
    by_key,
    makers_names,
    pump_values,
)
from eclsim.inputs.fields import Field, number, one_of
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.numbers import RefusedValueError, read_number
from eclsim.inputs.sections import Raw, read_name
from eclsim.parameters.parameter import Bounds, Parameter
from eclsim.parameters.regulation import REGULATION
from eclsim.parameters.thiel2025 import circuit_parameters
from eclsim.patient.anthropometry import body_surface
from eclsim.patient.sites import ARTERIAL_SITES, DRAINED, LEFT_HEART, PATIENT_SITES, VENOUS_SITES
from eclsim.units import ML_S_PER_L_MIN

if TYPE_CHECKING:
    from jax import Array

    from eclsim.circuit.network import Circuit, Connection, Site
    from eclsim.components import Path

GROUP = "ecmo"
LINES = ("drainage", "return")
GAS_KEYS = ("sweep_l_min", "fdo2", "drainage_mixing")
"""Keys of the section that only gas exchange uses."""
TUBES = ("ecmotudp", "ecmotupo", "ecmotuor")
"""Names of the compartments that are tubes."""

# Above these, a cardiac output on V-A ECMO probably includes the pump flow.
_LARGEST_INDEX = 5.5  # L/min/m^2
_LARGEST_COMPLIANCE = 5.0  # mL/mmHg, stroke volume per pulse pressure

PUMPS = by_key(
    (
        PumpCurve(
            key="Rotaflow", name="Rotaflow RF-32", use="ECMO", a=1.9583e-5, R1=-0.007545, R2=2.8864,
            Rrec=4.0256, kinf=0.0016, speed_range_rpm=(1000, 5000),
            evidence="one bench point in bovine blood, 3000 rpm and 4.2 L/min: 222 mmHg against 250 ± 10",
        ),
        PumpCurve(
            key="DP3", name="DP3", use="ECMO", a=6.5298e-6, R1=-1.9593e-3, R2=4.0802, Rrec=5.0355,
            kinf=0.0004, speed_range_rpm=(4000, 8000), evidence=UNVALIDATED,
        ),
    )
)  # fmt: skip
"""Rotary pumps by key (the name in case files)."""
ROLLER = number("Flow of a roller pump", "L/min", 0, 10, 4)
"""Key of a roller pump's table, `pump = { roller_l_min = 4.0 }`."""

_LABEL = "unvalidated pressure drop; label flow from FDA clearance K150267"
_LARGE_MEMBRANE, _SMALL_MEMBRANE = Membrane(7.0, 0.09, 4.66), Membrane(5.0, 0.0853, 3.37)
"""Membranes of 1.8 and 1.3 m2 after Khadka et al. 2024. Oxygen: 76 and 450 mL/min and a PO2 behind it of 376
and 120 mmHg at 1 and 7 L/min, and 5/7 of it at 5 L/min (0.09 (5/7)^0.16). Carbon dioxide, scaled by area: the
amounts removed at 1 and 7 L/min from blood that must have had 61.5 mmHg, as a gas flow of 1:1 carries 59
mL/min from 45 mmHg and 64 were measured. With a rating of 95 % saturation behind them they would transfer 346
mL/min of oxygen."""
OXYGENATORS = by_key(
    (
        Oxygenator(
            key="Quadrox-i Adult", resistance=0.6744, priming_volume_ml=335.0, label_flow_l_min=(0.5, 7.0),
            evidence=_LABEL, membrane=_LARGE_MEMBRANE,
        ),
        Oxygenator(
            key="Quadrox-i Small Adult", resistance=0.5174, priming_volume_ml=295.0,
            label_flow_l_min=(0.5, 5.0), evidence=_LABEL, membrane=_SMALL_MEMBRANE,
        ),
        Oxygenator(
            key="Nautilus MC3", resistance=0.6312, priming_volume_ml=None, label_flow_l_min=None,
            evidence=UNVALIDATED, membrane=_LARGE_MEMBRANE,
        ),
    )
)  # fmt: skip
"""Oxygenators by key (the name in case files)."""
ASSUMED_ML = OXYGENATORS["Quadrox-i Adult"].priming_volume_ml or math.nan
"""Blood volume assumed for an oxygenator without a published one [mL]."""

_R, _C = "mmHg s/mL", "mL/mmHg"
TUBING = circuit_parameters(
    GROUP, "S-2",
    (
        ("Decmotudp", 0.9625, "cm", "Diameter of tubing drainage - pump (3/8 inch)", 0.2, 2.5, "installed"),
        ("Lecmotudp", 200.0, "cm", "Length of tubing drainage - pump", 1.0, 1000.0, "installed"),
        ("Decmotupo", 0.9625, "cm", "Diameter of tubing pump - oxygenator (3/8 inch)", 0.2, 2.5, "installed"),
        ("Lecmotupo", 20.0, "cm", "Length of tubing pump - oxygenator", 1.0, 1000.0, "installed"),
        (
            "Decmotuor", 0.9625, "cm", "Diameter of tubing oxygenator - return (3/8 inch)", 0.2, 2.5,
            "installed",
        ),
        ("Lecmotuor", 200.0, "cm", "Length of tubing oxygenator - return", 1.0, 1000.0, "installed"),
        ("Recmooxy", 0.6744, _R, "Resistance of oxygenator", 0.01, 5.0, "data sheet, taken as linear"),
        ("Cecmodrain", 0.1, _C, "Compliance of drainage cannula", 1e-4, 5.0, "assumed"),
        ("Cecmotudp", 0.1, _C, "Compliance of tubing drainage - pump", 1e-4, 5.0, "assumed"),
        ("Cecmotupo", 0.1, _C, "Compliance of tubing pump - oxygenator", 1e-4, 5.0, "assumed"),
        ("Cecmooxy", 0.008, _C, "Compliance of oxygenator", 1e-4, 5.0, "assumed"),
        ("Cecmotuor", 0.1, _C, "Compliance of tubing oxygenator - return", 1e-4, 5.0, "assumed"),
        ("Cecmoreturn", 0.1, _C, "Compliance of return cannula", 1e-4, 5.0, "assumed"),
    ),
)  # fmt: skip
_VASLEF = "form of Vaslef et al. 1994 (ASAIO J 40:990); default for 1.8 m2"
_FITTED = "fitted to Khadka et al. 2024 (doi 10.5772/intechopen.1006540)"
GAS_PARAMETERS = (
    Parameter(
        "ecmo.sweep_l_min", 4.0, "L/min", "Sweep gas of the oxygenator; 0: it exchanges nothing",
        "setting", 0.0, 20.0, GROUP, clipped=True,
    ),
    Parameter(
        "ecmo.fdo2", 1.0, "1", "Fraction of oxygen in the sweep gas", "setting", 0.21, 1.0, GROUP,
        half_width=0.25, clipped=True,
    ),
    Parameter(
        "ecmo.drainage_mixing", 1.0, "1",
        "Where drainage and return share a compartment: 1, its blood is drained; 0, that of its veins",
        "assumed; recirculation is m Qe / (CO + m Qe): medians of 9, 18 and 28 % mean 0.14, 0.32, 0.58",
        0.0, 1.0, GROUP, Bounds(0.5, 0.0, 1.0), 0.25, clipped=True,
    ),
    Parameter(
        "ecmo.oxygenator.oxygen_transfer", 0.09, "mL/min/mmHg",
        "Oxygen transfer of the oxygenator's membrane at 1 L/min", f"{_VASLEF}; {_FITTED}",
        0.001, 1.0, GROUP, Bounds(0.09, 0.009, 0.9), clipped=True,
    ),
    Parameter(
        "ecmo.oxygenator.oxygen_exponent", 0.84, "1", "Exponent of blood flow in the oxygen transfer",
        f"{_VASLEF}; {_FITTED}", 0.3, 1.0, GROUP, half_width=0.1, clipped=True,
    ),
    Parameter(
        "ecmo.oxygenator.carbon_dioxide_transfer", 4.66, "mL/min/mmHg",
        "Carbon dioxide transfer of the oxygenator's membrane at 1 L/min",
        "64 and 648 mL/min at 1 and 7 L/min, 1 and 35 L/min of gas (Khadka et al. 2024), by membrane area",
        0.1, 50.0, GROUP, clipped=True,
    ),
    Parameter(
        "ecmo.oxygenator.clotted_fraction", 0.0, "1", "Share of the oxygenator's membrane that is clotted",
        "0 when new", 0.0, 0.99, GROUP, Bounds(0.2, 0.0, 0.99), 0.25, clipped=True,
    ),
)  # fmt: skip
"""Sweep gas, recirculation, membrane; the first three are keys of the section. Bounds are wide on purpose."""
MEMBRANE = (
    "ecmo.oxygenator.oxygen_transfer", "ecmo.oxygenator.oxygen_exponent",
    "ecmo.oxygenator.carbon_dioxide_transfer", "ecmo.oxygenator.clotted_fraction",
    "ecmo.sweep_l_min", "ecmo.fdo2",
)  # fmt: skip
"""Parameters of the membrane, in the order of `eclsim.components.MembraneLung`."""

SMALLEST_EXHAUST = 1.0
"""Flow of exhaust gas of an oxygenator [mL/min STPD] below which its partial pressures are not computed."""
SUCTION_MMHG = -100.0
"""Drainage pressure [mmHg] below which suction of the vessel wall and haemolysis are likely."""
_ELSO = "ELSO General Guidelines 2017"
_RUPTURE_RISK = "danger of rupture and haemolysis"
_PRESSURES_BEHIND_PUMP = (
    "post_pump_pressure", "pre_oxygenator_pressure", "post_oxygenator_pressure", "return_cannula_pressure",
)  # fmt: skip
"""Outputs of pressures downstream of the pump."""
LEFT_SIDE = ("PCWP", "EDVLV", "ESVLV", "left_atrial_pressure", "end_diastolic_pressure_lv")
"""Outputs that do not reproduce left ventricular distension by a pump that returns to the arteries."""

POSITIONS = {
    "post_dc": "ecmodrain",
    "pre_pump": "ecmotudp",
    "post_pump": "ecmotupo",
    "pre_oxy": "ecmooxy",
    "post_oxy": "ecmotuor",
    "pre_rc": "ecmoreturn",
}
"""Positions in the circuit, in flow direction, and the compartment at each."""
BEFORE_OXYGENATOR, BEHIND_OXYGENATOR = tuple(POSITIONS)[:4], tuple(POSITIONS)[4:]

POSITION_WORDS = {
    "post_dc": "post drainage cannula",
    "pre_pump": "pre pump",
    "post_pump": "post pump",
    "pre_oxy": "pre oxygenator",
    "post_oxy": "post oxygenator",
    "pre_rc": "pre return cannula",
}
ROLLER_PUMP = "Roller pump"
OTHER_MODE = "other_mode"
"""Choices on the page for a roller pump and for sites that form no usual mode; never in a case file."""
_OTHER_SITE = {"drainage_site": "return_site", "return_site": "drainage_site"}
_BOTH_SIZES = tuple(f"{line}_fr" for line in LINES)
_DUAL_LUMEN_SITES = {"protek": ("ra", "pas")}
"""Sites of drainage and return of dual-lumen cannulae that do not return to the vein they drain."""
_USUAL_MIXING = {"dual": 0.15, "two": 0.33}
"""Mixing of the median recirculation with dual-lumen (9 %) and femoro-jugular cannulae (18 %)."""
MIXED_SITE = "ra"
"""Compartment in which drainage and return of V-V ECMO meet where recirculation is to be stated."""
_GREAT_VEINS = frozenset((*VENOUS_SITES, *DRAINED.values()))
LEAST_EJECTED_L_MIN, DESATURATED_PERCENT = 0.3, 90.0
"""Output of the heart from which, and its saturation below which, a caution names differential hypoxaemia."""
USUAL_PO2 = 60.0
"""PO2 of such blood, of which little is dissolved [mmHg]."""
SMALLEST_EXCESS_L_MIN = 0.1
"""Flow of veno-venous ECMO beyond the venous return from which a caution says so."""
_CIRCUIT_GASES = ("SpreO2", "SpostO2", "PpostO2", "PpostCO2", "PexhaustCO2", "recirculation_fraction")
RETURN_CLAMP = "return_clamp"
CLAMPS = (RETURN_CLAMP, "drainage_clamp")
_IF_OMITTED = {"drainage_mixing": 1.0, **dict.fromkeys(CLAMPS, 0.0)}
"""Values shown by the knobs of keys that a case leaves out."""
_MODES = {"VA": "veno-arterial", "VV": "veno-venous", OTHER_MODE: "other sites"}

USUAL = {
    "VA": {
        "drainage_site": "ra", "drainage_cannula": "venous", "drainage_fr": 21.0,
        "return_site": "ao", "return_cannula": "arterial", "return_fr": 17.0,
    },
    "VV": {
        "drainage_site": "svn", "drainage_cannula": "venous", "drainage_fr": 25.0,
        "return_site": "ra", "return_cannula": "venous", "return_fr": 21.0,
    },
}  # fmt: skip
"""Sites and cannulae that `mode` sets if they are left out."""


class RollerPump(BaseModel):
    """Roller pump, which delivers its flow [L/min] independent of the pressures."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    roller_l_min: float


def _read_pump(value: object, field: Field) -> object:
    if isinstance(value, dict):
        if set(value) != {"roller_l_min"}:
            raise RefusedValueError("a pump given as a table contains only roller_l_min", field.allowed)
        try:
            return {"roller_l_min": read_number(value["roller_l_min"], ROLLER)}
        except RefusedValueError as error:
            mistake = error.mistake
            message = f"roller_l_min {shown(value['roller_l_min'])}: {mistake.message}"
            raise RefusedValueError(message, mistake.allowed, mistake.suggestion) from None
    if isinstance(value, str) and "roller" in value.lower():
        raise RefusedValueError("a roller pump needs its flow", field.allowed, "{ roller_l_min = 4.0 }")
    return read_name(value, field)


_PUMP = Field(
    "Blood pump", "name", names=tuple(PUMPS), also_allowed="{ roller_l_min = 4.0 }", read=_read_pump,
    aliases=makers_names(PUMPS.values()),
)  # fmt: skip
_SIZES = ", ".join(f"{key} {c.sizes_fr[0]} to {c.sizes_fr[-1]} Fr" for key, c in CANNULAE.items())


def _size(description: str) -> Field:
    return number(description, "Fr", 3, 60, 19, required=False, allowed=_SIZES)


def _cannula(description: str, line: str) -> Field:
    return one_of(description, fits_line(line), required=False)


class Ecmo(SecondCannulae):
    """Section [ecmo]: pump speed in rpm, cannula sizes in Fr.

    A rotary pump has a speed, or a flow [L/min] for which `eclsim.simulation.target_flow` solves the speed.
    """

    section = GROUP
    parameters = {parameter.key: parameter for parameter in GAS_PARAMETERS}
    exclusive = (("speed_rpm", "flow_l_min"),)
    pump: Annotated[str | RollerPump, _PUMP]
    speed_rpm: Annotated[
        float | None, number("Speed of a rotary pump", "rpm", 0, 10000, 3400, required=False)
    ] = None
    flow_l_min: Annotated[
        float | None, number("Pump flow that the speed is solved for", "L/min", 0.1, 10, 4, required=False)
    ] = None
    oxygenator: Annotated[str, one_of("Oxygenator", tuple(OXYGENATORS))]
    drainage_site: Annotated[str, patient_site("Compartment that is drained", required=False)]
    drainage_cannula: Annotated[str, _cannula("Type of drainage cannula", "drainage")]
    drainage_fr: Annotated[float, _size("Size of drainage cannula")]
    return_site: Annotated[str, patient_site("Compartment that receives", required=False)]
    return_cannula: Annotated[str, _cannula("Type of return cannula", "return")]
    return_fr: Annotated[float, _size("Size of return cannula")]
    return_clamp: Annotated[
        float | None, number("Clamp on the return line: 0 open, 1 closed", "", 0, 1, 0, required=False)
    ] = None
    drainage_clamp: Annotated[
        float | None,
        number("Clamp or kink of the drainage line: 0 open, 1 closed", "", 0, 1, 0, required=False),
    ] = None
    sweep_l_min: float | None = None
    fdo2: float | None = None
    drainage_mixing: float | None = None
    mode: Annotated[
        Literal["VA", "VV"] | None, one_of("Fills in usual sites and cannulae", tuple(USUAL), required=False)
    ] = None

    @property
    def clamps(self) -> dict[str, float]:
        """Closed share of each clamp that the case has, by key."""
        given = {clamp: getattr(self, clamp) for clamp in CLAMPS}
        return {clamp: closed for clamp, closed in given.items() if closed is not None}

    @classmethod
    def complete(cls, raw: Raw, values: dict[str, Any], key: str, remarks: Remarks) -> None:
        """Fill in the settings that `mode` determines and check that all others are given."""
        usual = USUAL.get(str(values.get("mode")), {})
        filled = {name: value for name, value in usual.items() if name not in raw}
        values |= filled
        if filled:
            settings = ", ".join(f"{name} = {shown(value)}" for name, value in filled.items())
            remarks.note(f"{key}.mode", f"fills in {settings}", shown(values["mode"]))
        fields = cls.fields()
        for name in USUAL["VA"]:
            if name not in raw and name not in filled and ("mode" not in raw or "mode" in values):
                allowed = fields[name].allowed + ', or mode = "VA" or "VV" for the usual ones'
                remarks.error(f"{key}.{name}", "missing", allowed=allowed)
        _check_speed_or_flow(raw, values, key, remarks)


def _gas_setting(section: Ecmo, name: str) -> float:
    value = getattr(section, name)
    return section.parameters[f"{GROUP}.{name}"].value if value is None else value


def _check_speed_or_flow(raw: Raw, values: Raw, key: str, remarks: Remarks) -> None:
    """Check that a rotary pump has either a speed or a target flow, and a roller pump neither."""
    pump = values.get("pump")
    if isinstance(pump, str):
        if "speed_rpm" not in raw and "flow_l_min" not in raw:
            allowed = f"{Ecmo.fields()['speed_rpm'].allowed}, or flow_l_min, to solve for the speed"
            remarks.error(f"{key}.speed_rpm", "missing", allowed=allowed)
        if "speed_rpm" in raw and "flow_l_min" in raw:
            message = f"given with speed_rpm = {shown(raw['speed_rpm'])}: the speed follows from the flow"
            remarks.error(f"{key}.flow_l_min", message, shown(raw["flow_l_min"]), "one of the two")
    if isinstance(pump, dict):
        wrong = {"speed_rpm": "has a flow, not a speed", "flow_l_min": "takes its flow from roller_l_min"}
        for name, reason in wrong.items():
            if name in raw:
                remarks.error(f"{key}.{name}", f"a roller pump {reason}; leave it out", shown(raw[name]))


def ecmo(
    drainage_site: Site,
    return_site: Site,
    drainage_cannula: str = "venous",
    return_cannula: str = "arterial",
    roller: bool = False,
    second: tuple[Connection, ...] = (),
    clamped: Collection[str] = (),
) -> Circuit:
    """An ECMO circuit between two sites.

    Args:
        drainage_site: compartment from which blood is drained.
        return_site: compartment to which blood is returned.
        drainage_cannula: type of the cannula, a key of `CANNULAE`, which determines its resistance.
        return_cannula: type of the cannula, likewise.
        roller: True for a roller pump (`ecmo.roller_l_min`), else a rotary pump (`ecmo.speed_rpm`,
            `ecmo.pump.a` ...).
        second: connections of further cannulae.
        clamped: those of `CLAMPS` that the lines have; each is a parameter (`ecmo.return_clamp`).

    Raises:
        ValueError: There is no such type of cannula.
    """
    OneOf(tuple(CANNULAE))("drainage_cannula", drainage_cannula)
    OneOf(tuple(CANNULAE))("return_cannula", return_cannula)
    from eclsim.circuit.network import Circuit, Compartment, Connection, Exchange
    from eclsim.components import (
        Cannula,
        ElasticVessel,
        MembraneLung,
        Resistance,
        RollerPump,
        RotaryPump,
        Tube,
        TubeVolume,
    )

    volumes = {tube: TubeVolume("L" + tube, "D" + tube) for tube in TUBES} | {"ecmooxy": "ecmo.oxygenator_ml"}
    compartments = tuple(
        Compartment(name, ElasticVessel("C" + name), GROUP, rest_volume=volumes.get(name, 0.0))
        for name in POSITIONS.values()
    )
    pump: Path = (
        RollerPump("ecmo.roller_l_min", "l/min") if roller else RotaryPump("ecmo.speed_rpm", "ecmo.pump.")
    )
    back_clamp, drainage_clamp = (f"ecmo.{clamp}" if clamp in clamped else 0.0 for clamp in CLAMPS)
    drainage = Cannula("ecmo.drainage_fr", CANNULAE[drainage_cannula].coefficients, drainage_clamp)
    back = Cannula("ecmo.return_fr", CANNULAE[return_cannula].coefficients, back_clamp)
    connections = (
        Connection("ecmodrain", drainage, drainage_site, "ecmodrain", GROUP, "ecmo.drainage_mixing"),
        Connection("ecmotudp", Tube("Lecmotudp", "Decmotudp"), "ecmodrain", "ecmotudp", GROUP),
        Connection("ecmopump", pump, "ecmotudp", "ecmotupo", GROUP),
        Connection("ecmotupo", Tube("Lecmotupo", "Decmotupo"), "ecmotupo", "ecmooxy", GROUP),
        Connection("ecmooxy", Resistance("Recmooxy"), "ecmooxy", "ecmotuor", GROUP),
        Connection("ecmotuor", Tube("Lecmotuor", "Decmotuor"), "ecmotuor", "ecmoreturn", GROUP),
        Connection("ecmoreturn", back, "ecmoreturn", return_site, GROUP),
        *second,
    )
    return Circuit(
        compartments, connections, exchanges=(Exchange("ecmooxy", MembraneLung(*MEMBRANE), "ecmooxy", GROUP),)
    )


_DRAINED_BLOOD, _RETURNED_BLOOD = ("in", "ecmodrain"), ("behind", "ecmooxy")
"""Where blood is sampled: where both drainage cannulae and a vent meet, and behind the oxygenator."""


def _gas_output(name: str, long_name: str, definition: str, what: str, sign: float) -> Output:
    return Output(
        name, long_name, "mL/min", definition, ("Qecmooxy",), lambda m: sign * m.gas(what, "at", "ecmooxy"),
        parameters=(GASES,), all_flows=True, read_at="Qecmooxy",
    )  # fmt: skip


def _weighted_law(n: Array) -> Array:
    """Mean of the first two numbers, weighted by the last two; the first where nothing flows."""
    import jax.numpy as jnp

    flow = n[2] + n[3]
    flows = jnp.where(flow > 0.0, flow, 1.0)
    return jnp.stack([jnp.where(flow > 0.0, (n[0] * n[2] + n[1] * n[3]) / flows, n[0])])


def _recirculated(m: BeatMeasures) -> Numbers:
    """Share of recirculated blood in what all drainage cannulae draw."""
    cannulae = ("ecmodrain", "ecmodrain2")
    first = m.gas("recirculated", "drawn", cannulae[0])
    try:
        second = m.gas("recirculated", "drawn", cannulae[1])
    except KeyError:  # there is only one
        return first
    return m.apply(_weighted_law, [first, second, *map(m.forward, cannulae)])[0]


def _exhaust_law(n: Array) -> Array:
    """Exhaust PCO2 [mmHg] from both gases gained, sweep [L/min] and temperature; NaN if no gas leaves."""
    import jax.numpy as jnp

    from eclsim.components.exchangers import AIR_CARBON_DIOXIDE, FLOWMETER_TO_STPD, dry_gas_pressure

    sweep = 1000.0 * FLOWMETER_TO_STPD * n[2]
    left = sweep - n[0] - n[1]
    leaves = left > SMALLEST_EXHAUST
    share = (AIR_CARBON_DIOXIDE * sweep - n[1]) / jnp.where(leaves, left, 1.0)
    return jnp.stack([jnp.where(leaves, dry_gas_pressure(n[3]) * share, jnp.nan * left)])


def _exhaust_pco2(m: BeatMeasures) -> Numbers:
    gained = [m.gas(what, "at", "ecmooxy") for what in ("gained", "gained_co2")]
    settings = [m.parameter(name) for name in ("ecmo.sweep_l_min", "gas.temperature_c")]
    return m.apply(_exhaust_law, [*gained, *settings])[0]


GAS_OUTPUTS = (
    gas_sample("SpreO2", "oxygen saturation of the drained blood", *_DRAINED_BLOOD, "SO2", ("Qecmodrain",)),
    gas_sample("PpreO2", "PO2 of the drained blood", *_DRAINED_BLOOD, "PO2", ("Qecmodrain",)),
    gas_sample("PpreCO2", "PCO2 of the drained blood", *_DRAINED_BLOOD, "PCO2", ("Qecmodrain",)),
    gas_sample("SpostO2", "oxygen saturation behind the oxygenator", *_RETURNED_BLOOD, "SO2", ("Qecmooxy",)),
    gas_sample("PpostO2", "PO2 behind the oxygenator", *_RETURNED_BLOOD, "PO2", ("Qecmooxy",)),
    gas_sample("PpostCO2", "PCO2 behind the oxygenator", *_RETURNED_BLOOD, "PCO2", ("Qecmooxy",)),
    gas_sample(
        "SreturnO2", "oxygen saturation of the blood that the ECMO returns", "drawn", "ecmoreturn", "SO2",
        ("Qecmoreturn",),
    ),
    gas_sample(
        "PreturnCO2", "PCO2 of the blood that the ECMO returns", "drawn", "ecmoreturn", "PCO2",
        ("Qecmoreturn",),
    ),
    _gas_output("VO2_oxygenator", "oxygen uptake of the oxygenator (STPD)", "gained by blood", "gained", 1.0),
    _gas_output(
        "VCO2_oxygenator", "carbon dioxide removed by the oxygenator (STPD)", "lost by blood",
        "gained_co2", -1.0,
    ),
    Output(
        "PexhaustCO2", "PCO2 of the gas that leaves the oxygenator", "mmHg",
        "of the sweep gas with what it has given off and taken up, with water vapour; NaN where none leaves",
        ("Qecmooxy",), _exhaust_pco2, parameters=(GASES,), all_flows=True,
    ),
    Output(
        "recirculation_fraction", "recirculated share of the drained blood", "1",
        "share of the blood of all drainage cannulae that came straight from the return, as a tracer has it",
        ("Qecmooxy",), _recirculated, parameters=(GASES,), all_flows=True, read_at="Qecmodrain",
    ),
)  # fmt: skip


class EcmoDevice(Device[Ecmo]):
    """Veno-arterial or veno-venous ECMO circuit."""

    key, name, section = GROUP, "ECMO", Ecmo
    compartments = {
        "ecmodrain": "after drainage cannula",
        "ecmotudp": "before pump",
        "ecmotupo": "after pump",
        "ecmooxy": "before oxygenator",
        "ecmotuor": "after oxygenator",
        "ecmoreturn": "before return cannula",
    }
    connections = {
        "ecmodrain": "drainage cannula",
        "ecmotudp": "tube to pump",
        "ecmopump": "ECMO pump",
        "ecmotupo": "tube to oxygenator",
        "ecmooxy": "oxygenator",
        "ecmotuor": "tube from oxygenator",
        "ecmoreturn": "return cannula",
        **CONNECTIONS,
    }
    boxes = {
        "ecmodrain": Box(0, 1, "After drainage"),
        "ecmotudp": Box(0, 0, "Before pump"),
        "ecmotupo": Box(1, 0, "After pump"),
        "ecmooxy": Box(2, 0, "Before oxygenator", "Before oxyg."),
        "ecmotuor": Box(3, 0, "After oxygenator", "After oxyg."),
        "ecmoreturn": Box(3, 1, "Before return"),
    }
    marks = {
        "ecmodrain": Mark("cannula", "drainage cannula"),
        "ecmotudp": Mark("tube", "tube"),
        "ecmopump": Mark("pump", "pump"),
        "ecmotupo": Mark("tube", "tube"),
        "ecmooxy": Mark("exchanger", "oxygenator"),
        "ecmotuor": Mark("tube", "tube"),
        "ecmoreturn": Mark("cannula", "return cannula"),
        **MARKS,
    }
    look = Look("#0072B2", "#EEF5FA", 2.0, marker="s")
    panels = (
        Panel("Before the pump", "mmHg", ("Pecmodrain", "Pecmotudp")),
        Panel("After the pump", "mmHg", ("Pecmotupo", "Pecmooxy", "Pecmotuor", "Pecmoreturn")),
        Panel(
            "Flows",
            "L/min",
            ("Qecmodrain", "Qecmodrain2", "Qecmopump", "Qecmooxy", "Qecmoreturn", "Qecmoreturn2"),
        ),
        Panel("Pump head", "mmHg", ("Pecmopump",)),
    )
    swept = (
        Panel(
            "ECMO circuit", "mmHg",
            (
                "pre_oxygenator_pressure", "return_cannula_pressure", "pump_inlet_pressure",
                "lowest_drainage_pressure",
            ),
            ("before oxygenator", "before return", "before pump", "drainage, lowest"),
        ),
    )  # fmt: skip
    tabled = (
        (
            "ECMO circuit",
            (
                "lowest_drainage_pressure", "pump_inlet_pressure", "post_pump_pressure",
                "oxygenator_pressure_drop", "return_cannula_pressure",
            ),
        ),
        (
            "Oxygenator",
            (
                "SpreO2", "SpostO2", "PpostO2", "PpostCO2", "VO2_oxygenator", "VCO2_oxygenator",
                "recirculation_fraction",
            ),
        ),
    )  # fmt: skip
    positions, position_words = POSITIONS, POSITION_WORDS
    products = (*PUMPS.values(), *CANNULAE.values(), *OXYGENATORS.values())
    parameters = (*TUBING, *GAS_PARAMETERS)
    nominal = {
        "ecmo.speed_rpm": 3000.0, "ecmo.drainage_fr": 23.0, "ecmo.return_fr": 17.0,
        "ecmo.roller_l_min": 3.0, "Recmooxy": OXYGENATORS["Quadrox-i Adult"].resistance,
        **{f"ecmo.{clamp}": 0.0 for clamp in CLAMPS}, **pump_values(GROUP, PUMPS["Rotaflow"]), **NOMINAL,
    }  # fmt: skip
    outputs = (
        mean_flow("PF", "ECMO pump flow", "Qecmopump", in_contract=True),
        *SECOND_OUTPUTS,
        mean("drainage_pressure", "mean pressure in the ECMO drainage cannula", "Pecmodrain"),
        lowest("lowest_drainage_pressure", "lowest pressure in the ECMO drainage cannula", "Pecmodrain"),
        mean("pump_inlet_pressure", "mean pressure before the ECMO pump", "Pecmotudp"),
        mean("post_pump_pressure", "mean pressure behind the ECMO pump", "Pecmotupo"),
        mean("pump_head", "mean head of the ECMO pump", "Pecmopump"),
        mean("pre_oxygenator_pressure", "mean pressure before the oxygenator", "Pecmooxy"),
        mean("post_oxygenator_pressure", "mean pressure after the oxygenator", "Pecmotuor"),
        difference(
            "oxygenator_pressure_drop", "mean pressure drop of the oxygenator", "Pecmooxy", "Pecmotuor"
        ),
        mean("return_cannula_pressure", "mean pressure before the ECMO return cannula", "Pecmoreturn"),
        *GAS_OUTPUTS,
    )
    optional = dict(zip(SECOND_SITES, (f"Q{name}" for name in CONNECTIONS), strict=True))
    limits = (
        *SECOND_LIMITS,
        Limit(
            "PF", "alarm", "below", BACKWARD_L_MIN,
            "blood runs backwards through the ECMO circuit: clamp it", "physics",
        ),
        Limit(
            "lowest_drainage_pressure", "warning", "below", SUCTION_MMHG, "suction: lower the pump speed",
            "warning limit of the Cardiohelp system",
        ),
        Limit(
            "lowest_drainage_pressure", "collapse", "below", COLLAPSE_MMHG,
            "the vessel collapses and the pump would not reach this flow: lower its speed", _ELSO,
        ),
        Limit(
            "pump_inlet_pressure", "warning", "below", SUCTION_MMHG, "suction: lower the pump speed",
            "warning limit of the Cardiohelp system",
        ),
        Limit(
            "pump_inlet_pressure", "alarm", "below", COLLAPSE_MMHG,
            "cavitation and haemolysis: lower the pump speed", _ELSO,
        ),
        Limit(
            "PpostO2", "warning", "below", 100.0,
            "the oxygenator gives little oxygen: no gas or too little oxygen in it, flow above the rated "
            "one, or a clot",
            "a convention of this project",
        ),
        *(
            limit
            for name in _PRESSURES_BEHIND_PUMP
            for limit in (
                Limit(name, "warning", "above", 300.0, _RUPTURE_RISK, "usual upper limit of ECMO circuits"),
                Limit(name, "alarm", "above", 400.0, _RUPTURE_RISK, _ELSO),
            )
        ),
    )  # fmt: skip
    usual = {"pump": "Rotaflow", "speed_rpm": 3000.0, "oxygenator": "Quadrox-i Adult", "mode": "VA"}
    set_by_products = {"oxygenator": "Recmooxy"}
    adjusted = ("speed_rpm", "sweep_l_min")
    target = Target("flow_l_min", "speed_rpm", "PF")
    columns = Columns(
        {
            "ecmo_pump": "pump", "ecmo_speed_rpm": "speed_rpm", "oxygenator": "oxygenator",
            "drainage_fr": "drainage_fr", "return_fr": "return_fr",
        },
        ({"ecmo_mode": "mode"}
        | {f"{line}_{what}": f"{line}_{what}" for line in LINES for what in ("site", "cannula")}),
        {"mode": "VA"},
        GAS_KEYS,
    )  # fmt: skip
    alike = (_PRESSURES_BEHIND_PUMP, ("lowest_drainage_pressure", "pump_inlet_pressure"))
    carries_circulation = True
    views = Views(
        traces=(
            Trace(
                "Qecmopump", "ECMO flow", "ECMO pump flow", "flow", ("PF",),
                ((0.0, 6.0), (0.0, 10.0), (-2.0, 6.0), (-5.0, 10.0)),
            ),
        ),
        figures=(KeyFigure("PF", "ECMO", "PF", "L/min", 2),),
        curves=(
            Curve("PF", "ECMO flow", "flow"),
            Curve("drainage_pressure", "Drainage cannula", "circuit", "lowest_drainage_pressure", "drainage"),
        ),
        compared=("PF", "lowest_drainage_pressure", "recirculation_fraction"),
        flow_outputs={"ecmopump": "PF"},
        samples=(
            Sample("ecmodrain", "ECMO, drained"),
            Sample(
                "ecmotuor", "ECMO, after oxygenator",
                {"SO2": "SpostO2", "PO2": "PpostO2", "PCO2": "PpostCO2"},
            ),
        ),
    )  # fmt: skip

    def circuit(self, section: Ecmo) -> Circuit:
        """Circuit between the sites of its section."""
        roller = isinstance(section.pump, RollerPump)
        return ecmo(
            section.drainage_site, section.return_site, section.drainage_cannula, section.return_cannula,
            roller, section.second_connections(), section.clamps,
        )  # fmt: skip

    def values(self, section: Ecmo) -> dict[str, float]:
        """Parameters of pump, cannulae, oxygenator and gas exchange.

        Raises:
            UnsolvedFlowError: A target flow is given in place of a speed.
        """
        values = {
            "Recmooxy": OXYGENATORS[section.oxygenator].resistance,
            "ecmo.oxygenator_ml": OXYGENATORS[section.oxygenator].priming_volume_ml or ASSUMED_ML,
            "ecmo.drainage_fr": section.drainage_fr,
            "ecmo.return_fr": section.return_fr,
            **{f"ecmo.{name}": _gas_setting(section, name) for name in GAS_KEYS},
            **OXYGENATORS[section.oxygenator].gas_values(),
            **OXYGENATORS[section.oxygenator].label_values(),
            **section.second_values(),
            **{f"ecmo.{clamp}": closed for clamp, closed in section.clamps.items()},
        }
        if isinstance(section.pump, RollerPump):
            return values | {"ecmo.roller_l_min": section.pump.roller_l_min}
        if section.speed_rpm is None and section.flow_l_min is not None:
            raise UnsolvedFlowError(
                f"ecmo.flow_l_min = {section.flow_l_min:g} is a target: solve for the pump speed first, "
                "with eclsim.simulation.target_flow.with_speed"
            )
        return values | pump_values(GROUP, PUMPS[section.pump]) | {"ecmo.speed_rpm": section.speed_rpm or 0.0}

    def summary(self, section: Ecmo) -> str:
        """Pump and speed, or flow of a roller pump."""
        if isinstance(section.pump, RollerPump):
            return f"{section.pump.roller_l_min:g} L/min"
        return f"{section.pump} {section.speed_rpm:g} rpm"

    def controls(self, section: Ecmo, sites: Mapping[str, str]) -> list[Control]:
        """Controls of pump, cannulae, oxygenator, mode, sites and gas exchange."""
        result: list[Control] = [picker("pump", "Pump", (*PUMPS, ROLLER_PUMP))]
        if isinstance(section.pump, RollerPump):
            result.append(Knob("roller_l_min", "Pump flow", "L/min", 0.0, 7.0, 0.05))
        else:
            low, high = PUMPS[section.pump].speed_range_rpm
            result.append(Knob("speed_rpm", "Pump speed", "rpm", 0 if low < 2000 else low / 2, high, 25))
        result.append(cannulae_picker(str(self.shown(section, "cannulae"))))
        for line, kind in (("drainage", section.drainage_cannula), ("return", section.return_cannula)):
            sizes = CANNULAE[kind].sizes_fr
            result.append(Knob(f"{line}_fr", f"{line.capitalize()} cannula", "Fr", sizes[0], sizes[-1], 1))
        result.append(Knob("return_clamp", "Clamp on the return line", "", 0.0, 1.0, 0.01))
        result.append(Knob("drainage_clamp", "Kink of the drainage line", "", 0.0, 1.0, 0.01))
        result.append(picker("oxygenator", "Oxygenator", OXYGENATORS))
        others = (OTHER_MODE,) if self.shown(section, "mode") == OTHER_MODE else ()
        result.append(picker("mode", "Mode", (*USUAL, *others), _MODES))
        own = (section.drainage_site, section.return_site)
        mixing = Knob("drainage_mixing", "Mixing before drainage", "", 0.0, 1.0, 0.01, needs="gas")
        return [
            *result,
            *_site_pickers("drainage_site", "Drained from", *own),
            *_site_pickers("return_site", "Returned to", *own[::-1]),
            *second_controls(section, own),
            *((mixing,) if own[0] == own[1] else ()),
            Knob("sweep_l_min", "Sweep gas", "L/min", 0.0, 12.0, 0.1, needs="gas"),
            Knob("fdo2", "Oxygen in the sweep (FdO2)", "", 0.21, 1.0, 0.01, needs="gas"),
            *_CLOTTING,
        ]

    def shown(self, section: Ecmo, key: str) -> float | str:
        """Value of a control: the name of the pump, or the mode, which follows from the sites."""
        if key == "pump":
            return ROLLER_PUMP if isinstance(section.pump, RollerPump) else section.pump
        if key == "roller_l_min" and isinstance(section.pump, RollerPump):
            return section.pump.roller_l_min
        if key in SECOND_SITES:
            return getattr(section, key) or NO_SITE
        if key == "cannulae":
            return chosen_cannulae(section.drainage_cannula, section.return_cannula)
        if key in _IF_OMITTED and getattr(section, key) is None:
            return _IF_OMITTED[key]
        if key != "mode":
            return getattr(section, key)
        if section.drainage_site in VENOUS_SITES and section.return_site in ARTERIAL_SITES:
            return "VA"
        venous = section.drainage_site in VENOUS_SITES and section.return_site in VENOUS_SITES
        return "VV" if venous else OTHER_MODE

    def turned(self, raw: dict[str, Any], key: str, value: object) -> dict[str, Any]:
        """Change a control: a pump starts at a usual speed, a mode sets its sites, new sites remove it."""
        if key == "pump":
            changed = {**raw, "pump": value}
            if value == ROLLER_PUMP:
                changed.pop("speed_rpm", None)
                return changed | {"pump": {"roller_l_min": 4.0}}
            if isinstance(value, str) and value in PUMPS and value != raw["pump"]:
                changed["speed_rpm"] = PUMPS[value].usual_speed_rpm
            return changed
        if key == "roller_l_min":
            return {**raw, "pump": {"roller_l_min": value}}
        if key == "mode":
            settings = {name: raw[name] for name in ("pump", "speed_rpm", "oxygenator") if name in raw}
            return raw if value == OTHER_MODE else settings | {"mode": value}
        if key in SECOND_SITES and isinstance(value, str):
            return with_second(raw, key, value)
        changed = {**raw, key: value}
        if key in _OTHER_SITE:
            changed.pop("mode", None)
            other = _OTHER_SITE[key]
            if value == raw.get(other) != raw.get(key):  # swap the sites of both cannulae
                changed[other] = raw.get(key)
        if (
            key in _BOTH_SIZES
            and chosen_cannulae(raw["drainage_cannula"], raw["return_cannula"]) in DUAL_LUMEN
        ):
            changed |= dict.fromkeys(_BOTH_SIZES, value)
        return changed

    def turned_in(
        self, raw: dict[str, Any], key: str, value: object, sections: Collection[str]
    ) -> dict[str, Any]:
        """Change a control: with gases, both cannulae may share a vein, from which mixing recirculates."""
        shares = "gas" in sections and (raw["drainage_site"], raw["return_site"])
        if key == "cannulae":
            changed = self._with_cannulae(raw, str(value), bool(shares))
        elif key in _OTHER_SITE and shares and {value, *shares} <= {*VENOUS_SITES}:
            changed = {**raw, key: value}
            changed.pop("mode", None)
        else:
            changed = self.turned(raw, key, value)
        return _with_mixing(changed) if key in ("cannulae", *_OTHER_SITE) else changed

    def _with_cannulae(self, raw: dict[str, Any], chosen: str, may_share: bool) -> dict[str, Any]:
        """The section with other cannulae; a dual-lumen one has its sites, mixing is that of the cannulae."""
        if chosen == chosen_cannulae(raw["drainage_cannula"], raw["return_cannula"]):
            return raw
        if chosen not in (TWO, *DUAL_LUMEN):
            return {**raw, "cannulae": chosen}  # which the check refuses
        changed = {name: value for name, value in raw.items() if name not in ("mode", "drainage_mixing")}
        if chosen in DUAL_LUMEN:
            sites = _DUAL_LUMEN_SITES.get(chosen, (MIXED_SITE if may_share else "svn", MIXED_SITE))
            return with_dual_lumen(changed, chosen) | dict(zip(_OTHER_SITE, sites, strict=True))
        usual = USUAL["VA" if raw["return_site"] in ARTERIAL_SITES else "VV"]
        return changed | {name: value for name, value in usual.items() if name not in _OTHER_SITE}

    def sizes(self, section: Ecmo, key: str) -> tuple[float, ...]:
        """The maker's sizes of a cannula [Fr]."""
        kinds = {"drainage_fr": section.drainage_cannula, "return_fr": section.return_cannula}
        return tuple(map(float, CANNULAE[kinds[key]].sizes_fr)) if key in kinds else ()

    def sweep(self, section: Ecmo) -> Sweep | None:
        """Speed of a rotary pump and its usual range; None for a roller pump."""
        if isinstance(section.pump, RollerPump):
            return None
        low, high = PUMPS[section.pump].speed_range_rpm
        return Sweep("speed_rpm", float(section.speed_rpm or 0.0), low, high)

    def check(self, values: Raw, case: CaseValues, key: str, remarks: Remarks) -> None:
        """Check sites, mode, cannulae, speed, gas settings and measured flows."""
        if values.get("return_site") in VENOUS_SITES and "gas" not in case.physiology:
            check_sites(key, values, "drainage_site", "return_site", remarks, "; in a vein only with [gas]")
        elif not _shares_a_vein(values, case):
            check_sites(key, values, "drainage_site", "return_site", remarks)
        _check_mode(values, key, remarks)
        for line in LINES:
            kind, size = values.get(f"{line}_cannula"), values.get(f"{line}_fr")
            if kind is not None and size is not None:
                check_cannula(f"{key}.{line}_fr", size, CANNULAE[kind], remarks)
        check_vessels(key, values, remarks)
        check_lumens(key, values, remarks)
        check_second(key, values, remarks)
        check_speed(key, values, PUMPS, remarks)
        _check_gases(values, case, key, remarks)
        single = len(case.of(self.key)) == 1
        _check_pump_flow(values, case.measurements if single else {}, key, remarks)
        if single:
            _check_native_output(values, case, remarks)

    def held_back(self, names: Naming, values: Mapping[str, float]) -> str:
        """The clamp on the return line, before which the pump holds blood."""
        if not is_clamped(names, values):
            return ""
        return "against the clamp on its return line the pump holds blood in the circuit: lower its speed"

    def narrowed(self, names: Naming, values: Mapping[str, float]) -> tuple[float, str]:
        """The line whose clamp or kink leaves least of its area open."""
        shares = {clamp: values.get(names.parameter(f"ecmo.{clamp}"), 0.0) for clamp in CLAMPS}
        clamp = max(shares, key=lambda one: shares[one])
        if not (closed := shares[clamp]) > 0.0:
            return 0.0, ""
        line, share = clamp.partition("_")[0], "" if closed >= 1.0 else f"{100.0 * closed:.3g} % "
        return (
            closed,
            f"the {line} line of the {names.label} is {share}closed ({names.key}.{clamp} = {closed:g})",
        )

    def findings(
        self, names: Naming, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
    ) -> list[Finding]:
        """Findings on flow outside the label, exhausted sweep gas, recirculation, reading of ventricles."""
        return [
            *_outside_label(names, outputs, values),
            *_standing_blood(names, outputs),
            *_without_exhaust_gas(names, outputs, values),
            *_more_than_venous_return(names, outputs, circuit),
            *_caution_on_left_ventricle(names, outputs, circuit),
            *_caution_on_mixed_artery(names, outputs, circuit, values),
            *caution_on_chart(names, outputs, circuit),
            *ejection_fraction_findings(names, outputs, circuit, ("ecmodrain", "ecmodrain2"), "PF"),
        ]


_CLOTTING = (
    Knob("Recmooxy", "Oxygenator resistance", "mmHg s/mL", 0.05, 5.0, 0.01, True, is_parameter=True),
    Knob(
        "ecmo.oxygenator.clotted_fraction", "Clotted share of the membrane", "", 0.0, 0.99, 0.01,
        needs="gas", is_parameter=True,
    ),
)  # fmt: skip
"""Clotting has two independent effects: higher resistance to blood, and loss of membrane for gas."""


def _site_pickers(key: str, label: str, own: str, other: str) -> list[Control]:
    """Choices of a site; that of the other cannula swaps both, or with gases in veins is shared by both."""

    def offered(word: str) -> Picker:
        labels = {**PATIENT_SITES, **({other: f"{PATIENT_SITES[other]} ({word})"} if other != own else {})}
        return picker(key, label, PATIENT_SITES, labels)

    if not {own, other} <= {*VENOUS_SITES}:
        return [offered("swap")]
    return [replace(offered("swap"), unless="gas"), replace(offered("both"), needs="gas")]


def _with_mixing(raw: dict[str, Any]) -> dict[str, Any]:
    """The section with usual mixing if both cannulae share a vein, and without if they do not."""
    if raw["drainage_site"] != raw["return_site"]:
        return {name: value for name, value in raw.items() if name != "drainage_mixing"}
    is_dual = chosen_cannulae(raw["drainage_cannula"], raw["return_cannula"]) in DUAL_LUMEN
    return {"drainage_mixing": _USUAL_MIXING["dual" if is_dual else "two"], **raw}


def is_clamped(names: Naming, values: Mapping[str, float]) -> bool:
    """Whether the return line of a circuit is at least partly clamped."""
    return values.get(names.parameter(f"ecmo.{RETURN_CLAMP}"), 0.0) > 0.0


def is_closed(names: Naming, values: Mapping[str, float]) -> bool:
    """Whether a line of a circuit is clamped off, so that its blood is meant to stand still."""
    return any(values.get(names.parameter(f"ecmo.{clamp}"), 0.0) >= 1.0 for clamp in CLAMPS)


def _outside_label(names: Naming, outputs: Mapping[str, float], values: Mapping[str, float]) -> list[Finding]:
    """Warning for a flow outside the oxygenator's label; not for backward flow or a circuit clamped off."""
    name = names.output("PF")
    flow = outputs.get(name, -1.0)
    low, high = (values.get(names.parameter(end), math.nan) for end in LABEL_FLOWS)
    held = flow < low and is_closed(names, values)
    end = beyond_label(flow, low, high) if flow >= BACKWARD_L_MIN and not held else None
    if end is None:
        return []
    sentence = (
        f"{names.label} flow {flow:.3g} L/min is {'below' if end == low else 'above'} {end:g} L/min: outside "
        f"the label of its oxygenator, {low:g} to {high:g} L/min"
    )
    if values.get(names.parameter("ecmo.speed_rpm")) == 0.0:
        sentence = (
            f"the pump of the {names.label} stands still, and {max(flow, 0.0):.2f} L/min pass its "
            "oxygenator: it hardly supplies the patient, and blood that stands in it clots (not modelled): "
            "raise the speed, or clamp it"
        )
    return [Finding("warning", name, flow, end, sentence, concerns=(name,))]


def _standing_blood(names: Naming, outputs: Mapping[str, float]) -> list[Finding]:
    """Caution on blood gases in a circuit in which blood hardly moves: they say nothing of the patient."""
    flow = outputs.get(names.output("PF"), math.nan)
    concerns = [name for one in _CIRCUIT_GASES if (name := names.output(one)) in outputs]
    if not concerns or not abs(flow) < -BACKWARD_L_MIN:
        return []
    text = (
        f"blood stands in the {names.label} circuit: before and behind the oxygenator it has met the sweep "
        "gas for a long time, and its gases reach nobody"
    )
    return [Finding.without_limit(CAUTION, concerns[0], outputs[concerns[0]], text, *concerns)]


def _without_exhaust_gas(
    names: Naming, outputs: Mapping[str, float], values: Mapping[str, float]
) -> list[Finding]:
    """Caution if blood takes up nearly all of the sweep gas, so that carbon dioxide is not removed."""
    gained, removed = (outputs.get(names.output(name)) for name in ("VO2_oxygenator", "VCO2_oxygenator"))
    sweep = values.get(names.parameter("ecmo.sweep_l_min"), 0.0)
    if gained is None or removed is None:
        return []
    from eclsim.components.exchangers import FLOWMETER_TO_STPD, USED_UP_SHARE

    brought = 1000.0 * FLOWMETER_TO_STPD * sweep
    left = brought - gained + removed
    used_up = left < max(USED_UP_SHARE * brought, SMALLEST_EXHAUST)
    if not (gained > 0.5 * brought > SMALLEST_EXHAUST and used_up):
        return []
    text = (
        f"the blood of the {names.label} takes up nearly all of its sweep gas ({gained:.0f} of "
        f"{brought:.0f} mL/min STPD): hardly any leaves the oxygenator, which removes "
        f"{max(removed, 0.0):.0f} mL/min of carbon dioxide; raise the sweep"
    )
    concerned = ("VCO2_oxygenator", "VO2_oxygenator", "PpostCO2", "PexhaustCO2")
    concerns = tuple(map(names.output, concerned))
    return [Finding.without_limit(CAUTION, concerns[0], removed, text, *concerns)]


def _more_than_venous_return(names: Naming, outputs: Mapping[str, float], circuit: Circuit) -> list[Finding]:
    """Caution if veno-venous ECMO drains more than the veins bring, so that blood flows back to it."""
    flow, organs = outputs.get(name := names.output("PF")), organ_flow(outputs)
    output = outputs.get("CO") if organs is None else organs
    sites = [(c.source, c.target) for c in circuit.connections if c.group == names.key]
    own = {c.name for c in circuit.compartments if c.group == names.key}
    outer = {site for ends in sites for site in ends} - own
    if flow is None or output is None or not outer or not outer <= _GREAT_VEINS:
        return []
    again = flow - output
    if not again > SMALLEST_EXCESS_L_MIN:
        return []
    text = (
        f"the {names.label} drains {flow:.2f} L/min, but only {output:.2f} L/min come back from the "
        f"body: at least {again:.2f} L/min flow from the return cannula back to the drainage cannula "
        "(recirculation) and supply nobody with oxygen; lower the flow"
    )
    concerns = (one for one in (name, names.output("recirculation_fraction")) if one in outputs)
    return [Finding.without_limit(CAUTION, name, flow, text, *concerns)]


def _caution_on_left_ventricle(
    names: Naming, outputs: Mapping[str, float], circuit: Circuit
) -> list[Finding]:
    """Caution that left ventricular distension is not reproduced if a pump returns blood to arteries."""
    back = (names.place("ecmoreturn"), names.place("ecmoreturn2"))
    returns = any(c.name in back and c.target in ARTERIAL_SITES for c in circuit.connections)
    if not returns or "EDVLV" not in outputs:
        return []
    text = (
        f"{names.label} returns to the arteries: do not read distension or unloading of the left "
        f"ventricle off EDVLV, LVEDP and PCWP; {_reason_for_left_ventricle(circuit)}"
    )
    concerns = (name for name in LEFT_SIDE if name in outputs)
    return [Finding.without_limit(CAUTION, "EDVLV", outputs["EDVLV"], text, *concerns)]


def _caution_on_mixed_artery(
    names: Naming, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
) -> list[Finding]:
    """Caution that desaturated blood of the heart is not seen where the pump's blood mixes with all of it."""
    back = {c.target for c in circuit.connections if c.name == names.place("ecmoreturn")}
    divided = any(c.name == "upper" for c in circuit.compartments)
    if "SaO2" not in outputs or not back & ({"ao", "arch"} if divided else set(ARTERIAL_SITES)):
        return []
    lungs = _saturation_of_the_heart(names, outputs, values)
    if not lungs < DESATURATED_PERCENT:
        return []
    place = (
        "the pump returns to the ascending aorta (central cannulation)"
        if divided
        else "one artery holds the blood of pump and heart, mixed"
    )
    ways = ("" if divided else "[physiology] regional = true and ") + 'ecmo.return_site = "lower"'
    text = (
        f"{place}: SaO2 {outputs['SaO2']:.0f} % is not that of a patient with femoral return, whose heart, "
        f"brain and right hand first get what the heart ejects, {outputs['LVO']:.1f} L/min of about "
        f"{max(lungs, 0.0):.0f} % (differential hypoxaemia); {ways} shows it"
    )
    concerns = [name for name in ("SaO2", "PaO2", "SaO2_lower", "PaO2_lower") if name in outputs]
    return [Finding.without_limit(CAUTION, "SaO2", outputs["SaO2"], text, *concerns)]


def _saturation_of_the_heart(
    names: Naming, outputs: Mapping[str, float], values: Mapping[str, float]
) -> float:
    """Saturation [%] of the blood that the heart ejects, from the oxygen of its mixture with the pump's.

    NaN if the heart ejects next to nothing, or gases are not known.
    """
    from eclsim.blood.standard import OXYGEN_SOLUBILITY
    from eclsim.components.exchangers import HAEMOGLOBIN, OXYGEN_CAPACITY

    own = [names.output(name) for name in ("SreturnO2", "PpostO2", "PF")]
    known = [outputs.get(name, math.nan) for name in ("SaO2", "PaO2", *own, "LVO")]
    mixed, mixed_po2, pumped, pumped_po2, flow, ejected = known
    if not ejected > LEAST_EJECTED_L_MIN:
        return math.nan
    dissolved = 100.0 * OXYGEN_SOLUBILITY / (values[OXYGEN_CAPACITY] * values[HAEMOGLOBIN])
    excess = pumped - mixed + dissolved * (pumped_po2 - mixed_po2)
    return mixed + dissolved * (mixed_po2 - USUAL_PO2) - flow * excess / ejected


def _reason_for_left_ventricle(circuit: Circuit) -> str:
    """Reason why left ventricular filling on V-A ECMO differs from that of patients."""
    there = {
        "reflexes": any(c.name == REGULATION for c in circuit.controllers),
        "bronchial return": any(c.name == "bronchial" for c in circuit.connections),
    }
    missing = " and ".join(name for name, known in there.items() if not known)
    if not missing:
        return "they depend on what is held while the flow changes (volume, tone); not validated in patients"
    return (
        f"without {missing} they follow filling alone (with pump flow they rise in a well-filled patient "
        "and fall in a poorly filled one), whereas patients' ventricles distend"
    )


def _shares_a_vein(values: Raw, case: CaseValues) -> bool:
    """Whether drainage and return share a venous compartment in a case with gas exchange (recirculation)."""
    site = values.get("return_site")
    return "gas" in case.physiology and site in VENOUS_SITES and values.get("drainage_site") == site


def _check_gases(values: Raw, case: CaseValues, key: str, remarks: Remarks) -> None:
    """Warn of gas settings without effect if there is no [gas]; otherwise report assumed values."""
    with_gas = "gas" in case.physiology
    for name in GAS_KEYS:
        if name in values and not with_gas:
            message = "without effect: gases are computed only if the case has a [gas] section"
            remarks.warning(f"{key}.{name}", message, shown(values[name]))
    if with_gas and "sweep_l_min" not in values:
        assumed = Ecmo.parameters["ecmo.sweep_l_min"].value
        remarks.note(f"{key}.sweep_l_min", f"left out, so assumed: {assumed:g} L/min")
    product = OXYGENATORS.get(values.get("oxygenator", ""))
    if with_gas and product is not None and product.priming_volume_ml is None:
        message = (
            f"its blood volume is not known: {ASSUMED_ML:g} mL, that of a Quadrox-i Adult, is assumed where "
            "a course follows gases beat by beat"
        )
        remarks.note(f"{key}.oxygenator", message, shown(product.key))
    if with_gas:
        _check_recirculation(values, key, remarks)


def _check_recirculation(values: Raw, key: str, remarks: Remarks) -> None:
    """Say where drained and returned blood meet in no compartment, so that their mixing has no effect."""
    drained, returned = values.get("drainage_site"), values.get("return_site")
    if drained is None or returned is None or drained in (returned, values.get("second_return_site")):
        return
    apart = f"drainage ({shown(drained)}) and return ({shown(returned)}) share no compartment"
    mixing = values.get("drainage_mixing", _IF_OMITTED["drainage_mixing"])
    in_veins = drained in VENOUS_SITES and returned in VENOUS_SITES
    if mixing != _IF_OMITTED["drainage_mixing"]:
        advice = f': to state recirculation, write drainage_site and return_site = "{MIXED_SITE}"'
        message = f"without effect: {apart}{advice if in_veins else ''}"
        remarks.warning(f"{key}.drainage_mixing", message, shown(mixing))
    elif in_veins:
        message = (
            f"{apart}, so only blood that flows back between them recirculates, whatever the cannulae, and "
            "the more the higher the flow: to state recirculation (with usual cannulae, 9 to 28 % at 4 L/min "
            f'were measured), write "{MIXED_SITE}" for both sites, and drainage_mixing'
        )
        remarks.note(f"{key}.drainage_site", message)


def _check_mode(values: Raw, key: str, remarks: Remarks) -> None:
    mode, site = values.get("mode"), values.get("return_site")
    if mode is None or site is None:
        return
    if site in (VENOUS_SITES if mode == "VA" else ARTERIAL_SITES):
        message = f"contradicts return_site = {shown(site)} ({PATIENT_SITES[site]})"
        other = "VV" if mode == "VA" else "VA"
        allowed = f'mode = "{other}", another return_site, or no mode: the sites then decide'
        remarks.error(f"{key}.mode", message, shown(mode), allowed)


def _check_pump_flow(values: Raw, measured: Raw, section: str, remarks: Remarks) -> None:
    """Compare the measured or set pump flow with the oxygenator's label and the pump's speed."""
    pump, flow, key = values.get("pump"), measured.get("PF"), "measurements.PF"
    if isinstance(pump, dict):
        rate = pump["roller_l_min"]
        if flow is not None and abs(flow - rate) > max(0.3, 0.2 * flow):
            remarks.warning(key, f"the roller pump is set to {rate:g} L/min", shown(flow))
        key, flow = f"{section}.pump", rate
    if flow is None:
        return
    oxygenator = OXYGENATORS.get(values.get("oxygenator", ""))
    if oxygenator is not None and (warning := oxygenator.label_warning(flow)):
        remarks.warning(key, warning, shown(flow))
    expected = _expected_flow(values, measured) if isinstance(pump, str) else None
    if expected is not None and not 0.4 * expected <= flow <= 1.6 * expected + 0.5:
        message = f"implausible at {values['speed_rpm']:g} rpm, which gives about {expected:.1f} L/min"
        remarks.warning(key, message, shown(flow))


def _expected_flow(values: Raw, measured: Raw) -> float | None:
    """Steady flow [L/min], 0 or more, at which the pump's head equals the circuit's pressure drop."""
    lines = (f"{line}_{what}" for line in LINES for what in ("cannula", "fr"))
    needed = ("pump", "speed_rpm", "oxygenator", *lines)
    if any(name not in values for name in needed) or not values["speed_rpm"]:
        return None
    pump, oxygenator = PUMPS[values["pump"]], OXYGENATORS[values["oxygenator"]]
    arterial = values.get("return_site") in (*ARTERIAL_SITES, "lv")
    afterload = measured.get("MAP", 75.0) - 5.0 if arterial else 0.0

    def surplus(flow: float) -> float:
        drop = oxygenator.resistance * flow * ML_S_PER_L_MIN + _tubing_drop_mmhg(flow)
        for line in LINES:
            drop += CANNULAE[values[f"{line}_cannula"]].pressure_drop_mmhg(values[f"{line}_fr"], flow)
        return pump.head_mmhg(values["speed_rpm"], flow) - drop - afterload

    low, high = 0.0, 15.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if surplus(middle) > 0 else (low, middle)
    return low


def _tubing_drop_mmhg(flow_l_min: float) -> float:
    """Laminar pressure drop [mmHg] of the tubing at a flow [L/min], about 4 per 100 cm and L/min."""
    length_cm = sum(parameter.value for parameter in TUBING if parameter.key.startswith("Lecmotu"))
    return 0.0179 * length_cm * flow_l_min


def _check_native_output(values: Raw, case: CaseValues, remarks: Remarks) -> None:
    """Compare a measured CO, read as native output through the lungs, with the pump flow."""
    output, pump_flow = case.measurements.get("CO"), case.measurements.get("PF")
    if output is None or pump_flow is None:
        return
    added = _adds_to_native_output(values, case)
    if added is None:
        return
    if not added:
        if output < pump_flow:
            message = (
                f"below the pump flow {pump_flow:g} L/min: where ECMO returns before the lungs, CO is the "
                "whole flow of the body, and the pump would drain blood that it has just returned"
            )
            remarks.warning("measurements.CO", message, shown(output))
        return
    message = "is read as the native output, through the lungs; "
    if reason := _reason_for_total_output(case, output, pump_flow):
        hint = f"CO = {output - pump_flow:.3g}, a total minus the pump flow {pump_flow:g} L/min"
        remarks.warning("measurements.CO", message + reason, shown(output), hint)
    else:
        message += f"with the pump flow the organs get {output + pump_flow:.3g} L/min"
        remarks.note("measurements.CO", message, shown(output))


def _adds_to_native_output(values: Raw, case: CaseValues) -> bool | None:
    """Whether the pump flow adds to CO in supplying the organs or is part of it; None if it is mixed."""
    drained, given = ({values.get(f"{n}{line}_site") for n in ("", "second_")} - {None} for line in LINES)
    if case.of("vent") or drained & {*ARTERIAL_SITES, *LEFT_HEART}:
        return None
    behind = {site in (*ARTERIAL_SITES, *LEFT_HEART, "part") for site in given}
    return behind.pop() if len(behind) == 1 else None


def _reason_for_total_output(case: CaseValues, output: float, pump_flow: float) -> str:
    """Reason why a CO on V-A ECMO probably includes the pump flow (it then exceeds it), or ""."""
    if output <= pump_flow:
        return ""
    height, weight = case.patient.get("height_cm"), case.patient.get("weight_kg")
    if height is not None and weight is not None:
        index = (output + pump_flow) / body_surface(height, weight)
        if index > _LARGEST_INDEX:
            return (
                f"with the pump flow {pump_flow:g} L/min the organs would get {output + pump_flow:.3g} "
                f"L/min, {index:.1f} L/min/m^2; values above {_LARGEST_INDEX:g} are hardly ever seen"
            )
    systolic, diastolic = case.measurements.get("SP"), case.measurements.get("DP")
    rate = case.patient.get("heart_rate_bpm")
    if systolic is None or diastolic is None or not rate or systolic <= diastolic:
        return ""
    stroke = output * ML_S_PER_L_MIN * 60.0 / rate
    compliance = stroke / (systolic - diastolic)
    if compliance <= _LARGEST_COMPLIANCE:
        return ""
    return (
        f"a stroke volume of {stroke:.0f} mL with a pulse pressure of {systolic - diastolic:g} mmHg means "
        f"an arterial compliance of {compliance:.1f} mL/mmHg; 1 to 2 is usual, and values above "
        f"{_LARGEST_COMPLIANCE:g} are hardly ever seen"
    )


ECMO = EcmoDevice()
