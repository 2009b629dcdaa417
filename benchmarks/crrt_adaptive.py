"""Compare the CRRT study with the independent adaptive solver, integrated until the beat is steady.

    python benchmarks/crrt_adaptive.py CASE.toml [--schemes all] [--speeds 1000,5000] [--policy as_published]

Prints the largest differences of the outputs of every scheme and speed, relative to the output, or to
5 mmHg, mL and L/min for smaller outputs.
"""

import argparse
import time

import numpy as np

from eclsim.cases import read_case
from eclsim.crrt_study.study import crrt_study
from eclsim.devices.crrt import Crrt
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate_adaptive

OUTPUTS = (
    "SP", "DP", "MAP", "MPAP", "PCWP", "CO", "PF", "EDVRV", "ESVRV", "crrt_access_pressure",
    "crrt_return_pressure", "drainage_pressure",
)  # fmt: skip
SMALL = {"CO": 0.5, "PF": 0.5}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("case")
    parser.add_argument("--schemes", default="all")
    parser.add_argument("--speeds", default="1000,3425,5000")
    parser.add_argument("--policy", default="as_published")
    chosen = parser.parse_args()
    case = read_case(chosen.case).case
    study = crrt_study(case, schemes=chosen.schemes, speeds=chosen.speeds, volume_policy=chosen.policy)
    worst, where, started = {}, {}, time.perf_counter()
    count = 0
    for scheme in study.schemes:
        lines = Crrt(
            flow_ml_min=study.crrt_flow_ml_min, access_site=scheme.access_site, return_site=scheme.return_site
        )
        model = model_of(case.model_copy(update={"crrt": lines}))
        for speed in study.means["speed"].values:
            exact = simulate_adaptive(model.with_values({"ecmo.speed_rpm": float(speed)}), chosen.policy)
            ours = study.means.sel(policy=chosen.policy, scheme=scheme.letter, speed=speed)
            if not (exact.attrs["converged"] and bool(ours["converged"])):
                print(f"{scheme.letter} {speed:.0f}: no steady beat ({exact.attrs['status']})")
                continue
            count += 1
            differences = {}
            for name in OUTPUTS:
                there = float(exact[name])
                differences[name] = abs(float(ours[name]) - there) / max(abs(there), SMALL.get(name, 5.0))
                if differences[name] > worst.get(name, -1.0):
                    worst[name], where[name] = differences[name], f"{scheme.letter}, {speed:.0f} rpm"
            largest = 100.0 * max(differences.values())
            waited = f"{exact.attrs['beats']} beats waited for, {time.perf_counter() - started:.0f} s"
            print(f"{scheme.letter} {speed:.0f}: largest {largest:.4f} %, {waited}", flush=True)
    for name in OUTPUTS:
        print(f"{name:22} {100.0 * worst[name]:8.4f} %   {where[name]}")
    seconds = time.perf_counter() - started
    print(
        f"{count} beats, {chosen.policy}; largest {100 * np.max(list(worst.values())):.4f} %; {seconds:.0f} s"
    )


if __name__ == "__main__":
    main()
