"""Descriptions that make up a device: outputs of a beat, limits, findings, drawing, knobs."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar

from eclsim.inputs.fields import Field
from eclsim.patient.sites import PATIENT_SITES
from eclsim.units import ML_S_PER_L_MIN

if TYPE_CHECKING:
    from jax import Array

    from eclsim.circuit.network import Circuit

_EMPTY: Mapping[str, str] = MappingProxyType({})

Measured = TypeVar("Measured")
Numbers = Any
"""One number for each patient: a float, an array, or either with its derivatives."""
Law = Callable[["Array"], "Array"]
"""A differentiable function of numbers of one patient, (n,) to (m,); it is compiled once for each object."""
GASES = "gas.vo2_ml_min"
"""Parameter that a circuit has exactly if its gases are computed."""
Kind = Literal["collapse", "alarm", "warning"]
GRAVEST_FIRST: tuple[Kind, ...] = ("collapse", "alarm", "warning")
"""Kinds of limits. Beyond a "collapse" the numbers cannot be those of a patient."""
SIDES = ("below", "above")
"""Where a value may be beyond a limit."""
COLLAPSE_MMHG = -300.0
"""Pressure that no vein withstands: the vessel has collapsed and a pump would not reach the computed flow."""
CAUTION = "caution"
"""Kind of a finding that breaks no limit: how a number is to be read."""


class BeatMeasures(Protocol):
    """What can be measured on the waveforms of a beat (`eclsim.outputs.measures.Measures`)."""

    def mean(self, name: str) -> Numbers: ...  # noqa: D102 (named after what it is)
    def maximum(self, name: str) -> Numbers: ...  # noqa: D102
    def maximum_before(self, name: str, phase: str) -> Numbers: ...  # noqa: D102
    def maximum_after(self, name: str, phase: str) -> Numbers: ...  # noqa: D102
    def minimum(self, name: str) -> Numbers: ...  # noqa: D102
    def at_start(self, name: str) -> Numbers: ...  # noqa: D102
    def largest_ratio(self, above: str, below: str) -> Numbers: ...  # noqa: D102
    def loop_area(self, pressure: str, volume: str) -> Numbers: ...  # noqa: D102
    def forward(self, connection: str) -> Numbers: ...  # noqa: D102
    def backward(self, connection: str) -> Numbers: ...  # noqa: D102
    def parameter(self, name: str) -> Numbers: ...  # noqa: D102
    def apply(self, function: Law, numbers: Sequence[Numbers]) -> Sequence[Numbers]: ...  # noqa: D102
    def gas(self, what: str, where: str, place: str) -> Numbers: ...  # noqa: D102
    def effective(  # noqa: D102
        self, at: str, clearances: Sequence[Numbers], water: Sequence[Numbers]
    ) -> Sequence[Numbers]: ...
    def native(self, artery: str) -> Numbers: ...  # noqa: D102
    def cached(self, key: tuple[str, ...], measure: Callable[[], Measured]) -> Measured: ...  # noqa: D102
    @property
    def circuit(self) -> Circuit: ...  # noqa: D102


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
        in_contract: whether it is one of the main outputs that every result file leads with.
        parameters: that it reads besides; it exists only in circuits that have them. Where it is not to be
            trusted it is NaN.
        all_flows: whether it follows from the flows of all connections.
        by_gases: whether it follows from the gases of the blood too where they are followed.
        in_effect: whether it follows from what controllers read, and so from all parameters of theirs.
    """

    name: str
    long_name: str
    unit: str
    definition: str
    needs: tuple[str, ...]
    compute: Callable[[BeatMeasures], Numbers]
    extremes: tuple[str, ...] = ()
    in_contract: bool = False
    parameters: tuple[str, ...] = ()
    all_flows: bool = False
    by_gases: bool = False
    in_effect: bool = False


def mean(name: str, long_name: str, signal: str) -> Output:
    """Mean of a pressure [mmHg]."""
    return Output(name, long_name, "mmHg", f"mean of {signal}", (signal,), lambda m: m.mean(signal))


def highest(name: str, long_name: str, signal: str, unit: str = "mmHg") -> Output:
    """Largest value of a waveform."""
    definition = f"maximum of {signal}"
    return Output(name, long_name, unit, definition, (signal,), lambda m: m.maximum(signal), (signal,))


def lowest(name: str, long_name: str, signal: str, unit: str = "mmHg") -> Output:
    """Smallest value of a waveform."""
    definition = f"minimum of {signal}"
    return Output(name, long_name, unit, definition, (signal,), lambda m: m.minimum(signal), (signal,))


def mean_flow(name: str, long_name: str, signal: str, in_contract: bool = False) -> Output:
    """Mean of a flow [L/min]."""
    return Output(
        name, long_name, "L/min", f"mean of {signal}", (signal,),
        lambda m: m.mean(signal) / ML_S_PER_L_MIN, in_contract=in_contract,
    )  # fmt: skip


