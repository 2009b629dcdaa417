"""Speed: the measurements of `eclsim benchmark`, for the paper's patient with V-A ECMO and CRRT.

Each number is the median of repetitions, as elapsed time and as processor time. If other programs run on the
machine, only processor time is meaningful. The published code was measured on one core of a two-core machine.
"""

from __future__ import annotations

import datetime
import json
import math
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from eclsim._version import __version__
from eclsim.validation.reference_cases import DATA, PAPER_PATIENT, reference_model

MEMBERS = 1024
SPREAD = 0.25
REPEATS = 15
PROCESS_REPEATS = 3
MEASURE_BATCH = "from eclsim.validation import timing; timing.print_batch()"


@dataclass(frozen=True)
class Measurement:
    """One measured time or memory size.

    Args:
        name: name of the measurement.
        value: median elapsed time, or memory.
        unit: "ms", "s" or "MB".
        bar: largest allowed value in the same unit; None if there is none.
        processor: median processor time in the same unit; None for memory.
        published: value of the published code in the same unit; None if there is none.
        remark: conditions of the measurement.
    """

    name: str
    value: float
    unit: str
    bar: float | None
    processor: float | None = None
    published: float | None = None
    remark: str = ""

    @property
    def holds(self) -> bool:
        """Whether the elapsed time or memory is within the bar."""
        return self.bar is None or self.value <= self.bar

    @property
    def ratio(self) -> float | None:
        """Speed relative to the published code; None if that is unknown."""
        return None if self.published is None else self.published / self.value

    def as_object(self) -> dict[str, object]:
        """Plain data for JSON."""
        return {
            "name": self.name, "value": self.value, "unit": self.unit, "processor_time": self.processor,
            "bar": self.bar, "holds": self.holds, "published_code": self.published,
            "times_faster": self.ratio, "remark": self.remark,
        }  # fmt: skip


def measurements() -> Iterator[Measurement]:
    """Yield all measurements, each as soon as it is done."""
    yield from first_results()
    yield warm_orbit()
    yield warm_derivatives()
    yield from batch()


def first_results() -> Iterator[Measurement]:
    """Measure a whole command, with an empty and with a filled cache of compiled programs."""
    cold, warm = [], []
    for _ in range(PROCESS_REPEATS):
        with tempfile.TemporaryDirectory(prefix="eclsim-benchmark-") as folder:
            cold.append(_command_seconds(folder))
            warm.append(_command_seconds(folder))
    remark = f"`eclsim simulate` from start to end, median of {PROCESS_REPEATS} new processes"
    names = ("first result of a new process, empty cache", "first result of a new process, filled cache")
    for name, measured, bar, published in zip(names, (cold, warm), (6.0, 3.5), (7.2, None), strict=True):
        wall, cpu = (statistics.median(column) for column in zip(*measured, strict=True))
        yield Measurement(name, wall, "s", bar, cpu if math.isfinite(cpu) else None, published, remark)


def _command_seconds(cache: str) -> tuple[float, float]:
    """Elapsed and processor seconds of one command."""
    case = DATA / "cases" / f"{PAPER_PATIENT}.toml"
    command = [sys.executable, "-m", "eclsim", "simulate", str(case), "--json", "-"]
    return _process(command, {"ECLSIM_CACHE_DIR": cache})[:2]


def _process(command: list[str], environment: dict[str, str]) -> tuple[float, float, str]:
    before, start = os.times(), time.perf_counter()
    done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True, check=True)
    wall, after = time.perf_counter() - start, os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return wall, cpu if os.name == "posix" else math.nan, done.stdout  # Windows counts no child processes


def warm_orbit() -> Measurement:
    """Measure one steady beat with everything compiled."""
    from eclsim.orbit.steady import Batch, solve

    single = Batch.of(reference_model(PAPER_PATIENT))
    wall, cpu = _medians(lambda: solve(single))
    beats = int(solve(single).beats[0])
    remark = f"{beats} beats from the circuit's nominal orbit; median of {REPEATS}"
    return Measurement("one steady beat, warm", wall, "ms", 10.0, cpu, 1740.0, remark)


