"""Outputs of regulated circuits: the heart rate and other effects of reflexes and drugs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from eclsim.devices.description import GASES, BeatMeasures, Numbers, Output
from eclsim.parameters import regulation as keys
from eclsim.parameters.regulation import GAIN, LUNG_RESISTANCE, SET_POINT, UNSTRESSED

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit, Reading
    from eclsim.components.base import Values

_HEART_RATE = "heart_rate_bpm"
REFLEX_USE = "reflex_use"


def in_effect(parameter: str) -> Callable[[BeatMeasures], Numbers]:
    """Return a function for the value of a parameter during the beat."""

    def compute(measures: BeatMeasures) -> Numbers:
        from eclsim.regulation.effects import effect_law, parameters_of, readings_of, steady_controls

        controls = steady_controls(measures.circuit)
        acted = tuple(dict.fromkeys(name for control in controls for name in control.acts_on))
        if parameter not in acted:
            return measures.parameter(parameter)

        def all_in_effect() -> Sequence[Numbers]:
            numbers = [_read(measures, reading) for reading in readings_of(controls)]
            numbers += [measures.parameter(name) for name in parameters_of(controls)]
            return measures.apply(effect_law(controls, acted), numbers)

        return measures.cached(("in effect",), all_in_effect)[acted.index(parameter)]

    return compute


def _read(measures: BeatMeasures, reading: Reading) -> Numbers:
    statistics = {"mean": measures.mean, "maximum": measures.maximum, "minimum": measures.minimum}
    return statistics[reading.statistic.value](str(reading.signal))


def _use(measures: BeatMeasures) -> Numbers:
    from eclsim.regulation.effects import reflex_of, reflex_use_law

    control = reflex_of(measures.circuit)
    assert control is not None  # the output exists only with a controller
    return measures.apply(
        reflex_use_law(control), [measures.mean("Pao"), *map(measures.parameter, (SET_POINT, GAIN))]
    )[0]


def corner_at_set_point(circuit: Circuit, values: Values, use: float) -> list[str]:
    """What to say of slopes of `reflex_use` at the set point, where they differ on both sides.

    Args:
        circuit: with a reflex.
        values: of its parameters.
        use: share of the reflex's range in use [%].
    """
    from eclsim.regulation.effects import reflex_of
    from eclsim.regulation.reflex import AT_REST_MMHG, Reflex

    control = reflex_of(circuit)
    if control is None or not isinstance(control.component, Reflex) or not values[GAIN] > 0.0:
        return []
    lower, higher = (
        abs(float(control.component.model.share_in_use(d))) for d in (-AT_REST_MMHG, AT_REST_MMHG)
    )
    if not abs(use) <= 100.0 * max(lower, higher):
        return []
    return [
        "reflex_use has a corner at the set point, where this patient is: its slopes are those towards lower "
        f"pressures; towards higher ones they are {higher / lower:.2f} times as large"
    ]


_FACTORS = (
    ("contractility_lv", "Emaxlv", "systolic elastance of the left ventricle in effect"),
    ("contractility_rv", "Emaxrv", "systolic elastance of the right ventricle in effect"),
    ("systemic_resistance", "Rmc", "resistance of the systemic microcirculation by reflexes and drugs"),
    ("pulmonary_resistance", "Rpmc", "resistance of the pulmonary microcirculation by drugs"),
)
FACTORS = {f"{name}_factor": parameter for name, parameter, _ in _FACTORS}
"""Outputs that are the factors by which reflexes and drugs change a parameter, with these parameters."""


def _factor(name: str, parameter: str, label: str) -> Output:
    now = in_effect(parameter)
    return Output(
        f"{name}_factor", f"{label}, relative to the patient's own", "1",
        f"{parameter} during the beat / {parameter} of the case", ("Pao", "Pra"),
        lambda m: now(m) / m.parameter(parameter), parameters=(UNSTRESSED, parameter), in_effect=True,
    )  # fmt: skip


def _local(bed: str) -> Callable[[BeatMeasures], Numbers]:
    """Return a function for the factor by which gases change the resistance of a vascular bed."""

    def compute(m: BeatMeasures) -> Numbers:
        from eclsim.regulation.oxygen import local_law, local_settings

        numbers = [m.gas("oxygen", "mixed", bed), m.gas("supplied", "at", bed), m.gas("gained", "at", bed)]
        numbers += [m.gas("PCO2", "in", bed), *map(m.parameter, local_settings(bed))]
        return m.apply(local_law, numbers)[0]

    return compute


def _lung(m: BeatMeasures) -> Numbers:
    from eclsim.regulation.oxygen import LUNG_SETTINGS, lung_law

    gases = [m.gas("PO2", "in", "pas"), *(m.gas(what, "at", "part") for what in ("gained", "gained_co2"))]
    settings = map(m.parameter, (*LUNG_SETTINGS, keys.HYPOXIA, keys.LUNG_AT_REST))
    return m.apply(lung_law, [*gases, *settings])[0]


LOCAL_OUTPUTS = {bed: keys.local_factor(keys.local_resistance(bed)) for bed in keys.BEDS}
"""Output of each vascular bed: factor by which its gases change its resistance."""
GAS_RESPONSE_OUTPUTS = (
    *(
        Output(
            LOCAL_OUTPUTS[bed], f"resistance of the {label}, by oxygen and carbon dioxide", "1",
            "relative to that at the set points; of brain, heart, muscle and the rest side by side",
            ("Q" + bed,), _local(bed), all_flows=True,
            parameters=(GASES, keys.local_resistance(bed), keys.DILATION,
                        keys.of_bed(keys.VENOUS_O2_SET_POINT, bed), keys.paco2_set_point(bed),
                        keys.CARBON_DIOXIDE),
        )
        for bed, label in (("sart", "organs"), ("upper", "upper body"), ("lower", "lower body"))
    ),
    Output(
        "hypoxic_resistance_factor", "resistance of the lung in effect, by hypoxia", "1",
        "relative to that at rest", ("Qpart",), lambda m: m.parameter(LUNG_RESISTANCE),
        parameters=(LUNG_RESISTANCE,),
    ),
    Output(
        "hypoxic_resistance_wanted", "resistance of the lung that the present oxygen will bring about", "1",
        "relative to that at rest; in effect after minutes", ("Qpart",), _lung,
        parameters=(GASES, LUNG_RESISTANCE, keys.HYPOXIA, keys.LUNG_AT_REST), all_flows=True,
    ),
)  # fmt: skip
"""Outputs that exist only if something responds to blood gases."""
SOLVED_BY = {
    keys.SENSED_PAO2: "PaO2",
    keys.SENSED_PACO2: "PaCO2",
    **{keys.local_resistance(bed): name for bed, name in LOCAL_OUTPUTS.items()},
    LUNG_RESISTANCE: "hypoxic_resistance_wanted",
}
"""Parameters that are solved for, and the outputs that they equal in the steady beat."""
REGULATED = (
    Output(
        "heart_rate", "heart rate in effect", "bpm", "heart_rate_bpm during the beat", ("Pao", "Pra"),
        in_effect(_HEART_RATE), parameters=(UNSTRESSED,), in_effect=True,
    ),
    *(_factor(*one) for one in _FACTORS),
    Output(
        "unstressed_volume", "change of the veins' unstressed volume against the published patient", "mL",
        f"{UNSTRESSED} during the beat", ("Pao", "Pra"), in_effect(UNSTRESSED), parameters=(UNSTRESSED,),
        in_effect=True,
    ),
    Output(
        REFLEX_USE, "use of the baroreflex's range", "%",
        "drive of the systemic resistance at MAP / drive at a pressure far below, or above with a minus sign",
        ("Pao",), _use,
        parameters=(GAIN, SET_POINT),
    ),
    *GAS_RESPONSE_OUTPUTS,
)  # fmt: skip
"""Outputs of circuits with reflexes, drugs or extra volume, or with responses to blood gases."""
