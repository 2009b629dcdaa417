"""Commands `eclsim reproduce` and `eclsim demo`: the paper's tables and figures, and its patient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from eclsim.cli.cases import names_of, read_usable_cohort
from eclsim.cli.console import Progress, fail, say, warn
from eclsim.cli.destination import (
    Destinations,
    Target,
    explaining_resume,
    reporting_write_errors,
    write_json_output,
)
from eclsim.cli.options import Distributed, argument, option
from eclsim.paper.reproduction import DEFAULT_EXPLORE, DEFAULT_SAMPLES, INDEX, PARTS, ReproductionSettings
from eclsim.reporting.numbers import text_table
from eclsim.spelling import spelling_hint

if TYPE_CHECKING:
    from eclsim.execution import Distribution
    from eclsim.paper.comparison import Row
    from eclsim.paper.reproduction import Reproduction


@dataclass(frozen=True, kw_only=True)
class ReproduceOptions(Distributed):
    """Options of `eclsim reproduce`."""

    folder: str | None = argument(None, "DIR", "The same as --out DIR.", show_default=False)
    out: str | None = option(None, "Folder to write to; created if necessary.", "--out", metavar="DIR")
    parts: str = option(
        ",".join(PARTS),
        "Parts besides the CRRT study (crrt, always done), separated by commas: sensitivity (Figures 3, S-1, "
        "S-3, S-4, Table 2), positions (Figures 7, S-5 to S-7), cohort (Table 1, Figures 4, S-2).",
        metavar="LIST",
    )
    samples: int = option(
        DEFAULT_SAMPLES, "Rows N of the sensitivity analyses, a power of two; the paper uses 2048.", minimum=2
    )
    explore: int = option(
        DEFAULT_EXPLORE,
        "Parameter sets explored per free parameter in the fits of the cohort; `eclsim identify` uses 1000.",
        minimum=2,
    )
    cohort: str | None = option(
        None,
        "Measurements to fit; default: the synthetic cohort, since those of the paper are not published.",
        metavar="COHORT.csv",
    )
    resume: bool = option(False, "Continue from the results in DIR/runs.", "--resume")
    force: bool = option(False, "Overwrite existing files and start again.", "--force")

    @property
    def locked_folder(self) -> tuple[str | None, str]:
        """The folder, named by either of two options, and the shard, as shards run side by side."""
        return self.out if self.out is not None else self.folder, super().locked_folder[1]


def reproduce(options: ReproduceOptions) -> None:
    """Recompute every table and figure of Thiel et al. 2025 and the numbers of its text.

    Writes index.html with all of them beside the printed values, and each as SVG or CSV, in a few minutes.
    Ctrl-C keeps finished results of the long parts; --resume continues.

    Exit status: 0 done, 2 bad input.
    """
    from eclsim.paper.report import as_object, write_reproduction
    from eclsim.paper.reproduction import RUNS
    from eclsim.paper.reproduction import reproduce as recompute

    folder, target, parts, distribution = _checked(options)
    cohort = None if options.cohort is None else Path(options.cohort)
    settings = ReproductionSettings(options.samples, options.explore, cohort)
    if options.cohort is not None:
        read_usable_cohort(options.cohort)
    with explaining_resume(folder), reporting_write_errors(folder), Progress() as progress:
        folder.mkdir(exist_ok=True)
        result = recompute(folder / RUNS, settings, parts, progress, distribution)
        write_reproduction(result, folder, progress)
    if write_json_output(as_object(result), target):
        _show(result)
    say(f"all figures and tables: {folder / INDEX}")


def _checked(o: ReproduceOptions) -> tuple[Path, Target, Sequence[str], Distribution]:
    from eclsim.paper.reproduction import RUNS, file_names

    if o.folder is not None and o.out is not None:
        fail(f"{o.folder} and --out {o.out}: two folders; give only one")
    places = Destinations(force=o.force, resume=o.continues)
    folder = places.folder("--out", o.locked_folder[0], (*file_names(), RUNS))
    target = places.target("--json", o.json)
    distribution = o.distribution(places.mistakes)
    if folder is None:
        fail("no output folder; give one, such as --out reproduction")
    parts = tuple(dict.fromkeys(names_of(o.parts) or ()))
    places.mistakes += [
        f"--parts '{name[:40]}': allowed: {', '.join(PARTS)}{spelling_hint(name, PARTS)}"
        for name in parts
        if name not in PARTS
    ]
    if o.samples & (o.samples - 1):
        places.mistakes.append(f"--samples {o.samples}: allowed: a power of two, such as 256 or 2048")
    places.check()
    return folder, target, parts, replace(distribution, force=not distribution.continues)


def _show(result: Reproduction) -> None:
    from eclsim.paper.comparison import Verdict
    from eclsim.paper.report import counts

    typer.echo(counts(result.rows))
    for row in result.rows:
        if row.verdict is Verdict.DIFFERS:
            typer.echo(f"  {row.source}: {row.name}: {both_values(row)}; {row.reason}")


def both_values(row: Row) -> str:
    """Format the paper's number and that of eclsim with their unit; a claim of the text is met or not."""
    from eclsim.paper.comparison import YES_NO

    if row.unit == YES_NO:
        return "ours: no"
    unit = "" if row.unit == "1" else f" {row.unit}"
    return f"paper {row.expected:g}{unit}, ours {row.got:.4g}{unit}"


