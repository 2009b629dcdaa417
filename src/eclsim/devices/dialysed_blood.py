"""Settings, checks and outputs of dialyzers: fluid flows, the blood that enters, the membrane of the CRRT."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from eclsim.devices.description import CAUTION, GASES, BeatMeasures, Finding, Numbers, Output
from eclsim.devices.device import CaseValues, Naming
from eclsim.inputs.fields import Field, number
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.sections import Raw, Section
from eclsim.parameters import dialysed_drug
from eclsim.parameters.fluid import HAEMATOCRIT
from eclsim.parameters.gas import PARAMETERS as GAS
from eclsim.parameters.parameter import Parameter
from eclsim.units import RED_CELL_HAEMOGLOBIN

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit
    from eclsim.components.dialysis import Performance


FLUIDS = ("dialysate_ml_h", "replacement_pre_ml_h", "replacement_post_ml_h", "net_ultrafiltration_ml_h")
"""Keys of fluid flows; dialysis is computed if one of them is given."""
NET_ULTRAFILTRATION = FLUIDS[3]
DRAWN_FROM_PLASMA = FLUIDS[2:]
"""Fluids removed from the plasma that enters; replacement before the filter is added to it first."""
HARMFUL_ML_KG_H = 1.75
"""Net ultrafiltration above which fewer patients survived than below 1.01 mL/kg/h (Murugan et al. 2019, JAMA
Netw Open, doi 10.1001/jamanetworkopen.2019.5418)."""
FEWER_SURVIVED_TEXT = (
    f"above {HARMFUL_ML_KG_H:g} mL/kg/h fewer critically ill patients survived than below 1.01 (Murugan et "
    "al. 2019)"
)
USUAL_FLUID = {
    "fluid_bicarbonate_mmol_l": 32.0, "haematocrit_in": 0.30, "plasma_bicarbonate_mmol_l": 24.0,
    "citrate_mmol_l": 0.0,
}  # fmt: skip
"""Default values of these keys if dialysis is computed."""
LARGEST_WITH_CITRATE_MMOL_L = 27.0
"""Bicarbonate of fluids above which they are not made for citrate (a convention of this project)."""
USUAL_RED_CELLS = (28.0, 38.0)
"""Range of mean corpuscular haemoglobin concentrations in patients [g/dL]; 32 to 36 are normal."""
USUAL_HAEMOGLOBIN = GAS["gas.haemoglobin_g_dl"].value
"""Default haemoglobin of the section `[gas]`, in g/dL."""
CARBON_DIOXIDE_FROM_GASES = 0.0
"""Value of plasma carbon dioxide that selects the one computed from the gases of the entering blood."""
HAEMATOCRIT_OF_PATIENT = 0.0
"""Value of `haematocrit_in` that selects the haematocrit of the patient's blood, whatever it is."""
OF_PATIENT = {
    "haematocrit_in": HAEMATOCRIT_OF_PATIENT, "plasma_bicarbonate_mmol_l": CARBON_DIOXIDE_FROM_GASES,
}  # fmt: skip
"""Keys that need not be given, each with the value that selects the patient's own."""
HAEMOGLOBIN = "gas.haemoglobin_g_dl"
BLOOD_PARAMETERS = (HAEMOGLOBIN, HAEMATOCRIT)
"""Parameters that the patient's haematocrit is computed from: the second if gases are not computed."""
TEMPERATURE = "gas.temperature_c"
DRUG = (dialysed_drug.SIEVING, dialysed_drug.AREA_PRODUCT)
"""Parameters of the drug of [dialysed_drug], in the order of `eclsim.components.dialysis.drug_clearance`."""
DRUG_DEFINITION = "removed / concentration in the plasma, bound and unbound"
UNKNOWN_GASES = (0.0, 7.4, 37.0)
"""PCO2 [mmHg], pH and temperature [C] if gases are not computed; the plasma's CO2 is then set."""


def fluid_flow(
    description: str, typical: float, least: float = 20.0, maximum: float = 20000.0, required: bool = False
) -> Field:
    """Field of a fluid flow [mL/h]; a value below `least`, which no machine delivers, is probably in L/h."""
    return number(description, "mL/h", 0, maximum, typical, required=required, least=least)


