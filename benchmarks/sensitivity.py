"""Speed of a Sobol analysis: runs, indices and files.

    python benchmarks/sensitivity.py CASE.toml [--samples 2048] [--dask local]

Prints one JSON object: seconds of the whole and of its parts, processor time per run, peak memory, runs that
failed, largest residual. It runs on whatever device JAX finds; the device is in the result.
"""

import argparse
import json
import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eclsim.execution import Executor

STARTED = time.perf_counter()


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("case")
    parser.add_argument("--samples", type=int, default=2048)
    parser.add_argument("--dask", default=None)
    chosen = parser.parse_args()

    from eclsim.execution import Distribution
    from eclsim.sensitivity.analysis import PRELOAD

    with Distribution(dask=chosen.dask).running(PRELOAD) as executor:
        print(json.dumps(measured(chosen, executor), indent=1))


def measured(chosen: argparse.Namespace, executor: "Executor") -> dict[str, object]:
    """Run the analysis and measure its time."""
    import jax

    from eclsim.cases import read_case
    from eclsim.execution import threads
    from eclsim.sensitivity.analysis import SobolSettings, plan_analysis, run_analysis
    from eclsim.sensitivity.results import indices_of_runs, write_results
    from eclsim.sensitivity.runs import SAMPLES

    plan = plan_analysis(read_case(chosen.case).case, SobolSettings(samples=chosen.samples))
    clock = [time.perf_counter()]
    if chosen.dask is None:
        plan.block(0)  # compiles, or loads what was compiled before
    clock.append(time.perf_counter())
    processor = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        result = run_analysis(plan, Path(folder), executor)
        write_results(Path(folder), result)
        clock.append(time.perf_counter())
        processor = time.process_time() - processor
        size = (Path(folder) / SAMPLES).stat().st_size
    indices_of_runs(result.design, result.indices.outputs, result.runs)
    clock.append(time.perf_counter())
    runs = plan.design.evaluations
    return {
        "device": str(jax.devices()[0]),
        "threads": threads(),
        "runs": runs,
        "failed": len(result.indices.failed),
        "seconds_import_and_plan": round(clock[0] - STARTED, 2),
        "seconds_first_block": round(clock[1] - clock[0], 2),
        "seconds_runs_indices_files": round(clock[2] - clock[1], 2),
        "seconds_whole": round(clock[2] - STARTED, 2),
        "seconds_indices": round(clock[3] - clock[2], 2),
        "processor_ms_per_run": round(1e3 * processor / runs, 4),
        "largest_residual": float(result.runs.residual.max()),
        "samples_mb": round(size / 1e6, 1),
        "peak_memory_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
        "python": sys.version.split()[0],
    }


if __name__ == "__main__":
    main()
