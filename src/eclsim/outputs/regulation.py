"""Outputs of regulated circuits: the heart rate and what else reflexes and drugs have in effect."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from eclsim.devices.description import Output
from eclsim.parameters.regulation import GAIN, SET_POINT, UNSTRESSED

if TYPE_CHECKING:
    from eclsim.circuit.network import Reading
    from eclsim.devices.description import BeatMeasures, Numbers

_HEART_RATE = "heart_rate_bpm"


def _in_effect(parameter: str) -> Callable[[BeatMeasures], Numbers]:
    """The value of a parameter during the beat."""

    def compute(measures: BeatMeasures) -> Numbers:
        from eclsim.regulation.effects import effect_law, parameters_of, readings_of, steady_controls

        controls = steady_controls(measures.circuit)
        if not any(parameter in control.acts_on for control in controls):
            return measures.parameter(parameter)
        numbers = [_read(measures, reading) for reading in readings_of(controls)]
        numbers += [measures.parameter(name) for name in parameters_of(controls)]
        acted = tuple(dict.fromkeys(name for control in controls for name in control.acts_on))
        return measures.apply(effect_law(controls, acted), numbers)[acted.index(parameter)]

    return compute


def _read(measures: BeatMeasures, reading: Reading) -> Numbers:
    statistics = {"mean": measures.mean, "maximum": measures.maximum, "minimum": measures.minimum}
    return statistics[reading.statistic.value](str(reading.signal))


def _use(measures: BeatMeasures) -> Numbers:
    from eclsim.regulation.effects import reflex_of, use_law

    control = reflex_of(measures.circuit)
    assert control is not None  # the output exists where there is one
    return measures.apply(
        use_law(control), [measures.mean("Pao"), *map(measures.parameter, (SET_POINT, GAIN))]
    )[0]


_FACTORS = (
    ("contractility_lv", "Emaxlv", "systolic elastance of the left ventricle"),
    ("contractility_rv", "Emaxrv", "systolic elastance of the right ventricle"),
    ("systemic_resistance", "Rmc", "resistance of the systemic microcirculation"),
    ("pulmonary_resistance", "Rpmc", "resistance of the pulmonary microcirculation"),
)
FACTORS = {f"{name}_factor": parameter for name, parameter, _ in _FACTORS}
"""Outputs that say by how much reflexes and drugs change a parameter, and which."""


def _factor(name: str, parameter: str, words: str) -> Output:
    now = _in_effect(parameter)
    return Output(
        f"{name}_factor", f"{words} in effect, relative to the patient's own", "1",
        f"{parameter} during the beat / {parameter} of the case", ("Pao", "Pra"),
        lambda m: now(m) / m.parameter(parameter), parameters=(UNSTRESSED, parameter), in_effect=True,
    )  # fmt: skip


REGULATED = (
    Output(
        "heart_rate", "heart rate in effect", "bpm", "heart_rate_bpm during the beat", ("Pao", "Pra"),
        _in_effect(_HEART_RATE), parameters=(UNSTRESSED,), in_effect=True,
    ),
    *(_factor(*one) for one in _FACTORS),
    Output(
        "unstressed_volume", "change of the veins' unstressed volume against the published patient", "mL",
        f"{UNSTRESSED} during the beat", ("Pao", "Pra"), _in_effect(UNSTRESSED), parameters=(UNSTRESSED,),
        in_effect=True,
    ),
    Output(
        "reflex_use", "use of the baroreflex's range", "%",
        "drive of the systemic resistance at MAP / drive at a pressure far below, or above with a minus sign",
        ("Pao",), _use,
        parameters=(GAIN, SET_POINT),
    ),
)  # fmt: skip
"""They exist in circuits with reflexes, drugs or extra volume."""
