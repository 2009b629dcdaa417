"""The experiments of docs/fluid.md: fluid removal at three walls, solutes, sweep, men who bleed or stand up.

    python benchmarks/fluid_experiments.py [FOLDER]

prints the tables of the page and, with a folder, writes its figure there.
"""

import sys
from pathlib import Path

import numpy as np

from eclsim.cases.reading import read_case
from eclsim.course.course import course
from eclsim.regulation.attach import REFLEXES
from eclsim.reporting.style import curve_style, figure_style
from eclsim.validation.fluid import MEASURED, Patient, bled, healthy, stood

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


def bleeding() -> None:
    """Men who lose blood: by reflex, veins and the pressure of an empty right ventricle."""
    print("\nmen who lose blood")
    print("measured".ljust(36), *(f"{expected:7.4g}" for _, expected, *_ in MEASURED))
    for reflex in REFLEXES:
        for words, stiff, empty in (
            ("published veins", True, {}),
            ("soft veins", False, {}),
            ("soft veins, RV_Pd_beta 0", False, {"RV_Pd_beta": 0.0}),
        ):
            found = bled(healthy(reflex, stiff, **empty))
            print(f"{reflex}, {words}".ljust(36), *(f"{found[name]:7.3g}" for name, *_ in MEASURED),
                  f" resistance {found['0.9 L: resistance']:+.0f} %")  # fmt: skip


def standing() -> None:
    """Plasma lost by men who stand: what circulation and veins of the legs do."""
    print("\nplasma lost at 3, 5, 10, 35 min [%], time constant and half of it back [min]")
    print("measured".ljust(36), "    8.5    11.7    16.8    17.4    4.6    6.0")
    for reflex in REFLEXES:
        for words, held, pooled in (
            ("pressures as lying", True, 0.0),
            ("pooled", False, None),
            ("700 mL", False, 700.0),
            ("950 mL", False, 950.0),
        ):
            man = Patient(healthy(reflex))
            man.pooled_ml = man.pooled_ml if pooled is None else pooled
            if held:
                man.values = {
                    name: np.full_like(v, man.at(np.zeros(1))[name][0]) for name, v in man.values.items()
                }
                man.upright = man.values
            lost, tau, back = stood(man)
            print(f"{reflex}, {words}".ljust(36), *(f"{v:7.3g}" for v in (*lost, tau, back)))


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
    bleeding()
    standing()
    days_, swept_ = days(), sweep()
    if len(sys.argv) > 1:
        draw(days_, swept_, Path(sys.argv[1]))
