"""How much of the paper is recomputed; loads nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

PARTS = ("crrt", "sensitivity", "positions", "cohort")
"""Parts of the paper: the CRRT study; sensitivity of the circulation; positions of the CRRT lines as inputs
of a sensitivity analysis; fits of the cohort."""
USUAL_SAMPLES, PAPER_SAMPLES = 512, 2048
USUAL_EXPLORE = 30


@dataclass(frozen=True)
class ReproductionSettings:
    """How much is computed.

    Args:
        samples: rows N of the sensitivity analyses; the paper has 2048.
        explore: explored sets of parameters for each free one in the fits of the cohort.
        cohort: table of measurements; None takes the synthetic cohort.
        resume: whether to go on with what is there.
    """

    samples: int = USUAL_SAMPLES
    explore: int = USUAL_EXPLORE
    cohort: Path | None = None
    resume: bool = False
