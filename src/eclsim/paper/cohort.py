"""Table 1, Figures 4 and S-2: the fits of 30 data points of 8 patients on V-A ECMO.

The clinical data of the paper are not published. A synthetic cohort of the same size stands in for them:
simulated with known parameters, disturbed by noise. Any table of the same form can take its place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.cases.cohort import read_cohort
from eclsim.identification.cohort_fit import FitStore, fit_cohort, pairs, r_squared
from eclsim.identification.multi_start import MultiStart
from eclsim.identification.objective import Box, Objective, Target
from eclsim.identification.profiles import CostCurves, slices
from eclsim.identification.settings import FitSettings, checked_fit
from eclsim.orbit.model import model_of
from eclsim.paper.rows import Row, statement

if TYPE_CHECKING:
    from eclsim.cases.cohort import CohortPoint, CohortReading

SYNTHETIC = Path(str(files("eclsim.paper") / "data" / "synthetic_cohort.csv"))
"""The synthetic cohort."""

TABLE_1 = {
    "SP": (111.0, 70.0, 183.0, 1), "DP": (69.5, 42.0, 88.0, 1), "MAP": (79.0, 55.0, 113.0, 1),
    "MPAP": (19.5, 6.0, 30.0, 1), "PCWP": (11.0, 7.0, 15.0, 1), "CO": (3.4, 1.5, 7.5, 1),
    "PF": (2.5, 1.2, 3.8, 1),
}  # fmt: skip
"""Median, smallest and largest measured value and decimals printed [mmHg, L/min]."""
UNITS = {"CO": "L/min", "PF": "L/min"}
POINTS, PATIENTS, FEMALE_POINTS = 30, 8, 17
R2 = {"pressures": 0.99, "flows": 0.98}


@dataclass(frozen=True)
class CohortPart:
    """The fits beside the paper.

    Args:
        rows: one for each number and statement.
        results: data points as in the JSON file of `eclsim identify`.
        r2: of pressures and flows.
        slices: through the objective of one point.
        sliced: name of that point.
        synthetic: whether the cohort is the synthetic one.
        explore: explored sets of parameters for each free one.
    """

    rows: tuple[Row, ...]
    results: tuple[Mapping[str, Any], ...]
    r2: Mapping[str, float | None]
    slices: CostCurves
    sliced: str
    synthetic: bool
    explore: int


def reproduce_cohort(
    folder: Path,
    cohort: Path | None,
    explore: int,
    resume: bool,
    progress: Callable[[str], None] = lambda _: None,
) -> CohortPart:
    """Fit the cohort and compare.

    Args:
        folder: keeps the fits.
        cohort: table of measurements; None takes the synthetic cohort.
        explore: explored sets of parameters for each free one.
        resume: whether to go on with what the folder holds.
        progress: is told what is being computed.
    """
    reading = read_cohort(cohort or SYNTHETIC)
    settings = FitSettings(multi_start=MultiStart.quick(explore))
    store = FitStore(folder, reading.digest, settings)
    store.open(resume=resume and (folder / "settings.json").exists(), force=not resume)
    results = fit_cohort(reading.points, settings, store, lambda text: progress(f"cohort: {text}"))
    r2 = r_squared(results)
    chosen = next(k for k, result in enumerate(results) if result["cost"] is not None)
    found = _slices(reading.points[chosen], results[chosen], settings)
    rows = (*_table_1(reading, cohort is None), *_fit_rows(reading, results, r2, cohort is None))
    return CohortPart(rows, tuple(results), r2, found, reading.points[chosen].name, cohort is None, explore)


def _table_1(reading: CohortReading, synthetic: bool) -> list[Row]:
    why = "the clinical data are not published: the cohort is synthetic" if synthetic else "another cohort"
    rows = []
    for name, (*printed, digits) in TABLE_1.items():
        values = [v for p in reading.points if (v := getattr(p.case.measurements, name, None)) is not None]
        found = (np.median(values), min(values), max(values)) if values else (np.nan,) * 3
        for words, paper, ours in zip(("median", "smallest", "largest"), printed, found, strict=True):
            unit, tolerance = UNITS.get(name, "mmHg"), 0.5 * 10.0**-digits
            row = Row(
                "Table 1", f"{name}, {words}", unit, paper, float(ours), None, digits, tolerance, why, True
            )
            rows.append(row.because("") if row.as_printed else row)
    return rows


def _fit_rows(
    reading: CohortReading, results: list[dict[str, Any]], r2: Mapping[str, float | None], synthetic: bool
) -> list[Row]:
    points = reading.points
    female = sum(p.case.patient.sex == "female" for p in points)
    counts = (
        ("data points", POINTS, len(points)),
        ("patients", PATIENTS, len({p.patient_id for p in points})),
        ("data points of women", FEMALE_POINTS, female),
    )
    rows = [
        Row("2.1", f"number of {w}", "1", paper, ours, None, 0, 0.5, "", True) for w, paper, ours in counts
    ]
    mean = [p.case.measurements.MAP for p in points if p.case.measurements is not None]
    known = [value for value in mean if value is not None]
    rows.append(
        statement("3.2", "hypotension (MAP below 65) and hypertension (above 92 mmHg) are among them",
                  bool(known) and min(known) < 65.0 and max(known) > 92.0)
    )  # fmt: skip
    noise = "simulated by this model, then disturbed: easier to fit than patients are" if synthetic else ""
    for kind, printed in R2.items():
        found = np.nan if (value := r2[kind]) is None else value
        row = Row("3.2", f"R² of {kind}", "1", printed, found, None, 2, 0.005, noise, other_data=True)
        rows.append(row.because("") if row.as_printed else row)
    flow, wedge = (float(np.diff(pairs(results, (name,)), axis=1).mean()) for name in ("PF", "PCWP"))
    bias = "by {:+.2f} on average"
    return [
        *rows,
        statement("3.2", "fitted pump flows are higher than measured", flow > 0.0, bias.format(flow)),
        statement("3.2", "fitted wedge pressures are lower than measured", wedge < 0.0, bias.format(wedge)),
    ]


def _slices(point: CohortPoint, result: Mapping[str, Any], settings: FitSettings) -> CostCurves:
    """Slices through the fit of a point, along every free parameter."""
    checked = checked_fit(point.case, settings)
    box = Box.of(checked.free)
    measured = dict(checked.targets)
    scales = {name: abs(value) for name, value in measured.items()}
    target = Target(model_of(point.case).with_values(dict(checked.fixed)), measured, scales)
    fitted = np.log([result["parameters"][name]["value"] for name in box.names])
    return slices(Objective([target], box.names), box, fitted)
