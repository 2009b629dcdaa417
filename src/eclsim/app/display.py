"""Content of the views of patient and devices: knobs, traces, key figures, curves of the ramp."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

from eclsim.app.knobs import VOLUME, connectable, controls, section_and_name
from eclsim.app.texts import ENGLISH, text
from eclsim.cases.case import Case
from eclsim.cases.resolve import circuit_of
from eclsim.cases.sections import PATIENT_SECTIONS
from eclsim.circuit import Circuit
from eclsim.devices.description import Control, Curve, KeyFigure, Knob, Output, Sample, Sweep, Trace, Views
from eclsim.devices.registry import device_of, devices, naming_of, parameter_of
from eclsim.gas.network import gas_exchanges
from eclsim.outputs.alarms import device_returning_to_pulmonary_artery
from eclsim.outputs.gas import artery_of, recirculation_labels
from eclsim.outputs.limits import NO_VALUES, limits_of
from eclsim.outputs.registry import all_outputs
from eclsim.parameters.adult_ranges import Sex, adult_ranges
from eclsim.patient.anthropometry import AGE, SIZE
from eclsim.reporting.saturation import COLOUR_STOPS, text_colour_on
from eclsim.units import with_micro_sign


def _figure(
    key: str, output: str, unit: str, digits: int, limits: tuple[str, ...] = (),
    extremes: tuple[str, ...] = (), unlike: str = "",
) -> KeyFigure:  # fmt: skip
    return KeyFigure(key, text(f"key_{key}"), output, unit, digits, limits, extremes, unlike)


LUNGS = "lungs"
"""Key of the tile of lung flow, which is CO unless a device returns to the pulmonary artery."""
PATIENT = Views(
    traces=(
        Trace(
            "Pao", text("Pao"), text("Pao_long"), "pressure", ("SP", "DP"),
            ((0.0, 150.0), (0.0, 200.0), (0.0, 300.0)),
        ),
        Trace(
            "Ppas", text("Ppas"), text("Ppas_long"), "pressure", ("SPAP", "DPAP"),
            ((0.0, 40.0), (0.0, 80.0), (0.0, 160.0)),
        ),
        Trace(
            "Pra", text("Pra"), text("Pra_long"), "mean", ("right_atrial_pressure",),
            ((0.0, 20.0), (-10.0, 30.0), (-20.0, 60.0)),
        ),
    ),
    figures=(
        _figure("MAP", "MAP", "mmHg", 0, limits=("MAP", "pulse_pressure"), extremes=("SP", "DP")),
        _figure("CO", "CO", "L/min", 2),
        _figure("LVO", "LVO", "L/min", 2, unlike="CO"),
        _figure(LUNGS, "pulmonary_flow", "L/min", 2, unlike="CO"),
        _figure("MPAP", "MPAP", "mmHg", 0),
        _figure("PCWP", "PCWP", "mmHg", 0),
        _figure("CVP", "right_atrial_pressure", "mmHg", 0),
        _figure("EF", "ejection_fraction_lv", "%", 0),
        _figure("SaO2", "SaO2", "%", 0),
        _figure("SaO2_lower", "SaO2_lower", "%", 0),
        _figure("PaCO2", "PaCO2", "mmHg", 0),
    ),
    curves=(
        Curve("MAP", text("key_MAP"), "pressure"),
        Curve("MPAP", text("key_MPAP"), "pressure"),
        Curve("PCWP", text("key_PCWP"), "pressure"),
        Curve("right_atrial_pressure", text("key_CVP"), "pressure"),
        Curve("CO", text("key_CO"), "flow"),
    ),
    compared=(
        "SP", "DP", "MAP", "MPAP", "PCWP", "right_atrial_pressure", "CO", "ejection_fraction_lv", "EDVLV",
        "stroke_work_lv", "SaO2", "SaO2_lower", "PaCO2", "SvO2", "DO2",
    ),
    samples=(
        *(
            Sample(place, text(label), {"SO2": "SaO2", "PO2": "PaO2", "PCO2": "PaCO2", "pH": "pHa"})
            for place, label in (("sart", "sample_mixed"), ("upper", "sample_radial"))
        ),
        Sample(
            "lower", text("sample_femoral"),
            {"SO2": "SaO2_lower", "PO2": "PaO2_lower", "PCO2": "PaCO2_lower"},
        ),
        Sample("ao", text("sample_ao")),
        Sample("pvn", text("sample_pvn")),
        Sample("pas", text("sample_pas"), {"SO2": "SvO2"}),
        *(Sample(place, text(f"sample_{place}")) for place in ("svn", "svc", "ivc")),
    ),
)  # fmt: skip
_COLOURS = (
    "#FF8A70", "#F0E442", "#6CC3F5", "#3BD3A5", "#FFB733", "#E4E7EC", "#E7A6CC", "#B5D334", "#BFA0EE",
    "#FF9A5C", "#58CFE6",
)  # fmt: skip
"""Colours of traces on the dark monitor background: the patient's, then those of devices."""
_INKS = 4
"""Number of device colours in the style sheet."""
_UNITS = {"C": "°C", "%/C": "%/°C", "cm2": "cm²"}
"""Units of knobs that are written differently from case files."""
LOOPS = ("Plv", "Vlv", "Prv", "Vrv")


