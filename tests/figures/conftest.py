"""Simulated cases to draw: one beat of four published cases (tests/figures/data, mmHg, mL/s, mL)."""

import csv
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

DATA = Path(__file__).parent / "data"
UNITS = {"P": "mmHg", "Q": "mL/s", "V": "mL"}


def read_result(name: str) -> xr.Dataset:
    with (DATA / f"{name}.csv").open(newline="") as file:
        header, *rows = list(csv.reader(file))
    table = dict(zip(header, np.array(rows, dtype=float).T, strict=True))
    time = table.pop("time_s")
    phase = time / time[-1]
    result = xr.Dataset(
        {key: ("phase", values, {"units": UNITS[key[0]]}) for key, values in table.items()},
        coords={"phase": phase, "time": ("phase", time)},
        attrs={"id": name, "converged": 1, "blood_volume_policy": "as_published"},
    )
    aorta = result["Pao"].values
    scalars = {"SP": aorta.max(), "DP": aorta.min(), "MAP": np.trapezoid(aorta, phase)}
    scalars["MPAP"] = np.trapezoid(result["Ppas"].values, phase)
    scalars["CO"] = 0.06 * np.trapezoid(result["Qpas"].values, phase)
    if "Qecmopump" in result:
        scalars["PF"] = 0.06 * np.trapezoid(result["Qecmopump"].values, phase)
    return result.assign(scalars)


@pytest.fixture
def healthy() -> xr.Dataset:
    return read_result("cvs_healthy_75bpm")


@pytest.fixture
def ecmo() -> xr.Dataset:
    return read_result("va_ecmo_default")


@pytest.fixture
def ecmo_crrt() -> xr.Dataset:
    return read_result("s4_crrt_g_3425")


@pytest.fixture
def lvad() -> xr.Dataset:
    return read_result("lvad_hvad_2600")
