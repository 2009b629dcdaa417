"""`eclsim simulate --sweep KEY=first:last:step`: one key varied, a steady beat for each value."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from eclsim.cli.messages import fail, warn

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.cases import Case, CaseReading, Mistake
    from eclsim.cli.destinations import Destinations
    from eclsim.simulation.sweep import Sweep, Value

_SHOWN = (
    ("SP", "SP"), ("DP", "DP"), ("MAP", "MAP"), ("MPAP", "MPAP"), ("PCWP", "PCWP"),
    ("right_atrial_pressure", "CVP"), ("systemic_flow", "Qs"), ("CO", "CO"), ("PF", "PF"),
    ("lowest_drainage_pressure", "drain"),
)  # fmt: skip


@dataclass(frozen=True)
class Readings:
    """The case at each value: the key as a case file writes it, its unit, the case's own value."""

    key: str
    unit: str
    own: Value | None
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
    warn(stops_short(text), "note")
    readings = _read_each(file, settings, key, texts, policy)
    found = {_value(reading.case, section, name): reading.case for reading in readings}
    if all(isinstance(value, float) for value in found):
        found = dict(sorted(found.items()))
    key = name if section == "parameters" else f"{section}.{name}"
    return Readings(key, _unit(section, name), _own(file, settings, section, name), found)


def _set_keys(settings: Sequence[str]) -> Collection[tuple[str, str]]:
    """Section and name of each setting; mistakes in them are said where the case is read."""
    from eclsim.cases import CaseError
    from eclsim.cases.settings import parse_settings

    try:
        return parse_settings(settings)
    except CaseError:
        return ()


def show(sweep: Sweep) -> None:
    """The table on standard output; a value without a steady beat has its reason in place of numbers."""
    import typer

    from eclsim.cli.tables import columns
    from eclsim.simulation.single import SPEED_FOUND
    from eclsim.simulation.summary import cell, legend

    shown = [(name, head) for name, head in _SHOWN if any(name in result for result in sweep.results)]
    solved = any(SPEED_FOUND in result.attrs for result in sweep.results)
    head = [f"{sweep.key} [{sweep.unit}]" if sweep.unit else sweep.key]
    head += (["rpm"] if solved else []) + [f"{head} " for _, head in shown] + ["beat"]
    rows = []
    for value, result in zip(sweep.values, sweep.results, strict=True):
        settled = bool(result.attrs["converged"])
        numbers = [cell(result, name) if settled else "" for name, _ in shown]
        speed = [f"{result.attrs[SPEED_FOUND]:.0f}" if SPEED_FOUND in result.attrs else ""] if solved else []
        rows.append([_text(value), *speed, *numbers, _word(result)])
    policy = sweep.results[0].attrs["blood_volume_policy"]
    typer.echo(f"{sweep.case_id}: steady beats, blood volume {policy}; mmHg, flows in L/min")
    typer.echo(columns(head, rows, numeric=range(len(head) - 1)))
    if said := legend([result for result in sweep.results if result.attrs["converged"]]):
        typer.echo(said)


def write(sweep: Sweep, planned: Destinations) -> None:
    """JSON, NetCDF, CSV and the figure, as far as they are wanted."""
    from eclsim.simulation.sweep_files import write_csv, write_figure, write_json, write_netcdf

    (stem,) = planned.stems
    try:
        if planned.out is not None:
            write_netcdf(sweep, planned.out)
        if planned.csv is not None:
            write_csv(sweep, planned.csv / f"{stem}.csv")
        if planned.figures is not None:
            write_figure(sweep, planned.figures / stem)
        if planned.json is not None:
            write_json(sweep, planned.json)
    except BrokenPipeError:
        raise
    except OSError as error:
        fail(f"{error.filename or 'output'}: cannot be written: {error.strerror or error}")


def say_doubts(sweep: Sweep, file: str) -> None:
    """Each sentence once, with the values it holds for; its numbers are those of the last of them."""
    where: dict[str, list[tuple[str, str]]] = {}
    for value, result in zip(sweep.values, sweep.results, strict=True):
        sentences = [str(sentence) for sentence in result.attrs.get("warnings", ())]
        if not result.attrs["converged"]:
            sentences = [f"no beat: {result.attrs.get('message', '')}"]
        for sentence in sentences:
            where.setdefault(re.sub(r"\d[\d.e+-]*", "", sentence), []).append((_text(value), sentence))
    unit = f" {sweep.unit}" if sweep.unit else ""
    for found in where.values():
        values = [value for value, _ in found]
        every = len(values) == len(sweep.values) > 1
        place = "at every value" if every else f"at {', '.join(values)}{unit}"
        last, sentence = found[-1]
        differ = any(other != sentence for _, other in found)
        warn([f"{file}: {sweep.key} {place}: {sentence}{f' (numbers at {last}{unit})' if differ else ''}"])


def run_sweep(readings: Readings) -> Sweep:
    """Solve; a sweep that cannot be run leaves with exit status 2."""
    from eclsim.simulation.sweep import SweepError, sweep_cases

    try:
        return sweep_cases(readings.key, readings.unit, readings.own, readings.cases)
    except SweepError as error:
        fail(f"--sweep {error}")


def _read_each(
    file: str, settings: Sequence[str], key: str, texts: Sequence[str], policy: str | None
) -> list[CaseReading]:
    from eclsim.cli.cases import read_each

    wanted = [(file, [*settings, f"{key}={text}"], policy) for text in texts]
    readings = read_each(wanted, lambda mistake: _of_sweep(mistake, key))
    warn(dict.fromkeys(str(_of_sweep(m, key)) for r in readings for m in r.warnings))
    notes = (m for m in readings[0].notes if not _is_of(m, key))
    warn(dict.fromkeys(map(str, notes)), "note")
    return readings


def _is_of(mistake: Mistake, key: str) -> bool:
    return mistake.key.removeprefix("parameters.") == key.removeprefix("parameters.")


def _of_sweep(mistake: Mistake, key: str) -> Mistake:
    return replace(mistake, file="--sweep") if _is_of(mistake, key) else mistake


def _own(file: str, settings: Sequence[str], section: str, name: str) -> Value | None:
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
    from eclsim.parameters import thiel2025

    if section == "parameters":
        return thiel2025.PARAMETERS[name].unit
    kind = section_of(section)
    return "" if kind is None else kind.fields()[name].unit


def _text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _word(result: xr.Dataset) -> str:
    if not result.attrs["converged"]:
        return f"none: {str(result.attrs.get('status', '')).replace('_', ' ')}"
    return "impossible, see warnings" if result.attrs.get("impossible") else "steady"
