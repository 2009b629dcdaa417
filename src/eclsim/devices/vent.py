"""Vent: a cannula from the left heart or the pulmonary artery into the drainage line of the ECMO circuit.

    lv | la | pas --(cannula)--> post_dc of the ECMO circuit

It unloads the left ventricle on V-A ECMO by the suction of the ECMO pump. At 15 Fr it is the arterial cannula
of `eclsim.devices.cannulae`; other sizes are orifices with a flow proportional to the squared diameter.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

from eclsim.devices.cannulae import BACKWARD_L_MIN, CANNULAE
from eclsim.devices.description import Control, Finding, Knob, Limit, Look, Mark, mean_flow, picker
from eclsim.devices.device import CaseValues, Device, Naming
from eclsim.devices.plausibility import ejection_fraction_findings
from eclsim.inputs.fields import number, one_of
from eclsim.inputs.mistakes import Remarks
from eclsim.inputs.sections import Raw, Section
from eclsim.patient.sites import PATIENT_SITES
from eclsim.units import ML_S_PER_L_MIN

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit

GROUP = "vent"
SITES = ("lv", "la", "pas")
_SMALLEST, _LARGEST = 8.0, 23.0
_REFERENCE_FR = 15.0
_COEFFICIENT = ML_S_PER_L_MIN / CANNULAE["arterial"].resistance(_REFERENCE_FR) ** 0.5
"""Flow coefficient [mL/(s mmHg^1/2)] at 15 Fr, the smallest arterial cannula of the maker's list."""


_BESIDE_VENT = mean_flow(
    "drainage_cannula_flow", "flow through the drainage cannula beside the vent", "Qecmodrain", beside="Qvent"
)


class Vent(Section):
    """Section [vent]: site that is drained, and size in Fr."""

    section = GROUP
    site: Annotated[str, one_of("What is drained", SITES)]
    fr: Annotated[float, number("Size of the vent", "Fr", _SMALLEST, _LARGEST, 15)]


class VentDevice(Device[Vent]):
    """Vent of the left side of the heart into the ECMO circuit."""

    key, name, section = GROUP, "Vent", Vent
    connections = {"vent": "vent"}
    marks = {"vent": Mark("cannula", "vent")}
    look = Look("#A65E00", "#FBF4EC", 1.6, marker="P")
    nominal = {"vent.fr": 15.0}
    outputs = (
        mean_flow("vent_flow", "flow through the vent into the ECMO circuit", "Qvent"),
        _BESIDE_VENT,
    )
    limits = (
        Limit("vent_flow", "alarm", "below", 0.0, "blood runs through the vent into the heart", "physics"),
        Limit(
            _BESIDE_VENT.name, "alarm", "below", BACKWARD_L_MIN,
            "blood of the vent runs through the drainage cannula into the patient: turn the pump up or take "
            "a smaller vent", "physics", without=("first_drainage_flow",),
        ),
    )  # fmt: skip

    def circuit(self, section: Vent) -> Circuit:
        """Circuit of one cannula."""
        from eclsim.circuit.network import Circuit, Connection
        from eclsim.components import OpenOrifice, Scaled

        path = OpenOrifice(Scaled(_COEFFICIENT / _REFERENCE_FR**2, ("vent.fr", "vent.fr")))
        return Circuit(connections=(Connection("vent", path, section.site, "post_dc", GROUP),))

    def summary(self, section: Vent) -> str:
        """Site and size."""
        return f"{section.site} {section.fr:g} Fr"

    def controls(self, section: Vent, sites: Mapping[str, str]) -> list[Control]:
        """Controls of size and site."""
        result: list[Control] = [Knob("fr", "Vent", "Fr", _SMALLEST, _LARGEST, 1)]
        return [*result, picker("site", "Vent of", SITES, PATIENT_SITES)]

    def check(self, values: Raw, case: CaseValues, key: str, remarks: Remarks) -> None:
        """Check that there is the ECMO circuit into which it drains."""
        if "ecmo" not in case.devices:
            message = "drains into the ECMO circuit, but the case has no [ecmo] section"
            other = "a vent needs an ECMO circuit without a name; the case has only named ones"
            message = other if case.of("ecmo") else message
            remarks.error(key, message, allowed="one [ecmo] section beside it")

    def findings(
        self, names: Naming, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
    ) -> list[Finding]:
        """Cautions on the ejection fraction of a drained left ventricle."""
        return ejection_fraction_findings(names, outputs, circuit, self.connections, "vent_flow")


VENT = VentDevice()
