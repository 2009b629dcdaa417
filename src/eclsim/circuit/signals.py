"""Names of recorded signals, as in the paper: P, Q or V and the place (`Pao`, `Qlv`, `Vlv`, `Qecmopump`)."""

from __future__ import annotations

from enum import Enum
from functools import lru_cache
from typing import NamedTuple


class Kind(Enum):
    """Quantity of a signal; the value is the first letter of the signal's name."""

    PRESSURE = "P"
    FLOW = "Q"
    VOLUME = "V"

    @property
    def unit(self) -> str:
        """Unit of the signal's values."""
        return {"P": "mmHg", "Q": "mL/s", "V": "mL"}[self.value]


class Form(Enum):
    """Form in which a signal is recorded; the value is the suffix of the signal's name."""

    VALUE = ""
    """Value at the end of each step."""
    RATE = "'"
    """Derivative with respect to phase at the end of each step."""
    MEAN = "~"
    """Mean of a flow over each step, correct even when a valve opens or closes within the step."""


class Signal(NamedTuple):
    """A waveform of the beat.

    Attributes:
        kind: pressure [mmHg], flow [mL/s] or stressed volume [mL].
        place: the compartment, or the connection for a flow or the pressure gained across a pump.
        form: value, rate or mean.
    """

    kind: Kind
    place: str
    form: Form = Form.VALUE

    def __str__(self) -> str:
        return self.kind.value + self.place + self.form.value

    @staticmethod
    @lru_cache(maxsize=4096)
    def parse(name: str) -> Signal:
        """Return the signal with a name; raises `ValueError` if the name begins with none of the letters."""
        form = next(f for f in (Form.RATE, Form.MEAN, Form.VALUE) if name.endswith(f.value))
        return Signal(Kind(name[:1]), name[1 : len(name) - len(form.value)], form)

    @property
    def plain(self) -> Signal:
        """The signal recorded as its value instead of a rate or mean."""
        return Signal(self.kind, self.place)
