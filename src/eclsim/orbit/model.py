"""A model: a circuit and the values of its parameters. What every solver and every study starts from."""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from eclsim.beat.heartbeat import HEART_RATE
from eclsim.circuit.network import Choice, Circuit
from eclsim.devices.constants import OXYGENATORS, PUMPS
from eclsim.devices.crrt import crrt
from eclsim.devices.ecmo import POSITIONS, ecmo
from eclsim.devices.lvad import lvad
from eclsim.parameters import thiel2025
from eclsim.patient.circulation import circulation

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.cases.reading import CaseReading

CaseSource: TypeAlias = "str | os.PathLike[str] | CaseReading | Case"
"""What functions take as a case: the path of a case file, what `read_case` returned, or the case itself."""
ModelSource: TypeAlias = "CaseSource | Model"
VolumePolicy = Literal["as_published", "patient_held"]
AS_PUBLISHED = "as_published"
PATIENT_HELD = "patient_held"
POLICIES = (AS_PUBLISHED, PATIENT_HELD)
"""Who fills the extracorporeal circuits: the patient (as in the published code), or a priming volume of their
own, so that the patient keeps the stressed volume they started with."""
POLICY_WORDS = {
    AS_PUBLISHED: "as published: the patient's own blood fills the circuits",
    PATIENT_HELD: "patient's volume held: the circuits are primed",
}


class UnknownValueError(KeyError):
    """A parameter that the circuit does not read, or one that it reads and that has no value."""

    def __str__(self) -> str:
        return str(self.args[0])


@dataclass(frozen=True)
class Model:
    """A circuit with values.

    Args:
        circuit: compartments and connections.
        values: a number for every parameter of the circuit and for `heart_rate_bpm`.
        name: what to call it in results.
        policy: blood volume policy that it is simulated with where no other is asked for.
    """

    circuit: Circuit
    values: Mapping[str, float] = field(hash=False)
    name: str = "model"
    policy: str = AS_PUBLISHED

    def __post_init__(self) -> None:
        missing = [n for n in (HEART_RATE, *self.circuit.parameter_names()) if n not in self.values]
        if missing:
            raise UnknownValueError(
                f"no value for {', '.join(missing)}: the circuit of '{self.name}' reads them"
            )

    def with_values(self, changes: Mapping[str, float] | None = None, **more: float) -> Model:
        """The same circuit with some parameters changed; a misspelt name lists its neighbours."""
        wanted = {**(changes or {}), **more}
        known = (HEART_RATE, *self.circuit.parameter_names())
        for name in wanted:
            if name not in known:
                near = difflib.get_close_matches(name, known, n=3)
                hint = f"; did you mean {', '.join(near)}?" if near else ""
                raise UnknownValueError(f"the circuit of '{self.name}' has no parameter '{name}'{hint}")
        return replace(self, values={**self.values, **wanted})


def model_of(case: Case) -> Model:
    """The model of a case: its circuit with its parameter values and its blood volume policy."""
    from eclsim.cases.resolve import resolve_parameters

    return Model(circuit_of(case), resolve_parameters(case), case.patient.id, case.volume_policy)


def as_case(source: CaseSource) -> Case:
    """The case of a file, of what `read_case` returned, or the case itself.

    Raises:
        CaseError: the file is no case; with everything that is wrong.
        TypeError: no case at all, such as a `Model`.
    """
    from eclsim.cases.case import Case
    from eclsim.cases.reading import CaseReading, read_case

    if isinstance(source, Case):
        return source
    if isinstance(source, CaseReading):
        return source.case
    if isinstance(source, (str, os.PathLike)):
        return read_case(source).case
    kind = type(source).__name__
    raise TypeError(f"a {kind} is no case; allowed: the path of a case file, a CaseReading or a Case")


def as_model(source: ModelSource) -> Model:
    """The model of a case, or the model itself; raises as `as_case` does."""
    return source if isinstance(source, Model) else model_of(as_case(source))


def circuit_of(case: Case) -> Circuit:
    """Patient plus the devices whose sections the case has."""
    circuit = circulation()
    if case.ecmo is not None:
        e = case.ecmo
        roller = not isinstance(e.pump, str)
        circuit += ecmo(e.drainage_site, e.return_site, e.drainage_cannula, e.return_cannula, roller)
    if case.crrt is not None:
        access, giving = (POSITIONS.get(s, s) for s in (case.crrt.access_site, case.crrt.return_site))
        circuit += crrt(access, giving)
    if case.lvad is not None:
        circuit += lvad(case.lvad.inlet_site, case.lvad.outlet_site)
    return circuit


@lru_cache(maxsize=256)
def nominal_values(circuit: Circuit) -> Mapping[str, float] | None:
    """The paper's parameters and usual devices for a circuit; None if it reads a parameter of its own.

    The orbit at these values is where the search for a patient's orbit starts, whoever was solved before.
    """
    known: dict[str, Any] = {key: parameter.value for key, parameter in thiel2025.PARAMETERS.items()}
    known |= {
        HEART_RATE: 90.0,
        "total_blood_volume_ml": 4500.0,
        "Recmooxy": OXYGENATORS["Quadrox-i Adult"].resistance,
    }
    known |= {
        "ecmo.speed_rpm": 3000.0,
        "ecmo.drainage_fr": 23.0,
        "ecmo.return_fr": 17.0,
        "ecmo.roller_l_min": 3.0,
    }
    known |= {"crrt.flow_ml_min": 200.0, "lvad.speed_rpm": 2600.0}
    known |= {"ecmo.pump." + k: v for k, v in PUMPS["Rotaflow"].constants.items()}
    known |= {"lvad.pump." + k: v for k, v in PUMPS["HVAD"].constants.items()}
    ends = (site for c in circuit.connections for site in (c.source, c.target))
    known |= {site.parameter: 0.0 for site in ends if isinstance(site, Choice)}
    names = (HEART_RATE, *circuit.parameter_names())
    return MappingProxyType({n: float(known[n]) for n in names}) if all(n in known for n in names) else None
