"""Base class of devices: one object that holds everything the rest of the package needs to know of a device.

A device is a subclass of `Device` in its own file, and a line in `eclsim.devices.registry` (or a call of
`eclsim.register_device`). Case files, outputs, limits, drawings, the page and the analyses use the registry
and name no device.

A device may be connected more than once, as `[lvad.left]` and `[lvad.right]`; each of these is an `Instance`.
The names in a `Device` are those of a single, unnamed instance (`[lvad]`: compartments such as `ecmodrain`,
parameters such as `lvad.speed_rpm` or `Recmooxy`). Those of a named instance contain the instance's name
(`ecmo.left.ecmodrain`, `lvad.left.speed_rpm`, `ecmo.left.Recmooxy`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from eclsim.devices.description import (
    Assumption,
    Box,
    Columns,
    Control,
    Finding,
    Housed,
    Limit,
    Look,
    Mark,
    Output,
    Panel,
    Sweep,
    Target,
    Views,
    plain_control,
)
from eclsim.devices.products import Product
from eclsim.inputs.mistakes import Remarks
from eclsim.inputs.numbers import is_number
from eclsim.inputs.sections import Raw, Section
from eclsim.parameters.parameter import Parameter

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit

S = TypeVar("S", bound=Section)
_EMPTY: Mapping[str, Any] = MappingProxyType({})


class Device(ABC, Generic[S]):
    """A device that can be connected to a patient.

    Names are those of a single, unnamed instance. Only `key`, `name`, `section`, `circuit` and `values` are
    required. Other attributes default to none (no limits, no knobs) or to a generic drawing and listing.
    """

    key: ClassVar[str]
    """Name of its section in a case file, group of its compartments, first part of its parameters' names."""
    name: ClassVar[str]
    """Clinical name, such as "ECMO"."""
    section: ClassVar[type[Section]]
    """Its section of the case file."""

    compartments: ClassVar[Mapping[str, str]] = _EMPTY
    """Labels of its compartments, in flow direction."""
    connections: ClassVar[Mapping[str, str]] = _EMPTY
    """Labels of its connections, in flow direction."""
    positions: ClassVar[Mapping[str, str]] = _EMPTY
    """Its sites to which other devices can be connected, and the compartment at each."""
    position_words: ClassVar[Mapping[str, str]] = _EMPTY
    """Labels of these sites."""
    lines: ClassVar[Mapping[str, str]] = _EMPTY
    """Keys of its section that set the sites of movable lines, and the connections of these lines."""
    boxes: ClassVar[Mapping[str, Box]] = _EMPTY
    """Boxes of its compartments in the drawing; by default in flow direction."""
    marks: ClassVar[Mapping[str, Mark]] = _EMPTY
    """Symbols of its connections in the drawing; by default from their laws and `connections`."""
    housed: ClassVar[Housed | None] = None
    """Its box in the drawing, if it has no compartments and lies in the housing of another device's part."""
    look: ClassVar[Look] = Look("#7A4A72", "#F8F2F6", 1.3, (0, (1.5, 1.2)), "v")
    """Its colours and line style in figures."""
    panels: ClassVar[Sequence[Panel]] = ()
    """Panels of its figure of waveforms; by default pressures and flows in flow direction."""
    swept: ClassVar[Sequence[Panel]] = ()
    """Panels of its outputs, in addition to its flow, in the figure of a sweep."""
    tabled: ClassVar[Sequence[tuple[str, Sequence[str]]] | None] = None
    """Titles and outputs, in addition to its flows, in the table of results; by default all outputs."""
    schemes: ClassVar[Mapping[str, Mapping[str, str]]] = _EMPTY
    """Usual ways of connecting its `lines`, by name: the site of each key."""
    products: ClassVar[Sequence[Product]] = ()
    """Products of which it may consist, with constants and sources."""
    parameters: ClassVar[Sequence[Parameter]] = ()
    """Its constants that a case file may change in `[parameters]`."""
    nominal: ClassVar[Mapping[str, float]] = _EMPTY
    """Usual values of the parameters that `values` returns; the search for a beat starts with them."""
    outputs: ClassVar[Sequence[Output]] = ()
    """Outputs of a beat that it adds."""
    optional: ClassVar[Mapping[str, str]] = _EMPTY
    """Keys of its section that may be left out, and the waveform or parameter that is then missing."""
    limits: ClassVar[Sequence[Limit]] = ()
    """Bounds that its outputs should not cross."""
    assumptions: ClassVar[Sequence[Assumption]] = ()
    """Usual values without a source on which its outputs depend."""
    alike: ClassVar[Sequence[tuple[str, ...]]] = ()
    """Groups of equivalent outputs; of the limits that a group exceeds, only the most serious is reported."""
    usual: ClassVar[Mapping[str, Any]] = _EMPTY
    """Section with which the page connects it; if empty, the page cannot connect it."""
    set_by_products: ClassVar[Mapping[str, str]] = _EMPTY
    """Keys of its section that name a product, and the parameter that the product sets."""
    carries_circulation: ClassVar[bool] = False
    """Whether it can maintain arterial pressure without a pulse."""
    adjusted: ClassVar[Sequence[str]] = ()
    """Keys of its section adjusted to reach goals, the costliest first; small values are preferred."""
    columns: ClassVar[Columns] = Columns()
    """Its columns in the table of a cohort."""
    target: ClassVar[Target | None] = None
    """Target that its section may give instead of a setting, which is then solved for."""
    views: ClassVar[Views] = Views()
    """Content of the page's views, in addition to its controls and its place in the circuit."""
    assist_flow: ClassVar[str] = ""
    """Output that holds its flow, if it is a pump that takes over a ventricle's work; else empty."""

    @abstractmethod
    def circuit(self, section: S) -> Circuit:
        """Return its compartments and connections, joined to the sites that the section names.

        Import `eclsim.circuit` and `eclsim.components` inside the method: reading a case file must not load
        them.
        """

    def values(self, section: S) -> dict[str, float]:
        """Values of circuit parameters that are missing in `parameters` or differ from the values there.

        By default these are the numbers of the section, such as `vent.fr`.
        """
        settings = section.model_dump().items()
        return {f"{self.key}.{name}": value for name, value in settings if is_number(value)}

    def values_of_blood(self, section: S, haemoglobin_g_dl: float, gases: bool) -> dict[str, float]:
        """Values that follow from the patient's blood (if haemoglobin is known) unless the section sets them.

        Args:
            section: section of the case.
            haemoglobin_g_dl: haemoglobin of the patient [g/dL].
            gases: whether blood gases are computed.
        """
        return {}

    def check(self, values: Raw, case: CaseValues, key: str, remarks: Remarks) -> None:
        """Report contradictions (errors) and implausible values (warnings) of a section that was read.

        Args:
            values: valid values of the section; any may be absent.
            case: valid values of the rest of the case.
            key: key of the section, such as "lvad" or "lvad.left".
            remarks: collects mistakes, warnings and notes.
        """

    def panels_of(self, section: S) -> Sequence[Panel]:
        """Panels of its figure of waveforms for a section, where they follow from how it is connected."""
        return self.panels

    def summary(self, section: S) -> str:
        """Short text of its main settings, such as "HM3 4900 rpm"."""
        settings = section.model_dump(exclude_none=True)
        return ", ".join(f"{name} {value}" for name, value in settings.items())

    def controls(self, section: S, sites: Mapping[str, str]) -> Sequence[Control]:
        """Controls on the page, in the order of the panel.

        Args:
            section: current section.
            sites: labels of the sites to which it can be connected: the patient's and those of other devices.
        """
        result = map(plain_control, self.section.fields().values())
        return [control for control in result if control is not None]

    def shown(self, section: S, key: str) -> float | str:
        """Current value of a control."""
        return getattr(section, key)

    def turned(self, raw: dict[str, Any], key: str, value: object) -> dict[str, Any]:
        """The section, as a mapping, after one control is changed."""
        return {**raw, key: value}

    def turned_in(
        self, raw: dict[str, Any], key: str, value: object, sections: Collection[str]
    ) -> dict[str, Any]:
        """As `turned`, where it depends on which optional `sections` of the patient the case has."""
        return self.turned(raw, key, value)

    def reconnected(self, raw: dict[str, Any], sites: Collection[str]) -> dict[str, Any]:
        """The section after lines are moved whose sites were removed with another device."""
        return raw

    def sizes(self, section: S, key: str) -> Sequence[float]:
        """Available values of a number in its section, such as a maker's sizes; empty if any is allowed."""
        return ()

    def sweep(self, section: S) -> Sweep | None:
        """Pump speed that can be swept, and its usual range; None if there is none."""
        return None

    def findings(
        self, names: Naming, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
    ) -> list[Finding]:
        """Findings about a beat in addition to exceeded limits, such as a flow outside a label's range.

        Args:
            names: names of the instance.
            outputs: outputs of the beat, by name.
            circuit: circuit of patient and devices, with fixed sites.
            values: values of all parameters, including those that `values` returns for the device's own
                section.
        """
        return []

    def held_back(self, names: Naming, values: Mapping[str, float]) -> str:
        """What holds blood back in the device, and what to do; empty if nothing does.

        It is said in place of "drains more than flows in" if a chamber of the patient is empty.
        """
        return ""

    def narrowed(self, names: Naming, values: Mapping[str, float]) -> tuple[float, str]:
        """Closed share of its most narrowed line, and which line that is in words; (0, "") if all are open.

        It is said before settings that are to reach a flow through the line.
        """
        return 0.0, ""

    def __repr__(self) -> str:
        return f"<device {self.key}>"


