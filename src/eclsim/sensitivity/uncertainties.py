"""Standard uncertainties of the clinical measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from eclsim.sensitivity.inputs import InputError


@dataclass(frozen=True)
class Uncertainty:
    """Standard uncertainty of a measurement: in its unit, or relative.

    Args:
        absolute: in the unit of the output.
        relative: share of the value.
    """

    absolute: float = 0.0
    relative: float = 0.0

    def at(self, value: float) -> float:
        """In the unit of the output."""
        return max(self.absolute, self.relative * abs(value))


DEFAULTS: MappingProxyType[str, Uncertainty] = MappingProxyType(
    {
        "SP": Uncertainty(4.0),
        "DP": Uncertainty(4.0),
        "MAP": Uncertainty(3.0),
        "MPAP": Uncertainty(2.0),
        "PCWP": Uncertainty(2.0),
        "CO": Uncertainty(relative=0.10),
        "PF": Uncertainty(relative=0.05),
        "SaO2": Uncertainty(1.5),
        "PaO2": Uncertainty(3.0, 0.05),
        "PaCO2": Uncertainty(2.0, 0.04),
        "SvO2": Uncertainty(2.0),
        "SpreO2": Uncertainty(2.0),
        "SpostO2": Uncertainty(1.0),
        "PpostO2": Uncertainty(5.0, 0.05),
        "PexhaustCO2": Uncertainty(2.0, 0.05),
    }
)
"""Assumed, for want of the paper's: fluid-filled catheters (transducer, damping, levelling), thermodilution,
an ultrasonic flow meter; of blood gases the analyser, and the minutes from the sample to the other readings.
A percentage is one of the measured value. Give your own devices' where you know them."""
LEAST_FLOW = 0.1
"""A flow measured as 0 has the uncertainty of this one [L/min]."""


def standard_uncertainties(values: Mapping[str, float], known: Mapping[str, Uncertainty]) -> dict[str, float]:
    """Standard uncertainty of each measured value, in its unit.

    Args:
        values: measured [mmHg, L/min].
        known: uncertainty of each, at least.
    """
    return {n: known[n].at(v) or known[n].at(LEAST_FLOW) for n, v in values.items()}


def read_uncertainties(text: str) -> dict[str, Uncertainty]:
    """Read "SP=4,CO=10%": numbers in the unit of the output, or percent of its value."""
    result, wrong = {}, []
    for part in (p.strip() for p in text.split(",") if p.strip()):
        name, _, number = (p.strip() for p in part.partition("="))
        try:
            value = float(number.removesuffix("%"))
        except ValueError:
            value = 0.0
        if not value > 0.0 or value == float("inf"):
            wrong.append(
                f"--uncertainty {part}: allowed: NAME=VALUE or NAME=PERCENT%, above 0, such as CO=10%"
            )
        elif name in result:
            wrong.append(f"--uncertainty {part}: {name} is given twice; leave one of them out")
        elif number.endswith("%") and value > 100.0:
            wrong.append(
                f"--uncertainty {part}: a value as uncertain as this says nothing; allowed: up to 100%, "
                "or leave the measurement out"
            )
        else:
            result[name] = Uncertainty(relative=value / 100.0) if number.endswith("%") else Uncertainty(value)
    if wrong:
        raise InputError(wrong)
    return result


def uncertainties_of(outputs: Sequence[str], given: Mapping[str, Uncertainty]) -> dict[str, Uncertainty]:
    """The uncertainty of each output: the one given, else the default."""
    wrong = [f"uncertainty of {name}: not among the measurements" for name in given if name not in outputs]
    known = {**DEFAULTS, **given}
    wrong += [
        f"uncertainty of {name}: no default; give one, such as {name}=5%"
        for name in outputs
        if name not in known
    ]
    if wrong:
        raise InputError(wrong)
    return {name: known[name] for name in outputs}