def ink(group: str) -> str:
    """Return the style-sheet colour of a part of the circuit."""
    device = device_of(group)
    return f"device-{_order(device.key) % _INKS + 1}" if device else group


def waves_of(case: Case) -> tuple[str, ...]:
    """Return the waveforms that the browser draws."""
    return (*(trace.signal for _, views in _displays(case) for trace in views.traces), *LOOPS)


def curves_of(case: Case) -> list[tuple[int, Curve]]:
    """Return the curves of the ramp, each with a number for its colour and dash, the same in all circuits."""
    shown = _displays(case)
    firsts = _numbered_by_device(shown, lambda views: views.curves)
    label = _label_of_output(case)
    return [
        (first + k, replace(c, label=label) if c.output == "CO" else c)
        for first, (_, views) in zip(firsts, shown, strict=True)
        for k, c in enumerate(views.curves)
    ]


def plain_curves(case: Case, outputs: Collection[str]) -> list[dict[str, Any]]:
    """Return the curves that have numbers, with their limits, for the browser."""
    return [
        {
            "name": curve.output, "label": curve.label, "panel": curve.panel, "number": number,
            "short": curve.short, "limits": bounds(curve.limited_by) if curve.limited_by else [],
        }
        for number, curve in curves_of(case)
        if curve.output in outputs
    ]  # fmt: skip


def sweep_of(case: Case) -> Sweep | None:
    """Return the speed that the ramp sweeps, with its case-file key: that of the first device with one."""
    for instance in case.instances():
        if sweep := instance.device.sweep(instance.section):
            return replace(sweep, key=f"{instance.key}.{sweep.key}")
    return None


def display(case: Case) -> dict[str, Any]:
    """Return groups of knobs, traces, key figures and outputs to compare, for the browser."""
    shown = _displays(case)
    return {
        "groups": _groups(case), "traces": _plain_traces(shown),
        "figures": [_plain_figure(figure) for figure in figures_of(case)],
        "specs": named_specs(case), "compared": compared_of(case),
        "samples": [vars(s) | {"outputs": dict(s.outputs)} for _, v in shown for s in v.samples],
        "exchangers": _exchangers(circuit_of(case)),
        "saturations": [[percent, colour, text_colour_on(percent)] for percent, colour in COLOUR_STOPS],
    }  # fmt: skip


def figures_of(case: Case) -> list[KeyFigure]:
    """Return the numbers that are always visible: arterial pressure, all flows, then the rest."""
    label = _label_of_output(case)
    mixed = artery_of(circuit_of(case)) == "sart"
    labels = {"CO": label} | ({"SaO2": text("key_SaO2_mixed")} if mixed else {})
    figures = [
        replace(figure, label=labels.get(figure.key, figure.label))
        for _, views in _displays(case)
        for figure in views.figures
        if figure.key != LUNGS or label != text("key_CO")
    ]
    flows = [figure for figure in figures[1:] if figure.unit == "L/min"]
    return [figures[0], *flows, *(figure for figure in figures[1:] if figure not in flows)]


