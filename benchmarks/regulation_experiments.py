"""Experiments of docs/regulation.md: a failing heart, veno-arterial ECMO at rising speed, static curves.

    python benchmarks/regulation_experiments.py [FOLDER]

Prints the tables of the page and, with a folder, writes its figure there.
"""

import sys
from pathlib import Path

import numpy as np

from eclsim.cases.reading import read_mapping
from eclsim.orbit.model import Model, model_of
from eclsim.outputs.results import simulate, simulate_many
from eclsim.parameters.regulation import EXTRA_VOLUME, GAIN, SET_POINT, UNSTRESSED, VENOUS_SET_POINT
from eclsim.regulation.attach import REFLEXES
from eclsim.reporting.style import curve_style, figure_style

PATIENT = {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75}
ECMO = {
    "pump": "Rotaflow", "speed_rpm": 1500, "oxygenator": "Quadrox-i Adult", "mode": "VA", "drainage_fr": 25,
    "return_fr": 17,
}  # fmt: skip
SPEEDS = np.array([1500.0, 2000.0, 2500.0, 3000.0, 3500.0, 4000.0, 4500.0])
OUTPUTS = ("MAP", "CO", "EDVLV", "end_diastolic_pressure_lv", "PCWP", "right_atrial_pressure")
HEAD = ("MAP", "CO", "LV EDV", "LVEDP", "wedge", "RAP")
PANELS = {
    "Emaxlv": ("left ventricle", "factor of contractility"),
    "Emaxrv": ("right ventricle", "factor of contractility"),
    "Rmc": ("systemic resistance", "factor"),
    "heart_rate_bpm": ("heart rate", "factor"),
    UNSTRESSED: ("unstressed volume", "change [mL]"),
}
"""Title and axis of the panel of each quantity that a reflex changes."""
IN_EFFECT = ("heart_rate", "contractility_lv_factor", "systemic_resistance_factor", "unstressed_volume")
FAILING = {"Emaxlv": 0.3}


def model(reflex="ursino1998", **sections) -> Model:
    """The published patient at constant blood volume, with set points of the same patient at rest."""
    base = {"format": 1, "blood_volume_policy": "patient_held", "patient": PATIENT}
    rest = simulate(read_mapping(base).case)
    points = {
        SET_POINT.partition(".")[2]: float(rest["MAP"]),
        VENOUS_SET_POINT.partition(".")[2]: float(rest["right_atrial_pressure"]),
    }
    if reflex == "ursino1998":
        points.popitem()
    regulation = {"baroreflex": 1.0, "model": reflex} | points
    return model_of(read_mapping(base | {"regulation": regulation} | sections).case)


def row(name: str, numbers) -> str:
    return f"| {name} | " + " | ".join(f"{float(number):.4g}" for number in numbers) + " |"


def failing_heart() -> None:
    print("\n| Emaxlv 0.3, no ECMO | " + " | ".join((*HEAD, *IN_EFFECT)) + " |")
    print("|---|" + "---:|" * (len(HEAD) + len(IN_EFFECT)))
    for reflex in REFLEXES:
        patient = model(reflex, parameters=FAILING)
        for gain in (0.0, 0.5, 1.0) if reflex == "ursino1998" else (1.0,):
            found = simulate(patient.with_values({GAIN: gain}))
            print(row(f"{reflex}, gain {gain:g}", [found[n] for n in (*OUTPUTS, *IN_EFFECT)]))


def rising_speed() -> None:
    """Print one table per protocol (quantities held constant while the pump speed rises)."""
    for name, patient, changes in protocols():
        found = simulate_many(patient, {"ecmo.speed_rpm": SPEEDS} | changes, (*OUTPUTS, "PF"))
        print(f"\n{name}\n\n| rpm | flow | " + " | ".join(HEAD) + " |")
        print("|---:|" + "---:|" * (len(HEAD) + 1))
        for k, speed in enumerate(SPEEDS):
            print(row(f"{speed:.0f}", [found[n].values[k] for n in ("PF", *OUTPUTS)]))