AnyDevice = Device[Any]


@dataclass(frozen=True)
class Naming:
    """Translation of a device's names to those of one instance.

    Args:
        device: the device.
        name: name of the instance, such as "left" in `[lvad.left]`; empty for the unnamed instance `[lvad]`.
    """

    device: AnyDevice
    name: str = ""

    @property
    def key(self) -> str:
        """Name of its section, such as "lvad" or "lvad.left"; group of its compartments."""
        return instance_key(self.device.key, self.name)

    @property
    def label(self) -> str:
        """Label, such as "LVAD" or "LVAD left"."""
        return f"{self.device.name} {self.name}".strip()

    def cut(self, text: str, limit: int) -> str:
        """A label in at most `limit` characters; the instance's name at its end stays, to tell two apart."""
        if len(text) <= limit:
            return text
        end = f" {self.name}" if self.name and text.endswith(f" {self.name}") else ""
        half = limit // 3
        end = end if len(end) <= 2 * half else f"{end[:half]}…{end[1 - half :]}"
        return f"{text[: limit - 1 - len(end)].rstrip()}…{end}"

    def place(self, name: str) -> str:
        """Name of one of its compartments or connections."""
        return f"{self.key}.{name}" if self.name else name

    def device_place(self, place: str) -> str | None:
        """Device's name for a compartment or connection of the circuit; None if it belongs elsewhere."""
        if self.name:
            result = place.removeprefix(f"{self.key}.")
            return None if result == place else result
        return place if place in self.device.compartments or place in self.device.connections else None

    def signal(self, name: str) -> str:
        """Name of a waveform, such as "Pecmo.left.ecmodrain"; those of the patient are unchanged."""
        kind, place = name[0], name[1:]
        known = place in self.device.compartments or place in self.device.connections
        return kind + self.place(place) if known else name

    def output(self, name: str) -> str:
        """Name of one of its outputs, such as "lvad.left.flow" for "lvad_flow"."""
        return f"{self.key}.{name.removeprefix(f'{self.device.key}_')}" if self.name else name

    def place_label(self, signal: str) -> str:
        """Label of the place of one of its waveforms."""
        place = self.device_place(signal[1:]) or ""
        labels = self.device.connections if signal[0] == "Q" else self.device.compartments
        return f"{labels.get(place, place)} {self.name}".strip()

    def pumps(self) -> tuple[str, ...]:
        """Names of its connections that are pumps."""
        marks = self.device.marks.items()
        return tuple(self.place(place) for place, mark in marks if mark.symbol in ("pump", "roller"))

    def flows(self) -> tuple[str, ...]:
        """Names of its outputs that are mean flows."""
        return tuple(self.output(entry.name) for entry in self.device.outputs if entry.unit == "L/min")

    def panels(self) -> tuple[Panel, ...]:
        """Panels of its figure of waveforms, with the instance's names."""
        return self._named(self.device.panels)

    def _named(self, panels: Sequence[Panel]) -> tuple[Panel, ...]:
        panels = panels or (
            Panel("Pressures", "mmHg", tuple(f"P{place}" for place in self.device.compartments)),
            Panel("Flows", self.device.views.flow_unit.unit, tuple(f"Q{p}" for p in self.device.connections)),
            Panel("Pump head", "mmHg", tuple(f"P{place}" for place in Naming(self.device).pumps())),
        )
        return tuple(replace(panel, names=tuple(map(self.signal, panel.names))) for panel in panels)

    def swept(self) -> tuple[Panel, ...]:
        """Its panels in the figure of a sweep, with the instance's names."""
        return tuple(
            replace(
                panel, title=f"{panel.title} {self.name}".strip(), names=tuple(map(self.output, panel.names))
            )
            for panel in self.device.swept
        )

    def tabled(self) -> list[tuple[str, tuple[str, ...]]]:
        """Titles and outputs in the table of results, with the instance's names."""
        others = tuple(o.name for o in self.device.outputs if o.unit != "L/min")
        groups = ((self.device.name, others),) if self.device.tabled is None else self.device.tabled
        return [(f"{title} {self.name}".strip(), tuple(map(self.output, names))) for title, names in groups]

    def parameter(self, name: str) -> str:
        """Name of one of its parameters; those of others, such as the viscosity of blood, are unchanged."""
        if not self.name:
            return name
        if name.startswith(f"{self.device.key}."):
            return f"{self.key}.{name.removeprefix(f'{self.device.key}.')}"
        is_own = any(name == parameter.key for parameter in self.device.parameters)
        return f"{self.key}.{name}" if is_own else name

    def sites(self) -> dict[str, str]:
        """Its sites for other devices, as case files name them, and the compartment at each."""
        return {self.place(position): self.place(node) for position, node in self.device.positions.items()}

    def site_words(self) -> dict[str, str]:
        """Labels of its sites for other devices."""
        labels = self.device.position_words
        return {
            self.place(position): f"{labels.get(position, position)} {self.name}".strip()
            for position in self.device.positions
        }

    def views(self) -> Views:
        """Content of the page's views, with the instance's names."""
        views, name = self.device.views, self.name
        if not name:
            return views
        outputs = lambda names: tuple(map(self.output, names))  # noqa: E731
        return Views(
            tuple(
                replace(
                    t, signal=self.signal(t.signal), label=f"{t.label} {name}", text=f"{t.text} {name}",
                    outputs=outputs(t.outputs),
                )
                for t in views.traces
            ),
            tuple(
                replace(
                    f, key=f"{f.key}.{name}", label=f"{f.label} {name}", output=self.output(f.output),
                    limits=outputs(f.limits), extremes=outputs(f.extremes),
                )
                for f in views.figures
            ),
            tuple(
                replace(
                    c, output=self.output(c.output), label=f"{c.label} {name}",
                    limited_by=c.limited_by and self.output(c.limited_by),
                )
                for c in views.curves
            ),
            outputs(views.compared),
            views.flow_unit,
            {self.place(place): self.output(output) for place, output in views.flow_outputs.items()},
            tuple(
                replace(
                    s, place=self.place(s.place), label=f"{s.label} {name}",
                    outputs={key: self.output(output) for key, output in s.outputs.items()},
                )
                for s in views.samples
            ),
        )  # fmt: skip


