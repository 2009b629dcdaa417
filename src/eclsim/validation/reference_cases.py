"""The 26 reference cases: eclsim's steady beat and the last beats of long runs of the published code."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Iterable
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.files import read_table
from eclsim.paper.comparison import Check, Explanation, Row, within
from eclsim.paper.printed import AT_CASE, MEDIAN, TEXT, OfScheme, OverSchemes, Printed
from eclsim.reporting.beat_values import beat_mean, scalar

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.cases.case import Case
    from eclsim.orbit.model import Model


DATA = Path(str(files("eclsim.validation") / "data"))
"""Folder of the embedded data."""
PROTOCOLS: dict[str, Any] = tomllib.loads((DATA / "protocols.toml").read_text(encoding="utf-8"))
"""Cases used by the parts of `eclsim validate`, and titles of the comparisons."""
PAPER_PATIENT: str = PROTOCOLS["reference"]["paper_patient"]
"""The patient of Table S-4 at 3425 rpm, with CRRT connected as in scheme g."""
QUICK = tuple(PROTOCOLS["reference"]["quick"])
"""Cases of `validate --quick`: one for each kind of circuit."""

RELATIVE = 0.005
ABSOLUTE = {"mmHg": 0.1, "L/min": 0.02, "mL": 0.5}
"""Tolerance of an output: half a percent, or this value if larger."""
SHARE_OF_RANGE = 0.01
WAVEFORM_ABSOLUTE = {"P": 0.3, "Q": 2.0, "V": 0.5}
"""Tolerance of mean, minimum and maximum of a waveform: one percent of its range, or this if larger."""
WAVEFORM_UNITS = {"P": "mmHg", "Q": "mL/s", "V": "mL"}

EVIDENCE = 0.2
"""Largest error of the evidence of an explanation, as a share of the statistic's tolerance."""
PUBLISHED_LAWS = (
    "the published code smooths the valve law over 0.01 mmHg and lets chamber pressures lag by 0.08 ms; the "
    "same circuit integrated with these two laws gives the published number (data/published_laws.csv)"
)


def case_names() -> tuple[str, ...]:
    """Names of the 26 reference cases, in alphabetical order."""
    return tuple(sorted(file.stem for file in (DATA / "cases").glob("*.toml")))


def reference_case(name: str) -> Case:
    """Return a reference case without the warnings of reading it (some are deliberately unusual)."""
    from eclsim.cases.reading import read_case

    return read_case(DATA / "cases" / f"{name}.toml").case


def with_devices_of(patient: Case, other: Case) -> Case:
    """Return the patient with the devices of another case added."""
    return patient.model_copy(update={instance.key: instance.section for instance in other.instances()})


def reference_model(name: str) -> Model:
    """Circuit and values of a reference case."""
    from eclsim.orbit.model import model_of

    return model_of(reference_case(name))


@lru_cache(maxsize=64)
def reference_result(name: str) -> xr.Dataset:
    """eclsim's steady beat of a reference case."""
    from eclsim.outputs.results import simulate

    return simulate(reference_model(name))


@lru_cache(maxsize=1)
def expected_results() -> dict[str, Any]:
    """Outputs and waveform statistics of the published code, by case."""
    return json.loads((DATA / "expected.json").read_text(encoding="utf-8"))


def compared(name: str, rows: Iterable[Row]) -> Check:
    """Return a comparison that cannot fail the validation, with title, bar and remarks from `PROTOCOLS`."""
    about = PROTOCOLS["checks"][name]
    remarks = tuple(about.get("remarks", ()))
    key, title, bar = about.get("key", name), about["title"], about["bar"]
    return Check(key, title, bar, tuple(rows), required=False, remarks=remarks)


def sign(name: str, expected: float, got: float, source: str, explanation: Explanation | None = None) -> Row:
    """Row on whether a change has the measured direction."""
    signs = np.sign(expected), np.sign(got)
    return within(f"{name}: sign", *signs, 0.5, source=source, explanation=explanation)


def checks(quick: bool = False) -> list[Check]:
    """Compare outputs and waveforms of all cases, or of the quick ones."""
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


def output_rows(name: str) -> list[Row]:
    """Rows for the clinical outputs and chamber volumes of a case."""
    result, rows = reference_result(name), []
    for output, expected in expected_results()[name]["outputs"].items():
        unit = str(result[output].attrs["units"])
        tolerance = max(RELATIVE * abs(expected), ABSOLUTE[unit])
        rows.append(within(f"{name} {output}", expected, float(result[output]), tolerance, unit))
    return rows


