"""The table of results that the command line shows."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from eclsim.cases.fit_mark import untrusted
from eclsim.devices.description import placed_sentence
from eclsim.devices.registry import devices, flows_of_own_devices, named_output
from eclsim.outputs.regulation import FACTORS, REGULATED
from eclsim.reporting.beat_values import legend_of_marks, marks_of
from eclsim.reporting.numbers import text_table
from eclsim.simulation.target_flow import solved_speed_of

if TYPE_CHECKING:
    import xarray as xr
    from rich.table import Table
    from rich.text import Text

    from eclsim.simulation.sweep import Sweep

_MOST_COLUMNS = 3
_OUTPUTS_OF_ROWS = (
    "SP", "DP", "MAP", "CVP", "MPAP", "PCWP", "systemic_flow", "CO", "PF",
    "ejection_fraction_lv",
)  # fmt: skip
_WIDTH_WITHOUT_TERMINAL = 120
_REGULATION = "Regulation"
_GROUPS = (
    ("Arteries", ("SP", "DP", "MAP", "pulse_pressure")),
    ("Flows", ("systemic_flow", "CO", "pulmonary_flow", "LVO", "bronchial_flow")),
    (
        "Filling",
        (
            "CVP", "MPAP", "SPAP", "DPAP", "PCWP", "end_diastolic_pressure_lv", "pericardial_pressure",
            "caval_filling", "superior_caval_filling", "inferior_caval_filling",
        ),
    ),
    (
        "Heart",
        (
            "EDVLV", "ESVLV", "ejection_fraction_lv", "EDVRV", "ESVRV", "ejection_fraction_rv", "EDVLA",
            "ESVLA", "EDVRA", "ESVRA",
        ),
    ),
    (
        "Regions",
        (
            "upper_body_pressure", "lower_body_pressure", "superior_caval_pressure",
            "inferior_caval_pressure", "upper_body_flow", "lower_body_flow", "native_share_ao",
            "native_share_arch", "native_share_upper", "native_share_descending", "native_share_lower",
        ),
    ),
    (
        "Gases",
        (
            "SaO2", "PaO2", "PaCO2", "pHa", "SaO2_lower", "PaO2_lower", "PaCO2_lower", "SvO2", "VO2",
            "VO2_lung", "VCO2_lung", "DO2", "O2ER",
        ),
    ),
    (_REGULATION, tuple(one.name for one in REGULATED)),
)  # fmt: skip
"""Main outputs in clinical order, without those that no case has; devices add their own."""
_LONG_NAMES = {
    "pulse_pressure": "arterial pulse pressure (PP)",
    "CVP": "central venous (right atrial) pressure",
    "end_diastolic_pressure_lv": "end-diastolic pressure of the left ventricle (LVEDP)",
    "systemic_flow": "systemic flow, through all organs but the lungs (Qs)",
    "CO": "native cardiac output (in the pulmonary artery)",
    "LVO": "output of the left ventricle (aortic valve)",
}
_SHORT_HEADS = {
    "systemic_flow": "Qs",
    "ejection_fraction_lv": "EFLV",
    "lowest_drainage_pressure": "drain",
}
"""Heads of narrow columns; a line below the table gives the outputs' names."""
_SAME_FLOW_L_MIN = 0.05


def show(results: Sequence[xr.Dataset], changes: Mapping[str, float] | None = None) -> None:
    """Print the outputs: a column per case for a few cases, a row per case for many.

    Args:
        results: results of the cases.
        changes: changes by output between two cases that are before and after; shown in a column.
    """
    from rich.console import Console

    width = None if sys.stdout.isatty() else _WIDTH_WITHOUT_TERMINAL
    console = Console(width=width, highlight=False)
    if len(results) <= _MOST_COLUMNS:
        names = [n for _, group in _groups(results) for n in group if _is_shown(n, results)]
        console.print(_side_by_side(results, changes))
    else:
        names = _OUTPUTS_OF_ROWS
        console.print(_table_of_rows(results))
        console.print(_meaning_of_heads(names, results))
    if text := legend(results, names):
        console.print(text)


def legend(results: Sequence[xr.Dataset], names: Sequence[str]) -> str:
    """Explanation of the marks after the numbers that a table shows; empty if there are none."""
    return legend_of_marks(marks_of(result, name) for result in results for name in names)


