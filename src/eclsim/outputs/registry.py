"""The registry of outputs: name, long name, unit, definition and how it is computed."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from eclsim.outputs.measures import Measures
from eclsim.units import ML_S_PER_L_MIN


@dataclass(frozen=True)
class Output:
    """One number per beat.

    Args:
        name: key; the paper's where it has one.
        long_name: in words.
        unit: unit of the number.
        definition: how it follows from the waveforms.
        needs: waveforms without which it does not exist.
        compute: from the measures of a beat.
        extremes: waveforms whose largest or smallest value it reads, so that their rates are wanted too.
    """

    name: str
    long_name: str
    unit: str
    definition: str
    needs: tuple[str, ...]
    compute: Callable[[Measures], Any]
    extremes: tuple[str, ...] = ()


class UnknownOutputError(KeyError):
    """A name that is in no registry; lists the nearest ones."""

    def __str__(self) -> str:
        name = self.args[0]
        near = difflib.get_close_matches(name, REGISTRY, n=3, cutoff=0.5)
        hint = f"; did you mean {', '.join(near)}?" if near else ""
        return f"'{name}' is no output; allowed: {', '.join(REGISTRY)}{hint}"


def _mean(name: str, long_name: str, signal: str) -> Output:
    return Output(name, long_name, "mmHg", f"mean of {signal}", (signal,), lambda m: m.mean(signal))


def _max(name: str, long_name: str, signal: str, unit: str = "mmHg") -> Output:
    return Output(
        name, long_name, unit, f"maximum of {signal}", (signal,), lambda m: m.maximum(signal), (signal,)
    )


def _min(name: str, long_name: str, signal: str, unit: str = "mmHg") -> Output:
    return Output(
        name, long_name, unit, f"minimum of {signal}", (signal,), lambda m: m.minimum(signal), (signal,)
    )


def _flow(name: str, long_name: str, signal: str) -> Output:
    definition = f"mean of {signal}"
    return Output(name, long_name, "L/min", definition, (signal,), lambda m: m.mean(signal) / ML_S_PER_L_MIN)


CHAMBERS = {
    "lv": "left ventricle",
    "rv": "right ventricle",
    "la": "left atrium",
    "ra": "right atrium",
}
VALVES = {"ra": "tricuspid", "rv": "pulmonary", "la": "mitral", "lv": "aortic"}

CONTRACT = (
    _max("SP", "systolic arterial pressure", "Pao"),
    _min("DP", "diastolic arterial pressure", "Pao"),
    _mean("MAP", "mean arterial pressure", "Pao"),
    _mean("MPAP", "mean pulmonary artery pressure", "Ppas"),
    _mean("PCWP", "pulmonary capillary wedge pressure", "Ppvn"),
    Output(
        "CO",
        "native cardiac output",
        "L/min",
        "mean of Qpas: the flow through the pulmonary artery, and so through the lungs, whatever drives it",
        ("Qpas",),
        lambda m: m.mean("Qpas") / ML_S_PER_L_MIN,
    ),
    _flow("PF", "ECMO pump flow", "Qecmopump"),
    _max("SPAP", "systolic pulmonary artery pressure", "Ppas"),
    _min("DPAP", "diastolic pulmonary artery pressure", "Ppas"),
    *(
        make(prefix + place.upper(), f"{words} of the {chamber}", "V" + place, "mL")
        for place, chamber in CHAMBERS.items()
        for prefix, words, make in (
            ("EDV", "end-diastolic volume", _max),
            ("ESV", "end-systolic volume", _min),
        )
    ),
)
"""The 17 outputs of the case-file contract, in its order."""


def _ventricle(place: str) -> tuple[Output, ...]:
    p, v, words = "P" + place, "V" + place, CHAMBERS[place]
    needs = (p, v)
    stroke = lambda m: m.maximum(v) - m.minimum(v)  # noqa: E731  (shared by the entries below)
    energy = lambda m: 0.5 * m.largest_ratio(p, v) * m.minimum(v) ** 2  # noqa: E731  (likewise)
    return (
        Output(
            f"stroke_volume_{place}", f"stroke volume of the {words}", "mL", "EDV - ESV", needs, stroke, (v,),
        ),
        Output(
            f"ejection_fraction_{place}", f"ejection fraction of the {words}", "%", "(EDV - ESV) / EDV",
            needs,
            lambda m: 100.0 * stroke(m) / m.maximum(v), (v,),
        ),
        Output(
            f"stroke_work_{place}", f"stroke work of the {words}", "mmHg mL", "area of the PV loop",
            needs, lambda m: m.loop_area(p, v),
        ),
        Output(
            f"pressure_volume_area_{place}", f"pressure-volume area of the {words}", "mmHg mL",
            "stroke work + max(P / V) ESV^2 / 2 (Suga 1979, volume at zero pressure taken as 0)", needs,
            lambda m: m.loop_area(p, v) + energy(m), (v,),
        ),
        Output(
            f"end_diastolic_pressure_{place}", f"end-diastolic pressure of the {words}", "mmHg",
            f"{p} at phase 0, where the ventricles begin to contract", (p,), lambda m: m.at_start(p),
        ),
        _max(f"peak_pressure_{place}", f"peak pressure of the {words}", p),
    )  # fmt: skip


def _difference(name: str, long_name: str, high: str, low: str) -> Output:
    definition = f"mean of {high} - {low}"
    return Output(name, long_name, "mmHg", definition, (high, low), lambda m: m.mean(high) - m.mean(low))


MORE = (
    Output(
        "pulse_pressure", "arterial pulse pressure", "mmHg", "SP - DP", ("Pao",),
        lambda m: m.maximum("Pao") - m.minimum("Pao"), ("Pao",),
    ),
    Output(
        "LVO", "output of the left ventricle itself", "L/min",
        "mean of Qlv, what passes the aortic valve; an LVAD's flow comes on top", ("Qlv",),
        lambda m: m.mean("Qlv") / ML_S_PER_L_MIN,
    ),
    _flow("pulmonary_flow", "flow through the lungs", "Qpart"),
    _mean("right_atrial_pressure", "mean right atrial pressure", "Pra"),
    _mean("left_atrial_pressure", "mean left atrial pressure", "Pla"),
    _mean("venous_pressure", "mean systemic venous pressure", "Psvn"),
    *_ventricle("lv"),
    *_ventricle("rv"),
    *(
        _flow(f"{valve}_valve_flow", f"mean flow through the {valve} valve", "Q" + at)
        for at, valve in VALVES.items()
    ),
    *(
        _max(f"peak_{valve}_valve_flow", f"peak flow through the {valve} valve", "Q" + at, "mL/s")
        for at, valve in VALVES.items()
    ),
    _flow("systemic_flow", "systemic flow, through all organs but the lungs", "Qsart"),
    _flow("lvad_flow", "mean LVAD flow", "Qlvadpump"),
    _mean("lvad_head", "mean LVAD head", "Plvadpump"),
    _mean("drainage_pressure", "mean pressure in the ECMO drainage cannula", "Pecmodrain"),
    _min("lowest_drainage_pressure", "lowest pressure in the ECMO drainage cannula", "Pecmodrain"),
    _mean("pump_inlet_pressure", "mean pressure before the ECMO pump", "Pecmotudp"),
    _mean("post_pump_pressure", "mean pressure behind the ECMO pump", "Pecmotupo"),
    _mean("pump_head", "mean head of the ECMO pump", "Pecmopump"),
    _mean("pre_oxygenator_pressure", "mean pressure before the oxygenator", "Pecmooxy"),
    _mean("post_oxygenator_pressure", "mean pressure after the oxygenator", "Pecmotuor"),
    _difference("oxygenator_pressure_drop", "mean pressure drop of the oxygenator", "Pecmooxy", "Pecmotuor"),
    _mean("return_cannula_pressure", "mean pressure before the ECMO return cannula", "Pecmoreturn"),
    _flow("crrt_flow", "mean blood flow of the CRRT", "Qcrrtpump"),
    _mean("crrt_access_pressure", "mean pressure in the CRRT access line", "Pcrrttuin"),
    _mean("crrt_return_pressure", "mean pressure in the CRRT return line", "Pcrrttuout"),
    _difference("crrt_filter_pressure_drop", "mean pressure drop of the dialyzer", "Pcrrtfil", "Pcrrttuout"),
)  # fmt: skip

REGISTRY: dict[str, Output] = {o.name: o for o in (*CONTRACT, *MORE)}


def available(waveforms: Any) -> tuple[Output, ...]:
    """Outputs that a circuit with these waveforms has."""
    return tuple(o for o in REGISTRY.values() if all(signal in waveforms for signal in o.needs))


def output(name: str) -> Output:
    """The output of that name; a misspelt one lists its neighbours."""
    if name not in REGISTRY:
        raise UnknownOutputError(name)
    return REGISTRY[name]
