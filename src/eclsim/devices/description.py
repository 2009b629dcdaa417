"""Parts of a device's description: outputs of a beat, limits, findings, drawing, controls."""

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
"""A differentiable function of one patient's numbers, (n,) to (m,), compiled once per function object."""
GASES = "gas.vo2_ml_min"
"""Parameter that a circuit has if and only if its gases are computed."""
Kind = Literal["collapse", "alarm", "warning"]
GRAVEST_FIRST: tuple[Kind, ...] = ("collapse", "alarm", "warning")
"""Kinds of limits, most serious first. Beyond a "collapse" limit the numbers are impossible in a patient."""
SIDES = ("below", "above")
"""Sides on which a value may exceed a limit."""
ROUNDING = 1e-6
"""A value that a search has brought to a limit may miss it by this share of the limit."""
COLLAPSE_MMHG = -300.0
"""Pressure [mmHg] at which any vein has collapsed, so that a pump would not reach the computed flow."""
CAUTION = "caution"
"""Kind of a finding that concerns no limit but how to interpret a number."""
LABELS: Mapping[str, str] = MappingProxyType(
    {"collapse": "impossible", "alarm": "alarm", "caution": "caution"}
)
"""First words of sentences on findings, by kind; a warning has none."""


class BeatMeasures(Protocol):
    """Measurements on the waveforms of a beat (`eclsim.outputs.measures.Measures`)."""

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
        name: key; that of the paper if it has one.
        long_name: full name.
        unit: unit of the number.
        definition: definition in terms of the waveforms.
        needs: waveforms that it requires; without them it is left out.
        compute: function of the measures of a beat.
        extremes: waveforms whose largest or smallest value it reads, and whose rates are therefore needed.
        in_contract: whether it is one of the main outputs, which come first in every result file.
        parameters: parameters that it reads; it exists only in circuits that have them. It is NaN where it is
            not reliable.
        blood_parameters: parameters of the blood that it reads in circuits that have them.
        all_flows: whether it depends on the flows of all connections.
        by_gases: whether it also depends on blood gases if they are computed.
        in_effect: whether it depends on the readings of controllers, and so on all their parameters.
        read_at: waveform of the place that it describes, if that is not the place of `needs`.
        absolute: whether it changes with the level of all pressures although it needs several waveforms; an
            output of a single pressure always does, a difference of two never.
        same_as: name of the output of the same number that has the limits and the reference range.
        mean_of: waveform whose mean over the beat it is, as drawn at its place.
        saturation_in: compartments whose oxygen saturation it is; of several, the first in the circuit.
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
    blood_parameters: tuple[str, ...] = ()
    all_flows: bool = False
    by_gases: bool = False
    in_effect: bool = False
    read_at: str = ""
    absolute: bool = False
    same_as: str = ""
    mean_of: str = ""
    saturation_in: tuple[str, ...] = ()


def mean(name: str, long_name: str, signal: str) -> Output:
    """Output of the mean of a pressure [mmHg]."""
    return Output(
        name, long_name, "mmHg", f"mean of {signal}", (signal,), lambda m: m.mean(signal), mean_of=signal
    )


def highest(name: str, long_name: str, signal: str, unit: str = "mmHg") -> Output:
    """Output of the largest value of a waveform."""
    definition = f"maximum of {signal}"
    return Output(name, long_name, unit, definition, (signal,), lambda m: m.maximum(signal), (signal,))


def lowest(name: str, long_name: str, signal: str, unit: str = "mmHg") -> Output:
    """Output of the smallest value of a waveform."""
    definition = f"minimum of {signal}"
    return Output(name, long_name, unit, definition, (signal,), lambda m: m.minimum(signal), (signal,))


def mean_flow(name: str, long_name: str, signal: str, in_contract: bool = False, beside: str = "") -> Output:
    """Output of the mean of a flow [L/min]; with `beside`, it exists only if that other flow does."""
    return Output(
        name, long_name, "L/min", f"mean of {signal}", (signal, beside) if beside else (signal,),
        lambda m: m.mean(signal) / ML_S_PER_L_MIN, in_contract=in_contract, read_at=signal if beside else "",
        mean_of=signal,
    )  # fmt: skip