def _side_by_side(results: Sequence[xr.Dataset], changes: Mapping[str, float] | None) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table(title="Steady beat", title_justify="left", box=None, pad_edge=False)
    table.add_column("output", no_wrap=True)
    table.add_column("")
    compared = changes is not None
    heads = ("before", "after", "change") if compared else [str(result.attrs["id"]) for result in results]
    for head in heads:
        table.add_column(Text(head), justify="right")
    table.add_column("unit", no_wrap=True)
    for title, names in _groups(results):
        _add_group(table, title, [n for n in names if _is_shown(n, results)], results, changes)
    table.add_section()
    none = [""] if compared else []
    table.add_row("  converged", "", *(_verdict(result) for result in results), *none, "")
    if any(result.attrs.get("impossible") for result in results):
        verdicts = ("NO" if result.attrs.get("impossible") else "yes" for result in results)
        table.add_row("  possible in a patient", "", *verdicts, *none, "")
    policies = [str(result.attrs["blood_volume_policy"]) for result in results]
    table.add_row("  blood_volume_policy", _cut_to_fit("blood volume"), *policies, *none, "")
    for key in dict.fromkeys(solved.speed_key for solved in map(solved_speed_of, results) if solved):
        speeds = (_speed(result, key) or "-" for result in results)
        table.add_row(f"  {key}", _cut_to_fit("pump speed for the flow wanted"), *speeds, *none, "rpm")
    if any("grid_error_percent" in result.attrs for result in results):
        errors = (_grid_error(result) for result in results)
        table.add_row("  --check-grid", _cut_to_fit("largest change on half the step"), *errors, *none, "%")
    return table


_TITLE = 40
"""Length of a device's title in the table; a longer one would leave no room for descriptions."""


def _groups(results: Sequence[xr.Dataset]) -> list[tuple[str, tuple[str, ...]]]:
    """Titles and outputs of the groups, with the flows of devices among those of the patient."""
    outputs = (named_output(str(name)) for result in results for name in result.data_vars)
    instances = {naming[0].key: naming[0] for naming in outputs if naming is not None}.values()
    order = list(devices())
    instances = sorted(instances, key=lambda instance: order.index(instance.device.key))
    flows = tuple(name for instance in instances for name in instance.flows())
    groups = [one for one in _GROUPS if one[0] != _REGULATION or any(map(_is_regulated, results))]
    of_patient = [(title, names + flows if title == "Flows" else names) for title, names in groups]
    own = ((one.cut(title, _TITLE), names) for one in instances for title, names in one.tabled())
    return [*of_patient, *own]


def _is_regulated(result: xr.Dataset) -> bool:
    """Whether a case has reflexes or responses, or drugs that act; given fluid alone regulates nothing."""
    neutral = dict.fromkeys(FACTORS, 1.0) | {"unstressed_volume": 0.0}
    present = [one.name for one in REGULATED if one.name in result and one.name != "heart_rate"]
    return any(float(result[name]) != neutral.get(name) for name in present)


def _is_shown(name: str, results: Sequence[xr.Dataset]) -> bool:
    """Whether any case has an output; the flow through the lungs only if it differs from CO."""
    holding = [result for result in results if name in result]
    if name != "pulmonary_flow":
        return bool(holding)
    return any(abs(float(result[name]) - float(result["CO"])) > _SAME_FLOW_L_MIN for result in holding)


def _add_group(
    table: Table,
    title: str,
    names: Sequence[str],
    results: Sequence[xr.Dataset],
    changes: Mapping[str, float] | None,
) -> None:
    from rich.text import Text

    if not names:
        return
    table.add_row(Text(title, style="bold"))
    for name in names:
        about = next(result[name].attrs for result in results if name in result)
        description = _LONG_NAMES.get(name, about.get("long_name", ""))
        cells = [cell(result, name) for result in results]
        if changes is not None:
            cells.append(_rounded(changes[name], about, sign="+") if name in changes else "")
        table.add_row(f"  {name}", _cut_to_fit(description or ""), *cells, about.get("units", ""))


def _cut_to_fit(description: str) -> Text:
    """Description in one line, which gives way in a narrow terminal: the key beside it does not."""
    from rich.text import Text

    return Text(description, no_wrap=True, overflow="ellipsis")


def _table_of_rows(results: Sequence[xr.Dataset]) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table(title="Steady beat", title_justify="left", box=None, pad_edge=False)
    table.add_column("id", max_width=30)
    names = [name for name in _OUTPUTS_OF_ROWS if any(name in result for result in results)]
    for name in names:
        units = [result[name].attrs.get("units", "") for result in results if name in result]
        table.add_column(f"{_SHORT_HEADS.get(name, name)}\n{units[0] if units else ''}", justify="right")
    table.add_column("converged")
    for result in results:
        cells = [cell(result, name) for name in names]
        table.add_row(Text(str(result.attrs["id"])), *cells, _verdict(result))
    return table


def _verdict(result: xr.Dataset) -> str:
    beats = int(result.attrs["beats"])
    if not result.attrs["converged"]:
        return "no"
    return f"yes, {beats} beats" + (", one of many" if result.attrs.get("one_of_many") else "")


