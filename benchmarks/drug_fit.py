"""Fit the effects of drugs to their studies; the results are the values in `eclsim.drugs.published`.

    python benchmarks/drug_fit.py [DRUG ...]
    python benchmarks/drug_fit.py FOLDER

With a folder, it writes the figures of docs/drugs.md there and fits nothing.

Each drug's five effects at the first dose of its fit studies minimise the sum of squares of (computed -
measured) / uncertainty over all quantities measured after the drug, and of effect / expected size: an effect
without evidence in the measurements stays 0. At other doses effects are proportional to the share in use. The
uncertainty is the standard error of the two means if known, and at least 4 % of the value. Studies marked
`test` in the table are not fitted.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from eclsim.circuit.network import HEART_RATE
from eclsim.drugs.law import Effects
from eclsim.drugs.published import PUBLISHED
from eclsim.parameters.regulation import DRUG_DOSES, UNSTRESSED
from eclsim.reporting.style import OKABE_ITO, curve_style, figure_style
from eclsim.validation.drugs import RISES, arms, expected, measured, patient_of, uncertainty

EXPECTED_SIZE = Effects(0.5, 0.5, 0.5, 0.2, 0.05)
"""Prior standard deviation of each effect: 50 % for most, 5 % of the blood volume."""
NONE_KNOWN = {
    "milrinone": ("heart_rate",),
    "nitroprusside": ("contractility",),
    "vasopressin": ("contractility", "heart_rate"),
}
"""Effects that are fixed at 0: not measured in the fit study, or excluded by the drug's mechanism."""


TWO_DRUGS = "both"
COLOURS = dict(
    zip(
        (*PUBLISHED, TWO_DRUGS),
        (*(c for name, c in OKABE_ITO.items() if name != "yellow"), "0.6"),
        strict=True,
    )
)
"""Colour of each drug in the figure of the studies; two drugs together are grey."""


def at(patient, effects: np.ndarray, quantities) -> np.ndarray:
    """Quantities computed with each row of effects in place of a drug's."""
    heart, systemic, pulmonary, rate = np.exp(effects[:, :4].T)
    own = patient.values
    changes = {
        "Emaxlv": own["Emaxlv"] * heart, "Emaxrv": own["Emaxrv"] * heart, "Rmc": own["Rmc"] * systemic,
        "Rpmc": own["Rpmc"] * pulmonary, HEART_RATE: own[HEART_RATE] * rate,
        UNSTRESSED: effects[:, 4] * own["total_blood_volume_ml"],
    }  # fmt: skip
    found = measured(patient, changes, quantities)
    return np.stack([found[name] for name in quantities], axis=-1)


def fit(drug: str):
    own = [arm for arm in arms() if arm.arm == drug and any(row["use"] == "fit" for row in arm.rows)]
    fitted = {row["quantity"] for arm in own for row in arm.rows if row["use"] == "fit"}
    none = (*NONE_KNOWN.get(drug, ()), *(["pulmonary_resistance"] if not fitted & {"MPAP", "PVR"} else []))
    free = np.array([name not in none for name in Effects._fields])
    shares = [float(PUBLISHED[drug].share(dict(arm.doses)[drug])) for arm in own]
    size = np.array(EXPECTED_SIZE)[free]

    def misses(effects: np.ndarray, relative: bool = True) -> np.ndarray:
        """Residuals of all quantities of all arms, one column per row of effects."""
        found = []
        for arm, share in zip(own, shares, strict=True):
            patient = patient_of(arm)
            rows = [row for row in arm.rows if row["use"] == "fit"]
            names = [row["quantity"] for row in rows]
            before = at(patient, np.zeros((1, 5)), names)[0]
            table = at(patient, effects * share / shares[0], names)
            wanted = [expected(row, b) for row, b in zip(rows, before, strict=True)]
            scale = [uncertainty(row, b) if relative else 1.0 for row, b in zip(rows, before, strict=True)]
            found.append((table - wanted) / scale)
        return np.concatenate(found, axis=1)

    def full(some: np.ndarray) -> np.ndarray:
        effects = np.zeros((len(np.atleast_2d(some)), 5))
        effects[:, free] = np.atleast_2d(some) * size
        return effects

    def residuals(some: np.ndarray) -> np.ndarray:
        return np.concatenate([misses(full(some))[0], some])

    def slopes(some: np.ndarray) -> np.ndarray:
        step = 1e-3
        table = misses(full(np.vstack([some, some + step * np.eye(len(some))])))
        return np.vstack([(table[1:] - table[0]).T / step, np.eye(len(some))])

    found = least_squares(residuals, np.zeros(len(size)), jac=slopes)
    share = shares[0]
    spread = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac))) * size
    studies = ", ".join(f"{arm.study} {arm.label}" for arm in own)
    print(f"\n{drug}: {studies}; share of effects in use {share:.3f}")
    print("  at the dose", dict(zip(Effects._fields, np.round(full(found.x)[0], 3).tolist(), strict=True)))
    print(
        "  +-         ",
        dict(zip(np.array(Effects._fields)[free].tolist(), np.round(spread, 3).tolist(), strict=True)),
    )
    at_most = np.round(full(found.x)[0] / share, 3)
    print("  at most     Effects(" + ", ".join(f"{e:g}" for e in at_most) + ")")
    rows = [(f"{arm.study} {arm.label}", row) for arm in own for row in arm.rows if row["use"] == "fit"]
    for (study, row), weighed, plain in zip(
        rows, misses(full(found.x))[0], misses(full(found.x), False)[0], strict=True
    ):
        print(
            f"  {study} {row['quantity']}: {row['before']} -> {row['after']}, "
            f"computed less measured {plain:+.3g} ({weighed:+.2f} uncertainties)"
        )


