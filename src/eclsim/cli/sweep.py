"""The cases of `eclsim simulate --sweep KEY=first:last:step`: one key varied."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from eclsim.cli.cases import read_each
from eclsim.cli.console import fail, note, warn

if TYPE_CHECKING:
    from eclsim.cases import Case, CaseReading, Mistake
    from eclsim.simulation.sweep import Value


@dataclass(frozen=True)
class Readings:
    """The case at each value: the key as a case file writes it, its unit, the case's own value."""

    key: str
    unit: str
    case_value: Value | None
    cases: Mapping[Value, Case]


def read(file: str, settings: Sequence[str], text: str, policy: str | None = None) -> Readings:
    """The cases of a sweep; with anything wrong say all of it and leave with exit status 2."""
    from eclsim.cases import CaseError
    from eclsim.cases.settings import parse_settings
    from eclsim.simulation.sweep import SweepError, parse_sweep, stops_short

    try:
        key, texts = parse_sweep(text)
        ((section, name),) = parse_settings([f"{key}={texts[0]}"])
    except SweepError as error:
        fail(f"--sweep {error}")
    except CaseError as error:
        fail(*(str(m.at("--sweep", None)) for m in error.mistakes))
    if (section, name) == ("patient", "id") or section == "measurements":
        fail(f"--sweep {key}: changes nothing that the simulation reads; sweep a setting or a parameter")
    if (section, name) in _set_keys(settings):
        fail(f"--sweep {key}: --set gives it a value too; leave one of the two out")
    note(stops_short(text))
    readings = _read_each(file, settings, key, texts, policy)
    cases = {_value(reading.case, section, name): reading.case for reading in readings}
    if all(isinstance(value, float) for value in cases):
        cases = dict(sorted(cases.items()))
    key = name if section == "parameters" else f"{section}.{name}"
    return Readings(key, _unit(section, name), _value_without_sweep(file, settings, section, name), cases)


def _set_keys(settings: Sequence[str]) -> Collection[tuple[str, str]]:
    """Section and name of each setting; mistakes in them are said where the case is read."""
    from eclsim.cases import CaseError
    from eclsim.cases.settings import parse_settings

    try:
        return parse_settings(settings)
    except CaseError:
        return ()


def _read_each(
    file: str, settings: Sequence[str], key: str, texts: Sequence[str], policy: str | None
) -> list[CaseReading]:
    wanted = [(file, [*settings, f"{key}={text}"], policy) for text in texts]
    readings = read_each(wanted, lambda mistake: _of_sweep(mistake, key))
    warn(dict.fromkeys(str(_of_sweep(m, key)) for r in readings for m in r.warnings))
    note(dict.fromkeys(str(m) for m in readings[0].notes if not _is_of(m, key)))
    return readings


def _is_of(mistake: Mistake, key: str) -> bool:
    return mistake.key.removeprefix("parameters.") == key.removeprefix("parameters.")


def _of_sweep(mistake: Mistake, key: str) -> Mistake:
    return replace(mistake, file="--sweep") if _is_of(mistake, key) else mistake


def _value_without_sweep(file: str, settings: Sequence[str], section: str, name: str) -> Value | None:
    """The value of the case without the sweep; None where it has none or is no case without it."""
    from eclsim.cases import CaseError, read_case
    from eclsim.cases.resolve import resolve_parameters
    from eclsim.devices.device import UnsolvedFlowError

    try:
        case = read_case(file, settings).case
        if section == "parameters":
            return resolve_parameters(case)[name]
        return _value(case, section, name)
    except (CaseError, KeyError, UnsolvedFlowError):
        return None


def _value(case: Case, section: str, name: str) -> Value:
    value = case.setting(section, name)
    if value is None:
        raise KeyError(name)
    return float(value) if isinstance(value, (int, float)) else str(value)


def _unit(section: str, name: str) -> str:
    from eclsim.cases.sections import section_of
    from eclsim.devices.registry import parameter_of

    if section == "parameters":
        parameter = parameter_of(name)
        return "" if parameter is None else parameter.unit
    kind = section_of(section)
    return "" if kind is None else kind.fields()[name].unit