def warm_derivatives() -> Measurement:
    """Measure derivatives of all outputs with respect to 24 parameters, with everything compiled."""
    from eclsim.orbit.steady import Batch
    from eclsim.outputs.steady_beat import steady_beat
    from eclsim.sensitivity.inputs import CARDIOVASCULAR

    beat = steady_beat(Batch.of(reference_model(PAPER_PATIENT)))
    outputs = beat.names
    wall, cpu = _medians(lambda: beat.linearise(outputs, CARDIOVASCULAR))
    name = f"derivatives of all {len(outputs)} outputs with respect to {len(CARDIOVASCULAR)} parameters, warm"
    remark = f"on a solved orbit; median of {REPEATS}; published code: 7 parameters, reverse mode"
    return Measurement(name, wall, "ms", 15.0, cpu, 13_900.0, remark)


def batch() -> Iterator[Measurement]:
    """Measure many orbits at once on one core, in a separate process to determine its memory.

    An earlier process fills the cache, since compilation takes 240 MB that are not needed again.
    """
    _, results = (
        json.loads(_process([sys.executable, "-c", MEASURE_BATCH], {"ECLSIM_THREADS": "1"})[2])
        for _ in range(2)
    )
    name = f"a steady beat in a batch of {MEMBERS}, one core"
    remark = (
        f"24 parameters by +-25 %; {results['converged']} of {MEMBERS} converged, "
        f"median {results['beats']:g} beats, largest {results['most_beats']}"
    )
    yield Measurement(name, results["wall_ms"], "ms", 0.6, results["cpu_ms"], 1740.0, remark)
    memory = results["memory_mb"]
    yield Measurement(
        "largest memory of that process", memory, "MB", 500.0, remark="JAX included, programs in the cache"
    )


def print_batch() -> None:
    """Measure the batch in this process and print the results as JSON."""
    import numpy as np

    from eclsim.orbit.steady import Batch, solve
    from eclsim.sensitivity.inputs import CARDIOVASCULAR

    model, random = reference_model(PAPER_PATIENT), np.random.default_rng(1)
    factors = {name: random.uniform(1.0 - SPREAD, 1.0 + SPREAD, MEMBERS) for name in CARDIOVASCULAR}
    values = {**model.values, **{name: model.values[name] * factor for name, factor in factors.items()}}
    many = Batch(model.circuit, values, MEMBERS)
    orbits = solve(many, start=model.values)
    wall, cpu = _medians(lambda: solve(many, start=model.values), 5)
    figures = {
        "wall_ms": wall / MEMBERS,
        "cpu_ms": cpu / MEMBERS,
        "converged": int((orbits.status == 0).sum()),
        "beats": float(np.median(orbits.beats)),
        "most_beats": int(orbits.beats.max()),
        "memory_mb": _largest_memory_mb(),
    }
    print(json.dumps(figures))


def _medians(function: Callable[[], object], repeats: int = REPEATS) -> tuple[float, float]:
    """Median elapsed and processor time [ms]; two calls before the measurement are not counted."""
    for _ in range(2):
        function()
    times = []
    for _ in range(repeats):
        start, cpu = time.perf_counter(), time.process_time()
        function()
        times.append((1e3 * (time.perf_counter() - start), 1e3 * (time.process_time() - cpu)))
    wall, processor = zip(*times, strict=True)
    return statistics.median(wall), statistics.median(processor)


def _largest_memory_mb() -> float:
    """Largest resident memory of this process so far; Linux's `ru_maxrss` counts the parent's before exec."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines()
        return next(float(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1e3
    except (OSError, StopIteration):
        if sys.platform == "win32":
            return math.nan
        import resource

        largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return largest / (1e6 if sys.platform == "darwin" else 1e3)


# --- description of the machine, printed beside every table of results ---------------------------


def machine() -> dict[str, str]:
    """Date, versions, kind of machine, and number of processes competing for it."""
    return {
        "date": datetime.date.today().isoformat(),
        "eclsim": __version__,
        "jax": version("jax"),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "processor": processor(),
        "load": f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown",
        "processors": str(
            len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
        ),
    }


def processor() -> str:
    """Name of the processor as reported by the system."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"
