"""Simulator of a patient's circulation on extracorporeal life support (ECMO, CRRT, LVAD).

Names listed in ``_EXPORTS`` are imported from their module on first use, so that
``import eclsim`` and ``eclsim --help`` stay fast: importing JAX alone takes over a second.
Type checkers do not run that; they read the imports under ``TYPE_CHECKING``, which say the same.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING

from eclsim._version import __version__

if TYPE_CHECKING:
    from eclsim.cases.reading import read_case
    from eclsim.circuit import Choice, Circuit, Compartment, Connection, StartPressure, StartVolume
    from eclsim.crrt_study.study import crrt_study
    from eclsim.devices.crrt import crrt
    from eclsim.devices.ecmo import ecmo
    from eclsim.devices.lvad import lvad
    from eclsim.execution import Distribution, Shard
    from eclsim.orbit.equation import OrbitOptions
    from eclsim.orbit.execution import Execution
    from eclsim.orbit.model import Model, model_of
    from eclsim.orbit.status import Status
    from eclsim.orbit.steady import Batch
    from eclsim.outputs.results import derivatives, simulate, simulate_many
    from eclsim.outputs.steady_beat import SteadyBeat, steady_beat
    from eclsim.patient.circulation import circulation
    from eclsim.reporting.schematic import draw_circuit
    from eclsim.sensitivity.analysis import SobolSettings, sensitivity
    from eclsim.sensitivity.identifiability import identifiability
    from eclsim.simulation.pressure_volume import plot_pressure_volume
    from eclsim.simulation.waveforms import plot_waveforms

_EXPORTS: dict[str, str] = {
    # public name: module that defines it
    "Batch": "eclsim.orbit.steady",
    "Choice": "eclsim.circuit",
    "Circuit": "eclsim.circuit",
    "Compartment": "eclsim.circuit",
    "Connection": "eclsim.circuit",
    "Distribution": "eclsim.execution",
    "Execution": "eclsim.orbit.execution",
    "Model": "eclsim.orbit.model",
    "OrbitOptions": "eclsim.orbit.equation",
    "StartPressure": "eclsim.circuit",
    "StartVolume": "eclsim.circuit",
    "Shard": "eclsim.execution",
    "SobolSettings": "eclsim.sensitivity.analysis",
    "Status": "eclsim.orbit.status",
    "SteadyBeat": "eclsim.outputs.steady_beat",
    "circulation": "eclsim.patient.circulation",
    "crrt": "eclsim.devices.crrt",
    "crrt_study": "eclsim.crrt_study.study",
    "derivatives": "eclsim.outputs.results",
    "draw_circuit": "eclsim.reporting.schematic",
    "ecmo": "eclsim.devices.ecmo",
    "identifiability": "eclsim.sensitivity.identifiability",
    "lvad": "eclsim.devices.lvad",
    "model_of": "eclsim.orbit.model",
    "plot_pressure_volume": "eclsim.simulation.pressure_volume",
    "plot_waveforms": "eclsim.simulation.waveforms",
    "read_case": "eclsim.cases.reading",
    "sensitivity": "eclsim.sensitivity.analysis",
    "simulate": "eclsim.outputs.results",
    "simulate_many": "eclsim.outputs.results",
    "steady_beat": "eclsim.outputs.steady_beat",
}

__all__ = [
    "Batch",
    "Choice",
    "Circuit",
    "Compartment",
    "Connection",
    "Distribution",
    "Execution",
    "Model",
    "OrbitOptions",
    "Shard",
    "SobolSettings",
    "StartPressure",
    "StartVolume",
    "Status",
    "SteadyBeat",
    "__version__",
    "circulation",
    "crrt",
    "crrt_study",
    "derivatives",
    "draw_circuit",
    "ecmo",
    "identifiability",
    "lvad",
    "model_of",
    "plot_pressure_volume",
    "plot_waveforms",
    "read_case",
    "sensitivity",
    "simulate",
    "simulate_many",
    "steady_beat",
]

if not TYPE_CHECKING:  # a checker would take any name for an object, and a misspelt one for right

    def __getattr__(name: str) -> object:
        """Import a public name on first use (PEP 562)."""
        if name not in _EXPORTS:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(_EXPORTS[name]), name)
        if f"{__name__}.{name}" in sys.modules:  # a package of the same name: it can be called
            return sys.modules[f"{__name__}.{name}"]
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_EXPORTS})
