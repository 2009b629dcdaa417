"""The experiments of docs/fluid.md: fluid removal at three walls, solutes, a change of sweep, legs apart.

    python benchmarks/fluid_experiments.py [FOLDER]

prints the tables of the page and, with a folder, writes its figure there.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from eclsim.cases.reading import read_case
from eclsim.course.course import course
from eclsim.fluid.law import fluid_law
from eclsim.fluid.starling import Spaces, Wall, exchange
from eclsim.reporting.style import curve_style, figure_style
from eclsim.validation.fluid import dialysed, fall_of_blood, standing_man

CASE = Path(__file__).parents[1] / "examples" / "fluid_removal.toml"
WALLS = {
    "no refill": ["fluid.capillary_refill=false"],
    "LpS 1": ["fluid.filtration_ml_min_mmHg=1"],
    "LpS 10": ["fluid.filtration_ml_min_mmHg=10"],
}
OUTPUTS = ("MAP", "CO", "right_atrial_pressure", "lowest_drainage_pressure", "PaCO2", "pHa", "DO2")
SHOWN_H = (0, 8, 8.5, 12, 16, 17, 24)


def table(words: str, found, names) -> None:
    hours = found["time_min"].values / 60.0
    last = hours[-1]
    print(f"\n{words}" + ("" if found.attrs["converged"] else f": {found.attrs['message']}"))
    print("h".ljust(30), *(f"{h:9.4g}" for h in SHOWN_H))
    for name in names:
        values = [np.interp(h, hours, found[name].values) if h <= last + 1e-6 else np.nan for h in SHOWN_H]
        print(name.ljust(30), *(f"{v:9.4g}" for v in values))


def days() -> dict:
    found = {}
    for words, settings in WALLS.items():
        found[words] = course(read_case(CASE, settings).case, outputs=OUTPUTS)
        blood = found[words]["fluid.plasma_ml"] + found[words]["fluid.red_cells_ml"]
        found[words]["blood"] = blood
        names = (*OUTPUTS, "blood", "haematocrit", "oncotic_pressure", "fluid.refilled_ml")
        table(words, found[words], names)
    names = ("urea", "creatinine", "potassium", "bicarbonate")
    table("solutes, LpS 1", found["LpS 1"], names)
    return found


def sweep():
    """PaCO2 after the sweep is turned up at 1 h."""
    case = read_case(CASE, ["crrt.net_ultrafiltration_ml_h=0"]).case
    event = {"at_min": 60.0, "set": {"ecmo.sweep_l_min": 4.0}}
    mapping = case.as_mapping() | {"events": [event]}
    from eclsim.cases.reading import read_mapping

    found = course(read_mapping(mapping).case, minutes=180.0, every_min=2.0, outputs=("PaCO2", "tissue_PCO2"))
    minutes = found["time_min"].values
    for name in ("PaCO2", "tissue_PCO2"):
        values = found[name].values
        print(name, [round(float(np.interp(m, minutes, values)), 1) for m in (59.5, 61, 70, 80, 110, 180)])
    return found


LEGS, LEGS_HG = 0.32, 240.0
"""Share of the body that hangs below the heart, and its mass [100 g] in a man of 75 kg."""
COLUMN_MMHG = 0.75 * 1060.0 * 9.81 / 133.322
COEFFICIENTS = (0.002, 0.004, 0.006, 0.010)
"""Filtration coefficients of limbs [mL/min/mmHg/100 g]: plethysmography, then what standing men suggest."""
TIGHTNESS = (0.0, 0.02, 0.04)
"""Rise of tissue pressure for each mL that legs swell [mmHg/mL], beside the curve of all tissue. With 0.04 it
ends at 50 cmH2O in the whole leg, as in the anterior tibial muscle (Wells et al. 1938); skin stays at 0."""


def legs_apart() -> None:
    """Standing with an interstitium of the legs of its own; a dialysis with the same wall lying down."""
    man = standing_man()
    law = fluid_law(man.model.circuit)
    spaces, wall = law.at_rest({key: np.array([v]) for key, v in man.model.values.items()})
    print(
        "\nlegs apart, by filtration coefficient and tightness: plasma lost [%] 3, 10, 35 min after standing"
    )
    print("up; time constant [min]; rise of pressure in the legs [mmHg]; half of it back lying [min];")
    print("dialysis of 1.7 L [%/h], 1.5 L and 2.7 L [%/L]")
    print("measured".ljust(15), "8.5   16.8   17.4    4.6  37 (one)    6.0  dialysis  3.20  4.90  2.40")
    for coefficient in COEFFICIENTS:
        legs = coefficient * LEGS_HG
        patient = dialysed(legs / LEGS)
        falls = [
            fall_of_blood(patient, 1000.0 * litres) / per
            for litres, per in ((1.7, 4), (1.5, 1.5), (2.7, 2.7))
        ]
        for tightness in TIGHTNESS:
            values = _stood(spaces, wall, (legs, legs / LEGS - legs), tightness)
            words = f"{coefficient:g}, {tightness:g}".ljust(12)
            print(words, *(f"{v:6.1f}" for v in values), " dialysis", *(f"{v:5.2f}" for v in falls))


def _stood(spaces: Spaces, wall: Wall, coefficients, tightness: float) -> list[float]:
    """What a man who stands 35 min loses, and how fast it is back in one who lies down after 15."""
    whole = Spaces(*(float(np.ravel(v)[0]) for v in spaces))
    shares = (LEGS, 1.0 - LEGS)
    rest = [
        Spaces(whole.plasma, s * whole.interstitium, whole.plasma_protein, s * whole.interstitial_protein,
               s * whole.normal)
        for s in shares
    ]  # fmt: skip
    walls = [
        Wall(k, float(wall.reflection[0]), s * float(wall.lymph[0]))
        for k, s in zip(coefficients, shares, strict=True)
    ]

    def slope(column: float, y: np.ndarray) -> np.ndarray:
        plasma, protein = whole.plasma - y[0] - y[1], whole.plasma_protein - y[2] - y[3]
        rises = (column - tightness * y[0], 0.0)
        out = [
            exchange(
                r._replace(plasma=plasma, plasma_protein=protein, interstitium=r.interstitium + y[k],
                           interstitial_protein=r.interstitial_protein + y[2 + k]),
                r, rises[k], walls[k],
            )
            for k, r in enumerate(rest)
        ]  # fmt: skip
        return np.array([e.fluid for e in out] + [e.protein for e in out])

    def followed(column: float, start: np.ndarray, minutes: float):
        return solve_ivp(
            lambda _, y: slope(column, y), (0.0, minutes), start, "LSODA", rtol=1e-8, atol=1e-6, max_step=0.05
        )

    up = followed(COLUMN_MMHG, np.zeros(4), 35.0)
    lost = 100.0 * (up.y[0] + up.y[1]) / whole.plasma
    tau = np.interp((1.0 - np.exp(-1.0)) * lost[-1], lost, up.t)
    stood = np.array([np.interp(15.0, up.t, row) for row in up.y])
    down = followed(0.0, stood, 60.0)
    half = np.interp(-0.5 * (stood[0] + stood[1]), -(down.y[0] + down.y[1]), down.t)
    return [*np.interp((3.0, 10.0, 35.0), up.t, lost), tau, tightness * up.y[0][-1], half]


def draw(found, swept, folder: Path) -> None:
    from matplotlib import pyplot

    panels = (
        ("blood", "Blood volume", "mL"), ("MAP", "Mean arterial pressure", "mmHg"),
        ("lowest_drainage_pressure", "Drainage pressure, lowest", "mmHg"),
        ("haematocrit", "Haematocrit", "1"),
    )  # fmt: skip
    with figure_style():
        figure, axes = pyplot.subplots(2, 3, figsize=(10.0, 5.2), constrained_layout=True)
        flat = list(axes.T.flat)
        for ax, (name, title, unit) in zip(flat, panels, strict=False):
            for index, (words, one) in enumerate(found.items()):
                style = curve_style(index)
                ax.plot(one["time_min"] / 60.0, one[name], label=words, **style)
            ax.set_title(title)
            ax.set_ylabel(unit if unit != "1" else "")
        flat[0].legend()
        for index, name in enumerate(("urea", "potassium", "bicarbonate")):
            one = found["LpS 1"]
            flat[4].plot(one["time_min"] / 60.0, one[name], label=name, **curve_style(index))
        flat[4].set_title("Dissolved in plasma")
        flat[4].set_ylabel("mmol/L")
        flat[4].legend()
        for index, (name, label) in enumerate((("PaCO2", "arteries"), ("tissue_PCO2", "tissue"))):
            flat[5].plot(swept["time_min"], swept[name], label=label, **curve_style(index))
        flat[5].set_title("PCO2, sweep 1.5 to 4 L/min at 60 min")
        flat[5].set_ylabel("mmHg")
        flat[5].legend()
        for ax in flat[:5]:
            ax.set_xlabel("time [h]")
            ax.set_xticks(range(0, 25, 6))
        flat[5].set_xlabel("time [min]")
        folder.mkdir(parents=True, exist_ok=True)
        figure.savefig(folder / "fluid-day.png", dpi=110)


if __name__ == "__main__":
    legs_apart()
    days_, swept_ = days(), sweep()
    if len(sys.argv) > 1:
        draw(days_, swept_, Path(sys.argv[1]))
