"""What the views show of patient and devices: knobs, traces, key figures, curves of the ramp."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

from eclsim.app.knobs import connectable
from eclsim.app.ranges import bounds
from eclsim.app.texts import text
from eclsim.cases.resolve import circuit_of
from eclsim.devices.description import Control, Knob
from eclsim.parameters import default

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.circuit import Circuit

Range = tuple[float, float]


@dataclass(frozen=True)
class Trace:
    """A waveform of the monitor.

    Args:
        signal: name of the waveform.
        label: beside the trace.
        text: in full.
        form: what stands beside the trace: "pressure" (systolic, diastolic and mean), "mean" or "flow".
        outputs: the outputs behind these numbers.
        scales: fixed scales [mmHg or L/min]; the first that holds the whole waveform is taken.
    """

    signal: str
    label: str
    text: str
    form: Literal["pressure", "mean", "flow"]
    outputs: tuple[str, ...]
    scales: tuple[Range, ...]


@dataclass(frozen=True)
class Figure:
    """A number that is always in sight.

    Args:
        key: name of its tile.
        label: on the tile.
        output: whose number it is.
        unit: of the number.
        digits: decimals.
        limits: outputs whose limits colour the tile; empty for the output itself.
        extremes: outputs that stand below the number.
        only_with: an output; the tile is there only where that one is to be read with care.
    """

    key: str
    label: str
    output: str
    unit: str
    digits: int
    limits: tuple[str, ...] = ()
    extremes: tuple[str, ...] = ()
    only_with: str = ""

    def plain(self) -> dict[str, Any]:
        """For the browser."""
        return asdict(self) | {"limits": self.limits or (self.output,), "extremes": self.extremes or None}


@dataclass(frozen=True)
class Curve:
    """An output over the speed of a pump.

    Args:
        output: its name.
        label: in the legend.
        panel: which of the three charts it is in.
        limited_by: output whose limits are drawn beside a curve of a circuit.
        short: name of these limits.
    """

    output: str
    label: str
    panel: Literal["pressure", "flow", "circuit"]
    limited_by: str = ""
    short: str = ""


@dataclass(frozen=True)
class FlowUnit:
    """How flows of a part of the circuit are written: factor from mL/s, decimals, unit."""

    factor: float = 0.06
    digits: int = 2
    unit: str = "L/min"


@dataclass(frozen=True)
class Shown:
    """What is shown of the patient or of a device."""

    traces: tuple[Trace, ...] = ()
    figures: tuple[Figure, ...] = ()
    curves: tuple[Curve, ...] = ()
    compared: tuple[str, ...] = ()
    flow_unit: FlowUnit = FlowUnit()
    flow_outputs: Mapping[str, str] | None = None


def _figure(key: str, output: str, unit: str, digits: int, **more: Any) -> Figure:
    return Figure(key, text(f"key_{key}"), output, unit, digits, **more)


PATIENT = Shown(
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
        _figure("LVO", "LVO", "L/min", 2, only_with="CO"),
        _figure("MPAP", "MPAP", "mmHg", 0),
        _figure("PCWP", "PCWP", "mmHg", 0),
        _figure("CVP", "right_atrial_pressure", "mmHg", 0),
        _figure("EF", "ejection_fraction_lv", "%", 0),
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
        "stroke_work_lv",
    ),
)  # fmt: skip
_OF_DEVICES: Mapping[str, Shown] = {
    "ecmo": Shown(
        traces=(
            Trace(
                "Qecmopump", "ECMO flow", "ECMO pump flow", "flow", ("PF",),
                ((0.0, 6.0), (0.0, 10.0), (-2.0, 6.0), (-5.0, 10.0)),
            ),
        ),
        figures=(Figure("PF", "ECMO", "PF", "L/min", 2),),
        curves=(
            Curve("PF", "ECMO flow", "flow"),
            Curve("drainage_pressure", "Drainage cannula", "circuit", "lowest_drainage_pressure", "drainage"),
        ),
        compared=("PF", "lowest_drainage_pressure"),
        flow_outputs={"ecmopump": "PF"},
    ),
    "crrt": Shown(
        traces=(
            Trace(
                "Pcrrttuin", "CRRT access", "pressure in the CRRT access line", "mean",
                ("crrt_access_pressure",), ((-300.0, 300.0), (-600.0, 600.0)),
            ),
            Trace(
                "Pcrrttuout", "CRRT return", "pressure in the CRRT return line", "mean",
                ("crrt_return_pressure",), ((0.0, 400.0), (-200.0, 800.0)),
            ),
        ),
        curves=(
            Curve("crrt_access_pressure", "CRRT access", "circuit", "crrt_access_pressure", "access"),
            Curve("crrt_return_pressure", "CRRT return", "circuit", "crrt_return_pressure", "return"),
        ),
        compared=("crrt_access_pressure", "crrt_return_pressure"),
        flow_unit=FlowUnit(60.0, 0, "mL/min"),
    ),
    "lvad": Shown(
        traces=(
            Trace(
                "Qlvadpump", "LVAD flow", "LVAD flow", "flow", ("lvad_flow",),
                ((0.0, 8.0), (-4.0, 12.0), (-10.0, 20.0)),
            ),
        ),
        figures=(Figure("lvad_flow", "LVAD", "lvad_flow", "L/min", 2),),
        curves=(Curve("lvad_flow", "LVAD flow", "flow"),),
        compared=("lvad_flow",),
        flow_outputs={"lvadpump": "lvad_flow"},
    ),
}  # fmt: skip
_PATIENT_COLOURS = ("#FF8A70", "#F0E442", "#6CC3F5")
_DEVICE_COLOURS = ("#3BD3A5", "#FFB733", "#E4E7EC", "#E7A6CC", "#B5D334", "#BFA0EE", "#FF9A5C", "#58CFE6")
"""On the dark ground of the monitor."""
_INKS = 4
"""Colours of devices in the style sheet."""
LOOPS = ("Plv", "Vlv", "Prv", "Vrv")


def connected(case: Case) -> list[str]:
    """Keys of the devices of a case."""
    return list(dict.fromkeys(one.device.key for one in case.instances()))


def shown(group: str) -> Shown:
    """What is shown of a device, or of the patient."""
    return _OF_DEVICES.get(group, PATIENT)


def ink(group: str) -> str:
    """The colour of the style sheet that a part of the circuit is drawn in."""
    return f"device-{connectable().index(group) % _INKS + 1}" if group in connectable() else group


def waves_of(case: Case) -> tuple[str, ...]:
    """Waveforms that the browser draws."""
    traces = [trace.signal for part in _parts(case) for trace in part.traces]
    return (*traces, *LOOPS)


def curves_of(case: Case) -> list[tuple[int, Curve]]:
    """Curves of the ramp, each with a number of its own that is the same for every circuit."""
    every = [*PATIENT.curves, *(curve for device in connectable() for curve in shown(device).curves)]
    drawn = [curve for part in _parts(case) for curve in part.curves]
    return [(number, curve) for number, curve in enumerate(every) if curve in drawn]


def plain_curves(case: Case, outputs: Collection[str]) -> list[dict[str, Any]]:
    """The curves that there are numbers for, with their limits, for the browser."""
    return [
        {
            "name": curve.output, "label": curve.label, "panel": curve.panel, "number": number,
            "short": curve.short, "limits": bounds(curve.limited_by) if curve.limited_by else [],
        }
        for number, curve in curves_of(case)
        if curve.output in outputs
    ]  # fmt: skip


def display(case: Case) -> dict[str, Any]:
    """Groups of knobs, traces, key figures and outputs to compare, for the browser."""
    parts = _parts(case)
    groups = [{"key": key, "label": text(f"group_{key}")} for key in ("heart", "vessels", *connectable())]
    colours = dict(zip(_signals(connectable()), _DEVICE_COLOURS * 4, strict=False))
    colours |= dict(zip([trace.signal for trace in PATIENT.traces], _PATIENT_COLOURS, strict=True))
    traces = [asdict(trace) | {"colour": colours[trace.signal]} for part in parts for trace in part.traces]
    return {
        "groups": groups,
        "traces": traces,
        "figures": [figure.plain() for figure in _in_order([f for part in parts for f in part.figures])],
        "compared": [output for part in parts for output in part.compared],
    }


def _in_order(figures: Sequence[Figure]) -> list[Figure]:
    """The arterial pressure, all flows, and the rest."""
    flows = [figure for figure in figures[1:] if figure.unit == "L/min"]
    return [figures[0], *flows, *(figure for figure in figures[1:] if figure not in flows)]


def _signals(devices: Sequence[str] | Mapping[str, Any]) -> list[str]:
    return [trace.signal for device in devices for trace in shown(device).traces]


def _parts(case: Case) -> list[Shown]:
    return [PATIENT, *(shown(device) for device in connected(case))]


def shape_of(case: Case) -> Circuit:
    """What the drawing depends on; while it is the same only numbers change."""
    return circuit_of(case)


def described(control: Control) -> dict[str, Any]:
    """A knob or picker as plain data."""
    section, _, name = control.key.partition(".")
    hint = f"{name}: {default(name).description}" if section == "parameters" else ""
    common = {"key": control.key, "group": control.group, "label": control.label, "hint": hint}
    if isinstance(control, Knob):
        return common | {
            "unit": control.unit, "low": control.low, "high": control.high, "step": control.step,
            "log": control.logarithmic,
        }  # fmt: skip
    return common | {"options": [list(option) for option in control.options]}