def difference(name: str, long_name: str, high: str, low: str) -> Output:
    """Output of the mean difference of two pressures [mmHg]."""
    definition = f"mean of {high} - {low}"
    return Output(name, long_name, "mmHg", definition, (high, low), lambda m: m.mean(high) - m.mean(low))


def gas_sample(
    name: str, long_name: str, where: str, place: str, what: str, needs: tuple[str, ...]
) -> Output:
    """Output of a blood sample's saturation [%] or partial pressure [mmHg], if gases are computed.

    Args:
        name: name of the output.
        long_name: full name.
        where: "in" a compartment, "drawn" by a connection, "behind" an exchange.
        place: name of the compartment or connection.
        what: "SO2", "PO2" or "PCO2".
        needs: waveforms that it requires.
    """
    unit, factor = ("%", 100.0) if what == "SO2" else ("mmHg", 1.0)
    at = "drawn by" if where == "drawn" else where
    return Output(
        name, long_name, unit, f"of the blood {at} {place}", needs,
        lambda m: factor * m.gas(what, where, place), parameters=(GASES,), all_flows=True,
        read_at=f"{'P' if where == 'in' else 'Q'}{place}",
        saturation_in=(place,) if (what, where) == ("SO2", "in") else (),
    )  # fmt: skip


def organ_flow(outputs: Mapping[str, float]) -> float | None:
    """Flow through all organs except the lungs [L/min], of one body or both its regions; None if unknown."""
    places = ("systemic_flow",) if "systemic_flow" in outputs else ("upper_body_flow", "lower_body_flow")
    return sum(outputs[name] for name in places) if set(places) <= outputs.keys() else None


@dataclass(frozen=True, slots=True)
class Limit:
    """A limit that an output should not exceed.

    Attributes:
        quantity: Name of the output.
        kind: "warning", "alarm" or "collapse" (beyond it the numbers are impossible).
        side: Whether a value "below" or "above" the limit exceeds it.
        value: The limit, in the output's unit.
        meaning: Meaning of a value beyond it.
        source: Source of the limit.
        unassisted: Whether it applies only without a pump that drains the left ventricle.
        without: Outputs; the limit does not apply if any of them is present.
        running: Flow of the device; the limit does not apply while its pump stands still. Empty: always.
    """

    quantity: str
    kind: Kind
    side: Literal["below", "above"]
    value: float
    meaning: str
    source: str
    unassisted: bool = False
    without: tuple[str, ...] = ()
    running: str = ""

    def broken_by(self, value: float) -> bool:
        """Whether a value exceeds the limit, by more than rounding (NaN does not)."""
        beyond = self.value - value if self.side == "below" else value - self.value
        return beyond > ROUNDING * abs(self.value)


@dataclass(frozen=True, slots=True)
class Assumption:
    """A usual value without a source, and the outputs that depend on it.

    Attributes:
        parameter: parameter that has the value; reported only if a case does not change it.
        value: value in the parameter's unit.
        concerns: names of the outputs that depend on it.
        sentence: text that says what is assumed, how much it matters, and what to set.
    """

    parameter: str
    value: float
    concerns: tuple[str, ...]
    sentence: str


@dataclass(frozen=True)
class Finding:
    """A remark about a beat.

    Attributes:
        kind: "collapse" (impossible), "alarm", "warning", or "caution" (no limit: how to read a number).
        quantity: output or waveform that it concerns.
        value: value in the beat.
        limit: value with which it is compared; None if it is not compared with one.
        sentence: text of the finding.
        source: source of the limit.
        concerns: names of the outputs that it mentions.
        is_cause: whether others follow from it, so that it comes first among those of its kind.
    """

    kind: str
    quantity: str
    value: float
    limit: float | None
    sentence: str
    source: str = ""
    concerns: tuple[str, ...] = ()
    is_cause: bool = False

    @classmethod
    def without_limit(cls, kind: str, quantity: str, value: float, sentence: str, *concerns: str) -> Finding:
        """Return a finding that compares no value with a limit."""
        return cls(kind, quantity, value, None, sentence, concerns=concerns)

    def is_about(self, outputs: Collection[str]) -> bool:
        """Whether to report it if only these outputs are shown; always true unless it is a caution."""
        return self.kind != CAUTION or any(name in outputs for name in self.concerns)


