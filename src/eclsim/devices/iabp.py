"""Intra-aortic balloon pump: a balloon that fills in diastole and empties before the next ejection.

    ao --(catheter)-- iabpballoon       dV/dt = -d(u Vb)/dt, u(phase) the filling of the balloon

It displaces blood in the aorta as a function of the phase of the beat. Phase 0 is the onset of ventricular
contraction; the aortic valve closes at 0.31, independent of the heart rate. The balloon holds gas: the blood
that it displaces is in the vessels, and the total blood volume is unchanged.

Assumptions for lack of an open source: it fills and empties in 8 % of the beat (53 ms at 90/min), always by
its full volume; it is in the ascending aorta, whether or not the arteries are divided into regions.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

from eclsim.devices.description import CAUTION, Box, Control, Finding, Knob, Look, Mark, Output, Panel
from eclsim.devices.device import Device, Naming
from eclsim.inputs.fields import number
from eclsim.inputs.sections import Section

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit

GROUP = "iabp"
_VOLUME, _INFLATION = f"{GROUP}.volume_ml", f"{GROUP}.inflation_phase"
_BALLOON = "iabpballoon"
NOTCH = 0.31
"""Phase at which the aortic valve closes; elastance is highest at 0.30."""
DELAY = 100.0
"""Resistance [mmHg s/mL] between balloon and aorta. With the balloon's stiffness (1e6 mmHg/mL) blood follows
the gas within 0.1 ms at any pressure, and an explicit solver can still resolve it."""


_AFFECTED_OUTPUTS = ("CO", "LVO", "DP", f"{GROUP}_end_diastolic_pressure", f"{GROUP}_augmentation")
_IDEAL_BALLOON = (
    "the IABP is an ideal balloon, which always moves its whole volume, in stiff arteries: its effects on "
    "CO, LVO and diastolic pressure are the most that a patient may gain (0.5 to 1.0 L/min are reported, "
    "Parissis et al. 2016)"
)


class Iabp(Section):
    """Section [iabp]: volume of the balloon's gas and phase at which inflation begins."""

    section = GROUP
    volume_ml: Annotated[float, number("Volume of the balloon", "mL", 0, 60, 40)]
    inflation_phase: Annotated[
        float, number("Phase of the beat at which it inflates", "1", 0.1, 0.8, NOTCH, required=False)
    ] = NOTCH


def _peak(name: str, long_name: str, definition: str, when: str) -> Output:
    return Output(
        name, long_name, "mmHg", definition, ("Pao", f"V{_BALLOON}"),
        lambda m: getattr(m, f"maximum_{when}")("Pao", _INFLATION), ("Pao",), parameters=(_INFLATION,),
        read_at="Pao", absolute=True,
    )  # fmt: skip


_AUGMENTED = _peak(
    "iabp_augmented_pressure", "augmented diastolic pressure", "maximum of Pao from inflation on", "after"
)
_SYSTOLIC = _peak(
    "iabp_systolic_pressure", "assisted systolic pressure", "maximum of Pao before inflation", "before"
)
_DIFFERENCE = Output(
    "iabp_augmentation", "diastolic augmentation", "mmHg",
    "augmented diastolic pressure less assisted systolic pressure", _AUGMENTED.needs,
    lambda m: _AUGMENTED.compute(m) - _SYSTOLIC.compute(m), ("Pao",), parameters=(_INFLATION,),
    read_at="Pao",
)  # fmt: skip


class IabpDevice(Device[Iabp]):
    """Intra-aortic balloon pump."""

    key, name, section = GROUP, "IABP", Iabp
    compartments = {_BALLOON: "balloon"}
    connections = {"iabp": "balloon in the aorta"}
    boxes = {_BALLOON: Box(2, 0, "balloon")}
    marks = {"iabp": Mark("tube", "IABP")}
    panels = (
        Panel("Aortic pressure", "mmHg", ("Pao",)),
        Panel("Flow from aorta to balloon", "L/min", ("Qiabp",)),
    )
    look = Look("#3F6B2A", "#F3F8F0", 1.6, marker="h")
    nominal = {_VOLUME: 40.0, _INFLATION: NOTCH}
    usual = {"volume_ml": 40.0}
    outputs = (
        _AUGMENTED,
        _SYSTOLIC,
        _DIFFERENCE,
        Output(
            "iabp_end_diastolic_pressure", "assisted end-diastolic aortic pressure", "mmHg",
            "minimum of Pao", _AUGMENTED.needs, lambda m: m.minimum("Pao"), ("Pao",), read_at="Pao",
            absolute=True,
        ),
    )  # fmt: skip

    def circuit(self, section: Iabp) -> Circuit:
        """Compartment of the balloon, joined to the aorta; at the start it holds no blood."""
        from eclsim.circuit.network import Circuit, Compartment, Connection, StartVolume
        from eclsim.components import Balloon, Resistance

        room = Compartment(_BALLOON, Balloon(_VOLUME, _INFLATION), GROUP, StartVolume(0.0))
        return Circuit((room,), (Connection("iabp", Resistance(DELAY), "ao", _BALLOON, GROUP),))

    def summary(self, section: Iabp) -> str:
        """Volume and phase of inflation."""
        return f"{section.volume_ml:g} mL, inflates at {section.inflation_phase:g}"

    def controls(self, section: Iabp, sites: Mapping[str, str]) -> list[Control]:
        """Volume and phase of inflation."""
        volume = Knob("volume_ml", "Balloon", "mL", 0, 50, 1)
        return [volume, Knob("inflation_phase", "Inflation (phase of the beat)", "", 0.15, 0.6, 0.01)]

    def findings(
        self, names: Naming, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
    ) -> list[Finding]:
        """Cautions about the ideal balloon, early inflation, and a peak pressure made by the balloon."""
        if not values.get(names.parameter(_VOLUME), 0.0) > 0.0:
            return []
        result = []
        if "CO" in outputs:
            concerns = tuple(name for name in _AFFECTED_OUTPUTS if name in outputs)
            result.append(Finding.without_limit(CAUTION, "CO", outputs["CO"], _IDEAL_BALLOON, *concerns))
        if early := _early_inflation_finding(names, outputs, values):
            result.append(early)
        elif "SP" in outputs and outputs.get(names.output(_AUGMENTED.name), 0.0) >= outputs["SP"]:
            text = (
                "the highest aortic pressure is the balloon's, in diastole: SP, DP and pulse pressure are "
                f"those of the {names.label}; for the heart's own output, read "
                f"{names.output(_SYSTOLIC.name)} and LVO"
            )
            concerns = ("SP", "DP", "pulse_pressure")
            result.append(Finding.without_limit(CAUTION, "SP", outputs["SP"], text, *concerns))
        return result


def _early_inflation_finding(
    names: Naming, outputs: Mapping[str, float], values: Mapping[str, float]
) -> Finding | None:
    """Warning about a balloon that inflates while the left ventricle still ejects."""
    phase, name = values.get(names.parameter(_INFLATION), NOTCH), names.output(_SYSTOLIC.name)
    if not phase < NOTCH or name not in outputs:
        return None
    text = (
        f"the {names.label} inflates at {phase:g} of the beat, before the aortic valve shuts ({NOTCH:g}): "
        f"the left ventricle ejects against it; SP, {names.output(_AUGMENTED.name)} and {name} are read "
        "during ejection, and their difference is not an augmentation"
    )
    concerns = ("SP", name, *(names.output(one.name) for one in (_AUGMENTED, _DIFFERENCE)))
    return Finding.without_limit("warning", name, outputs[name], text, *concerns)


IABP = IabpDevice()
