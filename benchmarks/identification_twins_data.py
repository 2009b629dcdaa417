"""Make the twins of benchmarks/identification_twins.py: patients with known parameters, without noise.

Patients, heart rates and devices are those of the example cohort; the seven parameters are drawn
log-uniformly within a factor of two of that point's true ones, inside the bounds of the fit. Outputs come
from the adaptive solver (Dopri8 until steady), which shares no numerics with the solver that fits. Twins
whose
hearts hardly eject or whose values are implausible on a monitor are drawn again.

    python benchmarks/identification_twins_data.py [--count 200] [--seed 2025]

Continues an interrupted run: each twin has its own random stream.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np

from eclsim.cases.case import Case
from eclsim.cases.cohort import read_cohort
from eclsim.identification.quantities import BEAT_OUTPUTS as TARGETS
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate_adaptive
from eclsim.parameters.thiel2025 import BOUNDS

HERE = Path(__file__).parent
EXAMPLES = HERE.parent / "examples"
TABLE = HERE / "data" / "identification_twins.csv"
TRUTH = HERE / "data" / "identification_twins_truth.csv"
FACTOR = 2.0
MARGIN = 1.05
"""Factor by which parameters stay inside the bounds of the fit."""
PLAUSIBLE = {
    "SP": (50, 230),
    "DP": (25, 140),
    "MPAP": (6, 60),
    "PCWP": (2, 40),
    "CO": (0.5, 9),
    "PF": (0.5, 7),
}


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--count", type=int, default=200)
    options.add_argument("--seed", type=int, default=2025)
    asked = options.parse_args()
    points = {p.name: p.case for p in read_cohort(EXAMPLES / "synthetic_cohort.csv").points}
    with (EXAMPLES / "synthetic_cohort.csv").open(encoding="utf-8", newline="") as file:
        rows = {f"{r['patient_id']}/{r['measurement']}": r for r in csv.DictReader(file)}
    with (EXAMPLES / "synthetic_cohort_truth.csv").open(encoding="utf-8", newline="") as file:
        truths = {f"{r['patient_id']}/{r['measurement']}": r for r in csv.DictReader(file)}
    TABLE.parent.mkdir(exist_ok=True)
    done = sum(1 for _ in TABLE.open(encoding="utf-8")) - 1 if TABLE.exists() else 0
    for number in range(done, asked.count):
        generator = np.random.default_rng([asked.seed, number])
        name, true, outputs = twin(generator, points, truths)
        row = {**rows[name], "patient_id": f"T{number + 1:03d}", "measurement": "1"}
        row |= {n: f"{v:.7g}" for n, v in outputs.items()}
        label = {"patient_id": row["patient_id"], "measurement": "1", "of": name}
        append(TABLE, row)
        append(TRUTH, {**label, **{n: f"{v:.7g}" for n, v in true.items()}})


def twin(
    generator: np.random.Generator, points: dict[str, Case], truths: dict[str, dict[str, str]]
) -> tuple[str, dict[str, float], dict[str, float]]:
    """Point of the cohort, parameters and outputs of one twin."""
    names = list(points)
    while True:
        name = names[generator.integers(len(names))]
        around = np.array([float(truths[name][n]) for n in BOUNDS])
        drawn = around * FACTOR ** generator.uniform(-1.0, 1.0, len(around))
        ends = np.array([(low * MARGIN, high / MARGIN) for _, low, high in BOUNDS.values()])
        # Rounded before the simulation, so that the table holds what was simulated.
        true = {n: float(f"{v:.7g}") for n, v in zip(BOUNDS, np.clip(drawn, *ends.T), strict=True)}
        found = simulate_adaptive(model_of(points[name]).with_values(true))
        outputs = {n: float(found[n]) for n in TARGETS}
        if found.attrs["converged"] and all(a <= outputs[n] <= b for n, (a, b) in PLAUSIBLE.items()):
            return name, true, outputs


def append(path: Path, row: dict[str, str]) -> None:
    new = not path.exists()
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(row), lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerow(row)


if __name__ == "__main__":
    main()
