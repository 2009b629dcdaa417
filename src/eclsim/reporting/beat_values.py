"""Values that figures and tables read from a simulated case: means, curves over two beats, marks of numbers.

A case is an xarray Dataset with waveforms P [mmHg], Q [mL/s] and V [mL] on `phase` (0 to 1, both ends
included).
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from eclsim.arguments import written
from eclsim.devices.description import CAUTION
from eclsim.devices.device import Naming
from eclsim.devices.registry import devices, naming_of, namings
from eclsim.outputs.limits import places_with_limits
from eclsim.outputs.registry import outputs_of_mean
from eclsim.reporting.numbers import number
from eclsim.reporting.style import PAGE_WIDTH_MM, fitted_title, plain_text
from eclsim.units import convert, quantity_of

if TYPE_CHECKING:
    import xarray as xr


def beat_mean(result: "xr.Dataset", name: str) -> float:
    """Return the mean of a waveform over the beat, in the waveform's unit, as stored with the steady beat.

    Without a stored mean, as for the difference of two waveforms, it is computed with the trapezoidal rule.
    """
    if "mean" in result[name].attrs:
        return float(result[name].attrs["mean"])
    phase = np.asarray(result["phase"].values, dtype=float)
    return float(np.trapezoid(result[name].values, phase) / (phase[-1] - phase[0]))


def beat_period(result: "xr.Dataset") -> float:
    """Return the duration of the beat [s]."""
    time = np.asarray(result["time"].values, dtype=float)
    return float(time[-1] - time[0])


def two_beats(result: "xr.Dataset", name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return time [s] and values of a waveform over two identical beats."""
    time = np.asarray(result["time"].values, dtype=float)
    time = time - time[0]
    values = np.asarray(result[name].values, dtype=float)
    return np.concatenate([time, time[1:] + time[-1]]), np.concatenate([values, values[1:]])


def in_unit(value: float, unit: str) -> float:
    """Convert a flow from mL/s to the unit shown in a figure; return pressures and volumes unchanged."""
    return convert(value, "mL/s", unit) if quantity_of(unit) == "flow" else value


def scalar(result: "xr.Dataset", name: str) -> float | None:
    """Return a scalar output; None if the result does not have it."""
    return float(result[name].values) if name in result and result[name].ndim == 0 else None


def check_beat(result: object) -> None:
    """Check that a result is the beat of one case, with its waveforms.

    Raises:
        TypeError: It is something else, such as the results of many cases.
    """
    import xarray as xr

    if not isinstance(result, xr.Dataset) or "phase" not in result.dims:
        what = "a Dataset without waveforms" if isinstance(result, xr.Dataset) else written(result)
        raise TypeError(f"{what} cannot be drawn; allowed: the beat of one case, from eclsim.simulate")


COMPARED = "compared"
"""Attribute of two results of a comparison: which of `SIDES` of a change it is."""
SIDES = ("before", "after")


def case_name(result: "xr.Dataset") -> str:
    """Printable id, before or after a change, with a warning if the beat was not found or is not unique."""
    return plain_text(result.attrs.get("id", "case"), limit=44) + _suffix(result)


def case_title(result: "xr.Dataset", suffix: str = "", width_mm: float = PAGE_WIDTH_MM) -> str:
    """Return the title of a figure of the case, as `case_name`; an id is cut only where the line is full."""
    return fitted_title(result.attrs.get("id", "case"), f"{_suffix(result)}{suffix}", width_mm)


def _suffix(result: "xr.Dataset") -> str:
    """What stands behind an id: before or after a change, and a doubt about the beat."""
    side = f", {result.attrs[COMPARED]}" if COMPARED in result.attrs else ""
    return side + _doubt(result)


def _doubt(result: "xr.Dataset") -> str:
    if not int(result.attrs.get("converged", 1)):
        return " (NOT CONVERGED)"
    return " (VALVES SHUT: VOLUMES NOT DETERMINED)" if result.attrs.get("one_of_many") else ""


