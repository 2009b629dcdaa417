"""Names of what a beat records, as in the paper: P, Q or V and where (`Pao`, `Qlv`, `Vlv`, `Qecmopump`)."""

from __future__ import annotations

from enum import Enum
from functools import lru_cache
from typing import NamedTuple


class Kind(Enum):
    """Kind of quantity of a signal; the value is the letter that its name begins with."""

    PRESSURE = "P"
    FLOW = "Q"
    VOLUME = "V"

    @property
    def unit(self) -> str:
        """Unit of the signal's values."""
        return {"P": "mmHg", "Q": "mL/s", "V": "mL"}[self.value]


class Form(Enum):
    """In what form a signal is recorded; the value is what its name ends in."""

    VALUE = ""
    """At the end of each step."""
    RATE = "'"
    """Change per unit of phase at the end of each step."""
    MEAN = "~"
    """Mean of a flow over the step that ends here: what moved, whatever a valve did meanwhile."""


class Signal(NamedTuple):
    """A waveform of the beat.

    Attributes:
        kind: pressure [mmHg], flow [mL/s] or stressed volume [mL].
        place: a compartment; of a flow, and of the pressure gained across a pump, the connection.
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
        """The signal of a name; `ValueError` where the name begins with none of the letters."""
        form = next(f for f in (Form.RATE, Form.MEAN, Form.VALUE) if name.endswith(f.value))
        return Signal(Kind(name[:1]), name[1 : len(name) - len(form.value)], form)

    @property
    def plain(self) -> Signal:
        """The signal's value, of a rate or mean."""
        return Signal(self.kind, self.place)
