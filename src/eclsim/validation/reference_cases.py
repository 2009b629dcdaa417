"""The 26 reference cases: eclsim's steady beat against the last beats of long runs of the published code."""

from __future__ import annotations

import csv
import json
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.outputs.dataset import simulate
from eclsim.validation.cases import DATA, case_names, reference_model
from eclsim.validation.rows import Check, Explanation, Row, near

if TYPE_CHECKING:
    import xarray as xr

QUICK = (
    "cvs_healthy_75bpm", "cvs_default_120bpm", "va_ecmo_default", "vv_ecmo_3000",
    "s4_no_crrt_3425", "s4_crrt_g_3425", "lvad_hvad_2600",
)  # fmt: skip
"""Cases of `validate --quick`: one of each kind of circuit."""

RELATIVE = 0.005
ABSOLUTE = {"mmHg": 0.1, "L/min": 0.02, "mL": 0.5}
"""An output may be off by half a percent, or by this much."""
OF_RANGE = 0.01
WAVEFORM_ABSOLUTE = {"P": 0.3, "Q": 2.0, "V": 0.5}
"""Mean, minimum and maximum of a waveform may be off by one percent of its range, or by this much."""
WAVEFORM_UNITS = {"P": "mmHg", "Q": "mL/s", "V": "mL"}

EVIDENCE = 0.2
"""Share of a statistic's tolerance within which the evidence of an explanation must lie."""
PUBLISHED_LAWS = (
    "the published code rounds the valves off over 0.01 mmHg and lets chamber pressures lag by 0.08 ms; the "
    "same circuit integrated with these two laws gives its number (data/published_laws.csv)"
)


@lru_cache(maxsize=1)
def expected_results() -> dict[str, Any]:
    """Outputs and waveform statistics of the published code, by case."""
    return json.loads((DATA / "expected.json").read_text(encoding="utf-8"))


@lru_cache(maxsize=64)
def reference_result(name: str) -> xr.Dataset:
    """eclsim's steady beat of a reference case."""
    return simulate(reference_model(name))


def output_rows(name: str) -> list[Row]:
    """Clinical outputs and chamber volumes of a case."""
    result, rows = reference_result(name), []
    for output, expected in expected_results()[name]["outputs"].items():
        unit = str(result[output].attrs["units"])
        tolerance = max(RELATIVE * abs(expected), ABSOLUTE[unit])
        rows.append(near(f"{name} {output}", expected, float(result[output]), tolerance, unit))
    return rows


def waveform_rows(name: str) -> list[Row]:
    """Mean, minimum and maximum of every waveform of a case."""
    result, rows = reference_result(name), []
    phase = result["phase"].values
    for signal, expected in expected_results()[name]["waveforms"].items():
        series = result[signal].values
        got = {"mean": np.trapezoid(series, phase), "min": series.min(), "max": series.max()}
        tolerance = max(OF_RANGE * (expected["max"] - expected["min"]), WAVEFORM_ABSOLUTE[signal[0]])
        for kind, number in got.items():
            label, unit = f"{name} {signal} {kind}", WAVEFORM_UNITS[signal[0]]
            why = explanation(label, expected[kind], float(number), tolerance)
            rows.append(near(label, expected[kind], number, tolerance, unit, explanation=why))
    return rows


@lru_cache(maxsize=1)
def _with_published_laws() -> dict[str, tuple[float, float]]:
    """Statistics with the published code's laws, and those of eclsim's own that they were compared with."""
    with (DATA / "published_laws.csv").open(encoding="utf-8", newline="") as file:
        rows = csv.DictReader(file)
        return {row["statistic"]: (float(row["value"]), float(row["eclsim"])) for row in rows}


def explanation(label: str, expected: float, got: float, tolerance: float) -> Explanation | None:
    """Why a statistic of a waveform misses, where the published valve and pressure lag were shown to be why.

    It counts as long as the published laws give the published number, and eclsim's own laws the number that
    this was shown for.
    """
    if label not in _with_published_laws():
        return None
    published, own = _with_published_laws()[label]
    room, unit = EVIDENCE * tolerance, WAVEFORM_UNITS[label.split()[1][0]]
    return Explanation(
        PUBLISHED_LAWS,
        (
            near(f"{label}, with the published laws", expected, published, room, unit),
            near(f"{label}, with eclsim's laws, when this was shown", own, got, room, unit),
        ),
    )


def checks(quick: bool = False) -> list[Check]:
    """Outputs and waveforms of all cases, or of a few."""
    names = QUICK if quick else case_names()
    outputs = tuple(row for name in names for row in output_rows(name))
    waveforms = tuple(row for name in names for row in waveform_rows(name))
    return [
        Check(
            "outputs", f"Reference cases ({len(names)}): clinical outputs and chamber volumes",
            "0.5 %, or 0.1 mmHg, 0.02 L/min, 0.5 mL", outputs,
        ),
        Check(
            "waveforms", f"Reference cases ({len(names)}): mean, minimum and maximum of every waveform",
            "1 % of the range, or 0.3 mmHg, 2 mL/s, 0.5 mL; exceptions explained", waveforms,
            explained_pass=True,
        ),
    ]  # fmt: skip