def protocols():
    """Name, model, and values that change with the speed."""
    patient = model(parameters=FAILING, ecmo=ECMO)
    yield "no reflex", patient, {GAIN: 0.0}
    yield "reflex of Ursino", patient, {}
    yield "reflexes of Heldt", model("heldt2004", parameters=FAILING, ecmo=ECMO), {}
    tone = simulate(patient)
    fixed = {
        "Emaxlv": patient.values["Emaxlv"] * float(tone["contractility_lv_factor"]),
        "Emaxrv": patient.values["Emaxrv"] * float(tone["contractility_rv_factor"]),
        "Rmc": patient.values["Rmc"] * float(tone["systemic_resistance_factor"]),
        "heart_rate_bpm": float(tone["heart_rate"]),
        UNSTRESSED: float(tone["unstressed_volume"]),
    }
    yield "tone of 1500 rpm fixed", patient, {GAIN: 0.0} | fixed
    pressure = float(tone["right_atrial_pressure"])
    yield (
        "tone of 1500 rpm fixed, volume given to hold RAP",
        patient,
        {GAIN: 0.0}
        | fixed
        | {EXTRA_VOLUME: with_pressure_held(patient.with_values({GAIN: 0.0} | fixed), pressure)},
    )
    bronchial = model(parameters=FAILING, ecmo=ECMO, physiology={"bronchial_fraction": 0.05})
    yield "reflex of Ursino, bronchial return of 5 %", bronchial, {}


def with_pressure_held(patient: Model, pressure: float) -> np.ndarray:
    """Volume given [mL] at each speed that keeps right atrial pressure constant, by the secant method."""
    last, now = np.zeros(len(SPEEDS)), np.full(len(SPEEDS), 50.0)

    def excess(volume):
        found = simulate_many(patient, {"ecmo.speed_rpm": SPEEDS, EXTRA_VOLUME: volume}, OUTPUTS[-1:])
        return found[OUTPUTS[-1]].values - pressure

    before = excess(last)
    for _ in range(12):
        after = excess(now)
        if np.nanmax(np.abs(after)) < 1e-6:
            break
        found = (np.abs(after) < 1e-6) | (now == last) | (after == before)
        slope = np.where(found, 1.0, after - before) / np.where(found, 1.0, now - last)
        step = np.where(found, 0.0, np.clip(-after / slope, -300.0, 300.0))
        last, before, now = now, after, now + step
    reached = np.abs(excess(now)) < 1e-3
    print("\nvolume given [mL], - where the heart does not eject and none holds it:",
          *(f"{v:.0f}" if there else "-" for v, there in zip(now, reached, strict=True)))  # fmt: skip
    return np.where(reached, now, 0.0)


def static_curves(folder: Path) -> None:
    """Plot the factors of all reflexes against arterial pressure."""
    from matplotlib import pyplot

    deviations = np.linspace(-70.0, 60.0, 131)
    with figure_style():
        figure, panels = pyplot.subplots(1, 5, figsize=(12.0, 2.8), constrained_layout=True)
        for index, reflex in enumerate(REFLEXES.values()):
            rest = [0.0] * (len(reflex.reads) - 1)
            table = np.array(
                [[float(e) for e in reflex.steady_effects([d, *rest], 1.0, 5000.0)] for d in deviations]
            )
            for panel, values, name in zip(panels, table.T, reflex.acts_on, strict=True):
                title, axis = PANELS[name]
                panel.plot(deviations, values, label=reflex.name, **curve_style(index))
                panel.set(title=title, ylabel=axis, xlabel="MAP − set point [mmHg]")
        panels[0].legend()
        folder.mkdir(parents=True, exist_ok=True)
        figure.savefig(folder / "reflex-curves.png", dpi=110)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        static_curves(Path(sys.argv[1]))
    failing_heart()
    rising_speed()
