"""Parameters of the CRRT dialyzer's membrane, and outputs of dialysis."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from eclsim.devices.description import BeatMeasures, Finding, Numbers, Output
from eclsim.devices.device import Naming
from eclsim.devices.dialysed_blood import DRUG_DEFINITION, FLUIDS, Fibres
from eclsim.parameters.parameter import read_parameters

GROUP = "crrt"
FILTER_PARAMETERS = tuple(read_parameters(__file__).values())
HAEMATOCRIT = f"{GROUP}.haematocrit_in"
SETTINGS = (
    *(f"{GROUP}.{key}" for key in FLUIDS), HAEMATOCRIT, f"{GROUP}.fluid_bicarbonate_mmol_l",
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
_FIBRES = Fibres(("Qcrrtpump", "Pcrrtfil", "Pcrrttuout"), SETTINGS, "crrtfil", "Qcrrtfil")


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
        name, long_name, unit, definition, _FIBRES.signals, compute, parameters=SETTINGS, all_flows=True,
        by_gases=by_gases, read_at=_FIBRES.read_at,
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
        "mean pressure of the blood in the dialyzer - transmembrane pressure",
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