def dialysed_blood(section: Section, gases: bool) -> dict[str, float]:
    """Values of `haematocrit_in` and `plasma_bicarbonate_mmol_l` that select the patient's, if not set."""
    keys = OF_PATIENT if gases else ("haematocrit_in",)
    return {f"{section.section}.{key}": OF_PATIENT[key] for key in keys if getattr(section, key) is None}


@dataclass(frozen=True)
class Fibres:
    """Dialysate fibres of a device in a beat, and outputs that describe their performance.

    Args:
        signals: waveforms of blood flow, and of blood pressure before and after the fibres.
        settings: parameters, in the order of `eclsim.components.dialysis.Settings`.
        entering: connection of the exchange whose entering blood gases are used, if gases are computed.
        read_at: waveform of the place that the outputs describe.
        prefix: prefix of the names of the outputs.
        pump: parameter of the flow of a blood pump, with which the fluids stand still; empty if none has.
    """

    signals: tuple[str, str, str]
    settings: tuple[str, ...]
    entering: str
    read_at: str
    prefix: str = ""
    pump: str = ""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters of the performance."""
        return (*self.settings, self.pump) if self.pump else self.settings

    def performance(self, m: BeatMeasures, by_gases: bool = False) -> Performance:
        """Performance in a beat (`eclsim.components.dialysis.Performance`)."""
        return m.cached((self.entering, str(by_gases)), lambda: self._performance(m, by_gases))

    def _performance(self, m: BeatMeasures, by_gases: bool) -> Performance:
        from eclsim.components import dialysis

        flow, *pressures = map(m.mean, self.signals)
        gases: Sequence[Numbers] = UNKNOWN_GASES
        if by_gases and GASES in m.circuit.content_names():
            gases = [m.gas(what, "into", self.entering) for what in ("PCO2", "pH")]
            gases = [*gases, m.parameter(TEMPERATURE)]
        settings = map(m.parameter, self.settings)
        numbers = [60.0 * flow, *pressures, *gases, patients_haematocrit(m), *settings]
        if not self.pump:
            return dialysis.Performance(*m.apply(dialysis.performance, numbers))
        return dialysis.Performance(*m.apply(dialysis.pumped_performance, [m.parameter(self.pump), *numbers]))

    def drug(self, m: BeatMeasures) -> Sequence[Numbers]:
        """Clearance of the drug of [dialysed_drug] and flow of plasma in a beat [mL/min]."""
        from eclsim.components import dialysis

        of_drug, settings = map(m.parameter, DRUG), map(m.parameter, self.settings)
        numbers = [60.0 * m.mean(self.signals[0]), *of_drug, patients_haematocrit(m), *settings]
        if not self.pump:
            return m.apply(dialysis.drug_clearance, numbers)
        return m.apply(dialysis.pumped_drug_clearance, [m.parameter(self.pump), *numbers])

    def drug_output(self, name: str, long_name: str, compute: Callable[[BeatMeasures], Numbers]) -> Output:
        """Output of a clearance of the drug [mL/min], which only a case with a drug has."""
        return Output(
            f"{self.prefix}{name}", long_name, "mL/min", DRUG_DEFINITION, self.signals[:1], compute,
            parameters=(*self.parameters, *DRUG), blood_parameters=BLOOD_PARAMETERS,
            read_at=self.read_at,
        )  # fmt: skip

    def output(
        self, name: str, field: str, long_name: str, unit: str, definition: str, by_gases: bool = False,
        absolute: bool = False,
    ) -> Output:  # fmt: skip
        """Output that is a field of the performance."""
        return Output(
            f"{self.prefix}{name}", long_name, unit, definition, self.signals,
            lambda m: getattr(self.performance(m, by_gases), field), parameters=self.parameters,
            blood_parameters=BLOOD_PARAMETERS, all_flows=by_gases, by_gases=by_gases,
            read_at=self.read_at, absolute=absolute,
        )  # fmt: skip


def patients_haematocrit(m: BeatMeasures) -> Numbers:
    """Haematocrit of the patient's blood [-]; the usual one if the circuit does not know it."""
    if GASES in m.circuit.content_names():
        return m.parameter(HAEMOGLOBIN) / RED_CELL_HAEMOGLOBIN
    if HAEMATOCRIT in m.circuit.parameter_names():
        return m.parameter(HAEMATOCRIT)
    return USUAL_FLUID["haematocrit_in"]


