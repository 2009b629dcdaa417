"""All figures of one simulated case, written to a folder."""

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from eclsim.reporting.schematic import draw_circuit
from eclsim.reporting.style import save_figure
from eclsim.simulation.mean_flows import plot_mean_flows
from eclsim.simulation.pressure_volume import plot_pressure_volume
from eclsim.simulation.waveforms import available_parts, plot_overview, plot_waveforms

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.circuit import Circuit

_LONGEST_NAME = 40


def write_case_figures(
    circuit: "Circuit", result: "xr.Dataset", folder: str | Path, *, formats: Sequence[str] = ("svg", "png")
) -> list[Path]:
    """Writes every figure of a case; cases of different ids can share a folder.

    Args:
        circuit: the circuit that was simulated.
        result: the simulated case.
        folder: is made if it does not exist.
        formats: one file of each per figure; PNG takes more than half of the time.

    Returns:
        The files written: `<id>_circuit`, `_overview`, `_pressure_volume`, `_mean_flows` and one
        `_waveforms_<part>` for each part of the circuit.
    """
    stem = Path(folder) / file_name(str(result.attrs.get("id", "case")))
    figures = {
        "circuit": lambda: draw_circuit(circuit, result),
        "overview": lambda: plot_overview(result),
        "pressure_volume": lambda: plot_pressure_volume(result, atria=True),
        "mean_flows": lambda: plot_mean_flows(result),
    }
    for part in available_parts(result):
        figures[f"waveforms_{part}"] = lambda part=part: plot_waveforms(result, part)
    written = []
    for name, draw in figures.items():
        written += save_figure(draw(), stem.with_name(f"{stem.name}_{name}"), formats)
    return written


def file_name(case_id: str) -> str:
    """A file name for an id: ASCII letters, digits, `_` and `-`; ids that differ get names that differ."""
    safe = re.sub(r"[^A-Za-z0-9_-]+", "_", case_id).strip("_")[:_LONGEST_NAME]
    if safe and safe == case_id:
        return safe
    mark = hashlib.sha256(case_id.encode("utf-8", "surrogatepass")).hexdigest()[:8]
    return f"{safe or 'case'}_{mark}"
