"""Model: a circuit and the values of its parameters, the input of every solver and study."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NoReturn, TypeAlias

from eclsim.arguments import Kind, article, number_of, written
from eclsim.beat.heartbeat import HEART_RATE
from eclsim.cases.case import Case
from eclsim.cases.quantities import numeric_field, section_and_key
from eclsim.cases.reading import CaseReading, as_file, read_case
from eclsim.cases.resolve import circuit_of, nominal_values, resolve_parameters
from eclsim.cases.sections import AS_PUBLISHED, PATIENT_HELD, POLICY_KEY
from eclsim.circuit.network import Circuit
from eclsim.circuit.own_laws import mistakes_of_own_laws
from eclsim.devices.device import DeviceError
from eclsim.devices.dialysed_blood import OF_PATIENT
from eclsim.parameters.regulation import SET_POINT, SOLVED_FOR, VENOUS_SET_POINT
from eclsim.spelling import spelling_hint

__all__ = ["Model", "UnknownValueError", "as_case", "as_model", "circuit_of", "model_of", "nominal_values"]

CaseSource: TypeAlias = "str | os.PathLike[str] | CaseReading | Case"
"""Case argument of functions: the path of a case file, the result of `read_case`, or the case itself."""
ModelSource: TypeAlias = "CaseSource | Model"
VolumePolicy = Literal["as_published", "patient_held"]
CASE = "case"
"""Attribute of a result that holds its case as JSON text (`case_record`)."""
POLICY_WORDS = {
    AS_PUBLISHED: "as published: the patient's own blood fills the circuits",
    PATIENT_HELD: "patient's volume held: the circuits are primed",
}


class UnknownValueError(KeyError):
    """Raised for a parameter that the circuit does not read, or one that it reads and that has no value."""

    def __str__(self) -> str:
        return str(self.args[0])


def _refuse(*_: Any, **__: Any) -> NoReturn:
    raise TypeError("the values of a model cannot be changed; model.with_values(...) makes another model")


class ReadOnlyValues(dict[str, float]):
    """Numbers by name that cannot be changed, only copied."""

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[type[ReadOnlyValues], tuple[dict[str, float]]]:
        return ReadOnlyValues, (dict(self),)


@dataclass(frozen=True)
class Model:
    """A circuit with parameter values, which cannot be changed: `with_values` makes another model.

    Args:
        circuit: the circuit.
        values: value of every parameter of the circuit and of `heart_rate_bpm`.
        name: name in results.
        policy: default blood volume policy of its simulations.
        doubts: cautions about the fit of the values, repeated with every result (`Case.doubts`).
    """

    circuit: Circuit
    values: Mapping[str, float] = field(hash=False)
    name: str = "model"
    policy: str = AS_PUBLISHED
    doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        Kind(Circuit)("circuit", self.circuit)
        Kind(Mapping, "numbers by parameter")("values", self.values)
        names = (HEART_RATE, *self.circuit.parameter_names())
        missing = [n for n in names if n not in self.values]
        if missing:
            raise UnknownValueError(
                f"no value for {', '.join(missing)}: the circuit of '{self.name}' needs them; "
                "a device gives its own in `values` or `parameters`"
            )
        others = {n: number_of(n, self.values[n]) for n in names if type(self.values[n]) is not float}
        if others or not isinstance(self.values, ReadOnlyValues):
            object.__setattr__(self, "values", ReadOnlyValues({**self.values, **others}))
        refuse_faulty_laws(self.circuit, self.values)

    def __repr__(self) -> str:
        parts = f"{len(self.circuit.compartments)} compartments, {len(self.circuit.connections)} connections"
        return f"<Model {self.name}: {parts}, blood volume {self.policy}>"

    @classmethod
    def published(cls, circuit: Circuit, name: str = "model", policy: str = AS_PUBLISHED) -> Model:
        """Model of a circuit with the paper's parameters and default devices, at 90 beats per minute.

        Raises:
            UnknownValueError: the circuit reads a parameter without a published value.
        """
        Kind(Circuit)("circuit", circuit)
        return cls(circuit, nominal_values(circuit) or {}, name, policy)

    def with_values(self, changes: Mapping[str, float] | None = None, **named: float) -> Model:
        """The same circuit with some parameters changed; an unknown name raises an error with suggestions."""
        if changes is not None and not isinstance(changes, Mapping):
            allowed = 'numbers by parameter, such as {"Rmc": 0.8}, or Rmc=0.8'
            raise TypeError(f"{article(type(changes).__name__)} names no parameter; allowed: {allowed}")
        changed = {**(changes or {}), **named}
        self.refuse_unknown(changed)
        numbers = {name: number_of(name, value) for name, value in changed.items()}
        return replace(self, values={**self.values, **numbers})

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters that the circuit reads and that have a number, as `derivatives` takes them.

        Without those that are solved with the beat and those whose value selects that of the patient's blood:
        `with_values` gives them a number.
        """
        own = OF_PATIENT.get
        numbers = {name: self.values.get(name, math.nan) for name in self._read()}
        return tuple(n for n, v in numbers.items() if not (math.isnan(v) or v == own(n.rpartition(".")[2])))

    def _read(self) -> tuple[str, ...]:
        """Names of all parameters that the circuit reads."""
        names = (HEART_RATE, *self.circuit.parameter_names(), *self.circuit.content_names())
        return tuple(dict.fromkeys(names))

    def refuse_unknown(self, parameters: Iterable[str]) -> None:
        """Raise an error, with suggested spellings, for names that are no parameters of the circuit."""
        names = self._read()
        for name in parameters:
            if not isinstance(name, str):
                raise TypeError(
                    f"{written(name)} is not the name of a parameter; allowed: a name such as Rmc"
                )
            if name not in names:
                hint = spelling_hint(name.removeprefix("parameters."), names) or _hint_of_case(name)
                raise UnknownValueError(f"the circuit of '{self.name}' has no parameter '{name}'{hint}")


