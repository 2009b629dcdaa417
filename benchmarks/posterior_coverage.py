"""Do 90 % intervals hold the truth nine times in ten? Made-up patients, measured once with noise.

    python benchmarks/posterior_coverage.py --patients 100 --out coverage.jsonl --seconds 280

Intervals of the parameters, of the outputs without noise, and of the outputs at another pump speed; by
weighted draws of the posterior (`--method importance`), by chains (`nuts`, minutes a patient), beside either
by the Gaussian approximation. Every patient is a line of the output file; a run that was stopped, or that ran
out of its seconds, goes on where it ended.
"""

import argparse
import time

import numpy as np
from resumable import run
from simulated_patients import NAMES, simulated_patient

from eclsim.identification.density import PosteriorDensity, Prior, approximate
from eclsim.identification.importance import importance_sample
from eclsim.identification.nuts import Sampling, diagnose, sample
from eclsim.identification.posterior import predict
from eclsim.identification.quantities import OF_THE_BEAT, measurement_errors
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.steady_beat import steady_beat
from eclsim.parameters.thiel2025 import BOUNDS

PREDICTED = 400
SHORT = Sampling(chains=4, warmup=300, draws=250)


def prior_of() -> Prior:
    table = np.log(np.array([tuple(b) for b in BOUNDS.values()]))
    return Prior(NAMES, *table.T)


def starts(posterior: PosteriorDensity, seed: int) -> np.ndarray:
    """Best of some random points; the truth plays no part."""
    z = np.random.default_rng(seed).uniform(-1.8, 1.8, (400, len(NAMES)))
    levels = posterior.potential(z, posterior.simulate(z))
    return posterior.prior.x_of(z[np.argsort(levels)[:4]])


def one_patient(seed: int, method: str) -> dict:
    started = time.perf_counter()
    point = simulated_patient(seed)
    prior, model = prior_of(), model_of(point.case)
    measured = {n: getattr(point.case.measurements, n) for n in OF_THE_BEAT}
    posterior = PosteriorDensity(model, measured, measurement_errors(measured), prior)
    gaussian = approximate(posterior, starts(posterior, seed))
    weighted = importance_sample(posterior, gaussian, seed=seed)
    doubts = weighted.doubts
    z = weighted.z[weighted.resample(PREDICTED, seed)]
    if method == "nuts":
        chains = sample(posterior, weighted.proposals, SHORT)
        doubts = diagnose(NAMES, chains.z, chains.statistics).doubts
        z = chains.z.reshape(-1, len(NAMES))
        z = z[:: max(1, len(z) // PREDICTED)]
    faster = model.with_values({"ecmo.speed_rpm": 1.15 * model.values["ecmo.speed_rpm"]})
    truth = {n: point.truth[n] for n in NAMES}
    at_speed = steady_beat(Batch(faster.circuit, {**faster.values, **truth}, 1), OF_THE_BEAT).values[:, 0]
    record = {"seed": seed, "doubts": list(doubts), "shape": weighted.shape, "effective": weighted.effective}
    for kind, draws in (("posterior", z), ("gaussian", gaussian.draws(PREDICTED, seed))):
        parameters = dict(zip(NAMES, np.exp(prior.x_of(draws)).T, strict=True))
        here, there_now = (predict(m, parameters, OF_THE_BEAT) for m in (model, faster))
        limits = np.quantile(np.stack(list(parameters.values()), axis=1), (0.05, 0.95), axis=0)
        values = np.array([point.truth[n] for n in NAMES])
        outputs = np.array([point.outputs[n] for n in OF_THE_BEAT])
        record[kind] = {
            "parameters": _inside(limits[0], values, limits[1]),
            "outputs": _inside(here.intervals[:, 0], outputs, here.intervals[:, 2]),
            "predictions": _inside(there_now.intervals[:, 0], at_speed, there_now.intervals[:, 2]),
        }
    return record | {"seconds": time.perf_counter() - started}


def _inside(lower, value, upper) -> list[bool]:
    return [bool(a <= v <= b) for a, v, b in zip(lower, value, upper, strict=True)]


def summary(lines: list[dict]) -> dict:
    found = {"patients": len(lines), "doubted": sum(bool(o["doubts"]) for o in lines)}
    for kind in ("posterior", "gaussian"):
        for what, names in (("parameters", NAMES), ("outputs", OF_THE_BEAT), ("predictions", OF_THE_BEAT)):
            inside = np.array([o[kind][what] for o in lines], dtype=float)
            found[f"{kind} {what}"] = {
                "all": round(float(inside.mean()), 4),
                **dict(zip(names, inside.mean(axis=0).round(3).tolist(), strict=True)),
            }
    found["seconds a patient"] = round(float(np.median([o["seconds"] for o in lines])), 1)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--patients", type=int, default=100)
    parser.add_argument("--method", choices=("importance", "nuts"), default="importance")
    run(
        parser,
        lambda chosen: range(1000, 1000 + chosen.patients),
        lambda seed, chosen: one_patient(seed, chosen.method),
        summary,
    )


if __name__ == "__main__":
    main()