def waveform_rows(name: str) -> list[Row]:
    """Rows for mean, minimum and maximum of every waveform of a case."""
    result, rows = reference_result(name), []
    for signal, expected in expected_results()[name]["waveforms"].items():
        tolerance = max(SHARE_OF_RANGE * (expected["max"] - expected["min"]), WAVEFORM_ABSOLUTE[signal[0]])
        for kind, value in waveform_statistics(result, signal).items():
            label, unit = f"{name} {signal} {kind}", WAVEFORM_UNITS[signal[0]]
            reason = explanation(label, expected[kind], value, tolerance)
            rows.append(within(label, expected[kind], value, tolerance, unit, explanation=reason))
    return rows


def waveform_statistics(result: xr.Dataset, signal: str) -> dict[str, float]:
    """Mean, minimum and maximum of a waveform over the beat."""
    about = result[signal].attrs
    return {"mean": about["mean"], "min": about["minimum"], "max": about["maximum"]}


@lru_cache(maxsize=1)
def _with_published_laws() -> dict[str, tuple[float, float]]:
    """Statistics with the published code's laws, and those with eclsim's laws at that time."""
    rows = read_table(DATA / "published_laws.csv")
    return {row["statistic"]: (float(row["value"]), float(row["eclsim"])) for row in rows}


def explanation(label: str, expected: float, got: float, tolerance: float) -> Explanation | None:
    """Reason for a missed waveform statistic, if shown to be the published valve and pressure lag.

    It is valid as long as the published laws give the published number, and eclsim's laws the number for
    which this was shown.
    """
    if label not in _with_published_laws():
        return None
    published, eclsim_value = _with_published_laws()[label]
    room, unit = EVIDENCE * tolerance, WAVEFORM_UNITS[label.split()[1][0]]
    return Explanation(
        PUBLISHED_LAWS,
        (
            within(f"{label}, with the published laws", expected, published, room, unit),
            within(f"{label}, with eclsim's laws, when this was shown", eclsim_value, got, room, unit),
        ),
    )


# --- the paper's patient: what `eclsim demo` simulates and compares -------------------------------

DEMO_RELATIVE = 0.02
DEMO_OUTPUTS = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO", "PF", "EDVRV", "ESVRV", "EDVLV", "ESVLV")
DEMO_MEDIANS = ("PF", "Psart", "Psvn")


def demo_rows(result: xr.Dataset) -> list[Row]:
    """Rows comparing the steady beat of `PAPER_PATIENT` with the paper's text and the published code.

    The text gives the ECMO flow and the CRRT pressures of scheme g. Its arterial and venous pressures are
    medians over all nine schemes, so those of scheme g alone are only close to them.
    """
    rows = [_demo_row(printed, result) for printed in TEXT if _of_the_demo(printed)]
    for name in DEMO_OUTPUTS:
        expected = expected_results()[PAPER_PATIENT]["outputs"][name]
        unit, tolerance = str(result[name].attrs["units"]), RELATIVE * expected
        source = "published code, 120 s"
        rows.append(within(name, expected, float(result[name]), tolerance, unit, source=source))
    return rows


def _of_the_demo(printed: Printed) -> bool:
    match printed.what:
        case OverSchemes(quantity, statistic, speed):
            return quantity in DEMO_MEDIANS and statistic == MEDIAN and speed == AT_CASE
        case OfScheme(scheme="g"):
            return not printed.other_data
    return False


def _demo_row(printed: Printed, result: xr.Dataset) -> Row:
    assert isinstance(printed.what, OverSchemes | OfScheme)
    name = printed.what.quantity
    value = scalar(result, name)
    tolerance = max(10.0**-printed.decimals, DEMO_RELATIVE * printed.value)
    median = ", median of nine schemes" if isinstance(printed.what, OverSchemes) else ""
    source = f"paper, section {printed.section.partition(',')[0]}{median}"
    got = beat_mean(result, name) if value is None else value
    return within(name, printed.value, got, tolerance, printed.unit, source=source)


def root(function: Callable[[float], float], low: float, high: float, xtol: float = 2e-12) -> float:
    """Zero of a function between two bounds, by Brent's method."""
    from scipy.optimize import brentq

    return float(np.asarray(brentq(function, low, high, xtol=xtol)))
