"""The circulation of Shi and Hose 2009 (CellML): an independent implementation of the same equations.

The expected numbers come from a SciPy integration (DOP853, relative tolerance 1e-8) of the published CellML
model, beat 20 from its initial state, when the state changes by 2e-5 a beat; it agrees with the published
traces to 0.005 mL and 0.003 mmHg. eclsim gives the periodic state. It is no healthy adult: its mean pulmonary
arterial pressure is 40 mmHg.
"""

from __future__ import annotations

import csv
from functools import lru_cache

import numpy as np
import xarray as xr

from eclsim.orbit.model import Model
from eclsim.outputs.dataset import simulate
from eclsim.parameters import shi_hose2009
from eclsim.patient.circulation import shi_hose_circulation
from eclsim.validation.cases import DATA
from eclsim.validation.rows import Check, near

RELATIVE = 0.001
SOURCE = "Shi and Hose 2009 CellML model; integrated independently with SciPy"


def shi_hose_model() -> Model:
    """The circulation with its published parameters."""
    values = {key: parameter.value for key, parameter in shi_hose2009.PARAMETERS.items()}
    return Model(shi_hose_circulation(), values, "Shi and Hose 2009")


@lru_cache(maxsize=1)
def shi_hose_result() -> xr.Dataset:
    """Its periodic state."""
    return simulate(shi_hose_model())


def checks() -> list[Check]:
    """All scalars that are known, peak valve flows among them."""
    result, rows = shi_hose_result(), []
    with (DATA / "shi_hose2009.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            expected = float(row["value"])
            tolerance = max(RELATIVE * expected, _last_digit(row["value"]))
            rows.append(
                near(
                    row["output"],
                    expected,
                    _got(result, row["output"]),
                    tolerance,
                    row["unit"],
                    source=SOURCE,
                )
            )
    return [
        Check(
            "shi-hose",
            "Shi and Hose 2009 (CellML) at the periodic state",
            "0.1 % of each scalar",
            tuple(rows),
        )
    ]


def _last_digit(text: str) -> float:
    """Half a unit of the last digit of a printed number."""
    return 0.5 * 10.0 ** -len(text.partition(".")[2])


def _got(result: xr.Dataset, name: str) -> float:
    """An output of the registry, or "waveform mean", "waveform min", "waveform max"."""
    waveform, _, kind = name.partition(" ")
    if not kind:
        return float(result[name])
    series = result[waveform].values
    if kind == "mean":
        return float(np.trapezoid(series, result["phase"].values))
    return float(series.min() if kind == "min" else series.max())
