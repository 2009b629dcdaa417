"""A long benchmark as a file with a line for each seed: a run that was stopped goes on where it ended."""

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
    """Compute what the file lacks, as far as the seconds go, and print the summary of all its lines.

    Args:
        parser: of the benchmark's own options; `--seconds` and `--out` are added.
        seeds: of the options.
        compute: a line, with its "seed", from a seed and the options.
        summary: of all lines.
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
