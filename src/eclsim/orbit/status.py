"""Outcome of a solve as an enumeration, with messages that say what to do."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Outcome of solving for the steady beat of one patient."""

    CONVERGED = 0
    NO_EJECTION = 1
    NOT_CONVERGED = 2
    NOT_FINITE = 3
    INVALID_INPUT = 4
    ONE_OF_MANY = 5

    @property
    def message(self) -> str:
        """Meaning of the status, and what to do."""
        return _MESSAGES[self]

    @property
    def word(self) -> str:
        """Name in lower case, as used in results and files."""
        return self.name.lower()


_MESSAGES = {
    Status.CONVERGED: "steady beat found",
    Status.NO_EJECTION: (
        "the native heart ejects next to nothing, and no steady beat that the case alone determines was "
        "found: blood shifts towards the lungs for thousands of beats, or the valves stay shut and the "
        "final volumes depend on the start; raise Emaxlv or Emaxrv, lower the afterload or the pump "
        "speed, or follow the course from the start with --transient"
    ),
    Status.NOT_CONVERGED: (
        "no steady beat found: check the parameters against their ranges, or follow the course in time with "
        "--transient"
    ),
    Status.NOT_FINITE: (
        "pressures or flows became infinite: a parameter is far outside its physiological range (see "
        "`eclsim parameters list`), or a law of your own gives no finite number"
    ),
    Status.INVALID_INPUT: "a value is not allowed, so nothing was computed",
    Status.ONE_OF_MANY: "steady beat found, but it is one of many",
}


class NoDerivativesError(ValueError):
    """Raised if a patient has no derivatives: no steady beat was found, or its equation is singular.

    Attributes:
        status: outcome of the search for the steady beat; `CONVERGED` if the equation is singular.
        name: name of the patient; empty if there is none.
        reason: cause, and what to do.
        gases: outcome of the search for the steady gas state, in lower case; empty unless that is what is
            missing.
    """

    def __init__(self, status: Status, reason: str, name: str = "", gases: str = ""):
        self.status = status
        self.name = name
        self.reason = reason
        self.gases = gases
        of = f"{name}: " if name else ""
        super().__init__(f"{of}no derivatives ({self.word}): {reason}")

    @property
    def word(self) -> str:
        """The status of the gases or of the beat in lower case, or "singular" if the equation is singular."""
        if self.gases:
            return self.gases
        return "singular" if self.status in (Status.CONVERGED, Status.ONE_OF_MANY) else self.status.word
