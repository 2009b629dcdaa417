"""What gas exchange adds: one steady beat, derivatives of all outputs, a batch of 1024, with and without it.

    ECLSIM_THREADS=1 taskset -c 0 python benchmarks/gas_speed.py CASE.toml

Both are measured in turn, so that what else the machine does falls on both. Elapsed and processor time,
medians and least of the repeats, in ms; of the batch for each patient. For a ratio to an older eclsim run the
same with its sources first in PYTHONPATH.
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
from eclsim.validation.timing import MEMBERS, PARAMETERS, SPREAD


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


def shown(name: str, found: list[tuple[float, ...]], scale: float = 1.0) -> None:
    plain, gas = (np.array(one) / scale for one in found)
    words = ("elapsed median", "elapsed least", "processor median", "processor least")
    for word, a, b in zip(words, plain, gas, strict=True):
        print(f"{name:12} {word:17} {a:8.3f} {b:8.3f} ms   +{b - a:.3f} ms   {b / a:.2f} times")


def main() -> None:
    gas = model_of(read_case(sys.argv[1]).case)
    kept = tuple(e for e in gas.circuit.exchanges if e not in gas_exchanges(gas.circuit))
    models = (replace(gas, circuit=replace(gas.circuit, exchanges=kept)), gas)
    shown("one beat", in_turn([lambda m=m: steady_beat(Batch.of(m)) for m in models], 25))
    beats = [steady_beat(Batch.of(m)) for m in models]
    shown("derivatives", in_turn([lambda b=b: b.linearise(b.names, PARAMETERS) for b in beats], 25))
    random = np.random.default_rng(1)
    factors = {n: random.uniform(1 - SPREAD, 1 + SPREAD, MEMBERS) for n in PARAMETERS if n in gas.values}

    def many(model):
        values = {**model.values, **{n: model.values[n] * f for n, f in factors.items()}}
        return lambda: steady_beat(Batch(model.circuit, values, MEMBERS), start=model.values)

    shown("batch", in_turn([many(m) for m in models], 5), MEMBERS)


if __name__ == "__main__":
    main()