# --- the paper's patient --------------------------------------------------------------------------

_TITLE = (
    "The patient of Table S-4, V-A ECMO at 3425 rpm, CRRT 200 mL/min from after to before the oxygenator "
    "(scheme g)"
)
_NOTE = """\
Psart, Psvn: arterial and venous pressure; Pcrrttuin, Pcrrttuout: CRRT access and return pressure;
means over the beat. The paper does not print this patient's sex, age, size and cannulae; the
published code was run with, and eclsim takes, a woman of 70 years, 165 cm, 60 kg, 21 and 17 Fr."""


@dataclass(frozen=True, kw_only=True)
class DemoOptions:
    """Options of `eclsim demo`."""

    out: str = option("demo-output", "Folder for the case file, results and figures.", "--out", metavar="DIR")
    png: bool = option(True, "Also write figures as PNG, not only SVG.", "--png/--no-png")


def demo(options: DemoOptions) -> None:
    """Simulate the patient of the paper's Table S-4 on V-A ECMO at 3425 rpm with CRRT (scheme g).

    Shows pressures [mmHg], flows [L/min] and volumes [mL] beside the paper's and writes the case file,
    results (NetCDF, JSON) and figures. Files of an earlier demo are replaced.
    """
    places = Destinations(force=True)
    folder = places.folder("--out", options.out, parents=True)
    places.check()
    if folder is None:
        return
    from eclsim.devices.registry import example_setting
    from eclsim.outputs.results import simulate
    from eclsim.simulation import files
    from eclsim.simulation.figures import write_case_figures
    from eclsim.validation.reference_cases import DATA, PAPER_PATIENT, demo_rows, reference_model

    model = reference_model(PAPER_PATIENT)
    result = simulate(model)
    typer.echo(f"{_TITLE}\n\n{_demo_table(demo_rows(result))}\n\n{_NOTE}")
    typer.echo(
        f"\nsteady beat found after {result.attrs['beats']} beats, residual {result.attrs['residual']:.1e}"
    )
    warn(result.attrs["warnings"])
    case = folder / f"{PAPER_PATIENT}.toml"
    with reporting_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        case.write_bytes((DATA / "cases" / case.name).read_bytes())
        files.write_json([result], folder / "results.json")
        files.write_netcdf([result], [], folder / "results.nc", None)
        formats = ("svg", "png") if options.png else ("svg",)
        figures = write_case_figures(model.circuit, result, folder, formats=formats)
    typer.echo(
        f"written to {folder}: {case.name}, results.json, results.nc and {len(figures)} figures, such as"
    )
    typer.echo("\n".join(f"  {path}" for path in figures if path.suffix == f".{formats[-1]}"))
    typer.echo(f"\nnext: eclsim simulate {case} --set {example_setting()}=4000")


def _demo_table(rows: Sequence[Row]) -> str:
    head = ("quantity", "expected", "eclsim", "unit", "error", "within", "expected from")
    cells = [
        (
            row.name, f"{row.expected:.4g}", f"{row.got:.4g}", row.unit, f"{row.percent:+.2f} %",
            "yes" if row.holds else "no", row.source,
        )
        for row in rows
    ]  # fmt: skip
    return text_table(head, cells, numeric=(1, 2, 4))
