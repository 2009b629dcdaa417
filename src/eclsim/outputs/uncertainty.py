"""Standard uncertainties of measurements, and whether a beat is that of the patient who was measured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

from eclsim.arguments import number_of, written
from eclsim.devices.description import CAUTION, labelled_sentence
from eclsim.inputs.mistakes import InputError
from eclsim.outputs.registry import find_output

if TYPE_CHECKING:
    from eclsim.cases.case import Case


@dataclass(frozen=True)
class Uncertainty:
    """Standard uncertainty of a measurement, absolute or relative.

    Args:
        absolute: standard uncertainty in the unit of the output.
        relative: standard uncertainty as a share of the value.
    """

    absolute: float = 0.0
    relative: float = 0.0

    def __post_init__(self) -> None:
        both = (number_of("absolute", self.absolute), number_of("relative", self.relative))
        if not (all(0.0 <= number < math.inf for number in both) and max(both) > 0.0):
            text = f"uncertainty absolute = {self.absolute:g}, relative = {self.relative:g}"
            raise InputError([f"{text}: allowed: finite, none below 0, one of them above 0"])

    def at(self, value: float) -> float:
        """Standard uncertainty of a value, in the unit of the output."""
        return max(self.absolute, self.relative * abs(value))


UNCERTAINTY = "eclsim.Uncertainty(3.0) in its unit, or eclsim.Uncertainty(relative=0.05)"
_ROUNDING_L_MIN = 0.03
"""Standard deviation due to rounding, for a flow given to 0.1 L/min [L/min]."""
DEFAULTS: MappingProxyType[str, Uncertainty] = MappingProxyType({
    "SP": Uncertainty(4.0), "DP": Uncertainty(4.0), "MAP": Uncertainty(3.0), "MPAP": Uncertainty(2.0),
    "PCWP": Uncertainty(2.0), "CO": Uncertainty(_ROUNDING_L_MIN, 0.10),
    "PF": Uncertainty(_ROUNDING_L_MIN, 0.05), "CVP": Uncertainty(2.0),
    "drainage_pressure": Uncertainty(10.0), "pump_inlet_pressure": Uncertainty(10.0),
    "pre_oxygenator_pressure": Uncertainty(10.0), "post_oxygenator_pressure": Uncertainty(10.0),
    "crrt_access_pressure": Uncertainty(10.0), "crrt_return_pressure": Uncertainty(10.0),
    "crrt_filter_pressure_drop": Uncertainty(5.0),
    "SaO2": Uncertainty(1.5), "PaO2": Uncertainty(3.0, 0.05), "PaCO2": Uncertainty(2.0, 0.04),
    "SvO2": Uncertainty(2.0), "SpreO2": Uncertainty(2.0), "SpostO2": Uncertainty(1.0),
    "PpostO2": Uncertainty(5.0, 0.05), "PexhaustCO2": Uncertainty(2.0, 0.05),
})  # fmt: skip
"""Assumed uncertainties, since the paper gives none. They include, for pressures, fluid-filled catheters
(transducer, damping, levelling) and, for sensors of the circuit, 10 mmHg for 14 cm of height between them
and the heart, which the model does not have; thermodilution; an ultrasonic flow meter; for blood gases the
analyser and the minutes between the sample and the other readings. A percentage is one of the measured
value. Replace them by those of your own devices where known."""
SMALLEST_FLOW = 0.1
"""A flow measured as 0 has the uncertainty of this flow [L/min]."""
SMALLEST_SHARE = 1e-4
"""Smallest uncertainty, as a share of the usual one: beats are not computed more closely, and squares of much
smaller ones overflow."""


def as_uncertainties(stated: Mapping[str, Uncertainty]) -> Mapping[str, Uncertainty]:
    """Check and return uncertainties by measurement.

    Raises:
        InputError: They are of another type, such as plain numbers, which may be absolute or relative.
    """
    if not isinstance(stated, Mapping):
        raise InputError([f"uncertainties = {written(stated)}; allowed: by measurement, {UNCERTAINTY}"])
    wrong = [n for n, given in stated.items() if not (isinstance(n, str) and isinstance(given, Uncertainty))]
    if wrong:
        raise InputError([f"uncertainty of {n}: {written(stated[n])}; allowed: {UNCERTAINTY}" for n in wrong])
    return stated


def standard_uncertainties(values: Mapping[str, float], known: Mapping[str, Uncertainty]) -> dict[str, float]:
    """Standard uncertainty of each measured value, in its unit.

    Args:
        values: measured values [mmHg, L/min].
        known: uncertainty of at least each measured value.

    Raises:
        InputError: A percentage of 0, except of a flow, is given as an uncertainty, or a very small number.
    """
    as_uncertainties({name: known[name] for name in values})
    units = {n: entry.unit if (entry := find_output(n)) is not None else "" for n in values}
    least = {n: SMALLEST_FLOW if unit == "L/min" else 0.0 for n, unit in units.items()}
    errors = {n: known[n].at(v) or known[n].at(least[n]) for n, v in values.items()}
    wrong = [
        f"uncertainty of {n}: {100.0 * known[n].relative:g} % of a value of 0 is no uncertainty; give it in "
        f"{units[n] or 'the unit of the output'}, such as {n}={DEFAULTS.get(n, Uncertainty(1.0)).absolute:g}"
        for n, error in errors.items()
        if error == 0.0
    ]
    smallest = {n: SMALLEST_SHARE * DEFAULTS[n].at(v) for n, v in values.items() if n in DEFAULTS}
    wrong += [
        f"uncertainty of {n}: {errors[n]:.2g} {units[n]} is smaller than beats are computed to; allowed: at "
        f"least {bound:.2g} {units[n]} (usual: {bound / SMALLEST_SHARE:.2g})"
        for n, bound in smallest.items()
        if 0.0 < errors[n] < 0.9 * bound  # the bound as written is allowed
    ]
    if wrong:
        raise InputError(wrong)
    return errors


def measurement_errors(
    measured: Mapping[str, float], uncertainties: Mapping[str, Uncertainty] | None = None
) -> dict[str, float]:
    """Standard uncertainty of each measurement, in its unit.

    Args:
        measured: values [mmHg, L/min].
        uncertainties: uncertainties that differ from the defaults.
    """
    return standard_uncertainties(measured, {**DEFAULTS, **(uncertainties or {})})


FARTHEST = 3.0
"""Standard uncertainties beyond which a beat is not that of the patient who was measured."""
NOT_THE_MEASURED = "is not that of the patient who was measured"
"""Words that all sentences on such a beat contain."""


def sentence_on_misses(
    measured: Mapping[str, float], beat: Mapping[str, float], what: str = "this beat"
) -> str:
    """Sentence on measurements that a beat misses by more than measurement error; empty if there are none.

    Args:
        measured: measurements, in their units.
        beat: outputs of the beat.
        what: name of the beat in the sentence.
    """
    both = {name: value for name, value in measured.items() if math.isfinite(beat.get(name, math.nan))}
    errors = measurement_errors(both)
    off = {name: abs(beat[name] - value) / errors[name] for name, value in both.items()}
    missed = sorted((n for n in off if off[n] > FARTHEST), key=off.__getitem__, reverse=True)
    if not missed:
        return ""
    parts = "; ".join(f"{name} {both[name]:.4g} measured, {beat[name]:.4g} here" for name in missed)
    return (
        f"{what} {NOT_THE_MEASURED} ({parts}): the case is simulated as it is written; if its settings are "
        "those of [measurements], eclsim identify fits it to them"
    )


def misses_of(case: Case, beat: Mapping[str, float], what: str = "this beat") -> list[str]:
    """The sentence of `sentence_on_misses` for a case with the settings of its file; none if it has none."""
    if case.measurements is None or case.changed:
        return []
    measured = case.measurements.model_dump(exclude_none=True)
    return list(filter(None, [sentence_on_misses(measured, beat, what)]))


def cautions_on_misses(case: Case, beat: Mapping[str, float]) -> list[str]:
    """The same sentence as a caution among the warnings of a result."""
    return [labelled_sentence(CAUTION, one) for one in misses_of(case, beat)]
