"""Table 1, Figures 4 and S-2: the fits of 30 data points of 8 patients on V-A ECMO.

The clinical data of the paper are not published. They are replaced by a synthetic cohort of the same size,
simulated with known parameters and with added noise. Any table of the same form can be used instead.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from eclsim.cases.cohort import CohortPoint, CohortReading, read_cohort
from eclsim.execution import Executor
from eclsim.identification.cohort import fit_cohort, r_squared
from eclsim.identification.fit import problem_of
from eclsim.identification.multi_start import MultiStart
from eclsim.identification.profiles import CostCurves, slices
from eclsim.identification.quantities import measured_and_simulated
from eclsim.identification.settings import FitSettings, case_to_fit
from eclsim.paper.comparison import Row, printed_number, statement
from eclsim.paper.printed import FEMALE_POINTS, PATIENTS, POINTS, R2, TABLE_1

SYNTHETIC = Path(str(files("eclsim.paper") / "data" / "synthetic_cohort.csv"))
"""Path of the synthetic cohort."""

UNITS = {"CO": "L/min", "PF": "L/min"}


@dataclass(frozen=True)
class CohortComparison:
    """The fits of the cohort compared with the paper.

    Args:
        rows: one row for each number and statement.
        results: results of the data points, as in the JSON file of `eclsim identify`.
        r2: R2 of pressures and flows.
        slices: slices through the objective of one point.
        synthetic: whether the cohort is the synthetic one.
        explore: number of explored parameter sets for each free parameter.
    """

    rows: tuple[Row, ...]
    results: tuple[Mapping[str, Any], ...]
    r2: Mapping[str, float | None]
    slices: CostCurves
    synthetic: bool
    explore: int


def reproduce_cohort(
    folder: Path,
    cohort: Path | None,
    explore: int,
    executor: Executor,
    progress: Callable[[str], None] = lambda _: None,
) -> CohortComparison:
    """Fit the cohort and compare the results with the paper.

    Args:
        folder: folder that stores the fits.
        cohort: table of measurements; None for the synthetic cohort.
        explore: number of explored parameter sets for each free parameter.
        executor: runs the fits.
        progress: called with a description of the current step.
    """
    reading = read_cohort(cohort or SYNTHETIC)
    settings = FitSettings(multi_start=MultiStart.quick(explore))
    results = fit_cohort(
        reading.points, settings, digest=reading.digest, folder=folder, executor=executor,
        progress=lambda state: progress(f"cohort: {state}"),
    )  # fmt: skip
    r2 = r_squared(results)
    chosen = next(k for k, result in enumerate(results) if result["cost"] is not None)
    curves = _slices(reading.points[chosen], results[chosen], settings)
    rows = (*_table_1(reading, cohort is None), *_fit_rows(reading, results, r2, cohort is None))
    return CohortComparison(rows, tuple(results), r2, curves, cohort is None, explore)


def _table_1(reading: CohortReading, synthetic: bool) -> list[Row]:
    reason = "the clinical data are not published: the cohort is synthetic" if synthetic else "another cohort"
    rows = []
    for name, printed in TABLE_1.items():
        values = [v for p in reading.points if (v := getattr(p.case.measurements, name, None)) is not None]
        result = (np.median(values), min(values), max(values)) if values else (np.nan,) * 3
        rows += [
            printed_number("Table 1", f"{name}, {statistic}", UNITS.get(name, "mmHg"), paper, float(ours),
                           decimals=1, reason=reason, other_data=True)
            for statistic, paper, ours in zip(("median", "smallest", "largest"), printed, result, strict=True)
        ]  # fmt: skip
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
        printed_number("2.1", f"number of {w}", "1", paper, ours, other_data=True)
        for w, paper, ours in counts
    ]
    known = [v for p in points if (v := getattr(p.case.measurements, "MAP", None)) is not None]
    rows.append(
        statement("3.2", "hypotension (MAP below 65) and hypertension (above 92 mmHg) are among them",
                  bool(known) and min(known) < 65.0 and max(known) > 92.0)
    )  # fmt: skip
    noise = "simulated with this model and added noise: easier to fit than patients" if synthetic else ""
    for kind, printed in R2.items():
        result = np.nan if (value := r2[kind]) is None else value
        rows.append(
            printed_number(
                "3.2", f"R² of {kind}", "1", printed, result, decimals=2, reason=noise, other_data=True
            )
        )
    flow, wedge = (
        float(np.diff(measured_and_simulated(results, (name,)), axis=1).mean()) for name in ("PF", "PCWP")
    )
    bias = "by {:+.2f} on average"
    return [
        *rows,
        statement("3.2", "fitted pump flows are higher than measured", flow > 0.0, bias.format(flow)),
        statement("3.2", "fitted wedge pressures are lower than measured", wedge < 0.0, bias.format(wedge)),
    ]


def _slices(point: CohortPoint, result: Mapping[str, Any], settings: FitSettings) -> CostCurves:
    """Slices through the fit of a point, along every free parameter."""
    objective, box = problem_of([case_to_fit(point.case, settings)], settings)
    fitted = box.scale.coordinates(np.array([result["parameters"][name]["value"] for name in box.names]))
    return slices(objective, box, fitted)
