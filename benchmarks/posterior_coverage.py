"""Coverage of 90 % intervals: nine in ten should hold the truth of simulated patients measured with noise.

    python benchmarks/posterior_coverage.py --patients 100 --out coverage.jsonl --seconds 280

Intervals of the parameters, of the outputs without noise, and of the outputs at another pump speed; by
weighted draws of the posterior (`--method importance`), by chains (`nuts`, minutes a patient), beside either
by the Gaussian approximation. Every patient is a line of the output file; a run that was stopped, or that ran
out of its seconds, continues where it ended.

`--from-prior` draws patients from the prior itself, whoever has a steady beat, with the errors that the
posterior assumes, so that exact intervals hold the truth in nine of ten but for chance (simulation-based
calibration, Talts et al. 2018, arXiv:1804.06788). Each patient comes twice, the second time with all errors
reversed: their mean is zero, and less is left to chance.
"""

import argparse
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from resumable import run
from simulated_patients import NAMES, made_up_case, made_up_ecmo, simulated_patient

from eclsim.identification.density import PosteriorDensity, Prior, gaussian_approximation
from eclsim.identification.importance import importance_sample
from eclsim.identification.nuts import Sampling, diagnose, sample
from eclsim.identification.predictions import predict
from eclsim.identification.quantities import BEAT_OUTPUTS
from eclsim.orbit.model import Model, model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.steady_beat import steady_beat
from eclsim.outputs.uncertainty import measurement_errors
from eclsim.parameters.thiel2025 import BOUNDS

PREDICTION_DRAWS = 400
CANDIDATES = 16
"""Number of draws of the prior; the first with a steady beat is the patient."""
SHORT_CHAINS = Sampling(chains=4, warmup=300, draws=250)


def prior_of_bounds() -> Prior:
    table = np.log(np.array([tuple(b) for b in BOUNDS.values()]))
    return Prior(NAMES, *table.T)


def starts(posterior: PosteriorDensity, seed: int) -> np.ndarray:
    """Best of a number of random points, chosen without knowledge of the truth."""
    z = np.random.default_rng(seed).uniform(-1.8, 1.8, (400, len(NAMES)))
    levels = posterior.potential(z, posterior.simulate(z))
    return posterior.prior.x_of(z[np.argsort(levels)[:4]])


class MeasuredPatient(NamedTuple):
    """A simulated patient: the measurements with their errors, and the truth."""

    model: Model
    measured: dict[str, float]
    errors: dict[str, float]
    truth: dict[str, float]
    outputs: dict[str, float]


def plausible_patient(seed: int) -> MeasuredPatient:
    """A simulated patient with plausible values."""
    point = simulated_patient(seed)
    measured = {n: getattr(point.case.measurements, n) for n in BEAT_OUTPUTS}
    truth = {n: point.truth[n] for n in NAMES}
    errors = measurement_errors(measured)
    return MeasuredPatient(model_of(point.case), measured, errors, truth, dict(point.outputs))


