"""What figures read from a simulated case: means over the beat, and curves over two beats.

A case is an xarray Dataset with waveforms on `phase` (0 to 1, both ends included):
P [mmHg], Q [mL/s], V [mL].
"""

from typing import TYPE_CHECKING

import numpy as np

from eclsim.devices.registry import devices, namings
from eclsim.reporting.numbers import number
from eclsim.reporting.style import plain_text
from eclsim.units import convert, quantity_of

if TYPE_CHECKING:
    import xarray as xr


def beat_mean(result: "xr.Dataset", name: str) -> float:
    """Mean of a waveform over the beat, in the waveform's unit: the one measured with the steady beat.

    Of a waveform that was made otherwise, such as the difference of two, by the trapezoidal rule.
    """
    if "mean" in result[name].attrs:
        return float(result[name].attrs["mean"])
    phase = np.asarray(result["phase"].values, dtype=float)
    return float(np.trapezoid(result[name].values, phase) / (phase[-1] - phase[0]))


def beat_period(result: "xr.Dataset") -> float:
    """Length of the beat [s]."""
    time = np.asarray(result["time"].values, dtype=float)
    return float(time[-1] - time[0])


def two_beats(result: "xr.Dataset", name: str) -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and values of a waveform over two equal beats."""
    time = np.asarray(result["time"].values, dtype=float)
    time = time - time[0]
    values = np.asarray(result[name].values, dtype=float)
    return np.concatenate([time, time[1:] + time[-1]]), np.concatenate([values, values[1:]])


def in_unit(value: float, unit: str) -> float:
    """A pressure [mmHg], flow [mL/s] or volume [mL] of a result, in the unit that a figure shows."""
    return convert(value, "mL/s", unit) if quantity_of(unit) == "flow" else value


def scalar(result: "xr.Dataset", name: str) -> float | None:
    """A scalar output, or None where the result does not have it."""
    return float(result[name].values) if name in result and result[name].ndim == 0 else None


def case_name(result: "xr.Dataset") -> str:
    """The id of the case, safe to draw, and a warning where its beat was not found or is one of many."""
    name = plain_text(result.attrs.get("id", "case"), limit=44)
    if not int(result.attrs.get("converged", 1)):
        return f"{name} (NOT CONVERGED)"
    return f"{name} (VALVES SHUT: VOLUMES NOT DETERMINED)" if result.attrs.get("one_of_many") else name


def summary_lines(result: "xr.Dataset") -> list[str]:
    """The main outputs in words, such as "aortic pressure 73/69 (70) mmHg"; only those the result has."""
    lines = [f"heart rate {number(60 / beat_period(result), 0)} /min"]
    systolic, diastolic, mean = (scalar(result, name) for name in ("SP", "DP", "MAP"))
    if systolic is not None and diastolic is not None and mean is not None:
        lines.append(f"aortic pressure {number(systolic, 0)}/{number(diastolic, 0)} ({number(mean, 0)}) mmHg")
    for name, unit, digits in (
        ("MPAP", "mmHg", 1),
        ("PCWP", "mmHg", 1),
        ("CO", "L/min", 2),
        ("PF", "L/min", 2),
    ):
        value = scalar(result, name)
        if value is not None:
            lines.append(f"{name} {number(value, digits)} {unit}")
    for names in namings(device.key for device in devices().values()):
        share = scalar(result, f"{names.key}_recirculated_fraction")
        if share is not None:
            lines.append(f"{names.label} recirculation {number(100 * share, 0)} %")
    return lines
