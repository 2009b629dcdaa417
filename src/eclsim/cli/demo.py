"""`eclsim demo`: the paper's patient, from nothing to figures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from eclsim.paper.comparison import Row


def demo(
    out: Annotated[
        str, typer.Option("--out", metavar="DIR", help="Folder for the case file, results and figures.")
    ] = "demo-output",
    png: Annotated[
        bool, typer.Option("--png/--no-png", help="Also write figures as PNG, not only SVG.")
    ] = True,
) -> None:
    """Simulate the patient of the paper's Table S-4 on V-A ECMO at 3425 rpm with CRRT (scheme g).

    Shows pressures [mmHg], flows [L/min] and volumes [mL] beside the paper's and writes the case file,
    results (NetCDF, JSON) and figures. Files of an earlier demo are replaced.
    """
    folder = _folder(out)
    from eclsim.outputs.dataset import simulate
    from eclsim.simulation import files
    from eclsim.simulation.figures import write_case_figures
    from eclsim.validation.reference_cases import DATA, PAPER_PATIENT, demo_rows, reference_model

    model = reference_model(PAPER_PATIENT)
    result = simulate(model)
    typer.echo(_table(demo_rows(result)))
    typer.echo(
        f"\nsteady beat found after {result.attrs['beats']} beats, residual {result.attrs['residual']:.1e}"
    )
    case = folder / f"{PAPER_PATIENT}.toml"
    case.write_bytes((DATA / "cases" / case.name).read_bytes())
    files.write_json([result], folder / "results.json")
    files.write_netcdf([result], [], folder / "results.nc", None)
    written = write_case_figures(model.circuit, result, folder, formats=("svg", "png") if png else ("svg",))
    typer.echo(
        f"written to {folder}: {case.name}, results.json, results.nc and {len(written)} figures, such as"
    )
    typer.echo("\n".join(f"  {path}" for path in written if path.suffix == (".png" if png else ".svg")))
    typer.echo(f"\nnext: eclsim simulate {case} --set ecmo.speed_rpm=4000")


def _folder(written: str) -> Path:
    from eclsim.cli.messages import fail

    folder = Path(written)
    if not written.strip():
        fail("--out: an empty name")
    if folder.exists() and not folder.is_dir():
        fail(f"--out {folder}: a file; a folder belongs here")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        fail(f"--out {folder}: {error.strerror or error}")
    return folder


def _table(rows: list[Row]) -> str:
    from eclsim.cli.tables import columns

    head = ("quantity", "expected", "eclsim", "unit", "error", "within", "expected from")
    body = [
        (
            row.name, f"{row.expected:.4g}", f"{row.got:.4g}", row.unit, f"{row.percent:+.2f} %",
            "yes" if row.holds else "no", row.source,
        )
        for row in rows
    ]  # fmt: skip
    title = (
        "The patient of Table S-4, V-A ECMO at 3425 rpm, CRRT 200 mL/min from after to before the oxygenator "
        "(scheme g)"
    )
    note = (
        "Psart, Psvn: arterial and venous pressure; Pcrrttuin, Pcrrttuout: CRRT access and return pressure;\n"
        "means over the beat. The paper does not print this patient's sex, age, size and cannulae: the\n"
        "published code was run with, and eclsim takes, a woman of 70 years, 165 cm, 60 kg, 21 and 17 Fr."
    )
    return f"{title}\n\n{columns(head, body, numeric=(1, 2, 4))}\n\n{note}"