def follows_blood_hint(key: str) -> str:
    """What to do to vary a value that selects the patient's own blood; empty for any other."""
    if not key.endswith(".haematocrit_in"):
        return ""
    return f" (that of the patient's blood): give {key} in the case, or vary {' or '.join(BLOOD_PARAMETERS)}"


def check_fluids(values: Raw, case: CaseValues, key: str, remarks: Remarks) -> None:
    """Check that the plasma can supply the fluids removed, and warn of keys without effect."""
    given = {name: values[name] for name in FLUIDS if values.get(name) is not None}
    idle = [name for name in USUAL_FLUID if values.get(name) is not None]
    if not given:
        for name in idle:
            remarks.warning(
                f"{key}.{name}", f"has no effect without one of {', '.join(FLUIDS)}", shown(values[name])
            )
        return
    gas, own = case.physiology.get("gas"), values.get("haematocrit_in")
    if gas is not None and own:
        check_red_cells(f"{key}.haematocrit_in", own, gas.get("haemoglobin_g_dl", USUAL_HAEMOGLOBIN), remarks)
    drawn = {name: given[name] for name in DRAWN_FROM_PLASMA if given.get(name)}
    if drawn and values.get("flow_ml_min") != 0.0:  # fluids stand still with the pump
        _check_water(drawn, values, case, key, remarks)
    _check_rate(case, key, remarks)
    _check_base(values, key, remarks)


def _check_base(values: Raw, key: str, remarks: Remarks) -> None:
    """Warn of citrate, which becomes bicarbonate, with fluids that are not made for it."""
    citrate, flow = values.get("citrate_mmol_l") or 0.0, values.get("flow_ml_min") or 0.0
    stated = values.get("fluid_bicarbonate_mmol_l")
    bicarbonate = USUAL_FLUID["fluid_bicarbonate_mmol_l"] if stated is None else stated
    if not citrate * flow or bicarbonate <= LARGEST_WITH_CITRATE_MMOL_L:
        return
    given = 0.06 * flow * citrate
    message = (
        f"{given:.0f} mmol/h of citrate become up to {3.0 * given:.0f} mmol/h of bicarbonate, less what the "
        f"filter clears, and the fluids hold {bicarbonate:g} mmol/L as well: alkalosis within hours "
        "(base_gain); fluids made for citrate hold 20 to 25 mmol/L (fluid_bicarbonate_mmol_l)"
    )
    remarks.warning(f"{key}.citrate_mmol_l", message, shown(citrate))


def _check_water(
    drawn: Mapping[str, float], values: Raw, case: CaseValues, key: str, remarks: Remarks
) -> None:
    """Check that the plasma holds the water that is removed."""
    from eclsim.components.dialysis import PLASMA_WATER

    plasma = 60.0 * values.get("flow_ml_min", math.inf) * (1.0 - _haematocrit(values, case))
    water = PLASMA_WATER * plasma
    if sum(drawn.values()) >= water:
        message = (
            f"the water removed, {sum(drawn.values()):g} mL/h with {' and '.join(drawn)}, is not below the "
            f"water in the plasma flow of {plasma:.0f} mL/h"
        )
        largest = max(drawn, key=lambda name: drawn[name])
        remarks.error(f"{key}.{largest}", message, shown(drawn[largest]), f"together below {water:.0f} mL/h")


def _check_rate(case: CaseValues, key: str, remarks: Remarks) -> None:
    """Warn once, at the first filter, of a net ultrafiltration of all filters that harmed patients."""
    rates = {one: net for one, values in case.devices.items() if (net := values.get(NET_ULTRAFILTRATION))}
    weight, net = case.patient.get("weight_kg"), sum(rates.values())
    if weight is None or key != next(iter(rates), None) or net <= HARMFUL_ML_KG_H * weight:
        return
    others = f" together with {' and '.join(f'[{one}]' for one in rates if one != key)}" * (len(rates) > 1)
    message = f"{net / weight:.1f} mL/kg/h{others}: {FEWER_SURVIVED_TEXT}"
    remarks.warning(f"{key}.{NET_ULTRAFILTRATION}", message, shown(rates[key]))


