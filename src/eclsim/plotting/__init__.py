"""Figures of simulated cases. Import it only where figures are drawn: it loads matplotlib."""

from eclsim.plotting.figures import write_case_figures
from eclsim.plotting.mean_flows import plot_mean_flows
from eclsim.plotting.pressure_volume import plot_pressure_volume
from eclsim.plotting.schematic import draw_circuit
from eclsim.plotting.style import (
    CURVES,
    OKABE_ITO,
    curve_style,
    figure_style,
    new_figure,
    plain_text,
    save_figure,
)
from eclsim.plotting.waveforms import PARTS, available_parts, plot_overview, plot_waveforms

__all__ = [
    "CURVES",
    "OKABE_ITO",
    "PARTS",
    "available_parts",
    "curve_style",
    "draw_circuit",
    "figure_style",
    "new_figure",
    "plain_text",
    "plot_mean_flows",
    "plot_overview",
    "plot_pressure_volume",
    "plot_waveforms",
    "save_figure",
    "write_case_figures",
]
