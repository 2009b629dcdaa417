"""CRRT circuit: access line, roller pump, tube, dialyzer, return line.

    access site ==tube==> crrttuin --(roller pump)--> crrttupf ==tube==> crrtfil --(dialyzer)--> crrttuout
        ==tube==> return site

Source: Thiel et al. 2025, Figure 1 and Table S-3.

With a flow of dialysate, replacement fluid or net ultrafiltration in its section, the dialyzer also clears
solutes (`eclsim.components.dialysis`). The fluids change no pressure: within a beat their volumes are
negligible.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

from eclsim.devices.description import (
    Assumption,
    Box,
    Columns,
    Control,
    Curve,
    Finding,
    FlowUnit,
    Knob,
    Limit,
    Look,
    Mark,
    Panel,
    Trace,
    Views,
    difference,
    mean,
    mean_flow,
    picker,
)
from eclsim.devices.device import CaseValues, Device, Naming, device_key
from eclsim.devices.dialysed_blood import (
    BY_PLASMA_WATER,
    FILTER_PARAMETERS,
    FLUIDS,
    GROUP,
    OUTPUTS,
    SETTINGS,
    SOLUTES,
    USUAL_FLUID,
    check_fluids,
    dialysed_blood,
    fluid_flow,
    haemoconcentration_findings,
    no_plasma_water,
    warn_of_other_filters,
)
from eclsim.devices.ecmo import BEHIND_OXYGENATOR, ECMO, POSITIONS
from eclsim.devices.ecmo_findings import returned_flow
from eclsim.devices.products import Dialyzer, by_key
from eclsim.inputs.fields import Field, number
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.sections import Raw, Section, read_name, read_share
from eclsim.parameters.parameter import Parameter
from eclsim.parameters.thiel2025 import circuit_parameters
from eclsim.patient.sites import AFTER_LUNGS, ARTERIAL_SITES, BEFORE_LUNGS, PATIENT_SITES, VENOUS_SITES
from eclsim.units import convert

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit, Site


DIALYZERS = by_key(
    (
        Dialyzer(
            key="Prismaflex filter", resistance=15.75, priming_volume_ml=105.0,
            evidence="unvalidated: 52.5 mmHg at 200 mL/min; called M180 in the paper and M100 in the "
            "published code",
        ),
    )
)  # fmt: skip
"""CRRT filters; the parameter Rcrrtfil sets the filter of a case."""

TUBING = circuit_parameters(
    GROUP, "S-3",
    (
        ("Lcrrttuin", 250.0, "cm", "Length of access line", 1.0, 1000.0, "installed"),
        ("Dcrrttuin", 0.3175, "cm", "Diameter of access line (1/8 inch)", 0.1, 1.5, "installed"),
        ("Lcrrttupf", 100.0, "cm", "Length of tubing pump - dialyzer", 1.0, 1000.0, "installed"),
        ("Dcrrttupf", 0.3175, "cm", "Diameter of tubing pump - dialyzer (1/8 inch)", 0.1, 1.5, "installed"),
        ("Lcrrttuout", 250.0, "cm", "Length of return line", 1.0, 1000.0, "installed"),
        ("Dcrrttuout", 0.3175, "cm", "Diameter of return line (1/8 inch)", 0.1, 1.5, "installed"),
        ("Rcrrtfil", 15.75, "mmHg s/mL", "Resistance of dialyzer", 0.1, 200.0, "data sheet, taken as linear"),
        ("Ccrrttuin", 0.1, "mL/mmHg", "Compliance of access line", 1e-4, 5.0, "assumed"),
        ("Ccrrttupf", 0.1, "mL/mmHg", "Compliance of tubing pump - dialyzer", 1e-4, 5.0, "assumed"),
        ("Ccrrtfil", 0.008, "mL/mmHg", "Compliance of dialyzer", 1e-4, 5.0, "assumed"),
        ("Ccrrttuout", 0.1, "mL/mmHg", "Compliance of return line", 1e-4, 5.0, "assumed"),
    ),
)  # fmt: skip

ALARMS_MMHG = {"access": (-250.0, 250.0), "return": (-50.0, 350.0)}
"""Usual low and high pressure alarms [mmHg] of CRRT machines, by line (Thiel et al. 2025, Figures 5, 6)."""

SANSOM_ACCESS_MMHG = 190.0
"""Access pressure above which early circuit failure is more likely (Sansom 2023, cited by Thiel et al.)."""
_MACHINE = "usual alarm of CRRT machines"


def filter_limits(prefix: str = "") -> tuple[Limit, ...]:
    """Limits of a dialyzer whose outputs begin with `prefix`."""
    fraction, transmembrane = f"{prefix}filtration_fraction", f"{prefix}transmembrane_pressure"
    return (
        Limit(
            fraction, "warning", "above", LARGEST_FILTRATION_FRACTION,
            "blood thickens in the dialyzer and clots it", "Joannidis and Oudemans-van Straaten 2007",
        ),
        Limit(fraction, "collapse", "above", 1.0, "no plasma is left", "conservation of water"),
        Limit(
            transmembrane, "warning", "above", 300.0, "the membrane clogs", "usual warning of CRRT machines"
        ),
        Limit(
            transmembrane, "alarm", "above", 450.0, "the membrane may tear",
            "largest allowed for AN69 filters (maker's instructions)",
        ),
    )  # fmt: skip


def assumed_membrane(membrane: Sequence[Parameter], prefix: str = "") -> tuple[Assumption, ...]:
    """Assumptions about constants of the membrane without a source.

    Args:
        membrane: parameters of the membrane, in the order of `FILTER_PARAMETERS`.
        prefix: prefix of the names of outputs.
    """
    permeability, urea = membrane[:2]
    pressures = (f"{prefix}transmembrane_pressure", f"{prefix}effluent_pressure")
    cleared = (f"{prefix}{what}_{name}" for what in ("clearance", "effective_clearance") for name in SOLUTES)
    return (
        Assumption(
            permeability.key, permeability.value, pressures,
            f"the ultrafiltration coefficient of the membrane, {permeability.value:g} mL/h/mmHg, is assumed "
            "(30 to 60 is usual for 1.5 m2); transmembrane pressure, effluent pressure and filtration "
            f"through an open effluent depend on it: set {permeability.key} of your filter in [parameters]",
        ),
        Assumption(
            urea.key, urea.value, tuple(cleared),
            f"the mass transfer coefficients of the membrane, such as {urea.key} {urea.value:g} mL/min, are "
            "assumed; clearances hardly depend on them while the effluent is far less than the flow of blood",
        ),
    )  # fmt: skip


LARGEST_FILTRATION_FRACTION = 0.25

SITES_WITHOUT_ECMO = {"access_site": "svn", "return_site": "ra"}
"""Default sites without an ECMO circuit."""

SCHEMES = {
    "a": ("post_pump", "pre_oxy"),
    "b": ("pre_oxy", "pre_pump"),
    "c": ("post_oxy", "pre_pump"),
    "d": ("post_oxy", "pre_rc"),
    "e": ("pre_oxy", "pre_rc"),
    "f": ("pre_oxy", "post_oxy"),
    "g": ("post_oxy", "pre_oxy"),
    "h": ("pre_pump", "post_dc"),
    "i": ("post_pump", "pre_pump"),
}
"""Access and return position in an ECMO circuit of each scheme in Figure 2 of Thiel et al. 2025."""


def _device_of(site: str) -> str:
    """Key of the device that has a position, also of a named instance, as in "ecmo.left.post_oxy"."""
    from eclsim.devices.registry import devices

    named, _, position = site.rpartition(".")
    keys = (key for key, device in devices().items() if position in device.positions)
    return next((key for key in keys if not named or device_key(named) == key), "")


def _read_site(value: object, field: Field) -> object:
    """Read a site of the patient or a position in another device; "ecmo.post_oxy" is "post_oxy"."""
    device = _device_of(value) if isinstance(value, str) else ""
    if not isinstance(value, str) or not device:
        return read_name(value, field)
    named, _, position = value.rpartition(".")
    return position if named == device else value


def _site(description: str) -> Field:
    nodes = {node: position for position, node in POSITIONS.items()}
    names = (*POSITIONS, *PATIENT_SITES)
    return Field(description, "name", names=names, aliases=nodes, read=_read_site)


_HAEMATOCRIT = Field(
    "Haematocrit of the blood in the access line", "number", "1", 0.05, 0.7, 0.3, required=False,
    read=read_share,
)  # fmt: skip


_BLOOD_FLOW = number(
    "Blood flow of the CRRT pump; 0: pump and fluids stand still", "mL/min", 0, 600, 200, least=10.0
)


class Crrt(Section):
    """Section [crrt]: blood flow in mL/min, sites of the access and return lines, and fluids."""

    section = GROUP
    flow_ml_min: Annotated[float, _BLOOD_FLOW]
    access_site: Annotated[str, _site("Where the access line drains")]
    return_site: Annotated[str, _site("Where the return line ends")]
    dialysate_ml_h: Annotated[float | None, fluid_flow("Flow of dialysate", 1000.0)] = None
    replacement_pre_ml_h: Annotated[
        float | None, fluid_flow("Replacement fluid before the filter", 1000.0)
    ] = None
    replacement_post_ml_h: Annotated[
        float | None, fluid_flow("Replacement fluid behind the filter", 1000.0)
    ] = None
    net_ultrafiltration_ml_h: Annotated[
        float | None, fluid_flow("Net ultrafiltration (fluid taken from the patient)", 100.0, 1.0)
    ] = None
    fluid_bicarbonate_mmol_l: Annotated[
        float | None, number("Bicarbonate of all fluids", "mmol/L", 0, 60, 32, required=False)
    ] = None
    haematocrit_in: Annotated[float | None, _HAEMATOCRIT] = None
    plasma_bicarbonate_mmol_l: Annotated[
        float | None, number("Total CO2 of the patient's plasma", "mmol/L", 2, 80, 24, required=False)
    ] = None
    citrate_mmol_l: Annotated[
        float | None, number("Regional citrate, mmol per L of blood", "mmol/L", 0, 10, 3, required=False)
    ] = None

    @property
    def dialyses(self) -> bool:
        """Whether dialysis is computed: true if any flow of fluid is given."""
        return any(getattr(self, key) is not None for key in FLUIDS)


def crrt(access_site: Site, return_site: Site, dialysis: bool = False) -> Circuit:
    """Circuit of a CRRT between two sites.

    Args:
        access_site: compartment of the ECMO circuit or of the patient from which blood is drawn.
        return_site: compartment to which blood is returned.
        dialysis: whether the filter also exchanges water and solutes with fluids.
    """
    from eclsim.circuit.network import Circuit, Compartment, Connection, Exchange
    from eclsim.components import ElasticVessel, Resistance, RollerPump, Tube, TubeVolume

    (dialyzer,) = DIALYZERS.values()
    volumes = {name: TubeVolume("L" + name, "D" + name) for name in CrrtDevice.compartments}
    volumes |= {"crrtfil": dialyzer.priming_volume_ml or math.nan}
    compartments = tuple(
        Compartment(name, ElasticVessel("C" + name), GROUP, rest_volume=volume)
        for name, volume in volumes.items()
    )
    connections = (
        Connection("crrttuin", Tube("Lcrrttuin", "Dcrrttuin"), access_site, "crrttuin", GROUP),
        Connection("crrtpump", RollerPump("crrt.flow_ml_min"), "crrttuin", "crrttupf", GROUP),
        Connection("crrttupf", Tube("Lcrrttupf", "Dcrrttupf"), "crrttupf", "crrtfil", GROUP),
        Connection("crrtfil", Resistance("Rcrrtfil"), "crrtfil", "crrttuout", GROUP),
        Connection("crrttuout", Tube("Lcrrttuout", "Dcrrttuout"), "crrttuout", return_site, GROUP),
    )
    if not dialysis:
        return Circuit(compartments, connections)
    from eclsim.components.dialysis import DialysedBlood, Hemofilter

    fibres = Hemofilter(SETTINGS)
    laws = {"dialyzer": fibres, "dialysed": DialysedBlood(fibres)}
    exchanges = tuple(Exchange(name, law, "crrtfil", GROUP) for name, law in laws.items())
    return Circuit(compartments, connections, (), exchanges)


class CrrtDevice(Device[Crrt]):
    """Continuous renal replacement therapy."""

    key, name, section = GROUP, "CRRT", Crrt
    compartments = {
        "crrttuin": "access line",
        "crrttupf": "after roller pump",
        "crrtfil": "before dialyzer",
        "crrttuout": "return line",
    }
    connections = {
        "crrttuin": "access line",
        "crrtpump": "CRRT pump",
        "crrttupf": "tube to dialyzer",
        "crrtfil": "dialyzer",
        "crrttuout": "return line",
    }
    boxes = {
        "crrttuin": Box(0, 0, "Before pump"),
        "crrttupf": Box(1, 0, "After pump"),
        "crrtfil": Box(2, 0, "Before dialyzer"),
        "crrttuout": Box(3, 0, "After dialyzer"),
    }
    marks = {
        "crrtpump": Mark("roller", "roller pump"),
        "crrttupf": Mark("tube", "tube"),
        "crrtfil": Mark("exchanger", "dialyzer"),
    }
    look = Look("#00734F", "#EDF7F3", 1.5, (0, (4, 1.5)), "^")
    panels = (
        Panel("Before the pump", "mmHg", ("Pcrrttuin",)),
        Panel("After the pump", "mmHg", ("Pcrrttupf", "Pcrrtfil", "Pcrrttuout")),
        Panel("Flows", "mL/min", ("Qcrrttuin", "Qcrrtpump", "Qcrrtfil", "Qcrrttuout")),
        Panel("Pump head", "mmHg", ("Pcrrtpump",)),
    )
    swept = (
        Panel(
            "CRRT lines", "mmHg", ("crrt_return_pressure", "crrt_access_pressure"),
            ("return line", "access line"),
        ),
    )  # fmt: skip
    tabled = (
        ("CRRT lines", ("crrt_access_pressure", "crrt_return_pressure")),
        (
            "Dialysis",
            (
                "effluent_ml_h", "filtration_fraction", "transmembrane_pressure", "effluent_pressure",
                "effective_clearance_urea", "effective_clearance_creatinine",
                "effective_clearance_potassium", "effective_clearance_drug", "base_gain",
                "crrt_carbon_dioxide_removal",
            ),
        ),
    )  # fmt: skip
    products = tuple(DIALYZERS.values())
    parameters = (*TUBING, *FILTER_PARAMETERS)
    nominal = {"crrt.flow_ml_min": 200.0}
    lines = {"access_site": "crrttuin", "return_site": "crrttuout"}
    schemes = {
        letter: {"access_site": access, "return_site": back} for letter, (access, back) in SCHEMES.items()
    }
    usual = {"flow_ml_min": 200.0, "access_site": "post_oxy", "return_site": "pre_oxy"}
    columns = Columns(optional={f"crrt_{k}": k for k in ("flow_ml_min", "access_site", "return_site")})
    assumptions = assumed_membrane(FILTER_PARAMETERS)
    outputs = (
        mean_flow("crrt_flow", "mean blood flow of the CRRT", "Qcrrtpump"),
        mean("crrt_access_pressure", "mean pressure in the CRRT access line", "Pcrrttuin"),
        mean("crrt_return_pressure", "mean pressure in the CRRT return line", "Pcrrttuout"),
        difference(
            "crrt_filter_pressure_drop", "mean pressure drop of the dialyzer", "Pcrrtfil", "Pcrrttuout"
        ),
        *OUTPUTS,
    )
    optional = {"dialysate_ml_h or another flow of fluid": f"{GROUP}.{FLUIDS[0]}"}
    limits = (
        *(
            Limit(
                f"crrt_{line}_pressure", "alarm", side, value, "machine alarm", _MACHINE, running="crrt_flow"
            )
            for line, bounds in ALARMS_MMHG.items()
            for side, value in zip(("below", "above"), bounds, strict=True)
        ),
        Limit(
            "crrt_access_pressure", "warning", "above", SANSOM_ACCESS_MMHG,
            "early circuit failure is more likely", "Sansom et al. 2023", running="crrt_flow",
        ),
        *filter_limits(),
    )  # fmt: skip
    views = Views(
        traces=(
            Trace(
                "Pcrrttuin", "CRRT access", "pressure in the CRRT access line", "mean",
                ("crrt_access_pressure",), ((-300.0, 300.0), (-600.0, 600.0)),
            ),
            Trace(
                "Pcrrttuout", "CRRT return", "pressure in the CRRT return line", "mean",
                ("crrt_return_pressure",), ((0.0, 400.0), (-200.0, 800.0)),
            ),
        ),
        curves=(
            Curve("crrt_access_pressure", "CRRT access", "circuit", "crrt_access_pressure", "access"),
            Curve("crrt_return_pressure", "CRRT return", "circuit", "crrt_return_pressure", "return"),
        ),
        compared=("crrt_access_pressure", "crrt_return_pressure"),
        flow_unit=FlowUnit(60.0, 0, "mL/min"),
    )  # fmt: skip

    def circuit(self, section: Crrt) -> Circuit:
        """Circuit between the sites of its section."""
        return crrt(section.access_site, section.return_site, section.dialyses)

    def values(self, section: Crrt) -> dict[str, float]:
        """Flow of the roller pump and, with dialysis, settings of the fluids and the blood."""
        values = {"flow_ml_min": section.flow_ml_min}
        if section.dialyses:
            given = section.model_dump(exclude_none=True)
            values |= {key: given.get(key, 0.0) if section.flow_ml_min else 0.0 for key in FLUIDS}
            values |= {key: given.get(key, usual) for key, usual in USUAL_FLUID.items()}
        return {f"{GROUP}.{key}": value for key, value in values.items()}

    def values_of_blood(self, section: Crrt, haemoglobin_g_dl: float, gases: bool) -> dict[str, float]:
        """Haematocrit and carbon dioxide of the blood in the access line."""
        return dialysed_blood(section, gases) if section.dialyses else {}

    def summary(self, section: Crrt) -> str:
        """Blood flow."""
        return f"{section.flow_ml_min:g} mL/min"

    def controls(self, section: Crrt, sites: Mapping[str, str]) -> list[Control]:
        """Controls of blood flow, filter resistance, sites of the lines and given fluid flows."""
        return [
            Knob("flow_ml_min", "Blood flow", "mL/min", 50, 400, 5),
            Knob("Rcrrtfil", "Dialyzer resistance", "mmHg s/mL", 5.0, 200.0, 0.5, True, is_parameter=True),
            picker("access_site", "Access line at", sites, sites, line="access"),
            picker("return_site", "Return line at", sites, sites, line="return"),
            *(
                Knob(key, Crrt.fields()[key].description, "mL/h", 0, 4000 if key != FLUIDS[3] else 500, 50)
                for key in FLUIDS
                if getattr(section, key) is not None
            ),
        ]

    def reconnected(self, raw: dict[str, Any], sites: Collection[str]) -> dict[str, Any]:
        """Move lines to the patient's veins if the ECMO circuit to which they were connected is gone."""
        if raw["access_site"] not in sites:
            return raw | SITES_WITHOUT_ECMO
        gone = raw["return_site"] not in sites
        return raw | {"return_site": SITES_WITHOUT_ECMO["return_site"]} if gone else raw

    def check(self, values: Raw, case: CaseValues, key: str, remarks: Remarks) -> None:
        """Check that sites exist and are plausible, and that flow and fluids are possible."""
        circuits = case.of("ecmo")
        for name in ("access_site", "return_site"):
            _check_position(f"{key}.{name}", values.get(name), case, remarks)
        access, back = values.get("access_site"), values.get("return_site")
        if access is not None and access == back:
            message = "the same as access_site: the filter cleans blood that just passed it (recirculation)"
            remarks.warning(f"{key}.return_site", message, shown(back))
        elif access in ARTERIAL_SITES and back in VENOUS_SITES:
            remarks.warning(f"{key}.return_site", "drains an artery into a vein: a shunt", shown(back))
        if back in AFTER_LUNGS:
            _warn_of_embolism(f"{key}.return_site", access, str(back), remarks)
        elif _reaches_arteries(back, case):
            message = (
                "returns behind the oxygenator of an ECMO that returns to the arteries: nothing holds back "
                "air or clots from the CRRT before them"
            )
            remarks.warning(f"{key}.return_site", message, shown(back), "a position before the oxygenator")
        if "ecmo" in circuits and access in POSITIONS and back in POSITIONS:
            _check_flow(f"{key}.flow_ml_min", values.get("flow_ml_min"), circuits["ecmo"], remarks)
        check_fluids(values, case, key, remarks)

    def findings(
        self, names: Naming, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
    ) -> list[Finding]:
        """Findings on excessive water removal or blood flow, and on clearances beside other filters."""
        return [
            *_pump_stopped(names, outputs, values),
            *haemoconcentration_findings(names, outputs, values),
            *no_plasma_water(names, outputs, "filtration_fraction", BY_PLASMA_WATER),
            *_draws_more_than_carried(names, outputs, circuit),
            *warn_of_other_filters(names, outputs, circuit),
        ]