def _hint_of_case(name: str) -> str:
    """What to do with a number of a case that is no parameter of its circuit; empty for any other name."""
    if numeric_field(name) is None and section_and_key(name) is None:
        return ""
    return f'; it is a number of the case: eclsim.read_case(path, ["{name}=..."]) changes it there'


def refuse_faulty_laws(circuit: Circuit, values: Mapping[str, float], where: str = "") -> None:
    """Raise `DeviceError` for laws of users that cannot be solved at these values, told after `where`."""
    if mistakes := mistakes_of_own_laws(circuit, values):
        raise DeviceError(where + "\n".join(mistakes))


def model_of(case: CaseSource) -> Model:
    """The model of a case: its circuit with its parameter values and its blood volume policy.

    Args:
        case: path of a case file, result of `read_case`, or a case.
    """
    case = as_case(case)
    return Model(circuit_of(case), values_of(case), case.patient.id, case.volume_policy, case.doubts)


def values_of(case: Case) -> dict[str, float]:
    """Value of every parameter of a case; open set points of reflexes are computed at rest.

    Parameters that respond to gases are NaN: they are solved for with the beat (`eclsim.outputs.coupling`).
    """
    values, regulation = resolve_parameters(case), case.regulation
    if regulation is None:
        return values
    from eclsim.orbit.rest import resting_gases, resting_pressures

    open_points = set(regulation.open_set_points)
    if open_points & {SET_POINT, VENOUS_SET_POINT}:
        values |= {name: v for name, v in resting_pressures(case).items() if name in open_points}
    if case.gas is not None and open_points - {SET_POINT, VENOUS_SET_POINT}:
        values |= {name: v for name, v in resting_gases(case).items() if name in open_points}
    if case.gas is not None:
        read = circuit_of(case).parameter_names()
        values |= {name: math.nan for name in SOLVED_FOR if name in read and name not in case.parameters}
    return values


def case_record(case: Case, policy: str | None = None) -> dict[str, Any]:
    """The case of a result as a mapping; `Case.model_validate` of it gives a case that repeats the result.

    Args:
        case: the computed case. If its speed is not yet solved for a target flow, open set points stay open,
            as there are no numbers to repeat.
        policy: blood volume policy of the computation; by default the case's.
    """
    if case.as_written is not None and not case.targets() and not case.at_rest().targets():
        case = case.with_set_points(values_of(case))
    return as_file(case) | ({} if policy is None else {POLICY_KEY: policy})


def case_json(case: Case, policy: str | None = None) -> str:
    """The case of a labelled result as text for `Case.model_validate_json`, its attribute `case`.

    Args:
        case: as for `case_record`.
        policy: as for `case_record`.
    """
    return json.dumps(case_record(case, policy))


def as_case(source: CaseSource, *, or_model: bool = False) -> Case:
    """Return the case of a file, of the result of `read_case`, or the case itself.

    Args:
        source: source of the case.
        or_model: whether the error message should mention that a model is allowed as well.

    Raises:
        CaseError: the file is no valid case; lists all mistakes.
        TypeError: `source` is no case, such as a `Model`.
    """
    if isinstance(source, Case):
        return source
    if isinstance(source, CaseReading):
        return source.case
    if isinstance(source, (str, os.PathLike)):
        return read_case(source).case
    kind = "None" if source is None else article(type(source).__name__)
    allowed = "the path of a case file, a CaseReading or a Case" + (", or a Model" if or_model else "")
    hint = "; eclsim.Model.published(circuit) makes a model of a circuit" if or_model else ""
    raise TypeError(f"{kind} is not a case; allowed: {allowed}{hint if isinstance(source, Circuit) else ''}")


def as_model(source: ModelSource) -> Model:
    """Return the model of a case, or the model itself; raises the same errors as `as_case`."""
    return source if isinstance(source, Model) else model_of(as_case(source, or_model=True))