def labelled_sentence(kind: str, sentence: str) -> str:
    """Return the sentence of a finding after the label of its kind: "alarm: ..."."""
    return f"{LABELS[kind]}: {sentence}" if kind in LABELS else sentence


def has_label(sentence: str) -> bool:
    """Whether a sentence begins with the label of a kind of findings."""
    return sentence.partition(": ")[0] in LABELS.values()


def placed_sentence(place: str, sentence: str) -> str:
    """Return a sentence with a place, which follows its label if it has one: "alarm: at 3000 rpm: ..."."""
    if not has_label(sentence):
        return f"{place}: {sentence}"
    label, _, text = sentence.partition(": ")
    return f"{label}: {place}: {text}"


@dataclass(frozen=True)
class Box:
    """Position of a compartment's box in a device's frame of the drawing.

    Args:
        column: 0 (left) to 3 (right).
        row: 0 at the top; lines to other sites leave from the lowest row.
        label: text in the box.
        short: text if there is little room; by default `label`.
    """

    column: int
    row: int
    label: str
    short: str = ""


@dataclass(frozen=True)
class Mark:
    """Symbol and label of a connection in the drawing.

    Args:
        symbol: "pump", "roller", "exchanger", "cannula", "resistance", "valve" or "tube".
        label: text beside the symbol.
    """

    symbol: str
    label: str


@dataclass(frozen=True)
class Housed:
    """Box in the drawing of a device without compartments that lies in the housing of another device's part.

    Args:
        label: what the readings describe, after the name of the device.
        readings: outputs whose numbers are in the box, with their units.
    """

    label: str
    readings: tuple[str, ...]


@dataclass(frozen=True)
class Panel:
    """One panel of a figure: waveforms over two beats, or outputs over the values of a sweep.

    Args:
        title: title above the panel.
        unit: unit of the vertical axis.
        names: names of the waveforms or outputs.
        labels: labels of the curves; by default those of the places.
        change: whether to show volumes as differences from their means, which are then in the legend: the
            systemic veins hold twenty times as much as the aorta.
    """

    title: str
    unit: str
    names: tuple[str, ...]
    labels: tuple[str, ...] = ()
    change: bool = False


@dataclass(frozen=True)
class Look:
    """Appearance of a device in figures; dash patterns distinguish devices in greyscale.

    Args:
        colour: colour of lines.
        fill: background colour.
        width: width of lines [pt].
        dash: line style as in matplotlib.
        marker: marker of its points in dot plots.
    """

    colour: str
    fill: str
    width: float = 1.5
    dash: str | tuple[float, tuple[float, ...]] = "-"
    marker: str = "D"