def _pump_stopped(names: Naming, outputs: Mapping[str, float], values: Mapping[str, float]) -> list[Finding]:
    """Warning for a blood pump that stands still."""
    flow = names.output("crrt_flow")
    if flow not in outputs or values.get(names.parameter(f"{GROUP}.flow_ml_min")) != 0.0:
        return []
    text = (
        f"{names.label}: pump and fluids stand still, so nothing is cleared or removed, and its lines raise "
        "no alarms of pressure; the blood in the filter clots within minutes (not modelled), and is lost if "
        "it cannot be given back: bleed_ml"
    )
    return [Finding.without_limit("warning", flow, outputs[flow], text, flow)]


def _draws_more_than_carried(names: Naming, outputs: Mapping[str, float], circuit: Circuit) -> list[Finding]:
    """Alarm for a CRRT flow above what the ECMO circuit from which it is drawn carries to the patient.

    A pump between return and access carries the CRRT flow as well, in a circle: above this limit more than
    half of the blood in the access line came straight from the return line.
    """
    ends = {c.name: (c.source, c.target) for c in circuit.connections}
    groups = {c.name: c.group for c in circuit.compartments}
    access, _ = ends.get(names.place("crrttuin"), ("", ""))
    _, back = ends.get(names.place("crrttuout"), ("", ""))
    group = groups.get(str(access), "")
    if device_key(group) != "ecmo" or groups.get(str(back)) != group:
        return []
    ecmo = Naming(ECMO, group.partition(".")[2])
    drawn_name, drawn = (name := names.output("crrt_flow")), outputs.get(name)
    carried = returned_flow(ecmo, outputs, circuit)
    if drawn is None or carried is None or drawn <= abs(carried):
        return []
    text = (
        f"{names.label} flow {drawn:.2f} L/min is above the {carried + 0.0:.2f} L/min that the {ecmo.label} "
        "returns to the patient: between the CRRT lines blood runs backwards or in a circle"
    )
    cleared = (names.output(f"effective_clearance_{name}") for name in SOLUTES)
    concerns = (drawn_name, ecmo.output("PF"), *(name for name in cleared if name in outputs))
    return [Finding("alarm", drawn_name, drawn, carried, text, concerns=concerns)]


