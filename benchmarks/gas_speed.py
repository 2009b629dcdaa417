"""Cost of gas exchange: one steady beat, derivatives of all outputs, a batch of 1024, with and without it.

    ECLSIM_THREADS=1 taskset -c 0 python benchmarks/gas_speed.py CASE.toml
    python benchmarks/gas_speed.py CASE.toml --sobol 1024

Both are measured alternately, so that other load of the machine affects both. Prints elapsed and processor
times, medians and minima of the repeats, in ms, for the batch per patient. With `--sobol` it runs instead a
second-order analysis of SaO2 and PaCO2 with so many rows, 24 inputs of the circulation and 12 of gas exchange
(V-V ECMO). For a ratio to an older eclsim, run it with the older sources first in PYTHONPATH.
"""

import statistics
import sys
import time
from dataclasses import replace

import numpy as np

from eclsim.cases import read_case
from eclsim.gas.network import gas_exchanges
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.steady_beat import steady_beat
from eclsim.sensitivity.analysis import SobolSettings, plan_analysis, sensitivity
from eclsim.sensitivity.inputs import CARDIOVASCULAR
from eclsim.validation.timing import MEMBERS, SPREAD

INPUTS = (
    "gas.haemoglobin_g_dl", "gas.base_excess_mmol_l", "gas.temperature_c", "gas.respiratory_quotient",
    "gas.fio2", "gas.alveolar_ventilation_l_min", "gas.shunt_fraction", "gas.vo2_ml_min", "ecmo.sweep_l_min",
    "ecmo.fdo2", "ecmo.drainage_mixing", "ecmo.oxygenator.oxygen_transfer",
)  # fmt: skip


def in_turn(functions, repeats: int) -> list[tuple[float, ...]]:
    """Median and least elapsed, median and least processor milliseconds of each function."""
    for function in [*functions, *functions]:
        function()
    taken = [[] for _ in functions]
    for _ in range(repeats):
        for function, column in zip(functions, taken, strict=True):
            start, cpu = time.perf_counter(), time.process_time()
            function()
            column.append((1e3 * (time.perf_counter() - start), 1e3 * (time.process_time() - cpu)))
    return [
        tuple(f(side) for side in zip(*column, strict=True) for f in (statistics.median, min))
        for column in taken
    ]


def shown(name: str, times: list[tuple[float, ...]], scale: float = 1.0) -> None:
    plain, gas = (np.array(one) / scale for one in times)
    words = ("elapsed median", "elapsed least", "processor median", "processor least")
    for word, a, b in zip(words, plain, gas, strict=True):
        print(f"{name:12} {word:17} {a:8.3f} {b:8.3f} ms   +{b - a:.3f} ms   {b / a:.2f} times")


def sobol(case: str, rows: int) -> None:
    """Runs, failed ones, elapsed and processor seconds, programs from the cache or compiled before."""
    settings = SobolSettings(samples=rows, include=INPUTS, outputs=("SaO2", "PaCO2"))
    plan = plan_analysis(read_case(case).case, settings)
    plan.block(0)
    start, cpu = time.perf_counter(), time.process_time()
    found = sensitivity(case, settings=settings)
    wall, cpu = time.perf_counter() - start, time.process_time() - cpu
    print(
        f"{len(found.runs.status)} runs, {len(plan.design.inputs)} inputs, {(found.runs.status != 0).sum()} "
        f"failed: {wall:.1f} s, {cpu:.1f} s of processor time"
    )


def main() -> None:
    if sys.argv[2:3] == ["--sobol"]:
        return sobol(sys.argv[1], int(sys.argv[3]))
    gas = model_of(read_case(sys.argv[1]).case)
    kept = tuple(e for e in gas.circuit.exchanges if e not in gas_exchanges(gas.circuit))
    models = (replace(gas, circuit=replace(gas.circuit, exchanges=kept)), gas)
    shown("one beat", in_turn([lambda m=m: steady_beat(Batch.of(m)) for m in models], 25))
    beats = [steady_beat(Batch.of(m)) for m in models]
    shown("derivatives", in_turn([lambda b=b: b.linearise(b.names, CARDIOVASCULAR) for b in beats], 25))
    random = np.random.default_rng(1)
    factors = {n: random.uniform(1 - SPREAD, 1 + SPREAD, MEMBERS) for n in CARDIOVASCULAR if n in gas.values}

    def many(model):
        values = {**model.values, **{n: model.values[n] * f for n, f in factors.items()}}
        return lambda: steady_beat(Batch(model.circuit, values, MEMBERS), start=model.values)

    shown("batch", in_turn([many(m) for m in models], 5), MEMBERS)


if __name__ == "__main__":
    main()
