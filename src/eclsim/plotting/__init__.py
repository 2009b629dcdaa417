"""Figures of simulated cases.

Names are imported from their module on first use: the tables of the schematic's layout are wanted where
nothing is drawn with matplotlib, which takes half a second to load.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
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
_MODULES = {
    "figures": ("write_case_figures",),
    "mean_flows": ("plot_mean_flows",),
    "pressure_volume": ("plot_pressure_volume",),
    "schematic": ("draw_circuit",),
    "style": (
        "CURVES", "OKABE_ITO", "curve_style", "figure_style", "new_figure", "plain_text", "save_figure",
    ),
    "waveforms": ("PARTS", "available_parts", "plot_overview", "plot_waveforms"),
}  # fmt: skip


def __getattr__(name: str) -> object:
    """Import a public name on first use (PEP 562)."""
    module = next((module for module, names in _MODULES.items() if name in names), None)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{module}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