def _check_position(key: str, site: str | None, case: CaseValues, remarks: Remarks) -> None:
    """Report a position whose device is not connected."""
    device = "" if site is None or site in PATIENT_SITES else _device_of(site)
    if site is None or not device:
        return
    section = site.rpartition(".")[0] or device
    if section in case.devices:
        return
    message = f"a position in the {device.upper()} circuit, but the case has no [{section}] section"
    circuits = [Naming(ECMO, other.partition(".")[2]) for other in case.of("ecmo")]
    positions = [position for names in circuits for position in names.sites()]
    adds = f", or add [{section}]" if all(bool(names.name) == ("." in section) for names in circuits) else ""
    allowed = ", ".join((*PATIENT_SITES, *positions)) + adds
    remarks.error(key, message, shown(site), allowed)


def _reaches_arteries(back: str | None, case: CaseValues) -> bool:
    """Whether a return line ends between an oxygenator and the left heart or an artery."""
    section, _, position = str(back).rpartition(".")
    circuit = case.of("ecmo").get(section or "ecmo", {})
    return position in BEHIND_OXYGENATOR and circuit.get("return_site") in AFTER_LUNGS


def embolism_text(site: str) -> str:
    """What follows if a return line ends at a site of the left heart or the arteries."""
    return (
        f"returns to the {PATIENT_SITES[site]}: air or clots from the CRRT go to the arteries of the body "
        "(systemic embolism), as neither lungs nor an oxygenator hold them back"
    )


def _warn_of_embolism(key: str, access: str | None, back: str, remarks: Remarks) -> None:
    """Warn of a return line that ends where neither lungs nor an oxygenator hold back air and clots."""
    message = embolism_text(back)
    if access in BEFORE_LUNGS:
        message += "; it drains venous blood, which bypasses lungs and oxygenator"
    remarks.warning(key, message, shown(back), "a vein, or a position before the oxygenator")


def _check_flow(key: str, drawn: float | None, ecmo: Raw, remarks: Remarks) -> None:
    """Warn of a set CRRT flow above the set flow of the ECMO circuit from which it is drawn."""
    pump = ecmo.get("pump")
    carried = pump["roller_l_min"] if isinstance(pump, dict) else ecmo.get("flow_l_min")
    if drawn is None or carried is None or drawn <= convert(carried, "L/min", "mL/min"):
        return
    message = (
        f"above the ECMO flow {carried:g} L/min that it is drawn from: between the CRRT lines blood runs "
        "backwards or in a circle"
    )
    remarks.warning(key, message, shown(drawn))


CRRT = CrrtDevice()