DOUBTED = "*"
MARKS = {"collapse": "x", "alarm": "!", "warning": "!", "caution": DOUBTED}
"""Mark after a number in text by the kind of the most severe finding about it."""
FIGURE_MARKS = {"collapse": "✕", "alarm": "▲", "warning": "!", "caution": "†"}
"""Mark before a number in a figure, the same as on the bedside page."""
_MEANINGS = {"x": "x impossible in a patient", "!": "! beyond a limit", DOUBTED: "* to be read with care"}
_FIGURE_MEANINGS = {
    "✕": "✕ impossible in a patient", "▲": "▲ beyond a limit: alarm", "!": "! beyond a limit: warning",
    "†": "† to be read with care",
}  # fmt: skip


def marks_of(result: "xr.Dataset", *names: str) -> str:
    """Return the marks of outputs: of the most severe finding, and of a caution if a beat is possible."""
    return marks_for(*_findings(result, names))


def marks_for(kind: str, doubted: bool, marks: Mapping[str, str] = MARKS) -> str:
    """Return the marks for the kind of a finding ("" for none), and for whether a caution is beside it."""
    mark, care = marks.get(kind, ""), marks[CAUTION]
    return mark if mark in (marks["collapse"], care) or not doubted else f"{mark}{care}"


def figure_marks_of(result: "xr.Dataset", *names: str) -> str:
    """Return the marks of outputs in a figure."""
    return marks_for(*_findings(result, names), FIGURE_MARKS)


def figure_marks_in(cases: "Sequence[xr.Dataset]", name: str) -> str:
    """Return the marks of an output in a figure; of several cases, only whether any is in doubt."""
    marks = [figure_marks_of(case, name) for case in cases]
    care = FIGURE_MARKS[CAUTION]
    return marks[0] if len(marks) == 1 else care * any(care in mark for mark in marks)


def figure_marks_at(result: "xr.Dataset", signal: str, group: str) -> str:
    """Return the marks of the mean of a waveform in a figure; a pressure has all marks of its compartment.

    Args:
        result: the simulated case.
        signal: name of the waveform, a pressure or a flow.
        group: group of its place, "patient" or a device.
    """
    kind, doubted = _findings(result, outputs_of_mean(signal, group))
    if signal[0] == "P":
        scalars = tuple(str(name) for name, values in result.data_vars.items() if values.ndim == 0)
        place = signal[1:]
        limited = (*places_with_limits(scalars).get(place, ()), f"EDV{place.upper()}")
        others = (_findings(result, [name])[0] for name in limited)
        # A caution on the ejection fraction is none on the pressure.
        kind = _gravest([kind, *(other for other in others if other != CAUTION)])
    return marks_for(kind, doubted, FIGURE_MARKS)


def marked(marks: str, text: str) -> str:
    """Return a number with its marks before it, as on the bedside page."""
    return f"{marks} {text}" if marks and text else text


def _findings(result: "xr.Dataset", names: Iterable[str]) -> tuple[str, bool]:
    """Return the most severe kind of finding about any of the outputs, and whether there is a caution."""
    entries = [result[name].attrs for name in names if name in result]
    return _gravest(about.get("finding", "") for about in entries), any(
        about.get("read_with_care") for about in entries
    )


def _gravest(kinds: Iterable[str]) -> str:
    found = set(kinds)
    return next((kind for kind in MARKS if kind in found), "")


def meaning_of_figure_marks(marks: Iterable[str]) -> str:
    """Explanation of the marks of several numbers in a figure; empty if there are none."""
    used = "".join(marks)
    return ", ".join(meaning for mark, meaning in _FIGURE_MEANINGS.items() if mark in used)


def legend_of_figure_marks(marks: Iterable[str]) -> str:
    """Explanation of the marks in a figure without warnings beside them; empty if there are none."""
    meaning = meaning_of_figure_marks(marks)
    return f"{meaning}; the warnings of the results say why" if meaning else ""


def legend_of_marks(marks: Iterable[str]) -> str:
    """Explanation of the marks in a table, beside which warnings stand; empty if there are none."""
    used = "".join(marks)
    meaning = ", ".join(meaning for mark, meaning in _MEANINGS.items() if mark in used)
    return f"{meaning}: the warnings say why" if meaning else ""


_ARTERIAL = ("SP", "DP", "MAP", "pulse_pressure")
_SUMMARY = {"MPAP": ("mmHg", 1), "PCWP": ("mmHg", 1), "CO": ("L/min", 2), "PF": ("L/min", 2)}


