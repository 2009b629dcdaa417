"""Coverage of 90 % intervals of shunt, oxygen consumption and mixing: nine in ten should contain the truth.

    python benchmarks/gas_coverage.py --patients 100 --out gas_coverage.jsonl --seconds 280

Simulated patients on V-V ECMO, drawn from the prior, are measured once with noise: MAP, cardiac output, pump
flow and blood gases. Intervals are computed by weighted draws of the posterior and by its Gaussian
approximation; two parameters of the circulation are unknown as well. Every patient is a line of the output
file; an interrupted run, or one that reached its time limit, continues there when started again.
"""

import argparse
import time

import numpy as np
from resumable import run

from eclsim.cases.reading import read_mapping
from eclsim.identification.density import PosteriorDensity, Prior, gaussian_approximation
from eclsim.identification.importance import importance_sample
from eclsim.identification.objective import Box
from eclsim.orbit.model import model_of
from eclsim.outputs.uncertainty import measurement_errors

CASE = {
    "format": 1,
    "patient": {
        "id": "twin", "sex": "male", "age_years": 50, "height_cm": 178, "weight_kg": 80, "heart_rate_bpm": 95,
    },
    "gas": {"haemoglobin_g_dl": 10.0, "fio2": 0.5, "alveolar_ventilation_l_min": 2.5},
    "ecmo": {
        "pump": "Rotaflow", "speed_rpm": 2900, "oxygenator": "Quadrox-i Adult", "mode": "VV",
        "drainage_site": "ra", "drainage_fr": 25, "return_fr": 21, "sweep_l_min": 4.0,
    },
}  # fmt: skip
BOUNDS = {
    "gas.shunt_fraction": (0.5, 0.05, 0.95), "gas.vo2_ml_min": (220.0, 120.0, 400.0),
    "ecmo.drainage_mixing": (0.5, 0.05, 0.95), "Emaxlv": (2.8, 1.4, 5.6), "Rmc": (0.5, 0.3, 0.8),
}  # fmt: skip
NAMES = tuple(BOUNDS)
MEASURED = ("MAP", "CO", "PF", "SaO2", "PaO2", "PaCO2", "SvO2", "SpreO2", "PpostO2")
LEAST_PAO2 = 25.0
"""Limit of a survivable patient [mmHg]; patients beyond it are drawn again."""
EXPLORED, MAXIMISATIONS, INTERVAL_DRAWS = 256, 3, 400


def one_patient(seed: int) -> dict:
    started, random = time.perf_counter(), np.random.default_rng(seed)
    model, prior = model_of(read_mapping(CASE).case), Prior.within(Box.of(BOUNDS))
    drawn = PosteriorDensity(model, dict.fromkeys(MEASURED, 0.0), dict.fromkeys(MEASURED, 1.0), prior)
    z = random.standard_normal((8, len(NAMES)))
    outputs = drawn.simulate(z)
    alive = np.isfinite(outputs).all(axis=1) & (outputs[:, MEASURED.index("PaO2")] > LEAST_PAO2)
    truth, exact = z[alive][0], dict(zip(MEASURED, outputs[alive][0].tolist(), strict=True))
    errors = measurement_errors(exact)
    noisy = {n: v + errors[n] * random.standard_normal() for n, v in exact.items()}
    noisy |= {n: min(v, 100.0) for n, v in noisy.items() if n.startswith("S")}
    posterior = PosteriorDensity(model, noisy, errors, prior)
    points = random.uniform(-1.8, 1.8, (EXPLORED, len(NAMES)))
    levels = posterior.potential(points, posterior.simulate(points))
    gaussian = gaussian_approximation(posterior, prior.x_of(points[np.argsort(levels)[:MAXIMISATIONS]]))
    weighted = importance_sample(posterior, gaussian, seed=seed)
    draws = {
        "posterior": weighted.z[weighted.resample(10 * INTERVAL_DRAWS, seed)],
        "gaussian": gaussian.draws(10 * INTERVAL_DRAWS, seed),
    }
    values = prior.values_of(truth)
    record = {
        "seed": seed, "doubts": list(weighted.doubts), "effective": weighted.effective,
        "truth": values.tolist(), "exact": exact,
    }  # fmt: skip
    for kind, chosen in draws.items():
        low, middle, high = np.quantile(prior.values_of(chosen), (0.05, 0.5, 0.95), axis=0)
        record[kind] = {
            "inside": ((low <= values) & (values <= high)).tolist(),
            "width": (high - low).tolist(), "error": (middle - values).tolist(),
        }  # fmt: skip
    return record | {"seconds": time.perf_counter() - started}


def summary(lines: list[dict]) -> dict:
    found: dict = {"patients": len(lines), "doubted": sum(bool(o["doubts"]) for o in lines)}
    for kind in ("posterior", "gaussian"):
        for what, of in (("inside", np.mean), ("width", np.median), ("error", np.median)):
            each = np.array([o[kind][what] for o in lines], dtype=float)
            each = np.abs(each) if what == "error" else each
            found[f"{kind} {what}"] = dict(zip(NAMES, of(each, axis=0).round(3).tolist(), strict=True))
        gas = np.array([o[kind]["inside"][:3] for o in lines], dtype=float)
        found[f"{kind} shunt, consumption and mixing"] = round(float(gas.mean()), 4)
    return found | {"seconds a patient": round(float(np.median([o["seconds"] for o in lines])), 1)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--patients", type=int, default=100)
    run(parser, lambda chosen: range(chosen.patients), lambda seed, _: one_patient(seed), summary)


if __name__ == "__main__":
    main()
