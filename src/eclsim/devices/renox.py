"""RenOx: oxygenator and dialyzer in one housing that replaces the oxygenator of the ECMO circuit.

    pre_oxy --[ gas fibres and dialysate fibres side by side ]--> post_oxy

Outlook of Thiel et al. (2025). There are no lines, hence no blood to fill them, no access and return
pressures with alarms, and no recirculation. The dialysate fibres are exposed to the whole ECMO flow and to
the pressure of the ECMO circuit. Their clearance is that of `eclsim.components.dialysis` at this flow, and
ultrafiltration is driven by the blood pressure of 200 mmHg and more, unless the effluent is throttled.

No data of such a device are public. Pressure drop and gas exchange are those of the oxygenator that [ecmo]
names; the dialysate fibres have the membrane of the CRRT filter (1.5 m2). Combined devices under
development: Martins Costa et al. 2022, doi 10.3389/fmedt.2022.909990.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

from eclsim.devices.cannulae import BACKWARD_L_MIN
from eclsim.devices.crrt import Crrt, assumed_membrane, filter_limits
from eclsim.devices.description import CAUTION, BeatMeasures, Control, Finding, Housed, Knob, Numbers, Output
from eclsim.devices.device import CaseValues, Device, Naming
from eclsim.devices.dialysed_blood import (
    FILTER_PARAMETERS,
    FLUIDS,
    SOLUTES,
    USUAL_FLUID,
    Fibres,
    check_fluids,
    dialysed_blood,
    fluid_flow,
    no_plasma_water,
)
from eclsim.inputs.mistakes import Remarks
from eclsim.inputs.sections import Raw, Section

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit

GROUP = "renox"
_ASSUMED = "assumed: the membrane of the CRRT filter, no data of such a device are public"
MEMBRANE = tuple(
    replace(p, key=p.key.replace("crrtfil", "").replace("K", f"{GROUP}_K", 1), source=_ASSUMED, group=GROUP)
    for p in FILTER_PARAMETERS
)
_BLOOD = ("haematocrit_in", "fluid_bicarbonate_mmol_l", "plasma_bicarbonate_mmol_l", "citrate_mmol_l")
SETTINGS = (*(f"{GROUP}.{key}" for key in (*FLUIDS, *_BLOOD)), *(p.key for p in MEMBRANE))
"""Parameters of the dialysate fibres, in the order of `eclsim.components.dialysis.Settings`."""
_PERMEABILITY = MEMBRANE[0].key
_FIBRES = Fibres(("Qecmooxy", "Pecmooxy", "Pecmotuor"), SETTINGS, "ecmotuor", "Qecmooxy", f"{GROUP}_")


class Renox(Section):
    """Section [renox]: fluid flows in mL/h; the device has neither replacement fluid nor citrate."""

    section = GROUP
    dialysate_ml_h: Annotated[float, fluid_flow("Flow of dialysate", 2000.0, required=True)]
    net_ultrafiltration_ml_h: Annotated[
        float, fluid_flow("Net ultrafiltration (fluid taken from the patient)", 100.0, 1.0, 5000.0)
    ] = 0.0
    haematocrit_in: Annotated[float | None, Crrt.fields()["haematocrit_in"]] = None
    fluid_bicarbonate_mmol_l: Annotated[float | None, Crrt.fields()["fluid_bicarbonate_mmol_l"]] = None
    plasma_bicarbonate_mmol_l: Annotated[float | None, Crrt.fields()["plasma_bicarbonate_mmol_l"]] = None


def _free_filtration(m: BeatMeasures) -> Numbers:
    """Ultrafiltration [mL/h] that the blood pressure drives through the membrane at an open effluent."""
    return 0.5 * (m.mean("Pecmooxy") + m.mean("Pecmotuor")) * m.parameter(_PERMEABILITY)


_BY_FLOW = (*(f"{GROUP}_clearance_{name}" for name in SOLUTES), f"{GROUP}_base_gain",
            f"{GROUP}_carbon_dioxide_removal")  # fmt: skip
"""Outputs that depend on the direction in which blood runs past the dialysate."""


class RenoxDevice(Device[Renox]):
    """Oxygenator and dialyzer in one housing."""

    key, name, section = GROUP, "RenOx", Renox
    parameters = MEMBRANE
    housed = Housed("effluent", (f"{GROUP}_effluent_ml_h", f"{GROUP}_effluent_pressure"))
    usual = {"dialysate_ml_h": 2000.0}
    assumptions = assumed_membrane(MEMBRANE, f"{GROUP}_")
    limits = filter_limits(f"{GROUP}_")
    nominal = {
        f"{GROUP}.dialysate_ml_h": 2000.0, f"{GROUP}.replacement_pre_ml_h": 0.0,
        f"{GROUP}.replacement_post_ml_h": 0.0, f"{GROUP}.net_ultrafiltration_ml_h": 100.0,
        **{f"{GROUP}.{key}": USUAL_FLUID[key] for key in _BLOOD},
    }  # fmt: skip
    outputs = (
        _FIBRES.output("effluent_ml_h", "effluent", "effluent of the RenOx", "mL/h", "dialysate and net"),
        _FIBRES.output(
            "filtration_fraction", "filtration_fraction", "filtration fraction of the RenOx", "1",
            "ultrafiltrate / plasma flow",
        ),
        _FIBRES.output(
            "transmembrane_pressure", "transmembrane_pressure",
            "transmembrane pressure needed for the ultrafiltration of the RenOx", "mmHg",
            "ultrafiltrate / Kuf",
        ),
        _FIBRES.output(
            "effluent_pressure", "effluent_pressure", "pressure at which the effluent of the RenOx is held",
            "mmHg", "mean pressure of the blood in the housing - transmembrane pressure", absolute=True,
        ),
        *(
            _FIBRES.output(
                f"clearance_{name}", name, f"clearance of {name} by the RenOx", "mL/min",
                "removed / concentration in the water that enters",
            )
            for name in SOLUTES
        ),
        _FIBRES.drug_output(
            "clearance_drug", "clearance of the drug by the RenOx", lambda m: _FIBRES.drug(m)[0]
        ),
        _FIBRES.output(
            "base_gain", "base_gain", "bicarbonate gained from the RenOx", "mmol/h",
            "from the dialysate, less what is removed", by_gases=True,
        ),
        _FIBRES.output(
            "carbon_dioxide_removal", "carbon_dioxide", "carbon dioxide removed by the RenOx", "mL/min",
            "STPD, as bicarbonate and dissolved, less what the dialysate brings", by_gases=True,
        ),
        Output(
            f"{GROUP}_free_ultrafiltration_ml_h", "ultrafiltration of the RenOx with an open effluent",
            "mL/h",
            "Kuf times the mean pressure of the blood in the housing: what is filtered if the control fails",
            _FIBRES.signals, _free_filtration, parameters=(_PERMEABILITY,), read_at="Qecmooxy", absolute=True,
        ),
    )  # fmt: skip

    def circuit(self, section: Renox) -> Circuit:
        """Exchanges along the oxygenator; that of carbon dioxide is after the gas fibres."""
        from eclsim.circuit.network import Circuit, Exchange
        from eclsim.components.dialysis import DialysedBlood, Hemofilter

        fibres = Hemofilter(SETTINGS, f"{GROUP}_clearance", f"{GROUP}_base_gain", "")
        dialysed = Exchange("renox_dialysed", DialysedBlood(fibres), "ecmotuor", GROUP)
        return Circuit(exchanges=(Exchange(GROUP, fibres, "ecmooxy", GROUP), dialysed))

    def values(self, section: Renox) -> dict[str, float]:
        """Fluid flows, and composition of blood and fluid."""
        settings = section.model_dump(exclude_none=True)
        return dict(self.nominal) | {f"{GROUP}.{key}": value for key, value in settings.items()}

    def values_of_blood(self, section: Renox, haemoglobin_g_dl: float, gases: bool) -> dict[str, float]:
        """Haematocrit and carbon dioxide of the blood in the housing."""
        return dialysed_blood(section, gases)

    def controls(self, section: Renox, sites: Mapping[str, str]) -> list[Control]:
        """Controls of both fluid flows."""
        highest = {"dialysate_ml_h": 4000.0, "net_ultrafiltration_ml_h": 500.0}
        fields = Renox.fields()
        return [Knob(key, fields[key].description, "mL/h", 0.0, high, 50.0) for key, high in highest.items()]

    def summary(self, section: Renox) -> str:
        """Dialysate and net ultrafiltration."""
        return f"dialysate {section.dialysate_ml_h:g}, net {section.net_ultrafiltration_ml_h:g} mL/h"

    def check(self, values: Raw, case: CaseValues, key: str, remarks: Remarks) -> None:
        """Check that there is one ECMO circuit, unnamed, and one RenOx, with plausible fluids."""
        circuits = case.of("ecmo")
        if list(circuits) != ["ecmo"]:
            message = "RenOx replaces the oxygenator of an ECMO circuit, but the case has no [ecmo] section"
            other = "RenOx needs a single ECMO circuit without a name; the case has several or a named one"
            message = other if circuits else message
            remarks.error(key, message, allowed="one [ecmo] section")
        if key != GROUP:
            remarks.error(key, "two in one circuit are not modelled", allowed=f"one [{GROUP}] section")
        check_fluids(values, case, key, remarks)

    def findings(
        self, names: Naming, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
    ) -> list[Finding]:
        """Blood that runs backwards; how much water leaves where nothing holds the effluent's pressure."""
        result = no_plasma_water(names, outputs, f"{GROUP}_filtration_fraction", _BY_FLOW)
        result += _backwards(names, outputs)
        name = f"{GROUP}_free_ultrafiltration_ml_h"
        free, net = outputs.get(name), values.get(f"{GROUP}.net_ultrafiltration_ml_h")
        if free is None or net is None or not free > 1.1 * max(net, 10.0):
            return result
        text = (
            f"{names.label}: the pressure of the ECMO circuit would filter {free:.0f} mL/h through an open "
            f"effluent, where {net:g} mL/h is set: hold the effluent at "
            f"{outputs[f'{GROUP}_effluent_pressure']:.0f} mmHg"
        )
        concerns = (f"{GROUP}_effluent_pressure",)
        return [*result, Finding("warning", name, free, net, text, concerns=concerns)]


def _backwards(names: Naming, outputs: Mapping[str, float]) -> list[Finding]:
    """Caution on blood that meets the fibres from their other end, where dialysate flows with it."""
    flow, concerns = outputs.get("PF", 0.0), tuple(one for one in _BY_FLOW if one in outputs)
    if not flow < BACKWARD_L_MIN or not concerns:
        return []
    text = (
        f"{names.label}: blood runs backwards through the housing ({flow:.2f} L/min), so that dialysate "
        "flows with it, not against it; clearances are those of the other direction, a few percent too high"
    )
    return [Finding.without_limit(CAUTION, concerns[0], outputs[concerns[0]], text, *concerns)]


RENOX = RenoxDevice()
