"""ECMO flow and drainage pressure against speed, with veins that collapse and without (page Collapse).

python benchmarks/suction_experiments.py [FOLDER FOR THE FIGURE]
"""

import sys
from pathlib import Path

import numpy as np
import xarray as xr

from eclsim.outputs.results import simulate_many
from eclsim.reporting.style import OKABE_ITO, figure_style
from eclsim.validation.fluid import patient

SPEEDS = np.arange(1500.0, 5001.0, 250.0)
VOLUMES_ML = (-300.0, -700.0)
OUTPUTS = ("PF", "drainage_pressure", "lowest_drainage_pressure", "right_atrial_pressure", "ESVRA", "CO")


def ramp(collapsible: bool, volume_ml: float) -> xr.Dataset:
    """Outputs over the speeds."""
    names = (*OUTPUTS, "caval_filling") if collapsible else OUTPUTS
    return simulate_many(patient(collapsible, volume_ml), {"ecmo.speed_rpm": SPEEDS}, list(names))


def table(ramps: dict[tuple[bool, float], xr.Dataset]) -> str:
    """Every second speed as Markdown."""
    lines = ["| blood lost [mL] | veins | speed | flow | drainage | right atrium | filling | |",
             "|---|---|---|---|---|---|---|---|"]  # fmt: skip
    for (collapsible, volume), one in ramps.items():
        for k in range(2, len(SPEEDS), 4):
            row = one.isel(member=k)
            filling = f"{float(row['caval_filling']):.0f} %" if collapsible else ""
            lines.append(
                f"| {-volume:.0f} | {'collapse' if collapsible else 'do not'} | {SPEEDS[k]:.0f} "
                f"| {float(row['PF']):.2f} | {float(row['drainage_pressure']):.0f} "
                f"| {float(row['right_atrial_pressure']):.1f} | {filling} | {row['status'].item()} |"
            )
    return "\n".join(lines)


def draw(ramps: dict[tuple[bool, float], xr.Dataset], folder: Path) -> None:
    """Flow and drainage pressure; open circles where the beat is one of many."""
    from matplotlib import pyplot

    colours = dict(zip(VOLUMES_ML, (OKABE_ITO["blue"], OKABE_ITO["vermillion"]), strict=True))
    with figure_style():
        figure, panels = pyplot.subplots(1, 2, figsize=(9.0, 3.6), constrained_layout=True)
        for (collapsible, volume), one in ramps.items():
            words = "veins collapse" if collapsible else "veins do not collapse"
            colour, settled = colours[volume], one["status"].values == "converged"
            for panel, name in zip(panels, ("PF", "drainage_pressure"), strict=True):
                values, dash = one[name].values, "-" if collapsible else "--"
                panel.plot(SPEEDS, values, dash, color=colour, label=f"{-volume:.0f} mL lost, {words}")
                panel.plot(SPEEDS[~settled], values[~settled], "o", mfc="white", color=colour, ms=4)
        for panel, label in zip(panels, ("ECMO flow [L/min]", "drainage pressure [mmHg]"), strict=True):
            panel.set(xlabel="ECMO pump speed [rpm]", ylabel=label)
        panels[0].legend()
        folder.mkdir(parents=True, exist_ok=True)
        figure.savefig(folder / "suction.png", dpi=110)


if __name__ == "__main__":
    results = {(one, volume): ramp(one, volume) for volume in VOLUMES_ML for one in (False, True)}
    print(table(results))
    if len(sys.argv) > 1:
        draw(results, Path(sys.argv[1]))