def check_red_cells(key: str, haematocrit: float, haemoglobin_g_dl: float, remarks: Remarks) -> None:
    """Warn of a haematocrit [-] and a haemoglobin [g/dL] that do not fit together."""
    low, high = USUAL_RED_CELLS
    if low <= (held := haemoglobin_g_dl / haematocrit) <= high:
        return
    message = (
        f"with gas.haemoglobin_g_dl = {haemoglobin_g_dl:g} red cells would hold {held:.0f} g/dL (usual: "
        f"{RED_CELL_HAEMOGLOBIN:g}): the oxygen of the blood would follow the one, its flow the other; "
        "leave it out unless it was measured"
    )
    hint = f"{key.rpartition('.')[2]} = {haemoglobin_g_dl / RED_CELL_HAEMOGLOBIN:.2f}"
    remarks.warning(key, message, shown(haematocrit), hint)


def _haematocrit(values: Raw, case: CaseValues) -> float:
    """Haematocrit of the blood in the access line: as given, else from haemoglobin, else the default."""
    gas, fluid = case.physiology.get("gas"), case.physiology.get("fluid", {})
    usual = fluid.get("haematocrit") or USUAL_FLUID["haematocrit_in"]
    if gas is not None:
        usual = gas.get("haemoglobin_g_dl", USUAL_HAEMOGLOBIN) / RED_CELL_HAEMOGLOBIN
    return float(values.get("haematocrit_in") or usual)


def no_plasma_water(
    names: Naming, outputs: Mapping[str, float], fraction: str, cleared: Sequence[str]
) -> list[Finding]:
    """Alarm where a filter would take all water of the plasma, so that clearances are not computed.

    Args:
        names: names of the instance.
        outputs: outputs of the beat, by name.
        fraction: output of the filtration fraction.
        cleared: outputs that are not computed then.
    """
    from eclsim.components.dialysis import PLASMA_WATER

    fraction = names.output(fraction)
    lacking = tuple(name for name in map(names.output, cleared) if math.isnan(outputs.get(name, 0.0)))
    share = outputs.get(fraction, 0.0)
    if not lacking or not share >= PLASMA_WATER:
        return []
    text = (
        f"{names.label}: {100.0 * share:.0f} % of the plasma would be filtered, of which "
        f"{100.0 * PLASMA_WATER:.0f} % is water: clearances and what the filter does to bicarbonate and "
        "carbon dioxide are not computed; lower the net ultrafiltration or the replacement behind the "
        "filter, or raise the blood flow"
    )
    return [Finding("alarm", fraction, share, PLASMA_WATER, text, concerns=(fraction, *lacking))]


def warn_of_other_filters(names: Naming, outputs: Mapping[str, float], circuit: Circuit) -> list[Finding]:
    """Caution that effective clearances are computed as if other filters cleared nothing.

    Args:
        names: names of the instance whose clearances they are.
        outputs: outputs of the beat, by name.
        circuit: circuit of patient and devices.
    """
    concerned = names.output("effective_clearance_urea")
    if concerned not in outputs:
        return []
    from eclsim.components.dialysis import DialysedBlood

    filters = {e.group for e in circuit.exchanges if isinstance(e.component, DialysedBlood)}
    others = sorted(filters - {names.key})
    if not others:
        return []
    text = (
        f"effective clearances of the {names.label} are computed as if [{'] and ['.join(others)}] cleared "
        "nothing: too high if blood that it has cleared reaches this filter"
    )
    return [Finding.without_limit(CAUTION, concerned, outputs[concerned], text, concerned)]


# --- the CRRT dialyzer ----------------------------------------------------------------------------


