"""Effect of a pericardium, bronchial return or a stronger heart on rows of `ecmo-protocol`.

    python benchmarks/va_ecmo_experiments.py

Each animal is matched again with the addition, then its flow is raised as in the rows. The pericardium is
either that of the parameters or an enlarged one, with zero pressure at the mean volume of the matched heart.
Finally, only contractility is increased at the high flow.
"""

from collections.abc import Mapping

import numpy as np

from eclsim.files import read_table
from eclsim.orbit.model import Model
from eclsim.outputs.results import simulate
from eclsim.validation import regulation
from eclsim.validation.matching import UnreachableError, with_outputs
from eclsim.validation.reference_cases import DATA

BRONCHIAL = {"bronchial_fraction": 0.015}
PATIENTS: Mapping[str, tuple[dict[str, object], bool]] = {
    "as in the rows": ({}, False),
    "bronchial return 1.5 %": (BRONCHIAL, False),
    "bronchial return 5 %": ({"bronchial_fraction": 0.05}, False),
    "pericardium": ({"pericardium": True}, False),
    "pericardium, grown": ({"pericardium": True}, True),
    "pericardium, grown, bronchial 1.5 %": (BRONCHIAL | {"pericardium": True}, True),
}
CHAMBERS = ("Vra", "Vrv", "Vla", "Vlv")


def animal(study: str, physiology: Mapping[str, object], grown: bool) -> Model:
    """The animal at the lowest flow, matched with the addition."""
    goal, more = regulation.ANIMALS[study]
    free = ("Emaxlv", regulation.EXTRA_VOLUME, "Rmc", *more)
    rate = 1e3 * regulation.NATIVE_L_MIN / regulation.STROKE_ML
    first = regulation.animal(study)
    added = regulation.adult(rate, 50.0, ecmo=regulation.CIRCUIT, physiology=physiology)
    added = added.with_values({name: first.values[name] for name in free})
    if grown:
        beat = simulate(first)
        held = sum(np.trapezoid(beat[name].values, beat["phase"].values) for name in CHAMBERS)
        added = added.with_values({"pericardium_ml": float(held)})
    return with_outputs(added, free, goal)


def compared(study: str, patient: Model, stronger: float = 1.0) -> str:
    """Number of rows that agree: signs at constant volume and filling, sizes at constant filling."""
    changed = {regulation.FLOW: 5.0, "Emaxlv": stronger * patient.values["Emaxlv"]}
    low, held = simulate(patient), simulate(patient.with_values(changed))
    filled = simulate(regulation.with_output_held(patient, regulation.RIGHT_ATRIUM, stronger))
    signs, sizes, cells = np.zeros(2, dtype=int), 0, []
    rows = [row for row in read_table(DATA / "effects.csv") if row["study"] == study]
    for row in rows:
        start, end, name = float(row["from"]), float(row["to"]), row["quantity"]
        spread = np.hypot(float(row["from_sd"]), float(row["to_sd"])) / start
        expected = end / start - 1.0
        changes = np.array([float(high[name] / low[name] - 1.0) for high in (held, filled)])
        signs += np.sign(changes) == np.sign(expected)
        sizes += abs(changes[1] - expected) <= spread
        cells.append(f"{name} {100 * expected:+.0f}: {100 * changes[0]:+.0f}, {100 * changes[1]:+.0f}")
    around = float(low.get("pericardial_pressure", np.nan))
    return f"signs {signs} of {len(rows)}, sizes {sizes}, pericardium {around:.1f} mmHg; {'; '.join(cells)}"


def main() -> None:
    for words, (physiology, grown) in PATIENTS.items():
        print(f"\n{words}")
        for study in regulation.ANIMALS:
            try:
                print(f"  {study}: {compared(study, animal(study, physiology, grown))}", flush=True)
            except UnreachableError as error:
                print(f"  {study}: not to be matched ({error})", flush=True)
    for stronger in (1.1, 1.2):
        print(f"\ncontractility at the high flow x {stronger}")
        for study in regulation.ANIMALS:
            print(f"  {study}: {compared(study, regulation.animal(study), stronger)}", flush=True)


if __name__ == "__main__":
    main()
