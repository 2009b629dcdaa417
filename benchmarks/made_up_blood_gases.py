"""Measurements of two examples: a patient on V-V ECMO with known shunt, oxygen consumption and mixing.

    python benchmarks/made_up_blood_gases.py [FOLDER]

Prints the measurements of examples/veno_venous_blood_gases.toml, and with a folder writes there
ageing_oxygenator.csv: the same patient every morning, while the membrane loses its area. Values are the
model's with the noise that fits assume, at a fixed seed.
"""

import csv
import sys
from pathlib import Path

import numpy as np

from eclsim.cases.reading import read_case
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate
from eclsim.outputs.uncertainty import measurement_errors

EXAMPLES = Path(__file__).parents[1] / "examples"
CASE, TABLE = EXAMPLES / "veno_venous_blood_gases.toml", "ageing_oxygenator.csv"
TRUTH = {"Rmc": 0.6, "gas.shunt_fraction": 0.7, "gas.vo2_ml_min": 230.0, "ecmo.drainage_mixing": 0.35}
CLOTTED = "ecmo.oxygenator.clotted_fraction"
LOST = np.linspace(0.0, 0.6, 9)
"""Share of the membrane that is lost on each day."""
SEED = 2024


def measured(model, random, names) -> dict[str, float]:
    """Outputs with noise, to three digits."""
    beat = simulate(model)
    plain = {name: float(beat[name]) for name in names}
    errors = measurement_errors(plain)
    return {name: float(f"{v + errors[name] * random.standard_normal():.3g}") for name, v in plain.items()}


def main() -> None:
    case = read_case(CASE).case
    names = [name for name, value in case.measurements if value is not None]
    patient, random = model_of(case).with_values(TRUTH), np.random.default_rng(SEED)
    print(CASE.name, measured(patient, random, names))
    if len(sys.argv) < 2:
        return
    with open(EXAMPLES / TABLE, newline="") as handle:
        rows = list(csv.DictReader(handle))
    for row, lost in zip(rows, LOST, strict=True):
        row |= measured(patient.with_values({CLOTTED: lost}), random, names)
    with open(Path(sys.argv[1]) / TABLE, "w", newline="") as handle:
        table = csv.DictWriter(handle, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


if __name__ == "__main__":
    main()
