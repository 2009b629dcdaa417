"""ECMO circuit: six compartments in flow direction, connected to any two sites.

    drainage site --(cannula)--> ecmodrain ==tube==> ecmotudp --(pump)--> ecmotupo ==tube==> ecmooxy
        --(oxygenator)--> ecmotuor ==tube==> ecmoreturn --(cannula)--> return site

Sources: Thiel et al. 2025, Figure 1 and Table S-2; pump curves after the method of Boes et al. (2019),
cannulae and oxygenators from the makers' data sheets, as published with the code of Thiel et al.

Beside this file: its parts and their data sheets (`ecmo_parts`), checks of its section (`ecmo_checks`) and
findings about its beats (`ecmo_findings`).
"""

from __future__ import annotations

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
    chosen_cannulae,
    fits_line,
    second_controls,
    with_dual_lumen,
    with_second,
)
from eclsim.devices.cannulae import LIMITS as SECOND_LIMITS
from eclsim.devices.cannulae import OUTPUTS as SECOND_OUTPUTS
from eclsim.devices.description import (
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
    picker,
)
from eclsim.devices.device import CaseValues, Device, Naming, UnsolvedFlowError
from eclsim.devices.ecmo_checks import MIXED_SITE, check_section
from eclsim.devices.ecmo_findings import beat_findings
from eclsim.devices.ecmo_parts import (
    ASSUMED_ML,
    CLAMPS,
    GAS_IF_OMITTED,
    GAS_KEYS,
    GAS_PARAMETERS,
    GROUP,
    LINES,
    MEMBRANE,
    OXYGENATORS,
    PUMPS,
    ROLLER,
    SMALLEST_EXHAUST,
    TUBING,
    is_clamped,
)
from eclsim.devices.plausibility import patient_site
from eclsim.devices.products import makers_names, pump_values
from eclsim.inputs.fields import Field, number, one_of
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.numbers import RefusedValueError, read_number
from eclsim.inputs.sections import Raw, read_name
from eclsim.patient.sites import ARTERIAL_SITES, PATIENT_SITES, VENOUS_SITES

if TYPE_CHECKING:
    from jax import Array

    from eclsim.circuit.network import Circuit, Connection, Site
    from eclsim.components import Path

SUCTION_MMHG = -100.0
"""Drainage pressure [mmHg] below which suction of the vessel wall and haemolysis are likely."""
_ELSO = "ELSO General Guidelines 2017"
_RUPTURE_RISK = "danger of rupture and haemolysis"
_PRESSURES_BEHIND_PUMP = (
    "post_pump_pressure", "pre_oxygenator_pressure", "post_oxygenator_pressure", "return_cannula_pressure",
)  # fmt: skip
"""Outputs of pressures downstream of the pump."""

TUBES = ("ecmotudp", "ecmotupo", "ecmotuor")
"""Names of the compartments that are tubes."""
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
_IF_OMITTED = {"drainage_mixing": GAS_IF_OMITTED["drainage_mixing"], **dict.fromkeys(CLAMPS, 0.0)}
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
    return GAS_IF_OMITTED[name] if value is None else value


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
        "share of the blood of all drainage cannulae that came straight from the return of this circuit, "
        "as a tracer has it",
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
            "lowest_drainage_pressure", "warning", "below", SUCTION_MMHG, "suction: turn the pump down",
            "warning limit of the Cardiohelp system",
        ),
        Limit(
            "lowest_drainage_pressure", "collapse", "below", COLLAPSE_MMHG,
            "the vessel collapses and the pump would not reach this flow: turn it down", _ELSO,
        ),
        Limit(
            "pump_inlet_pressure", "warning", "below", SUCTION_MMHG, "suction: turn the pump down",
            "warning limit of the Cardiohelp system",
        ),
        Limit(
            "pump_inlet_pressure", "alarm", "below", COLLAPSE_MMHG,
            "cavitation and haemolysis: turn the pump down", _ELSO,
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
        check_section(values, case, key, remarks)

    def held_back(self, names: Naming, values: Mapping[str, float]) -> str:
        """The clamp on the return line, before which the pump holds blood."""
        if not is_clamped(names, values):
            return ""
        return "against the clamp on its return line the pump holds blood in the circuit: turn it down"

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
        return beat_findings(names, outputs, circuit, values)


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


ECMO = EcmoDevice()
