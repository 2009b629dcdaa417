"""Simulated patients on ECMO with known true parameters, to test intervals and forecasts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from eclsim.cases.case import Case, Measurements, Patient
from eclsim.devices.ecmo import Ecmo
from eclsim.identification.quantities import BEAT_OUTPUTS
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.steady_beat import steady_beat
from eclsim.outputs.uncertainty import DEFAULTS
from eclsim.parameters.thiel2025 import BOUNDS

NAMES = tuple(BOUNDS)
LIKELY = {"MAP": (45.0, 120.0), "MPAP": (8.0, 40.0), "PCWP": (3.0, 25.0), "CO": (0.8, 9.0), "PF": (0.5, 6.0)}
"""Ranges of plausible outputs; patients outside are drawn again."""
SPREAD = 0.8
"""Standard deviation of the latent variable of a patient's parameter, slightly below the prior's 1."""
LARGEST_DRIFT = 0.9
"""Largest change of a logarithm over a series."""
TRIES = 200


@dataclass(frozen=True)
class SimulatedPoint:
    """A patient at one time.

    Args:
        case: case with simulated measurements.
        truth: true parameters, in their units.
        outputs: outputs of the model, without noise.
    """

    case: Case
    truth: Mapping[str, float]
    outputs: Mapping[str, float]


def simulated_patient(seed: int) -> SimulatedPoint:
    """One patient, measured once."""
    return simulated_series(seed, 1)[0]


def simulated_series(seed: int, points: int, drifting: int = 3) -> list[SimulatedPoint]:
    """One patient over time: some parameters drift steadily, the pump speed and the heart rate change.

    Args:
        seed: seed of the patient.
        points: number of measurements.
        drifting: number of parameters that drift.
    """
    random = np.random.default_rng([2024, seed])
    table = np.log(np.array([tuple(b) for b in BOUNDS.values()]))
    for _ in range(TRIES):
        z = SPREAD * random.standard_normal(len(NAMES))
        change = np.zeros(len(NAMES))
        which = random.choice(len(NAMES), drifting, replace=False)
        change[which] = LARGEST_DRIFT * random.uniform(-1.0, 1.0, drifting)
        devices = made_up_ecmo(random)
        start = table[:, 1] + (table[:, 2] - table[:, 1]) * _share(z)
        x = start + np.linspace(0.0, 1.0, points)[:, None] * change
        x = np.clip(x, table[:, 1], table[:, 2])
        cases = [made_up_case(random, seed, k, devices) for k in range(points)]
        outputs = _outputs(cases, x)
        if outputs is not None and all(_likely(o) for o in outputs):
            return [_measured(random, c, row, o) for c, row, o in zip(cases, x, outputs, strict=True)]
    raise RuntimeError(f"no likely patient in {TRIES} tries")


def _share(z: np.ndarray) -> np.ndarray:
    from scipy.special import ndtr

    return ndtr(z)


def made_up_ecmo(random: np.random.Generator) -> Ecmo:
    """A V-A ECMO with a usual speed and usual cannulae."""
    return Ecmo(
        pump="Rotaflow", speed_rpm=float(round(random.uniform(2200, 3600))), oxygenator="Quadrox-i Adult",
        drainage_site="ra", drainage_cannula="venous", drainage_fr=float(random.choice([21, 23, 25])),
        return_site="ao", return_cannula="arterial", return_fr=float(random.choice([15, 17, 19])), mode="VA",
    )  # fmt: skip


def made_up_case(random: np.random.Generator, seed: int, number: int, ecmo: Ecmo) -> Case:
    """An adult on this ECMO, with a number in a series."""
    first = np.random.default_rng([2025, seed])
    sex = "female" if first.random() < 0.5 else "male"
    age, height, weight = first.uniform(30, 75), first.uniform(155, 188), first.uniform(55, 95)
    rate = first.uniform(65, 115) + random.uniform(-6, 6)
    speed = float(round((ecmo.speed_rpm or 3000.0) * random.uniform(0.92, 1.08)))
    return Case(
        patient=Patient(id=f"S{seed:03d}", sex=sex, age_years=round(age), height_cm=round(height),
                        weight_kg=round(weight), heart_rate_bpm=round(rate)),
        ecmo=ecmo.model_copy(update={"speed_rpm": speed if number else ecmo.speed_rpm}),
    )  # fmt: skip


def _outputs(cases: list[Case], x: np.ndarray) -> list[dict[str, float]] | None:
    models = [model_of(c) for c in cases]
    names = models[0].values
    values = {n: np.array([m.values[n] for m in models]) for n in names}
    values |= {n: np.exp(x[:, k]) for k, n in enumerate(NAMES)}
    beat = steady_beat(Batch(models[0].circuit, values, len(cases)), BEAT_OUTPUTS)
    return [beat.outputs(k) for k in range(len(cases))] if beat.determined.all() else None


def _likely(outputs: Mapping[str, float]) -> bool:
    return all(low <= outputs[n] <= high for n, (low, high) in LIKELY.items())


def _measured(
    random: np.random.Generator, case: Case, x: np.ndarray, outputs: Mapping[str, float]
) -> SimulatedPoint:
    noisy = {n: v + DEFAULTS[n].at(v) * random.standard_normal() for n, v in outputs.items()}
    noisy = {n: max(v, 0.2) for n, v in noisy.items()}
    return SimulatedPoint(
        case.model_copy(update={"measurements": Measurements(**noisy)}),
        dict(zip(NAMES, np.exp(x).tolist(), strict=True)), dict(outputs),
    )  # fmt: skip
