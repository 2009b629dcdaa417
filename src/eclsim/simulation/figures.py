"""All figures of one simulated case, written to a folder."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from eclsim.files import file_stem
from eclsim.reporting.schematic import draw_circuit
from eclsim.reporting.style import save_figure
from eclsim.simulation.mean_flows import plot_mean_flows
from eclsim.simulation.pressure_volume import plot_pressure_volume
from eclsim.simulation.waveforms import available_parts, plot_overview, plot_waveforms

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.circuit import Circuit


def write_case_figures(
    circuit: "Circuit",
    result: "xr.Dataset",
    folder: str | Path,
    *,
    formats: Sequence[str] = ("svg", "png"),
    stem: str = "",
) -> list[Path]:
    """Writes every figure of a case; cases of different ids can share a folder.

    Args:
        circuit: the circuit that was simulated.
        result: the simulated case.
        folder: is made if it does not exist.
        formats: one file of each per figure; PNG takes more than half of the time.
        stem: beginning of the names; left out, made from the case's id.

    Returns:
        The files written: `<stem>_circuit`, `_overview`, `_pressure_volume`, `_mean_flows` and one
        `_waveforms_<part>` for each part of the circuit.
    """
    beginning = Path(folder) / (stem or file_stem(str(result.attrs.get("id", "case"))))
    figures = {
        "circuit": lambda: draw_circuit(circuit, result),
        "overview": lambda: plot_overview(result),
        "pressure_volume": lambda: plot_pressure_volume(result, atria=True),
        "mean_flows": lambda: plot_mean_flows(result),
    }
    for part in available_parts(result):
        figures[f"waveforms_{part.replace('.', '_')}"] = lambda part=part: plot_waveforms(result, part)
    written = []
    for name, draw in figures.items():
        written += save_figure(draw(), beginning.with_name(f"{beginning.name}_{name}"), formats)
    return written