def difference(name: str, long_name: str, high: str, low: str) -> Output:
    """Mean difference of two pressures [mmHg]."""
    definition = f"mean of {high} - {low}"
    return Output(name, long_name, "mmHg", definition, (high, low), lambda m: m.mean(high) - m.mean(low))


def gas_sample(
    name: str, long_name: str, where: str, place: str, what: str, needs: tuple[str, ...]
) -> Output:
    """A gas of a sample of blood: saturation [%], or a partial pressure [mmHg]; where gas is computed.

    Args:
        name: of the output.
        long_name: in words.
        where: "in" a compartment, "drawn" by a connection, "behind" an exchange.
        place: name of the compartment or connection.
        what: "SO2", "PO2" or "PCO2".
        needs: waveforms without which it does not exist.
    """
    unit, factor = ("%", 100.0) if what == "SO2" else ("mmHg", 1.0)
    return Output(
        name, long_name, unit, f"of the blood {where} {place}", needs,
        lambda m: factor * m.gas(what, where, place), parameters=(GASES,), all_flows=True,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Limit:
    """A bound that an output should not cross.

    Attributes:
        quantity: Name of the output.
        kind: "warning", "alarm" or "collapse" (beyond it the numbers are impossible).
        side: Whether the limit is broken by a value "below" or "above" it.
        value: The bound, in the output's unit.
        meaning: What it means to be beyond it.
        source: Where the bound comes from.
        unassisted: Whether it holds only without a pump that empties the left ventricle.
        without: Outputs beside any of which it does not hold.
    """

    quantity: str
    kind: Kind
    side: Literal["below", "above"]
    value: float
    meaning: str
    source: str
    unassisted: bool = False
    without: tuple[str, ...] = ()

    def broken_by(self, value: float) -> bool:
        """Whether a value is beyond the limit (NaN is not)."""
        return value < self.value if self.side == "below" else value > self.value


@dataclass(frozen=True, slots=True)
class Assumption:
    """A usual value that no source gives, and outputs that follow from it.

    Attributes:
        parameter: whose value it is; said only where a case leaves it at that.
        value: in the parameter's unit.
        concerns: names of outputs.
        sentence: what is assumed, how far it matters, and what to set.
    """

    parameter: str
    value: float
    concerns: tuple[str, ...]
    sentence: str


@dataclass(frozen=True)
class Finding:
    """Something to say about a beat.

    Attributes:
        kind: "collapse" (impossible), "alarm", "warning", or "caution" (no limit: how to read a number).
        quantity: output or waveform that it is about.
        value: what the beat has.
        limit: what it is compared with.
        sentence: in words.
        source: where the limit comes from.
        concerns: outputs that it speaks of.
    """

    kind: str
    quantity: str
    value: float
    limit: float
    sentence: str
    source: str = ""
    concerns: tuple[str, ...] = ()

    def is_about(self, outputs: Collection[str]) -> bool:
        """Whether to say it where these outputs alone are shown: what is no mere caution holds for all."""
        return self.kind != CAUTION or any(name in outputs for name in self.concerns)


@dataclass(frozen=True)
class Box:
    """Where the box of a compartment stands in a device's frame of the drawing.

    Args:
        column: 0 (left) to 3 (right).
        row: 0 at the top; lines to other sites leave from the lowest row.
        label: what stands in it.
        short: the same where there is little room; left out, `label`.
    """

    column: int
    row: int
    label: str
    short: str = ""


@dataclass(frozen=True)
class Mark:
    """How a connection is marked in the drawing.

    Args:
        symbol: "pump", "roller", "exchanger", "cannula", "resistance", "valve" or "tube".
        label: what stands beside it.
    """

    symbol: str
    label: str


@dataclass(frozen=True)
class Panel:
    """One pair of axes of a figure: waveforms over two beats, or outputs over the values of a sweep.

    Args:
        title: above it.
        unit: of the axis.
        names: of the waveforms or outputs.
        labels: of the curves; left out, the places in words.
        change: shows volumes as the difference from their mean, which then stands in the legend: the systemic
            veins hold twenty times what the aorta holds.
    """

    title: str
    unit: str
    names: tuple[str, ...]
    labels: tuple[str, ...] = ()
    change: bool = False


@dataclass(frozen=True)
class Look:
    """Look of a device in figures; dash patterns tell devices apart in grey print.

    Args:
        colour: of lines.
        fill: of the ground behind it.
        width: of lines [pt].
        dash: as matplotlib takes it.
        marker: of its points in dot charts.
    """

    colour: str
    fill: str
    width: float = 1.5
    dash: str | tuple[float, tuple[float, ...]] = "-"
    marker: str = "D"


@dataclass(frozen=True)
class Knob:
    """A number that can be turned on the page.

    Args:
        key: key of the section, or name of a parameter; the page puts the section in front.
        label: in words.
        unit: unit of the number.
        low: left end of the slider; typed values may lie beyond, as far as a case file allows.
        high: right end.
        step: of the slider and of the arrow keys.
        logarithmic: whether equal ways on the slider are equal factors.
        group: section of the panel, which the page fills in for devices.
        needs: section of the case without which it has no effect, and is left out.
        is_parameter: whether `key` is a parameter of the device, which a case file has in `[parameters]`.
    """

    key: str
    label: str
    unit: str
    low: float
    high: float
    step: float
    logarithmic: bool = False
    group: str = ""
    needs: str = ""
    is_parameter: bool = False


@dataclass(frozen=True)
class Picker:
    """A choice among names on the page.

    Args:
        key: key of the section; the page puts the section in front.
        label: in words.
        options: names and what they are in words.
        line: what to call the line that the choice moves in the drawing, such as "access"; else empty.
        group: section of the panel, which the page fills in for devices.
    """

    key: str
    label: str
    options: Sequence[tuple[str, str]]
    line: str = ""
    group: str = ""


Control = Knob | Picker


def picker(
    key: str, label: str, names: Iterable[str], labels: Mapping[str, str] = _EMPTY, line: str = ""
) -> Picker:
    """A choice among names, each in words or, without words, as it is."""
    return Picker(key, label, tuple((name, labels.get(name, name)) for name in names), line)


_SWITCH_WORDS = MappingProxyType({"true": "yes", "false": "no"})


def plain_control(field: Field) -> Control | None:
    """How a field of a section can be turned without further words; None for a text."""
    if field.kind == "number":
        step = 10.0 ** math.floor(math.log10((field.maximum - field.minimum) / 40.0))
        unit = "" if field.unit == "1" else field.unit
        factors = field.minimum > 0.0 and field.maximum > 500.0 * field.minimum
        return Knob(field.name, field.description, unit, field.minimum, field.maximum, step, factors)
    labels = {**PATIENT_SITES, **_SWITCH_WORDS}
    return picker(field.name, field.description, field.names, labels) if field.names else None


@dataclass(frozen=True)
class Trace:
    """A waveform of the page's monitor.

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
    scales: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class KeyFigure:
    """A number that is always in sight on the page.

    Args:
        key: name of its tile.
        label: on the tile.
        output: the number.
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
class Sweep:
    """The speed of a pump that the page can sweep: key of the section, where it stands, usual range."""

    key: str
    present: float
    low: float
    high: float


@dataclass(frozen=True)
class Columns:
    """Columns of a device in the table of a cohort, and the keys of its section.

    Args:
        needed: that every such table has; empty cells where the device is absent.
        optional: that it may have.
        usual: keys of the section in rows that say nothing in optional columns.
        measured: those of the columns that clinical data may hold.
        settings: keys of the section that may be columns too, under their own names.
    """

    needed: Mapping[str, str] = field(default_factory=dict)
    optional: Mapping[str, str] = field(default_factory=dict)
    usual: Mapping[str, Any] = field(default_factory=dict)
    measured: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Target:
    """An output that a case may name in place of the setting that gives it.

    Args:
        key: of the section, such as "flow_l_min".
        setting: key of the section that is solved for, over the range of the device's `sweep`.
        output: what is to have the value.
    """

    key: str
    setting: str
    output: str


@dataclass(frozen=True)
class Sample:
    """A place whose blood stands in the page's table of gases.

    Args:
        place: compartment.
        label: where that is, in words.
        outputs: whose limits mark the numbers, by "SO2", "PO2", "PCO2" or "pH".
    """

    place: str
    label: str
    outputs: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class FlowUnit:
    """How flows of a part of the circuit are written: factor from mL/s, decimals, unit."""

    factor: float = 0.06
    digits: int = 2
    unit: str = "L/min"


@dataclass(frozen=True)
class Views:
    """What the page's views show of a device, or of the patient.

    Args:
        traces: of the monitor.
        figures: tiles.
        curves: of the speed ramp.
        compared: outputs in the table of saved states.
        flow_unit: of the flows in the schematic.
        flow_outputs: connections whose flow is marked by the limits of an output.
        samples: places of which blood gases are shown.
    """

    traces: tuple[Trace, ...] = ()
    figures: tuple[KeyFigure, ...] = ()
    curves: tuple[Curve, ...] = ()
    compared: tuple[str, ...] = ()
    flow_unit: FlowUnit = FlowUnit()
    flow_outputs: Mapping[str, str] = field(default_factory=dict)
    samples: tuple[Sample, ...] = ()
