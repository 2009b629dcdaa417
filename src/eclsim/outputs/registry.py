"""The registry of outputs: name, long name, unit, definition and computation."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, cast

from eclsim.circuit.network import HEART_RATE
from eclsim.devices.description import (
    GASES,
    BeatMeasures,
    Numbers,
    Output,
    highest,
    lowest,
    mean,
    mean_flow,
)
from eclsim.devices.device import Naming
from eclsim.devices.registry import (
    DeviceError,
    cached_by_devices,
    devices,
    is_of_user,
    named_output,
    naming_of,
    namings,
)
from eclsim.outputs.gas import GAS_OUTPUTS, RECIRCULATED
from eclsim.outputs.regulation import REGULATED, in_effect
from eclsim.parameters import regulation as keys
from eclsim.parameters.dialysed_drug import SIEVING
from eclsim.parameters.fluid import SOLUTES
from eclsim.spelling import spelling_hint
from eclsim.units import ML_S_PER_L_MIN


class UnknownOutputError(KeyError):
    """Raised for an unknown name, or for an output that a case lacks if all that it has are given as well.

    The message lists the nearest names, or says what the case needs.
    """

    def __str__(self) -> str:
        name, *had = self.args
        if had and find_output(name) is not None:
            return f"'{name}' is no output of this case{unavailable(name, *had)}"
        if name.endswith(RECIRCULATED):
            return f"'{name}' is computed by simulate only"
        hint = spelling_hint(name, had[0] if had else all_outputs())
        return f"'{name}' is not an output{hint}{'; `eclsim outputs` lists all' if had else ''}"


CHAMBERS = {"lv": "left ventricle", "rv": "right ventricle", "la": "left atrium", "ra": "right atrium"}
VALVES = {"ra": "tricuspid", "rv": "pulmonary", "la": "mitral", "lv": "aortic"}

_PRESSURES_AND_FLOWS = (
    highest("SP", "systolic arterial pressure", "Pao"),
    lowest("DP", "diastolic arterial pressure", "Pao"),
    mean("MAP", "mean arterial pressure", "Pao"),
    mean("MPAP", "mean pulmonary artery pressure", "Ppas"),
    mean("PCWP", "pulmonary capillary wedge pressure", "Ppvn"),
    Output(
        "CO", "native cardiac output", "L/min",
        "mean of Qpas: the flow through the pulmonary artery, and so through the lungs, whatever drives it",
        ("Qpas",), lambda m: m.mean("Qpas") / ML_S_PER_L_MIN, mean_of="Qpas",
    ),
)  # fmt: skip
_PULMONARY_PRESSURES_AND_VOLUMES = (
    highest("SPAP", "systolic pulmonary artery pressure", "Ppas"),
    lowest("DPAP", "diastolic pulmonary artery pressure", "Ppas"),
    *(
        make(prefix + place.upper(), f"{label} of the {chamber}", "V" + place, "mL")
        for place, chamber in CHAMBERS.items()
        for prefix, label, make in (
            ("EDV", "end-diastolic volume", highest),
            ("ESV", "end-systolic volume", lowest),
        )
    ),
)
"""With those of devices between them, these are the 17 outputs of the case-file format, in its order."""


def _ventricle(place: str) -> tuple[Output, ...]:
    p, v, label = "P" + place, "V" + place, CHAMBERS[place]
    needs = (p, v)
    stroke = lambda m: m.maximum(v) - m.minimum(v)  # noqa: E731  (shared by the entries below)
    energy = lambda m: 0.5 * m.largest_ratio(p, v) * m.minimum(v) ** 2  # noqa: E731  (likewise)
    return (
        Output(
            f"stroke_volume_{place}", f"stroke volume of the {label}", "mL", "EDV - ESV", needs, stroke, (v,),
        ),
        Output(
            f"ejection_fraction_{place}", f"ejection fraction of the {label}", "%", "(EDV - ESV) / EDV",
            needs,
            lambda m: 100.0 * stroke(m) / m.maximum(v), (v,),
        ),
        Output(
            f"stroke_work_{place}", f"stroke work of the {label}", "mmHg mL", "area of the PV loop",
            needs, lambda m: m.loop_area(p, v),
        ),
        Output(
            f"pressure_volume_area_{place}", f"pressure-volume area of the {label}", "mmHg mL",
            "stroke work + max(P / V) ESV^2 / 2 (Suga 1979, volume at zero pressure taken as 0)", needs,
            lambda m: m.loop_area(p, v) + energy(m), (v,),
        ),
        Output(
            f"end_diastolic_pressure_{place}", f"end-diastolic pressure of the {label}", "mmHg",
            f"{p} at phase 0, where the ventricles begin to contract", (p,), lambda m: m.at_start(p),
        ),
        highest(f"peak_pressure_{place}", f"peak pressure of the {label}", p),
    )  # fmt: skip


_REGIONS = (
    mean("upper_body_pressure", "mean pressure in the arteries of the upper body (right radial)", "Pupper"),
    mean("lower_body_pressure", "mean pressure in the arteries of the lower body (femoral)", "Plower"),
    mean("superior_caval_pressure", "mean pressure in the superior vena cava", "Psvc"),
    mean("inferior_caval_pressure", "mean pressure in the inferior vena cava", "Pivc"),
    mean_flow("upper_body_flow", "flow through the organs of the upper body", "Qupper"),
    mean_flow("lower_body_flow", "flow through the organs of the lower body", "Qlower"),
    *(
        Output(
            f"native_share_{place}",
            f"share of native blood in the {label}",
            "%",
            "from blood labelled at the mitral valve and where devices return to arteries, carried by the "
            "mean forward and backward flows of the beat",
            ("Qarchupper",),
            lambda m, place=place: 100.0 * m.native(place),
            all_flows=True,
            read_at=f"P{place}",
        )
        for place, label in (
            ("ao", "ascending aorta, which feeds the coronary arteries"),
            ("arch", "aortic arch"),
            ("upper", "arteries of the upper body: brain, right arm"),
            ("descending", "descending aorta"),
            ("lower", "arteries of the lower body"),
        )
    ),
)
"""Outputs of a patient with regions, which replace `venous_pressure` and `systemic_flow`."""


_REST, _SUPERIOR = "caval_rest_volume_ml", "svc_vessel_share"


def _filling(
    name: str, label: str, place: str, share: Callable[[BeatMeasures], Numbers], *read: str
) -> Output:
    """Output of the smallest volume of a collapsible vein, relative to its share of the rest volume."""
    signal = "V" + place
    return Output(
        name, f"lowest filling of the {label}", "%",
        f"minimum of {signal} relative to the volume below which it buckles", (signal,),
        lambda m: 100.0 * m.minimum(signal) / (share(m) * m.parameter(_REST)), (signal,),
        parameters=(_REST, *read),
    )  # fmt: skip


_COLLAPSIBLE = (
    _filling("caval_filling", "thoracic vena cava", "tvc", lambda m: 1.0),
    _filling(
        "superior_caval_filling", "superior vena cava", "tsvc", lambda m: m.parameter(_SUPERIOR), _SUPERIOR
    ),
    _filling(
        "inferior_caval_filling", "inferior vena cava", "tivc", lambda m: 1.0 - m.parameter(_SUPERIOR),
        _SUPERIOR,
    ),
)  # fmt: skip
"""Outputs of a patient with collapsible veins."""

OUTFLOW_TRACT_CM = 2.0
"""Width of the left ventricular outflow tract [cm], in adults 1.8 to 2.2 (textbooks)."""
SMALLEST_RATE = 1e-300
"""Added to the heart rate [1/min] in denominators: a rate of 0 is refused, and its beat has no numbers."""


def _vti(m: BeatMeasures) -> Numbers:
    period = 60.0 / (in_effect(HEART_RATE)(m) + SMALLEST_RATE)
    ejected = m.forward("lv") * ML_S_PER_L_MIN * period
    return ejected / (math.pi * (0.5 * OUTFLOW_TRACT_CM) ** 2)


_MORE = (
    Output(
        "pulse_pressure", "arterial pulse pressure", "mmHg", "SP - DP", ("Pao",),
        lambda m: m.maximum("Pao") - m.minimum("Pao"), ("Pao",),
    ),
    Output(
        "LVO", "output of the left ventricle itself", "L/min",
        "mean of Qlv, the flow through the aortic valve, without the flow of an assist device",
        ("Qlv",),
        lambda m: m.mean("Qlv") / ML_S_PER_L_MIN,
        mean_of="Qlv",
    ),
    Output(
        "LVOT_VTI", "velocity-time integral of the left ventricular outflow tract", "cm",
        "blood that passes the aortic valve forward in a beat, also that which leaks back, / area of an "
        f"outflow tract {OUTFLOW_TRACT_CM:g} cm wide", ("Qlv",), _vti,
        parameters=(HEART_RATE,), in_effect=True,
    ),
    mean_flow("pulmonary_flow", "flow through the lungs", "Qpart"),
    mean("right_atrial_pressure", "mean right atrial pressure", "Pra"),
    replace(mean("CVP", "central venous pressure", "Pra"), same_as="right_atrial_pressure"),
    mean("left_atrial_pressure", "mean left atrial pressure", "Pla"),
    mean("venous_pressure", "mean systemic venous pressure", "Psvn"),
    *_ventricle("lv"),
    *_ventricle("rv"),
    *(
        mean_flow(f"{valve}_valve_flow", f"mean flow through the {valve} valve", "Q" + at)
        for at, valve in VALVES.items()
    ),
    *(
        highest(f"peak_{valve}_valve_flow", f"peak flow through the {valve} valve", "Q" + at, "mL/s")
        for at, valve in VALVES.items()
    ),
    mean_flow("systemic_flow", "systemic flow, through all organs but the lungs", "Qsart"),
    *REGULATED,
    *_REGIONS,
    *_COLLAPSIBLE,
    mean("pericardial_pressure", "mean pressure in the pericardium", "Ppericardium"),
    mean_flow("bronchial_flow", "flow from the systemic arteries into the pulmonary veins", "Qbronchial"),
    *GAS_OUTPUTS,
)  # fmt: skip


_NAMED_BY = {
    **dict.fromkeys(("mean", "maximum", "minimum", "at_start"), ("signal",)),
    **dict.fromkeys(("maximum_before", "maximum_after"), ("signal", "parameter")),
    **dict.fromkeys(("largest_ratio", "loop_area"), ("signal", "signal")),
    **dict.fromkeys(("forward", "backward", "effective"), ("place",)),
    "parameter": ("parameter",),
    "gas": ("", "", "place"),
}
"""Kinds of the names that a measure of a beat takes first; the others take none of a device."""


class _RenamedMeasures:
    """The measures of a beat under the names of a device, converted to those of one instance."""

    def __init__(self, measures: BeatMeasures, names: Naming):
        self._measures, self._names = measures, names

    def __getattr__(self, measure: str) -> Any:
        method, kinds = getattr(self._measures, measure), _NAMED_BY.get(measure)
        if kinds is None:
            return method

        def renamed(*given: Any) -> Numbers:
            pairs = zip(kinds, given, strict=False)
            converted = (getattr(self._names, kind)(x) if kind else x for kind, x in pairs)
            return method(*converted, *given[len(kinds) :])

        return renamed

    def cached(self, key: tuple[str, ...], measure: Callable[[], Numbers]) -> Numbers:
        """Return a measure under a key of this instance."""
        return self._measures.cached((self._names.key, *key), measure)


@lru_cache(maxsize=1024)
def _of_instance(entry: Output, names: Naming) -> Output:
    """Return the output of a device for one instance."""
    if not names.name:
        return entry
    definition = entry.definition
    for signal in entry.needs:
        definition = definition.replace(signal, names.signal(signal))
    return replace(
        entry,
        name=names.output(entry.name),
        long_name=f"{entry.long_name}, {names.name}",
        definition=definition,
        needs=tuple(map(names.signal, entry.needs)),
        extremes=tuple(map(names.signal, entry.extremes)),
        parameters=tuple(map(names.parameter, entry.parameters)),
        read_at=entry.read_at and names.signal(entry.read_at),
        mean_of=entry.mean_of and names.signal(entry.mean_of),
        saturation_in=tuple(map(names.place, entry.saturation_in)),
        compute=lambda measures: entry.compute(cast("BeatMeasures", _RenamedMeasures(measures, names))),
    )


def leading_outputs(instances: Iterable[Naming] | None = None) -> tuple[Output, ...]:
    """The outputs at the beginning of every result file, in order; arguments as for `all_outputs`."""
    entries = [entry for entry in _of_devices(instances) if entry.in_contract]
    return (*_PRESSURES_AND_FLOWS, *entries, *_PULMONARY_PRESSURES_AND_VOLUMES)


def all_outputs(instances: Iterable[Naming] | None = None) -> dict[str, Output]:
    """All outputs by name, those of the case-file format first.

    Args:
        instances: instances of devices; None for the only instance of each device.
    """
    if instances is None:
        return dict(_usual())
    more = [entry for entry in _of_devices(instances) if not entry.in_contract]
    return {entry.name: entry for entry in (*leading_outputs(instances), *_MORE, *more)}


@cached_by_devices(8)
def _usual() -> Mapping[str, Output]:
    """All outputs of the patient and of the only instance of each device.

    Raises:
        DeviceError: A user's device has an output with the name of one of the patient's.
    """
    patients = all_outputs(())
    for key, device in devices().items():
        if taken := [entry.name for entry in device.outputs if entry.name in patients]:
            message = "the name of an output of the patient; choose another"
            raise DeviceError(f"device {key}, output {taken[0]!r}: {message}")
    return all_outputs([Naming(device) for device in devices().values()])


def _of_devices(instances: Iterable[Naming] | None) -> list[Output]:
    names = map(Naming, devices().values()) if instances is None else instances
    return [_of_instance(entry, naming) for naming in names for entry in naming.device.outputs]


def available(signals: Collection[str], parameters: Collection[str] = ()) -> tuple[Output, ...]:
    """Return the outputs that a circuit with these waveforms and parameters has."""
    groups = (".".join(signal[1:].split(".")[:2]) for signal in signals if "." in signal)
    instances = [*map(Naming, devices().values()), *namings(groups)]
    result = all_outputs(instances)
    return tuple(
        entry
        for entry in result.values()
        if all(name in signals for name in entry.needs) and all(p in parameters for p in entry.parameters)
    )


@cached_by_devices(4096)
def find_output(name: str) -> Output | None:
    """Return the output of a name; None if there is none."""
    result = _usual().get(name)
    if result is None and (known := named_output(name)) is not None:
        return _of_instance(known[1], known[0])
    return result


def output(name: str) -> Output:
    """Return the output of a name; the error for an unknown name lists similar ones."""
    result = find_output(name)
    if result is None:
        raise UnknownOutputError(name)
    return result


@cached_by_devices(1024)
def outputs_of_mean(signal: str, group: str) -> tuple[str, ...]:
    """Return the outputs that are the mean of a waveform, such as PF of the flow of the ECMO pump.

    Args:
        signal: name of the waveform.
        group: group of its place: "patient", or the device and its name.
    """
    return tuple(entry.name for entry in _outputs_beside(group) if entry.mean_of == signal)


@cached_by_devices(1024)
def saturations_in(place: str, group: str) -> tuple[str, ...]:
    """Return the outputs that are the oxygen saturation in a compartment, such as SaO2.

    Args:
        place: name of the compartment.
        group: its group: "patient", or the device and its name.
    """
    return tuple(entry.name for entry in _outputs_beside(group) if place in entry.saturation_in)


def _outputs_beside(group: str) -> Iterable[Output]:
    """Outputs of all unnamed devices and of the instance to which a group belongs."""
    names = naming_of(group)
    return (all_outputs() | all_outputs(() if names is None else (names,))).values()


def is_users_output(name: str) -> bool:
    """Whether an output is that of a device from outside the package."""
    known = named_output(name)
    return known is not None and is_of_user(known[0].device)


def computed(name: str, measures: BeatMeasures) -> Numbers:
    """Compute an output from the measures of a beat.

    Raises:
        DeviceError: The output of a user's device fails; names the output and what it may compute.
    """
    try:
        return output(name).compute(measures)
    except (KeyError, TypeError, ValueError) as error:
        if not is_users_output(name):
            raise
        allowed = "waveforms in its `needs`, `parameters`, + - * / ** and m.apply(function, [numbers])[0]"
        raise DeviceError(f"output {name!r}: {type(error).__name__}: {error}; allowed: {allowed}") from error


def first_name(name: str) -> str:
    """Name of an output; of the two names of a number, the one that has the limits."""
    entry = find_output(name)
    return name if entry is None else entry.same_as or name


def listed_as(name: str) -> str:
    """Name of an output in tables of limits, where a device has only one instance."""
    known = named_output(name)
    return first_name(name if known is None else known[1].name)


_REFLEX = "[regulation] baroreflex or chemoreflex"
PARTS = (
    ("[gas]", {GASES, keys.LUNG_RESISTANCE}),
    ("[dialysed_drug]", {SIEVING}),
    ("[solutes]", {f"{SOLUTES}.{bed}tissue_pco2_mmHg" for bed in ("", "upper_", "lower_")}),
    ("[physiology] regional = true", {*(s for one in _REGIONS for s in one.needs), "Vtsvc", "Vtivc"}),
    ("no [physiology] regional", {"Qsart", "Psvn", "Vtvc"}),
    ("[physiology] bronchial_fraction", {"Qbronchial"}),
    ("[physiology] collapsible_veins = true", {"Vtvc", "Vtsvc", "Vtivc"}),
    ("[physiology] pericardium = true", {"Ppericardium"}),
    (f"{_REFLEX}, [drugs] or [fluid]", {keys.UNSTRESSED}),
    (_REFLEX, {keys.GAIN}),
    (
        "[regulation] hypoxic_vasodilation or carbon_dioxide_response",
        set(map(keys.local_resistance, keys.BEDS)),
    ),
    ("[regulation] hypoxic_vasoconstriction", {keys.LUNG_RESISTANCE}),
)
"""Parts of a case file of the patient, and the waveforms and parameters of outputs that only they provide."""


def unavailable(name: str, names: Collection[str]) -> str:
    """Advice for an output that a case lacks: the part of the case file that provides it, or a spelling.

    Args:
        name: name of the output, as written.
        names: names of the outputs that the case has.

    Returns:
        The end of a sentence; empty if there is no advice.
    """
    entry = find_output(name)
    if entry is None:
        return spelling_hint(name, names)
    read, had = _reads([entry]), _reads(map(output, names))
    missing = [section for section, brings in PARTS if read & brings and not had & brings]
    known = named_output(name)
    if known is not None and not any(known[0].output(o.name) in names for o in known[0].device.outputs):
        missing.insert(0, f"[{known[0].key}]")
    return f"; it needs {' and '.join(missing)} in the case file" if missing else ""


def _reads(entries: Iterable[Output]) -> set[str]:
    return {name for entry in entries for name in (*entry.needs, *entry.parameters)}