def _meaning_of_heads(names: Sequence[str], results: Sequence[xr.Dataset]) -> str:
    """Outputs of the heads that are shorter than their names, as in "Qs: systemic_flow"."""
    shown = (name for name in names if name in _SHORT_HEADS and any(name in result for result in results))
    return ", ".join(f"{_SHORT_HEADS[name]}: {name}" for name in shown)


def _speed(result: xr.Dataset, key: str | None = None) -> str:
    """Speed that was solved for, with a key if one is given; empty if there is none."""
    solved = solved_speed_of(result)
    return "" if solved is None or key not in (None, solved.speed_key) else f"{solved.speed_rpm:.0f}"


def _grid_error(result: xr.Dataset) -> str:
    if "grid_error_percent" not in result.attrs:
        return "-"
    return f"{result.attrs['grid_error_percent']:.2f} ({result.attrs['grid_error_output']})"


def _digits(about: Mapping[str, object]) -> int:
    return 2 if about.get("units") in ("L/min", "1") else 1


def cell(result: xr.Dataset, name: str) -> str:
    """A number with its marks, or a space without one, so that digits are aligned."""
    value = float(result[name]) if name in result else math.nan
    if not math.isfinite(value):
        return "- "
    return f"{_rounded(value, result[name].attrs)}{marks_of(result, name) or ' '}"


def _rounded(value: float, about: Mapping[str, object], sign: str = "-") -> str:
    """A number with the decimals of its unit, and zero without a minus sign."""
    return f"{value:{sign}z.{_digits(about)}f}"


# --- one key varied -------------------------------------------------------------------------------

_SWEPT = (
    "SP", "DP", "MAP", "MPAP", "PCWP", "CVP", "systemic_flow", "CO", "PF", "lowest_drainage_pressure",
    "SaO2", "PaCO2",
)  # fmt: skip


def sweep_text(sweep: Sweep) -> str:
    """Table with one row for each value; without a steady beat it has the reason instead of numbers."""
    present = dict.fromkeys(str(name) for result in sweep.results for name in result.data_vars)
    columns = [name for name in _SWEPT if name in present] + [*flows_of_own_devices(present)]
    solved = any(map(solved_speed_of, sweep.results))
    head = [f"{sweep.key} [{sweep.unit}]" if sweep.unit else sweep.key]
    head += (["rpm"] if solved else []) + [f"{_SHORT_HEADS.get(name, name)} " for name in columns] + ["beat"]
    rows = []
    for value, result in zip(sweep.values, sweep.results, strict=True):
        settled = bool(result.attrs["converged"])
        numbers = [cell(result, name) if settled else "" for name in columns]
        speed = [_speed(result)] if solved else []
        rows.append([_value_text(value), *speed, *numbers, _beat_text(result)])
    policy = sweep.results[0].attrs["blood_volume_policy"]
    saturations = ", SaO2 in %" if "SaO2" in columns else ""
    title = f"{sweep.case_id}: steady beats, blood volume {policy}; mmHg, flows in L/min{saturations}"
    marks = legend([result for result in sweep.results if result.attrs["converged"]], columns)
    table = text_table(head, rows, numeric=range(len(head) - 1))
    return "\n".join(filter(None, (title, table, _meaning_of_heads(columns, sweep.results), marks)))


def sweep_doubts(sweep: Sweep) -> list[str]:
    """Each warning once, with the values it holds for; its numbers are those of the last value."""
    places: dict[str, list[tuple[str, str]]] = {}
    for value, result in zip(sweep.values, sweep.results, strict=True):
        warnings = [str(sentence) for sentence in result.attrs.get("warnings", ())]
        of_case = untrusted(warnings)  # reported when the case was read
        sentences = [text for text in warnings if text not in of_case]
        if not result.attrs["converged"]:
            sentences = [f"no beat: {result.attrs.get('message', '')}"]
        for sentence in sentences:
            places.setdefault(re.sub(r"\d[\d.e+-]*", "", sentence), []).append((_value_text(value), sentence))
    unit, lines = f" {sweep.unit}" if sweep.unit else "", []
    for same in places.values():
        values = [value for value, _ in same]
        everywhere = len(values) == len(sweep.values) > 1
        last, sentence = same[-1]
        numbers = f" (numbers at {last}{unit})" if any(other != sentence for _, other in same) else ""
        place = "at every value" if everywhere else f"at {', '.join(values)}{unit}"
        lines.append(placed_sentence(f"{sweep.key} {place}", f"{sentence}{numbers}"))
    return lines


def _value_text(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.6g}"


def _beat_text(result: xr.Dataset) -> str:
    if not result.attrs["converged"]:
        return f"none: {str(result.attrs.get('status', '')).replace('_', ' ')}"
    if result.attrs.get("impossible"):
        return "impossible, see warnings"
    gases = str(result.attrs.get("gas_status", "steady"))
    return "steady" if gases == "steady" else f"steady, gases: {gases.replace('_', ' ')}"
