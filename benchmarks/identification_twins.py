"""Noise-free twins: agreement of outputs, and errors of the parameters reported as identifiable.

Fits the patients of data/identification_twins.csv, whose outputs come from the adaptive solver and whose
parameters are known (identification_twins_data.py makes them), and counts

- twins all of whose outputs are reproduced to 1 %,
- parameters reported as identifiable that are within 5 % of the truth,
- for each parameter, how many are reported as identifiable, and the errors of those and of the others.

    python benchmarks/identification_twins.py OUT [--first 200] [--points 1000] [--minutes 60]

OUT stores each twin as soon as it is finished; run it again to continue.
"""

from __future__ import annotations

import argparse
import csv
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from eclsim.cases.cohort import read_cohort
from eclsim.execution import Distribution
from eclsim.identification.cohort import fit_cohort
from eclsim.identification.multi_start import MultiStart
from eclsim.identification.settings import FitSettings

DATA = Path(__file__).parent / "data"
SAME_OUTPUT, SAME_PARAMETER_SHARE = 0.01, 0.05
GROUP = 8


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("out", type=Path)
    options.add_argument("--first", type=int, default=200, help="how many twins")
    options.add_argument("--points", type=int, default=1000, help="explored points per parameter")
    options.add_argument("--minutes", type=float, default=60.0, help="stop after so many")
    asked = options.parse_args()
    reading = read_cohort(DATA / "identification_twins.csv")
    points = reading.points[: asked.first]
    search = MultiStart(points_per_parameter=asked.points, refined_share=0.01 * 1000 / asked.points)
    settings = FitSettings(multi_start=search)
    begun, results = time.monotonic(), []
    with Distribution(resume=True).running() as executor:
        for k in range(0, len(points), GROUP):
            if time.monotonic() - begun > 60.0 * asked.minutes:
                break
            chosen, folder = points[k : k + GROUP], asked.out / f"{k:04d}"
            results += fit_cohort(chosen, settings, digest=reading.digest, folder=folder, executor=executor)
    print(json.dumps(summary(results, truth()), indent=1))


def truth() -> dict[str, dict[str, float]]:
    """True parameters by name of the data point."""
    with (DATA / "identification_twins_truth.csv").open(encoding="utf-8", newline="") as file:
        return {
            f"{row['patient_id']}/{row['measurement']}": {
                n: float(v) for n, v in row.items() if n not in ("patient_id", "measurement", "of")
            }
            for row in csv.DictReader(file)
        }


def summary(results: list[dict[str, Any]], known: dict[str, dict[str, float]]) -> dict[str, Any]:
    """Summary over all twins."""
    worst = [
        max(abs(o["simulated"] / o["measured"] - 1.0) for o in r["outputs"].values() if o["simulated"])
        if r["cost"] is not None
        else np.inf
        for r in results
    ]
    errors = {
        (r["id"], n): (abs(p["value"] / known[r["id"]][n] - 1.0), p["identifiable"])
        for r in results
        if r["cost"] is not None
        for n, p in r["parameters"].items()
    }
    called = np.array([e for e, identifiable in errors.values() if identifiable])
    wrong = [
        f"{i} {n}: {100 * e:.1f} %" for (i, n), (e, ok) in errors.items() if ok and e > SAME_PARAMETER_SHARE
    ]
    by_name = {}
    for name in next(iter(known.values())):
        own = [v for (_, n), v in errors.items() if n == name]
        yes, no = ([e for e, ok in own if ok is which] for which in (True, False))
        by_name[name] = {
            "called_identifiable": len(yes),
            "median_error_if_so": float(np.median(yes)) if yes else None,
            "largest_error_if_so": max(yes, default=None),
            "median_error_if_not": float(np.median(no)) if no else None,
            "within_5_percent_though_not": sum(e <= SAME_PARAMETER_SHARE for e in no),
        }
    return {
        "twins": len(results),
        "fitted": sum(r["status"] == "fitted" for r in results),
        "outputs_within_1_percent": float(np.mean(np.array(worst) <= SAME_OUTPUT)) if worst else None,
        "largest_output_error": float(max(worst, default=np.nan)),
        "identifiable_within_5_percent": float(np.mean(called <= SAME_PARAMETER_SHARE))
        if len(called)
        else None,
        "identifiable_but_wrong": wrong,
        "parameters": by_name,
        "median_starts_agreeing": float(np.median([r["starts_agreeing"] for r in results])),
        "median_seconds": float(np.median([r["seconds"] for r in results])),
    }


if __name__ == "__main__":
    main()