def _label_of_output(case: Case) -> str:
    """Return the label of CO: the flow of the lungs only if no device returns to the pulmonary artery."""
    return text("key_CO_artery" if device_returning_to_pulmonary_artery(circuit_of(case)) else "key_CO")


def _exchangers(circuit: Circuit) -> dict[str, str]:
    """Return the labels of connections that exchange gas."""
    result = {}
    for exchange in gas_exchanges(circuit):
        names = naming_of(exchange.group)
        label = text(f"exchange_{exchange.at}") if names is None else names.place_label(f"Q{exchange.at}")
        result[exchange.at] = label if names is None else f"{names.device.name} {label}"
    return result


def _displays(case: Case) -> list[tuple[str, Views]]:
    """Return the views of the patient (key "") and of each device."""
    return [("", PATIENT), *((instance.device.key, instance.views()) for instance in case.instances())]


def _order(key: str) -> int:
    return list(devices()).index(key)


def _numbered_by_device(
    shown: Sequence[tuple[str, Views]], items: Callable[[Views], Sequence[object]]
) -> list[int]:
    """Return a number for the first item of each device, equal in all circuits, unique to an instance."""
    lengths = {key: len(items(device.views)) for key, device in devices().items()}
    firsts, known = [], []
    for key, _ in shown:
        before = sum(list(lengths.values())[: _order(key)]) + len(items(PATIENT)) if key else 0
        firsts.append(before + known.count(key) * sum(lengths.values()))
        known.append(key)
    return firsts


def _groups(case: Case) -> list[dict[str, str | bool]]:
    """Return the sections of the knob panel: each connectable device and each named instance."""
    groups = {key: text(f"group_{key}") for key in ("heart", "vessels")}
    for key, device in devices().items():
        if key in connectable():
            groups[key] = device.name
        groups |= {instance.key: instance.label for instance in case.instances() if instance.device is device}
    sections = {one.section: group_name(one.section) for one in PATIENT_SECTIONS}
    return [{"key": k, "label": label, "section": k in sections} for k, label in (groups | sections).items()]


def group_name(section: str) -> str:
    """Return the displayed name of a patient section's group of knobs."""
    return ENGLISH.get(f"group_{section}", section.capitalize())


def _plain_traces(shown: Sequence[tuple[str, Views]]) -> list[dict[str, Any]]:
    firsts = _numbered_by_device(shown, lambda views: views.traces)
    return [
        asdict(trace) | {"colour": _COLOURS[(first + k) % len(_COLOURS)]}
        for first, (_, views) in zip(firsts, shown, strict=True)
        for k, trace in enumerate(views.traces)
    ]


def _plain_figure(figure: KeyFigure) -> dict[str, Any]:
    entry = all_outputs().get(figure.output)
    return asdict(figure) | {
        "limits": figure.limits or (figure.output,), "extremes": figure.extremes or None,
        "text": figure.label if entry is None else entry.long_name,
    }  # fmt: skip


def described(control: Control) -> dict[str, Any]:
    """Return a knob or picker as plain data."""
    section, name = section_and_name(control.key)
    parameter = parameter_of(name, [control.group]) if section == "parameters" else None
    hint = f"{name}: {parameter.description}" if parameter else ""
    own = next((one for one in PATIENT_SECTIONS if one.section == section), None)
    hint = own.fields()[name].description if own else hint
    hint = text("volume_hint") if control.key == VOLUME else hint
    common = {"key": control.key, "group": control.group, "label": control.label, "hint": hint}
    if isinstance(control, Knob):
        return common | {
            "unit": unit_of(control), "low": control.low, "high": control.high,
            "step": control.step, "log": control.logarithmic,
        }  # fmt: skip
    return common | {"options": [list(option) for option in control.options]}