@dataclass(frozen=True)
class Knob:
    """A number that can be changed on the page.

    Args:
        key: key of the section, or name of a parameter; the page adds the name of the section.
        label: label of the control.
        unit: unit of the number.
        low: left end of the slider; typed values may lie beyond it if a case file allows them.
        high: right end of the slider.
        step: step of the slider and of the arrow keys.
        logarithmic: whether the slider has a logarithmic scale.
        group: section of the panel, which the page fills in for devices.
        needs: section of the case without which it has no effect and is not shown.
        is_parameter: whether `key` is a parameter of the device, set in `[parameters]` of a case file.
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
    """A choice among names on the page, as a drop-down list.

    Args:
        key: key of the section; the page adds the name of the section.
        label: label of the control.
        options: names and their labels.
        line: name of the line, such as "access", whose site it chooses in the drawing; else empty.
        group: section of the panel, which the page fills in for devices.
        needs: section of the case without which it is not shown.
        unless: section of the case with which it is not shown.
    """

    key: str
    label: str
    options: Sequence[tuple[str, str]]
    line: str = ""
    group: str = ""
    needs: str = ""
    unless: str = ""


Control = Knob | Picker


def picker(
    key: str, label: str, names: Iterable[str], labels: Mapping[str, str] = _EMPTY, line: str = ""
) -> Picker:
    """Create a choice among names, each shown by its label if it has one."""
    return Picker(key, label, tuple((name, labels.get(name, name)) for name in names), line)


_SWITCH_WORDS = MappingProxyType({"true": "yes", "false": "no"})


def plain_control(field: Field) -> Control | None:
    """Default control for a field of a section; None for a text field."""
    if field.kind == "number":
        step = 10.0 ** math.floor(math.log10((field.maximum - field.minimum) / 40.0))
        unit = "" if field.unit == "1" else field.unit
        factors = field.minimum > 0.0 and field.maximum > 500.0 * field.minimum
        return Knob(field.name, field.description, unit, field.minimum, field.maximum, step, factors)
    labels = {**PATIENT_SITES, **_SWITCH_WORDS}
    return picker(field.name, field.description, field.names, labels) if field.names else None


@dataclass(frozen=True)
class Trace:
    """A waveform on the page's monitor.

    Args:
        signal: name of the waveform.
        label: label beside the trace.
        text: full name.
        form: numbers beside the trace: "pressure" (systolic, diastolic and mean), "mean" or "flow".
        outputs: outputs that hold these numbers.
        scales: fixed scales [mmHg or L/min]; the first one that contains the whole waveform is used.
    """

    signal: str
    label: str
    text: str
    form: Literal["pressure", "mean", "flow"]
    outputs: tuple[str, ...]
    scales: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class KeyFigure:
    """A number that is always visible on the page, in a tile.

    Args:
        key: key of its tile.
        label: label on the tile.
        output: output that holds the number.
        unit: unit of the number.
        digits: number of decimals.
        limits: outputs whose limits determine the tile's colour; if empty, the output itself.
        extremes: outputs shown below the number.
        unlike: flow; if given, the tile is shown only if its own flow differs from it.
    """

    key: str
    label: str
    output: str
    unit: str
    digits: int
    limits: tuple[str, ...] = ()
    extremes: tuple[str, ...] = ()
    unlike: str = ""


@dataclass(frozen=True)
class Curve:
    """Curve of an output over the speed of a pump.

    Args:
        output: name of the output.
        label: label in the legend.
        panel: chart in which it is drawn.
        limited_by: output whose limits are drawn beside the curve, in the panel "circuit".
        short: short name of these limits.
    """

    output: str
    label: str
    panel: Literal["pressure", "flow", "circuit"]
    limited_by: str = ""
    short: str = ""


@dataclass(frozen=True)
class Sweep:
    """Pump speed that the page can sweep: key of the section, present value, usual range."""

    key: str
    present: float
    low: float
    high: float


@dataclass(frozen=True)
class Columns:
    """Columns of a device in the table of a cohort, with the keys of its section.

    Args:
        needed: columns that every such table has; cells are empty if the device is absent.
        optional: columns that a table may have.
        usual: values of keys of the section for rows with empty optional columns.
        settings: keys of the section that may also be columns, under their own names.
    """

    needed: Mapping[str, str] = field(default_factory=dict)
    optional: Mapping[str, str] = field(default_factory=dict)
    usual: Mapping[str, Any] = field(default_factory=dict)
    settings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Target:
    """An output value that a case may give in place of a setting, which is then solved for.

    Args:
        key: key of the section, such as "flow_l_min".
        setting: key of the section that is solved for, over the range of the device's `sweep`.
        output: output that is to reach the value.
    """

    key: str
    setting: str
    output: str


@dataclass(frozen=True)
class Sample:
    """A site whose blood is listed in the page's table of blood gases.

    Args:
        place: compartment.
        label: label of the site.
        outputs: outputs whose limits mark the numbers, by "SO2", "PO2", "PCO2" or "pH".
    """

    place: str
    label: str
    outputs: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class FlowUnit:
    """Format of flows in a part of the circuit: factor from mL/s, decimals, unit."""

    factor: float = 0.06
    digits: int = 2
    unit: str = "L/min"


@dataclass(frozen=True)
class Views:
    """Content of the page's views for a device or the patient.

    Args:
        traces: traces of the monitor.
        figures: tiles of key figures.
        curves: curves of the speed ramp.
        compared: outputs in the table that compares saved states.
        flow_unit: format of the flows in the schematic.
        flow_outputs: by connection, the output whose limits mark its flow.
        samples: sites whose blood gases are shown.
    """

    traces: tuple[Trace, ...] = ()
    figures: tuple[KeyFigure, ...] = ()
    curves: tuple[Curve, ...] = ()
    compared: tuple[str, ...] = ()
    flow_unit: FlowUnit = FlowUnit()
    flow_outputs: Mapping[str, str] = field(default_factory=dict)
    samples: tuple[Sample, ...] = ()
