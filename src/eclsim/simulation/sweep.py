"""Sweep: one key of a case varied over a list of values, steady beats as one batch, and files."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from eclsim import files
from eclsim.cases.case import Case
from eclsim.cases.fit_mark import untrusted, with_doubts
from eclsim.circuit import Circuit
from eclsim.devices.description import GRAVEST_FIRST
from eclsim.devices.registry import example_setting
from eclsim.files import frame_text, write_text
from eclsim.orbit.model import CASE, case_record, circuit_of, values_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.results import labelled, scalars_of
from eclsim.outputs.steady_beat import steady_beat
from eclsim.simulation.files import case_object, column_head
from eclsim.simulation.single import result_without_flow
from eclsim.simulation.target_flow import FlowNotReachedError, solved_speed_of, with_speed

if TYPE_CHECKING:
    import pandas as pd


LARGEST_COUNT = 201
"""Largest number of values of a sweep: all waveforms are held in memory, about 0.5 MB each."""

Value = float | str


class SweepError(ValueError):
    """Raised for a sweep that cannot be run; the message says what is allowed."""


@dataclass(frozen=True)
class Sweep:
    """A case at each value of one key.

    Args:
        case_id: id of the patient.
        key: key of the case file, or name of a parameter.
        unit: unit of the values; empty for names.
        values: numbers, or names.
        case_value: the case's own value; None if it has none.
        results: beat at each value, as of `eclsim.simulate`.
    """

    case_id: str
    key: str
    unit: str
    values: tuple[Value, ...]
    case_value: Value | None
    results: tuple[xr.Dataset, ...]

    @property
    def numeric(self) -> bool:
        """Whether the values are numbers."""
        return all(isinstance(value, float) for value in self.values)


def parse_sweep(text: str) -> tuple[str, tuple[str, ...]]:
    """Parse `KEY=first:last:step` or `KEY=value,value,...` into key and values, each value as text.

    Raises:
        SweepError: The text has neither form.
    """
    key, equals, written = (part.strip() for part in text.partition("="))
    if not (key and equals and written):
        raise SweepError(_no_sweep(text))
    values: dict[str, None] = {}
    for part in written.split(","):
        ends = part.strip().split(":")
        if len(ends) == 1 and ends[0]:
            values[ends[0]] = None
        elif len(ends) == 3:
            values |= dict.fromkeys(_steps(ends, text))
        else:
            raise SweepError(_no_sweep(text))
    if len(values) > LARGEST_COUNT:
        raise SweepError(f"'{text[:60]}': {len(values)} values; allowed: up to {LARGEST_COUNT}")
    return key, tuple(values)


def sweep_cases(
    key: str, unit: str, case_value: Value | None, cases: Mapping[Value, Case], policy: str | None = None
) -> Sweep:
    """Compute the steady beat of each of several cases that differ in one key.

    Args:
        key: name of the varied key in messages.
        unit: unit of the values.
        case_value: value of the unchanged case.
        cases: cases by value, in order.
        policy: blood volume policy; None takes that of the cases, which share it.

    Raises:
        SweepError: The values connect the circuit in different ways, or change nothing.
    """
    circuit = _one_circuit(key, cases)
    policy = policy or next(iter(cases.values())).volume_policy
    results: list[xr.Dataset | None] = []
    values: list[Mapping[str, float]] = []
    about: list[dict[str, str | float]] = []
    for case in cases.values():
        try:
            solved, speed = with_speed(case, policy)
        except FlowNotReachedError as error:
            results.append(result_without_flow(case, policy, str(error)))
            continue
        results.append(None)
        values.append(values_of(solved))
        solved_for = {} if speed is None else speed.attributes()
        about.append({CASE: json.dumps(case_record(solved, policy)), **solved_for})
    _check_effect(key, circuit, values, len(cases))
    first = next(iter(cases.values()))
    name = first.patient.id
    beats = iter(_beats(circuit, values, about, name, policy, first.doubts))
    filled = tuple(next(beats) if result is None else result for result in results)
    return Sweep(name, key, unit, tuple(cases), case_value, filled)


def _beats(
    circuit: Circuit,
    values: Sequence[Mapping[str, float]],
    about: Sequence[Mapping[str, str | float]],
    name: str,
    policy: str,
    doubts: Sequence[str],
) -> list[xr.Dataset]:
    if not values:
        return []
    shared = [key for key in values[0] if all(key in of_case for of_case in values)]
    columns = {key: np.array([of_case[key] for of_case in values]) for key in shared}
    solved = steady_beat(Batch(circuit, columns, len(values), policy), waveforms=None, keep=None)
    return [labelled(solved, k, name, doubts).assign_attrs(of_case) for k, of_case in enumerate(about)]


def _one_circuit(key: str, cases: Mapping[Value, Case]) -> Circuit:
    first, *further = cases
    circuit = circuit_of(cases[first])
    for value in further:
        if circuit_of(cases[value]) != circuit:
            raise SweepError(
                f"{key}: {value} connects the circuit in another way than {first}, which a sweep cannot do; "
                "simulate them side by side, a case file each"
            )
    return circuit


def _check_effect(key: str, circuit: Circuit, values: Sequence[Mapping[str, float]], count: int) -> None:
    read = ("heart_rate_bpm", *circuit.parameter_names(), *circuit.content_names())
    if (
        count > 1
        and len(values) == count
        and all(of_case.get(n) == values[0].get(n) for of_case in values for n in read)
    ):
        raise SweepError(f"{key}: changes nothing that the simulation reads; sweep a setting or a parameter")


def _steps(ends: Sequence[str], text: str) -> list[str]:
    try:
        first, last, step = (float(end) for end in ends)
    except ValueError:
        raise SweepError(_no_sweep(text)) from None
    if not all(math.isfinite(end) for end in (first, last, step)):
        raise SweepError(_no_sweep(text))
    if step == 0.0:
        raise SweepError(f"'{text[:60]}': a step of 0 never reaches the last value; {_allowed()}")
    count = (last - first) / step
    if count < 0.0:
        raise SweepError(f"'{text[:60]}': the step leads away from the last value; {_allowed()}")
    if count > LARGEST_COUNT:
        raise SweepError(f"'{text[:60]}': {count + 1:.0f} values; allowed: up to {LARGEST_COUNT}")
    return [f"{first + k * step:.12g}" for k in range(math.floor(count + 1e-9) + 1)]


def remarks_on_last_values(text: str) -> list[str]:
    """A sentence for each range of a sweep (see `parse_sweep`) whose steps do not reach its last value."""
    messages = []
    for part in text.partition("=")[2].split(","):
        ends = part.strip().split(":")
        if len(ends) == 3 and float(_steps(ends, text)[-1]) != float(f"{float(ends[1]):.12g}"):
            reached = _steps(ends, text)[-1]
            messages.append(
                f"--sweep: {part.strip()} ends at {reached}: {ends[1]} is not a whole number of steps away"
            )
    return messages


def _allowed() -> str:
    return f"allowed: KEY=first:last:step or KEY=value,value, such as {example_setting()}=2000:4500:250"


def _no_sweep(text: str) -> str:
    return f"'{text[:60]}' is not a sweep; {_allowed()}"


def as_table(sweep: Sweep) -> xr.Dataset:
    """Outputs over the values, NaN without a steady beat, with `status` and `message`.

    Returns:
        Dataset over `value`: every output that any of the beats has, `converged`, `impossible`, `warnings`
        (one line each), and the pump speed if it was solved for a flow. The attribute `broken` (JSON) names
        the outputs beyond a limit, with the kind of the limit and the indices of the values.
    """
    results = sweep.results
    data: dict[str, Any] = {}
    for name in dict.fromkeys(name for result in results for name in scalars_of(result)):
        about = next(r[name].attrs for r in results if name in r)
        labels = {k: about[k] for k in ("units", "long_name", "definition") if k in about}
        if any(result[name].attrs.get("read_with_care") for result in results if name in result):
            labels["read_with_care"] = 1
        data[name] = ("value", np.array([_value_if_converged(r, name) for r in results]), labels)
    solved = [solved_speed_of(result) for result in results]
    for key in dict.fromkeys(speed.speed_key for speed in solved if speed):
        speeds = np.array([np.nan if speed is None else speed.speed_rpm for speed in solved])
        labels = {"units": "rpm", "long_name": "pump speed that gives the flow wanted"}
        data["solved_" + key.replace(".", "_")] = ("value", speeds, labels)
    for name in ("converged", "impossible"):
        data[name] = ("value", np.array([int(r.attrs.get(name, 0)) for r in results]))
    for name in ("status", "message", CASE):
        data[name] = ("value", [str(r.attrs.get(name, "")) for r in results])
    data["warnings"] = ("value", ["\n".join(r.attrs.get("warnings", ())) for r in results])
    attributes = {
        **files.ORIGIN,
        "id": sweep.case_id,
        "key": sweep.key,
        "own_value": "" if sweep.case_value is None else sweep.case_value,
        "blood_volume_policy": str(results[0].attrs["blood_volume_policy"]),
        "failed": sum(not r.attrs["converged"] for r in results),
        "broken": json.dumps(_broken_limits(results)),
    }
    labels = {"units": sweep.unit, "long_name": sweep.key}
    return xr.Dataset(data, coords={"value": ("value", list(sweep.values), labels)}, attrs=attributes)


def _broken_limits(results: Sequence[xr.Dataset]) -> list[dict[str, Any]]:
    """Outputs that violate a limit, with its kind and the indices of the results."""
    places: dict[tuple[str, str], list[int]] = {}
    for k, result in enumerate(results):
        for name in scalars_of(result) if result.attrs["converged"] else ():
            if (kind := result[name].attrs.get("finding")) in GRAVEST_FIRST:
                places.setdefault((name, kind), []).append(k)
    return [{"quantity": name, "kind": kind, "at": at} for (name, kind), at in places.items()]


def _value_if_converged(result: xr.Dataset, name: str) -> float:
    """An output; NaN unless the beat converged."""
    return float(result[name]) if result.attrs["converged"] and name in result else math.nan


# --- files ------------------------------------------------------------------------------------------


def sweep_object(sweep: Sweep) -> dict[str, Any]:
    """The varied key, and for each value an object as `eclsim simulate` writes for each case."""
    about = {"id": sweep.case_id, "key": sweep.key, "unit": sweep.unit, "values": list(sweep.values)}
    cases = [
        {**case_object(result), "swept": {sweep.key: value}}
        for value, result in zip(sweep.values, sweep.results, strict=True)
    ]
    failed = [case["swept"][sweep.key] for case in cases if not case["converged"]]
    return {"sweep": about | {"own_value": sweep.case_value, "failed": failed}, "cases": cases}


def write_netcdf(sweep: Sweep, path: Path) -> None:
    """Write the outputs over the values, without waveforms."""
    files.write_netcdf({"": as_table(sweep)}, path)


def write_csv(sweep: Sweep, path: Path) -> None:
    """Write one row for each value, with units in the header; cells without a steady beat are empty."""
    path.parent.mkdir(exist_ok=True)
    write_text(frame_text(_frame(sweep)), path)


def write_figure(sweep: Sweep, path_without_suffix: Path) -> list[Path]:
    """Plot the outputs over the values, as SVG and PNG."""
    from eclsim.reporting.style import save_figure
    from eclsim.simulation.figures import plot_sweep

    doubts = untrusted(sweep.results[0].attrs.get("warnings", ()))
    return save_figure(plot_sweep(as_table(sweep)), path_without_suffix, above=doubts)


def _frame(sweep: Sweep) -> pd.DataFrame:
    import pandas as pd

    table = as_table(sweep)
    about = ("converged", "impossible", "status", "message")
    names = [str(name) for name in table.data_vars if name not in (*about, "warnings")]
    first = f"{sweep.key} [{sweep.unit}]" if sweep.unit else sweep.key
    columns: dict[str, Any] = {first: table["value"].to_numpy(), "id": sweep.case_id}
    columns |= {name: table[name].to_numpy() for name in about}
    columns["warnings"] = ["; ".join(result.attrs.get("warnings", ())) for result in sweep.results]
    columns |= {column_head(table, name): table[name].to_numpy() for name in names}
    return with_doubts(pd.DataFrame(columns), sweep.results[0].attrs.get("warnings", ()))
