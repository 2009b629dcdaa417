"""Simulator of a patient's circulation on extracorporeal life support (ECMO, CRRT, LVAD).

Names listed in ``_EXPORTS`` are imported from their module on first use, so that
``import eclsim`` and ``eclsim --help`` stay fast: importing JAX alone takes over a second.
"""

from importlib import import_module

from eclsim._version import __version__

_EXPORTS: dict[str, str] = {
    # public name: module that defines it
    "Batch": "eclsim.solver.steady",
    "Choice": "eclsim.circuit",
    "Circuit": "eclsim.circuit",
    "Compartment": "eclsim.circuit",
    "Connection": "eclsim.circuit",
    "Model": "eclsim.solver.model",
    "OrbitOptions": "eclsim.solver.orbit",
    "StartPressure": "eclsim.circuit",
    "StartVolume": "eclsim.circuit",
    "Status": "eclsim.solver.status",
    "batch_outputs": "eclsim.haemodynamics.evaluation",
    "circulation": "eclsim.models",
    "crrt": "eclsim.models",
    "draw_circuit": "eclsim.plotting",
    "ecmo": "eclsim.models",
    "lvad": "eclsim.models",
    "model_of": "eclsim.solver.model",
    "output_derivatives": "eclsim.haemodynamics.derivatives",
    "plot_pressure_volume": "eclsim.plotting",
    "plot_waveforms": "eclsim.plotting",
    "read_case": "eclsim.patients.reading",
    "simulate": "eclsim.haemodynamics.dataset",
    "simulate_many": "eclsim.haemodynamics.many",
    "steady_beats": "eclsim.solver.steady",
}

__all__ = ["__version__", *_EXPORTS]  # pyright: ignore[reportUnsupportedDunderAll] - names come from the table


def __getattr__(name: str) -> object:
    """Import a public name on first use (PEP 562)."""
    if name not in _EXPORTS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_EXPORTS[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_EXPORTS})
