"""Case files and a computation that costs nothing, so that tests of the command line test only that."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner


@dataclass
class Shell:
    """Runs commands in a folder of their own."""

    patient = """format = 1
[patient]
id = "{id}"
sex = "female"
age_years = 70
height_cm = 165
weight_kg = 60
heart_rate_bpm = 120
"""
    ecmo = """[ecmo]
pump = "Rotaflow"
speed_rpm = 3425
oxygenator = "Quadrox-i Adult"
mode = "VA"
"""

    folder: Path

    def case(self, name: str = "case.toml", patient_id: str = "P01", more: str = "") -> str:
        file = self.folder / name
        file.write_bytes((self.patient.format(id=patient_id) + more).encode())
        return str(file)

    def run(self, *arguments: str):
        from eclsim.cli.application import app

        return CliRunner().invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)


@pytest.fixture
def shell(tmp_path):
    return Shell(tmp_path)


def small_result(
    case_id: str, *, converged: bool = True, pump_flow: float | None = None, warnings: Sequence[str] = ()
) -> xr.Dataset:
    """A Dataset as the simulation gives it, with an uneven grid and one output that is not finite."""
    phase = np.array([0.0, 0.1, 0.5, 1.0])
    pressure = np.array([100.0, 120.0, 60.0, 100.0])
    data = {
        "Pao": ("phase", pressure, {"units": "mmHg", "mean": 87.5, "minimum": 59.5, "maximum": 120.5}),
        "Vlv": (
            "phase",
            np.array([50.0, np.nan, 60.0, 50.0]),
            {"units": "mL", "mean": np.nan, "minimum": np.nan, "maximum": np.nan},
        ),
        "SP": ((), 120.0, {"units": "mmHg", "long_name": "systolic arterial pressure"}),
        "DP": ((), np.nan, {"units": "mmHg"}),
        "CO": ((), 4.0, {"units": "L/min"}),
        "stroke_volume": ((), 50.0, {"units": "mL"}),
    }
    if pump_flow is not None:
        data["PF"] = ((), pump_flow, {"units": "L/min"})
    attributes = {
        "id": case_id,
        "converged": int(converged),
        "status": "converged" if converged else "not_converged",
        "message": "steady beat found" if converged else "no steady beat found",
        "beats": 9,
        "residual": 3e-9 if converged else np.nan,
        "blood_volume_policy": "as_published",
        "warnings": list(warnings),
    }
    return xr.Dataset(data, coords={"phase": phase, "time": ("phase", phase * 0.5)}, attrs=attributes)


@pytest.fixture
def instant(monkeypatch):
    """The simulation is replaced; the options it was called with are collected."""
    called = []

    def compute(case, **options):
        called.append((case, options))
        flow = 3.7 if case.ecmo is not None else None
        settled = case.patient.id != "never"
        return small_result(case.patient.id, converged=settled, pump_flow=flow, warnings=case.doubts)

    monkeypatch.setattr("eclsim.simulation.single.simulate", compute)
    return called