def patient_from_prior(seed: int) -> MeasuredPatient:
    """A patient drawn from the prior; an odd seed is the patient before with the errors reversed."""
    random, prior = np.random.default_rng([77, seed // 2]), prior_of_bounds()
    model = model_of(made_up_case(random, seed // 2, 0, made_up_ecmo(random)))
    without_measurements = PosteriorDensity(
        model, dict.fromkeys(BEAT_OUTPUTS, 0.0), dict.fromkeys(BEAT_OUTPUTS, 1.0), prior
    )
    z = random.standard_normal((CANDIDATES, len(NAMES)))
    outputs = without_measurements.simulate(z)
    first = int(np.flatnonzero(np.isfinite(outputs).all(axis=1))[0])
    exact = dict(zip(BEAT_OUTPUTS, outputs[first].tolist(), strict=True))
    errors, sign = measurement_errors(exact), 1.0 - 2.0 * (seed % 2)
    measured = {n: v + sign * errors[n] * random.standard_normal() for n, v in exact.items()}
    truth = dict(zip(NAMES, np.exp(prior.x_of(z[first])).tolist(), strict=True))
    return MeasuredPatient(model, measured, errors, truth, exact)


def one_patient(
    seed: int, method: str, patient: Callable[[int], MeasuredPatient] = plausible_patient
) -> dict:
    started, prior = time.perf_counter(), prior_of_bounds()
    model, measured, errors, truth, outputs = patient(seed)
    posterior = PosteriorDensity(model, measured, errors, prior)
    gaussian = gaussian_approximation(posterior, starts(posterior, seed))
    weighted = importance_sample(posterior, gaussian, seed=seed)
    doubts = weighted.doubts
    z = weighted.z[weighted.resample(PREDICTION_DRAWS, seed)]
    if method == "nuts":
        chains = sample(posterior, weighted.proposals, SHORT_CHAINS)
        doubts = diagnose(NAMES, chains.z, chains.statistics).doubts
        z = chains.z.reshape(-1, len(NAMES))
        z = z[:: max(1, len(z) // PREDICTION_DRAWS)]
    faster = model.with_values({"ecmo.speed_rpm": 1.15 * model.values["ecmo.speed_rpm"]})
    truth_at_higher_speed = steady_beat(
        Batch(faster.circuit, {**faster.values, **truth}, 1), BEAT_OUTPUTS
    ).values[:, 0]
    record = {"seed": seed, "doubts": list(doubts), "shape": weighted.shape, "effective": weighted.effective}
    for kind, draws in (("posterior", z), ("gaussian", gaussian.draws(PREDICTION_DRAWS, seed))):
        parameters = dict(zip(NAMES, np.exp(prior.x_of(draws)).T, strict=True))
        at_present_speed, at_higher_speed = (predict(m, parameters, BEAT_OUTPUTS) for m in (model, faster))
        limits = np.quantile(np.stack(list(parameters.values()), axis=1), (0.05, 0.95), axis=0)
        values, exact = np.array([truth[n] for n in NAMES]), np.array([outputs[n] for n in BEAT_OUTPUTS])
        record[kind] = {
            "parameters": _inside(limits[0], values, limits[1]),
            "outputs": _inside(at_present_speed.intervals[:, 0], exact, at_present_speed.intervals[:, 2]),
            "predictions": _inside(
                at_higher_speed.intervals[:, 0], truth_at_higher_speed, at_higher_speed.intervals[:, 2]
            ),
        }
    return record | {"seconds": time.perf_counter() - started}


def _inside(lower, value, upper) -> list[bool]:
    return [bool(a <= v <= b) for a, v, b in zip(lower, value, upper, strict=True)]


def summary(lines: list[dict]) -> dict:
    totals = {"patients": len(lines), "doubted": sum(bool(o["doubts"]) for o in lines)}
    for kind in ("posterior", "gaussian"):
        for what, names in (("parameters", NAMES), ("outputs", BEAT_OUTPUTS), ("predictions", BEAT_OUTPUTS)):
            inside = np.array([o[kind][what] for o in lines], dtype=float)
            totals[f"{kind} {what}"] = {
                "all": round(float(inside.mean()), 4),
                **dict(zip(names, inside.mean(axis=0).round(3).tolist(), strict=True)),
            }
    totals["seconds a patient"] = round(float(np.median([o["seconds"] for o in lines])), 1)
    return totals


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--patients", type=int, default=100)
    parser.add_argument("--method", choices=("importance", "nuts"), default="importance")
    parser.add_argument("--from-prior", action="store_true")
    run(
        parser,
        lambda chosen: range(1000, 1000 + chosen.patients),
        lambda seed, chosen: one_patient(
            seed, chosen.method, patient_from_prior if chosen.from_prior else plausible_patient
        ),
        summary,
    )


if __name__ == "__main__":
    main()
