"""How a solve ended: a typed value with a sentence that says what to do."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Outcome of solving for the steady beat of one patient."""

    CONVERGED = 0
    NO_EJECTION = 1
    NOT_CONVERGED = 2
    NOT_FINITE = 3

    @property
    def message(self) -> str:
        """What it means and what to do."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.CONVERGED: "steady beat found",
    Status.NO_EJECTION: (
        "the native heart ejects next to nothing, so blood shifts towards the lungs for thousands of beats "
        "and there is no steady beat to speak of: raise Emaxlv or Emaxrv, lower the afterload or the pump "
        "speed, or read the values as a state in passing"
    ),
    Status.NOT_CONVERGED: (
        "no steady beat found: check the parameters against their ranges, or follow the course in time with "
        "--transient"
    ),
    Status.NOT_FINITE: (
        "the beat left the range of numbers: a parameter is far outside its physiological range; see "
        "`eclsim parameters list`"
    ),
}