def curves(panels) -> None:
    """Plot the factors against the dose."""
    for panel, drug in zip(panels, PUBLISHED.values(), strict=False):
        doses = np.linspace(0.0, DRUG_DOSES[drug.name].usual, 201)
        heart, systemic, lung, rate, veins = (
            np.asarray(e) * np.ones_like(doses) for e in drug.effects(doses)
        )
        for index, (name, values) in enumerate((
            ("contractility", np.exp(heart)),
            ("systemic resistance", np.exp(systemic)),
            ("pulmonary resistance", np.exp(lung)),
            ("heart rate", np.exp(rate)),
            ("unstressed volume, 1 + share of blood", 1.0 + veins),
        )):  # fmt: skip
            panel.plot(doses, values, label=name, **curve_style(index))
        panel.set_title(drug.name)
        panel.set_xlabel(f"dose [{DRUG_DOSES[drug.name].unit.replace('ug', 'µg')}]")
        panel.set_ylim(0.3, 3.2)
    for panel in panels[::4]:
        panel.set_ylabel("factor")
    panels[-1].axis("off")
    panels[-1].legend(*panels[0].get_legend_handles_labels(), loc="center")


def predicted(panels) -> None:
    """Plot computed against measured changes with the drug, of fitted and of test studies."""
    from eclsim.validation.drugs import QUANTITIES

    marks = dict(zip(QUANTITIES, "os^DvP*Xdh<>pH", strict=False))
    for panel, use in zip(panels, ("fit", "test"), strict=True):
        seen = set()
        for arm in arms():
            rows = [row for row in arm.rows if row["use"] == use and row["after"] not in ("", RISES)]
            if not rows:
                continue
            names = [row["quantity"] for row in rows]
            found = measured(patient_of(arm), {k: [0.0, d] for k, d in arm.infusions.items()}, names)
            for row in rows:
                name = row["quantity"]
                before, after = found[name]
                colour = COLOURS[arm.arm]
                change = 100.0 * (float(row["after"]) / float(row["before"]) - 1.0)
                label = name if name not in seen else None
                panel.scatter(
                    change, 100.0 * (after / before - 1.0), marker=marks[name], color=colour, label=label
                )
                seen.add(name)
        panel.plot([-60, 130], [-60, 130], color="grey", linewidth=0.8)
        panel.axhline(0.0, color="grey", linewidth=0.4)
        panel.axvline(0.0, color="grey", linewidth=0.4)
        panel.set_title({"fit": "studies fitted", "test": "tests, never fitted"}[use])
        panel.set_xlabel("measured change [%]")
        for handle in panel.legend(fontsize=7, ncols=2).legend_handles:
            handle.set_color("0.4")
    panels[0].set_ylabel("computed change [%]")


def figures(folder: Path) -> None:
    from matplotlib import pyplot

    folder.mkdir(parents=True, exist_ok=True)
    with figure_style():
        figure, panels = pyplot.subplots(2, 4, figsize=(12.0, 6.0), sharey=True, constrained_layout=True)
        curves(panels.ravel())
        figure.savefig(folder / "drug-effects.png", dpi=110)
        figure, panels = pyplot.subplots(1, 2, figsize=(12.0, 5.4), sharey=True, constrained_layout=True)
        predicted(panels)
        for k, (name, colour) in enumerate(COLOURS.items()):
            panels[1].text(
                0.98, 0.02 + 0.04 * k, name, color=colour, ha="right", transform=panels[1].transAxes
            )
        figure.savefig(folder / "drug-studies.png", dpi=110)


if __name__ == "__main__":
    if len(sys.argv) > 1 and sys.argv[1] not in PUBLISHED:
        figures(Path(sys.argv[1]))
        sys.exit()
    for name in sys.argv[1:] or PUBLISHED:
        fit(name)
