"""Record eclsim's published numbers, and compare a later state of the code with the record.

    python benchmarks/recorded_numbers.py record before.json
    python benchmarks/recorded_numbers.py compare before.json

All computations use the command line, whose interface is stable while the code changes: steady beats
of the 26 reference cases (outputs and statistics of all waveforms), the derivatives, Table 2 at a fixed seed,
the CRRT study of the paper's patient, and the fits of the first data points of the synthetic cohort. A number
that differs by more than 1e-9 of its size is listed; so is one that is there in only one of the two.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
CASES = ROOT / "src" / "eclsim" / "validation" / "data" / "cases"
COHORT = ROOT / "examples" / "synthetic_cohort.csv"
TOLERANCE = 1e-9
FLOOR = 5e-12
"""Numbers below this are rounding and count as zero."""
ROUGHER = {
    "/checks/2/": 3e-6,  # own central differences: rounding of orbits solved to 1e-12, over a step of 2e-5
    "/P01/": 1e-7,  # fits end within their tolerance of the minimum, where depends on rounding on the way
}
"""Prefixes of the paths of numbers that are less precise than `TOLERANCE`."""
UNCOMPARED = {
    "seconds", "beats", "residual", "version", "date", "machine", "commit", "iterations", "sha256",
    "error_percent",
}  # fmt: skip
"""Keys of entries that describe the computation, not its results."""


def eclsim(*arguments: str, accepted: tuple[int, ...] = (0,)) -> str:
    """Run a command and return what it wrote to standard output."""
    done = subprocess.run(
        [sys.executable, "-c", "from eclsim.cli import main; main()", *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode not in accepted:
        raise SystemExit(f"eclsim {' '.join(arguments)}: exit status {done.returncode}\n{done.stderr}")
    return done.stdout


def reference_cases() -> object:
    """Outputs and waveform statistics of the reference cases, by case and policy."""
    files = [str(path) for path in sorted(CASES.glob("*.toml"))]
    names = [Path(file).stem for file in files]
    return {
        policy: dict(zip(names, _simulated(files, policy), strict=True))
        for policy in ("as_published", "patient_held")
    }


def _simulated(files: list[str], policy: str) -> list[object]:
    return json.loads(eclsim("simulate", *files, "--volume-policy", policy, "--json", "-"))["cases"]


def gradients() -> object:
    """Derivatives of the two cases whose derivatives are published."""
    return json.loads(eclsim("validate", "--only", "gradients", "--json", "-", accepted=(0, 1)))


def table_2() -> object:
    """Sensitivity indices of the paper's V-A patient at a fixed seed."""
    case = str(CASES / "va_ecmo_default.toml")
    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder) / "out")
        arguments = ("--samples", "512", "--seed", "1", "--no-figures", "--json", "-")
        return json.loads(eclsim("sensitivity", case, "--out", out, *arguments))


def crrt_study() -> object:
    """The nine schemes of the paper's patient, both policies."""
    case = str(CASES / "s4_crrt_g_3425.toml")
    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder) / "out")
        eclsim("crrt-study", case, "--volume-policy", "both", "--out", out)
        return {path.name: _csv(path) for path in sorted(Path(out).glob("**/*.csv"))}


def cohort(points: int) -> object:
    """Fits of the first data points of the synthetic cohort."""
    with tempfile.TemporaryDirectory() as folder:
        table, out = Path(folder) / "cohort.csv", Path(folder) / "out"
        lines = COHORT.read_text(encoding="utf-8").splitlines(keepends=True)
        table.write_text("".join(lines[: points + 1]), encoding="utf-8")
        eclsim("identify", str(table), "--out", str(out), accepted=(0, 1))
        whole = json.loads((out / "identification.json").read_text(encoding="utf-8"))
        return {result["id"]: result for result in whole["points"]}


def _csv(path: Path) -> list[dict[str, object]]:
    with path.open(encoding="utf-8", newline="") as file:
        return [{key: _number(cell) for key, cell in row.items()} for row in csv.DictReader(file)]


def _number(cell: str) -> object:
    try:
        return float(cell)
    except (TypeError, ValueError):
        return cell


def flat(value: object, path: str = "") -> dict[str, float]:
    """All numbers of nested mappings and lists, by their path."""
    if isinstance(value, bool) or value is None or isinstance(value, str):
        return {}
    if isinstance(value, int | float):
        return {path: float(value)}
    if isinstance(value, dict):
        pairs = [(str(key), child) for key, child in value.items() if str(key) not in UNCOMPARED]
    else:
        pairs = [(str(place), child) for place, child in enumerate(value)]  # type: ignore[arg-type]
    return {name: number for key, child in pairs for name, number in flat(child, f"{path}/{key}").items()}


def differences(before: dict[str, float], after: dict[str, float]) -> list[str]:
    """One line for each number that changed or that is in only one of the records."""
    lines = []
    for path in sorted(before.keys() | after.keys()):
        tolerance = next((share for start, share in ROUGHER.items() if path.startswith(start)), TOLERANCE)
        if path not in after:
            lines.append(f"{path}: was {before[path]!r}, is no longer there")
        elif path not in before:
            lines.append(f"{path}: new, {after[path]!r}")
        elif not _same(before[path], after[path], tolerance):
            lines.append(f"{path}: was {before[path]!r}, is {after[path]!r}")
    return lines


def _same(first: float, second: float, tolerance: float) -> bool:
    if math.isnan(first) and math.isnan(second):
        return True
    return abs(first - second) <= max(tolerance * max(abs(first), abs(second)), FLOOR)


PARTS = {"reference": reference_cases, "gradients": gradients, "table-2": table_2, "crrt-study": crrt_study}


def main() -> None:
    layout = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=layout)
    parser.add_argument("action", choices=["record", "compare"])
    parser.add_argument("file", type=Path)
    parser.add_argument("--only", action="append", choices=[*PARTS, "cohort"], help="only this part")
    parser.add_argument("--points", type=int, default=4, help="data points of the cohort to fit")
    arguments = parser.parse_args()
    parts = {**PARTS, "cohort": lambda: cohort(arguments.points)}
    before = json.loads(arguments.file.read_text(encoding="utf-8")) if arguments.action == "compare" else {}
    computed = {name: flat(parts[name]()) for name in arguments.only or parts}
    if arguments.action == "record":
        arguments.file.write_text(json.dumps(computed, indent=1), encoding="utf-8")
    changed = 0
    for name, numbers in computed.items():
        lines = differences(before.get(name, {}), numbers) if before else []
        missing = [line for line in lines if not line.partition(": ")[2].startswith("new")]
        changed += len(missing)
        print(f"{name}: {len(numbers)} numbers, {len(missing)} differ, {len(lines) - len(missing)} are new")
        print("".join(f"  {line}\n" for line in lines[:200]), end="")
    raise SystemExit(changed > 0)


if __name__ == "__main__":
    main()