def unit_of(knob: Knob) -> str:
    """Return the unit beside a knob; a fraction is marked as a share of 1, since tiles are in percent."""
    is_share = not knob.unit and 0.0 <= knob.low < knob.high <= 1.0
    return text("unit_share") if is_share else written_unit(knob.unit)


def written_unit(unit: str) -> str:
    """Return a case-file unit as written on the page: °C, µg."""
    return _UNITS.get(unit, with_micro_sign(unit))


def panel_of(case: Case) -> list[dict[str, Any]]:
    """Return all knobs and pickers of a case as plain data, each with the label of its device."""
    labels = {instance.key: instance.label for instance in case.instances()}
    return [described(control) | {"device": labels.get(control.group, "")} for control in controls(case)]


def compared_of(case: Case) -> list[str]:
    """Return the outputs used to compare states."""
    return [output for _, views in _displays(case) for output in views.compared]


# --- usual ranges and limits --------------------------------------------------------------------

_CATHETER = "practical table of right heart catheterisation, European Respiratory Society"
_NURSING = "nursing reference of haemodynamic norms"

_FURTHER_RANGES: dict[str, tuple[float, float, str]] = {
    "SP": (90.0, 140.0, _NURSING),
    "DP": (60.0, 90.0, _NURSING),
    "DPAP": (4.0, 12.0, _CATHETER),
    "peak_pressure_rv": (15.0, 25.0, _CATHETER),
    "stroke_volume_lv": (50.0, 100.0, _NURSING),
}
"""Adult reference range of outputs that a fit does not judge, in their units, with its source."""


def reference_ranges(sex: Sex) -> dict[str, tuple[float, float, str]]:
    """Return adult reference ranges of outputs with their sources, the same as in the report of a fit."""
    judged = {name: (*one.healthy, one.source) for name, one in adult_ranges(sex).items()}
    result = {**_FURTHER_RANGES, **judged}
    return result | {n: result[o.same_as] for n, o in all_outputs().items() if o.same_as in result}


def bounds(quantity: str, values: Mapping[str, float] = NO_VALUES) -> list[dict[str, Any]]:
    """Return an output's limits as plain data, most serious first; with values, for the patient's size."""
    return [
        {"kind": limit.kind, "side": limit.side, "value": limit.value, "meaning": limit.meaning}
        for limit in limits_of(quantity, values=values)
    ]


def output_specs() -> dict[str, dict[str, Any]]:
    """Return label, unit and definition of every output, and limits for all patients, as plain data."""
    result = {name: _spec(entry, name, entry.long_name) for name, entry in all_outputs().items()}
    return result | {
        name: {"label": about["long_name"], "unit": about["units"], "definition": about["definition"]}
        for name, about in recirculation_labels().items()
    }


def named_specs(case: Case) -> dict[str, dict[str, Any]]:
    """Return the same for named device instances, and for ranges and limits that depend on the patient."""
    height, weight = case.patient.height_cm, case.patient.weight_kg
    own: dict[str, Mapping[str, float]] = {}
    if case.gas is not None and height is not None and weight is not None:
        own["DO2"] = dict(zip(SIZE, (height, weight), strict=True))
    if case.regulation is not None or case.drugs is not None:
        own["heart_rate"] = {AGE: case.patient.age_years}
    ranges = reference_ranges(case.patient.sex)
    outputs = all_outputs()
    specs = {name: _spec(outputs[name], name, outputs[name].long_name) for name in (*ranges, *own)}
    for name, ends_and_source in ranges.items():
        specs[name]["range"] = list(ends_and_source)
    for name, values in own.items():
        specs[name]["limits"] = bounds(name, values)
    for instance in (one for one in case.instances() if one.name):
        for entry in instance.device.outputs:
            name = instance.output(entry.name)
            specs[name] = _spec(entry, name, f"{entry.long_name}, {instance.label}")
    return specs


def _spec(entry: Output, name: str, label: str) -> dict[str, Any]:
    spec: dict[str, Any] = {"label": label, "unit": entry.unit, "definition": entry.definition}
    return spec | ({"limits": limits} if (limits := bounds(name)) else {})
