"""Resumable benchmarks: a file with one line per seed, to which an interrupted run is continued."""

import json
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterable
from pathlib import Path


def run(
    parser: ArgumentParser,
    seeds: Callable[[Namespace], Iterable[int]],
    compute: Callable[[int, Namespace], dict],
    summary: Callable[[list[dict]], dict],
) -> None:
    """Compute the lines missing in the file within the given seconds, and print the summary of all lines.

    Args:
        parser: parser of the benchmark's own options; `--seconds` and `--out` are added.
        seeds: function from the options to the seeds.
        compute: function from a seed and the options to a line, which includes its "seed".
        summary: function from all lines to their summary.
    """
    parser.add_argument("--seconds", type=float, default=280.0)
    parser.add_argument("--out", type=Path, required=True)
    chosen = parser.parse_args()
    started = time.monotonic()
    lines = [json.loads(line) for line in chosen.out.read_text().splitlines()] if chosen.out.exists() else []
    done = {line["seed"] for line in lines}
    for seed in seeds(chosen):
        if seed in done or time.monotonic() - started > chosen.seconds:
            continue
        lines.append(compute(seed, chosen))
        with chosen.out.open("a") as file:
            file.write(json.dumps(lines[-1]) + "\n")
    print(json.dumps(summary(lines), indent=1))