@dataclass(frozen=True)
class Instance(Naming):
    """A device connected to a patient; `section` is its section of the case file."""

    section: Section = field(kw_only=True)

    def values(self, haemoglobin_g_dl: float | None = None, gases: bool = False) -> dict[str, float]:
        """Values of all its parameters, including those that follow from the patient's blood.

        Args:
            haemoglobin_g_dl: haemoglobin of the patient [g/dL]; None if unknown.
            gases: whether blood gases are computed.
        """
        values = {parameter.key: parameter.value for parameter in self.device.parameters}
        set_here = self.device.values(self.section)
        for name in set_here:
            if name not in values and not name.startswith(f"{self.device.key}."):
                allowed = f"a name of `parameters`, or one that begins with '{self.device.key}.'"
                message = f"value {name!r}: two of a kind would share it; allowed: {allowed}"
                raise DeviceError(f"device {self.device.key}, {message}")
        values |= set_here
        if haemoglobin_g_dl is not None:
            values |= self.device.values_of_blood(self.section, haemoglobin_g_dl, gases)
        return {self.parameter(name): value for name, value in values.items()}

    def panels(self) -> tuple[Panel, ...]:
        """Panels of its figure of waveforms as it is connected, with the instance's names."""
        return self._named(self.device.panels_of(self.section))

    def circuit(self) -> Circuit:
        """Its compartments and connections, all in the group of its own key."""
        circuit = self.device.circuit(self.section)
        tables = (getattr(circuit, one.name) for one in fields(circuit))
        if not self.name and all(part.group == self.key for table in tables for part in table):
            return circuit
        return circuit.renamed(self.place, self.parameter, lambda group: self.key)


@dataclass(frozen=True)
class CaseValues:
    """Valid values of a case while it is checked.

    Args:
        patient: values of the section [patient].
        measurements: values of the section [measurements].
        devices: values of each connected device, by the key of its section.
        physiology: values of the sections that extend the published model of the patient, by name.
    """

    patient: Raw
    measurements: Raw
    devices: Mapping[str, Raw]
    physiology: Mapping[str, Raw] = field(default_factory=dict)

    def of(self, device: str) -> dict[str, Raw]:
        """Values of all instances of a device, by the key of their section."""
        return {key: values for key, values in self.devices.items() if device_key(key) == device}


class DeviceError(ValueError):
    """Raised for a device that cannot be registered or used, or a file without one; gives the reason."""


class UnsolvedFlowError(ValueError):
    """Raised for a case with a target pump flow and no speed yet; says how to solve for the speed."""


def instance_key(device: str, name: str) -> str:
    """Key of a section, such as "lvad" or "lvad.left"."""
    return f"{device}.{name}" if name else device


def device_key(key: str) -> str:
    """Device key of a section's key, such as "lvad" for "lvad.left"."""
    return key.partition(".")[0]