def summary_lines(result: "xr.Dataset") -> list[str]:
    """Return the main outputs that the result has, such as "aortic pressure 73/69 (70) mmHg", with marks."""
    rate = marked(figure_marks_of(result, "heart_rate"), number(60 / beat_period(result), 0))
    lines = [f"heart rate {rate} /min"]
    systolic, diastolic, mean = (scalar(result, name) for name in ("SP", "DP", "MAP"))
    if systolic is not None and diastolic is not None and mean is not None:
        pressures = f"{number(systolic, 0)}/{number(diastolic, 0)} ({number(mean, 0)})"
        lines.append(f"aortic pressure {marked(figure_marks_of(result, *_ARTERIAL), pressures)} mmHg")
    for name, (unit, digits) in _SUMMARY.items():
        if (value := scalar(result, name)) is not None:
            lines.append(f"{name} {marked(figure_marks_of(result, name), number(value, digits))} {unit}")
    for names in namings(device.key for device in devices().values()):
        share = scalar(result, f"{names.key}_recirculated_fraction")
        if share is not None:
            lines.append(f"{names.label} recirculation {number(100 * share, 0)} %")
    return lines


def summary_marks(result: "xr.Dataset") -> list[str]:
    """Return the marks in the lines of `summary_lines`."""
    return [figure_marks_of(result, name) for name in ("heart_rate", *_ARTERIAL, *_SUMMARY)]


# --- words for compartments and connections ---------------------------------------------------------


COMPARTMENTS = {
    "ao": "aorta", "sart": "systemic arteries", "svn": "systemic veins", "arch": "aortic arch",
    "descending": "descending aorta", "upper": "upper body arteries", "lower": "lower body arteries",
    "svc": "superior vena cava", "ivc": "inferior vena cava", "tvc": "thoracic vena cava",
    "tsvc": "thoracic superior vena cava", "tivc": "thoracic inferior vena cava",
    "pericardium": "pericardium", "ra": "right atrium", "rv": "right ventricle", "pas": "pulmonary sinus",
    "part": "pulmonary arteries", "pvn": "pulmonary veins", "la": "left atrium", "lv": "left ventricle",
}  # fmt: skip

CONNECTIONS = {
    "ao": "aorta", "sart": "organs", "svn": "venous return", "arch": "descending aorta",
    "archupper": "arch vessels", "descending": "iliac arteries", "upper": "upper body",
    "lower": "lower body", "svc": "superior vena cava", "ivc": "inferior vena cava",
    "tvc": "thoracic vena cava", "tsvc": "thoracic superior vena cava",
    "tivc": "thoracic inferior vena cava", "bronchial": "bronchial return", "ra": "tricuspid valve",
    "rv": "pulmonary valve", "pas": "pulmonary artery", "part": "lungs", "pvn": "pulmonary veins",
    "la": "mitral valve", "lv": "aortic valve",
}  # fmt: skip


def naming_at(place: str) -> Naming | None:
    """Return the device instance of a compartment or connection; None if it belongs to the patient."""
    key, _, local = place.partition(".")
    if local:
        return naming_of(f"{key}.{local.partition('.')[0]}")
    return next((naming for naming in map(Naming, devices().values()) if naming.device_place(place)), None)


def instances_at(places: Iterable[str]) -> list[Naming]:
    """Return the device instances of compartments or connections, in the order of the registry."""
    result = {naming.key: naming for place in places if (naming := naming_at(place)) is not None}
    order = list(devices())
    return sorted(result.values(), key=lambda naming: order.index(naming.device.key))


def place_label_of(signal: str) -> str:
    """Return the displayed name of the place of a waveform."""
    kind, place = signal[0], signal[1:]
    names = naming_at(place)
    if kind == "P" and (place.endswith("pump") or (names is not None and place in names.pumps())):
        return "pressure rise over the pump"
    if names is not None:
        return names.place_label(signal)
    if kind == "P" and place in CONNECTIONS and place not in COMPARTMENTS:
        return f"pressure gained: {CONNECTIONS[place]}"
    return (CONNECTIONS if kind == "Q" else COMPARTMENTS).get(place, place)