GROUP = "crrt"
_FILTER = "AN69 ST filter of 1.5 m2"
_NO_DATA_SHEET = "no data sheet of the maker was read"
_HARDLY_SENSITIVE = "at CRRT flows clearance hardly depends on it"
_ESTIMATE = f"{_FILTER}; assumed: that of urea scaled by size of the molecule; {_HARDLY_SENSITIVE}"
FILTER_PARAMETERS = tuple(
    Parameter(key, value, unit, words, source, low, high, GROUP)
    for key, value, unit, words, source, low, high in (
        (
            "Kufcrrtfil", 37.0, "mL/h/mmHg", "Ultrafiltration coefficient of dialyzer in blood",
            f"{_FILTER}; assumed: 25 a m2, as high-flux membranes have 20 to 40 a m2; {_NO_DATA_SHEET}",
            2.0, 300.0,
        ),
        (
            "KoAurea", 300.0, "mL/min", "Mass transfer area product of dialyzer for urea",
            f"{_FILTER}; assumed: 200 a m2; {_NO_DATA_SHEET}; {_HARDLY_SENSITIVE}", 5.0, 3000.0,
        ),
        ("KoAcreatinine", 230.0, "mL/min", "The same for creatinine", _ESTIMATE, 5.0, 3000.0),
        ("KoApotassium", 300.0, "mL/min", "The same for potassium", _ESTIMATE, 5.0, 3000.0),
        ("KoAco2", 240.0, "mL/min", "The same for bicarbonate and dissolved CO2", _ESTIMATE, 5.0, 3000.0),
        ("KoAcitrate", 170.0, "mL/min", "The same for citrate", _ESTIMATE, 5.0, 3000.0),
    )
)  # fmt: skip
HAEMATOCRIT_IN = f"{GROUP}.haematocrit_in"
SETTINGS = (
    *(f"{GROUP}.{key}" for key in FLUIDS), HAEMATOCRIT_IN, f"{GROUP}.fluid_bicarbonate_mmol_l",
    f"{GROUP}.plasma_bicarbonate_mmol_l", f"{GROUP}.citrate_mmol_l", *(p.key for p in FILTER_PARAMETERS),
)  # fmt: skip
"""Parameters of the dialyzer, in the order of `eclsim.components.dialysis.Settings`."""
SOLUTES = ("urea", "creatinine", "potassium")
"""Solutes whose clearances are outputs."""
BY_PLASMA_WATER = (
    *(f"{what}_{name}" for what in ("clearance", "effective_clearance") for name in SOLUTES),
    "base_gain", "crrt_carbon_dioxide_removal", "citrate_load", "fresh_plasma_ml_h",
)  # fmt: skip
"""Outputs that are not computed where the filter would take all water of the plasma."""
_EFFECTIVE_SHARES = (*SOLUTES, "carbon_dioxide_cleared", "citrate_cleared", "plasma_water")
_FIBRES = Fibres(
    ("Qcrrtpump", "Pcrrtfil", "Pcrrttuout"), SETTINGS, "crrtfil", "Qcrrtfil", pump=f"{GROUP}.flow_ml_min"
)


def _share(m: BeatMeasures, what: str) -> Numbers:
    """Ratio of effective to own clearance of the filter (`eclsim.gas.tracers`).

    Args:
        m: measures of the beat.
        what: field of `Performance` that holds the clearance; `plasma_water` for complete removal in one
            pass.
    """

    def compute() -> Sequence[Numbers]:
        done = _FIBRES.performance(m)
        water = [done.urea_water if name == "urea" else done.plasma_water for name in _EFFECTIVE_SHARES]
        return m.effective("crrtfil", [getattr(done, name) for name in _EFFECTIVE_SHARES], water)

    return m.cached((GROUP, "effective"), compute)[_EFFECTIVE_SHARES.index(what)]


def _effective(m: BeatMeasures, solute: str) -> Numbers:
    """Effective clearance [mL/min], relative to the blood that leaves the tissues."""
    return getattr(_FIBRES.performance(m), solute) * _share(m, solute)


def _citrate(m: BeatMeasures) -> Numbers:
    """Citrate that reaches the tissues [mmol/h]."""
    return _FIBRES.performance(m).citrate * _share(m, "citrate_cleared")


def _base_gain(m: BeatMeasures) -> Numbers:
    """Bicarbonate [mmol/h] that reaches the tissues, from citrate and from the fluids."""
    from eclsim.components.dialysis import BASE_PER_CITRATE

    done = _FIBRES.performance(m, by_gases=True)
    fluids = done.base_gain - BASE_PER_CITRATE * done.citrate
    return BASE_PER_CITRATE * _citrate(m) + fluids * _share(m, "carbon_dioxide_cleared")


