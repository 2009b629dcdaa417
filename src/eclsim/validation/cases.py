"""The embedded reference cases."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.orbit.model import Model

DATA = Path(str(files("eclsim.validation") / "data"))
"""Folder of the embedded data."""

PAPER_PATIENT = "s4_crrt_g_3425"
"""The patient of Table S-4 at 3425 rpm, CRRT connected as in scheme g."""


def case_names() -> tuple[str, ...]:
    """Names of the 26 reference cases, in alphabetical order."""
    return tuple(sorted(file.stem for file in (DATA / "cases").glob("*.toml")))


def reference_case(name: str) -> Case:
    """A reference case, without the warnings of reading it (some are unusual on purpose)."""
    from eclsim.cases.reading import read_case

    return read_case(DATA / "cases" / f"{name}.toml").case


def reference_model(name: str) -> Model:
    """Circuit and values of a reference case."""
    from eclsim.orbit.model import model_of

    return model_of(reference_case(name))