def _for_patient(
    name: str,
    long_name: str,
    unit: str,
    definition: str,
    compute: Callable[[BeatMeasures], Numbers],
    by_gases: bool = False,
) -> Output:
    """Output of the filter's effect on the patient, which depends on recirculation."""
    return Output(
        name, long_name, unit, definition, _FIBRES.signals, compute, parameters=_FIBRES.parameters,
        blood_parameters=BLOOD_PARAMETERS, all_flows=True, by_gases=by_gases,
        read_at=_FIBRES.read_at,
    )  # fmt: skip


def _drug(m: BeatMeasures) -> Sequence[Numbers]:
    """Clearance of the drug by the filter and for the patient [mL/min]."""

    def compute() -> Sequence[Numbers]:
        cleared, plasma = _FIBRES.drug(m)
        (share,) = m.effective("crrtfil", [cleared], [plasma])
        return cleared, cleared * share

    return m.cached((GROUP, "drug"), compute)


OUTPUTS = (
    _FIBRES.output(
        "effluent_ml_h", "effluent", "effluent of the CRRT", "mL/h", "dialysate, replacement and net"
    ),
    _FIBRES.output(
        "filtration_fraction", "filtration_fraction", "filtration fraction", "1",
        "ultrafiltrate / (plasma flow + replacement before the filter)",
    ),
    _FIBRES.output(
        "transmembrane_pressure", "transmembrane_pressure", "transmembrane pressure of the dialyzer", "mmHg",
        "ultrafiltrate / Kuf",
    ),
    _FIBRES.output(
        "effluent_pressure", "effluent_pressure", "pressure of the effluent", "mmHg",
        "mean pressure of the blood in the dialyzer - transmembrane pressure", absolute=True,
    ),
    *(
        _FIBRES.output(
            f"clearance_{name}", name, f"clearance of {name} by the dialyzer", "mL/min",
            "removed / concentration in the water that enters the dialyzer",
        )
        for name in SOLUTES
    ),
    *(
        _for_patient(
            f"effective_clearance_{name}", f"clearance of {name} for the patient", "mL/min",
            "removed / concentration in the blood that leaves the tissues, corrected for recirculation",
            lambda m, name=name: _effective(m, name),
        )
        for name in SOLUTES
    ),
    _FIBRES.drug_output("clearance_drug", "clearance of the drug by the dialyzer", lambda m: _drug(m)[0]),
    replace(
        _FIBRES.drug_output(
            "effective_clearance_drug", "clearance of the drug for the patient", lambda m: _drug(m)[1]
        ),
        all_flows=True,
        definition=f"{DRUG_DEFINITION}, of the blood that leaves the tissues, corrected for recirculation",
    ),
    _for_patient(
        "base_gain", "bicarbonate gained from the CRRT", "mmol/h",
        "from fluids and citrate (3 each), less what is removed, corrected for recirculation", _base_gain,
        by_gases=True,
    ),
    _FIBRES.output(
        "crrt_carbon_dioxide_removal", "carbon_dioxide", "carbon dioxide removed by the dialyzer", "mL/min",
        "STPD, as bicarbonate and dissolved, less what the fluids bring", by_gases=True,
    ),
    _for_patient(
        "citrate_load", "citrate that reaches the patient", "mmol/h",
        "dose - removed, corrected for recirculation", _citrate,
    ),
    _for_patient(
        "fresh_plasma_ml_h", "plasma of the patient that reaches the dialyzer", "mL/h",
        "plasma flow of the dialyzer less what comes back from it",
        lambda m: _FIBRES.performance(m).plasma * _share(m, "plasma_water"),
    ),
)  # fmt: skip


def haemoconcentration_findings(
    names: Naming, outputs: Mapping[str, float], values: Mapping[str, float]
) -> list[Finding]:
    """Alarm for a net ultrafiltration above the flow of the patient's plasma to the dialyzer."""
    name = names.output("fresh_plasma_ml_h")
    fresh, net = outputs.get(name), values.get(names.parameter(f"{GROUP}.{FLUIDS[3]}"), 0.0)
    if fresh is None or not net > fresh:
        return []
    text = (
        f"{names.label}: net ultrafiltration {net:g} mL/h is more than the patient's plasma that reaches the "
        f"dialyzer, {fresh:.0f} mL/h, as blood goes in a circle: it thickens within minutes and clots; a "
        "course still takes the water from the patient"
    )
    return [Finding("alarm", name, fresh, net, text, concerns=(name,))]
