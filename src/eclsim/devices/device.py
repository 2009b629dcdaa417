"""What a device is: everything the rest of the package needs to know of it, in one object.

A device is a subclass of `Device` in a file of its own, and a line in `eclsim.devices.registry` (or a call of
`eclsim.register_device`). Case files, outputs, limits, drawings, the page and the analyses go through the
registry and name no device.

The same device may be connected more than once, as `[lvad.left]` and `[lvad.right]`: an `Instance` is one of
them. A device is written with the names of an only instance (`[lvad]`: compartments such as `ecmodrain`,
parameters such as `lvad.speed_rpm` or `Recmooxy`); those of a named one get the instance in front
(`ecmo.left.ecmodrain`, `lvad.left.speed_rpm`, `ecmo.left.Recmooxy`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from eclsim.devices.description import (
    Assumption,
    Box,
    Columns,
    Control,
    Finding,
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
from eclsim.inputs.sections import Raw, Section
from eclsim.parameters.parameter import Parameter

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit

S = TypeVar("S", bound=Section)
_EMPTY: Mapping[str, Any] = MappingProxyType({})


class Device(ABC, Generic[S]):
    """A device that can be connected to a patient.

    Names in it are those of an only instance. Only `key`, `name`, `section`, `circuit` and `values` are
    needed; what is left out is simply not there (no limits, no knobs), or drawn and listed in a plain way.
    """

    key: ClassVar[str]
    """Name of its section in a case file, group of its compartments, first part of its parameters' names."""
    name: ClassVar[str]
    """What clinicians call it, such as "ECMO"."""
    section: ClassVar[type[Section]]
    """Its section of the case file."""

    compartments: ClassVar[Mapping[str, str]] = _EMPTY
    """Its compartments, in flow direction, in words."""
    connections: ClassVar[Mapping[str, str]] = _EMPTY
    """Its connections, in flow direction, in words."""
    positions: ClassVar[Mapping[str, str]] = _EMPTY
    """Sites in it that other devices can be connected to, and the compartment that stands there."""
    position_words: ClassVar[Mapping[str, str]] = _EMPTY
    """These sites in words."""
    lines: ClassVar[Mapping[str, str]] = _EMPTY
    """Keys of its section that say where lines end that can be moved to such sites, and their connections."""
    boxes: ClassVar[Mapping[str, Box]] = _EMPTY
    """Where its compartments stand in the drawing; left out, in flow direction."""
    marks: ClassVar[Mapping[str, Mark]] = _EMPTY
    """How its connections are marked in the drawing; left out, by their laws and `connections`."""
    look: ClassVar[Look] = Look("#7A4A72", "#F8F2F6", 1.3, (0, (1.5, 1.2)), "v")
    """Its colour and line in figures."""
    panels: ClassVar[Sequence[Panel]] = ()
    """Its figure of waveforms; left out, pressures and flows in flow direction."""
    swept: ClassVar[Sequence[Panel]] = ()
    """Its outputs in the figure of a sweep, besides its flow."""
    tabled: ClassVar[Sequence[tuple[str, Sequence[str]]] | None] = None
    """Titles and outputs in the table of results, besides its flows; left out, all that it has."""
    schemes: ClassVar[Mapping[str, Mapping[str, str]]] = _EMPTY
    """Usual ways of connecting these lines by name: the position of each key."""
    products: ClassVar[Sequence[Product]] = ()
    """What it may be made of, with constants and sources."""
    parameters: ClassVar[Sequence[Parameter]] = ()
    """Its constants that a case file may change in `[parameters]`."""
    nominal: ClassVar[Mapping[str, float]] = _EMPTY
    """Usual values of what `values` gives: the search for a patient's beat starts from a beat with them."""
    outputs: ClassVar[Sequence[Output]] = ()
    """Numbers of a beat that it adds."""
    limits: ClassVar[Sequence[Limit]] = ()
    """Bounds that its outputs should not cross."""
    assumptions: ClassVar[Sequence[Assumption]] = ()
    """Usual values without a source that its outputs follow from."""
    alike: ClassVar[Sequence[tuple[str, ...]]] = ()
    """Equivalent outputs: of their broken limits only the gravest is reported."""
    usual: ClassVar[Mapping[str, Any]] = _EMPTY
    """Its section where the page connects it; without one the page cannot."""
    set_by_products: ClassVar[Mapping[str, str]] = _EMPTY
    """Keys of its section that name a product, and the parameter that follows from it."""
    carries_circulation: ClassVar[bool] = False
    """Whether it can keep the arterial pressure up without a pulse."""
    adjusted: ClassVar[Sequence[str]] = ()
    """Keys of its section that are turned to reach goals, the dearest first; small values are sought."""
    columns: ClassVar[Columns] = Columns()
    """Its columns in the table of a cohort."""
    target: ClassVar[Target | None] = None
    """What its section may name in place of a setting that is then solved for."""
    views: ClassVar[Views] = Views()
    """What the views of the page show of it besides its knobs and its place in the circuit."""
    assist_flow: ClassVar[str] = ""
    """The output that is its flow, if it is a pump that takes over a ventricle's work; else empty."""

    @abstractmethod
    def circuit(self, section: S) -> Circuit:
        """Its compartments and connections, joined to the sites that the section names.

        Import `eclsim.circuit` and `eclsim.components` inside: a case file is read without them.
        """

    @abstractmethod
    def values(self, section: S) -> dict[str, float]:
        """Values of the parameters of the circuit that `parameters` does not hold, or holds otherwise."""

    def values_of_blood(self, section: S, haemoglobin_g_dl: float, gases: bool) -> dict[str, float]:
        """Values that its section leaves to the patient's blood, where a case has its haemoglobin.

        Args:
            section: of the case.
            haemoglobin_g_dl: of the patient.
            gases: whether the gases of the blood are followed.
        """
        return {}

    def check(self, values: Raw, case: CaseValues, key: str, remarks: Remarks) -> None:
        """Report contradictions (errors) and doubts (warnings) about a section that was read.

        Args:
            values: of the section, as far as they are right: any may be absent.
            case: the rest of the case.
            key: of the section, such as "lvad" or "lvad.left".
            remarks: collects mistakes, warnings and notes.
        """

    def summary(self, section: S) -> str:
        """Its main settings in a few words, such as "HM3 4900 rpm"."""
        settings = section.model_dump(exclude_none=True)
        return ", ".join(f"{name} {value}" for name, value in settings.items())

    def controls(self, section: S, sites: Mapping[str, str]) -> Sequence[Control]:
        """What can be turned on the page, in the order of the panel.

        Args:
            section: as it is.
            sites: where the device can be connected, in words: the patient's and those of other devices.
        """
        result = map(plain_control, self.section.fields().values())
        return [control for control in result if control is not None]

    def shown(self, section: S, key: str) -> float | str:
        """Where a control stands."""
        return getattr(section, key)

    def turned(self, raw: dict[str, Any], key: str, value: object) -> dict[str, Any]:
        """Its section as mappings with one control turned."""
        return {**raw, key: value}

    def reconnected(self, raw: dict[str, Any], sites: Collection[str]) -> dict[str, Any]:
        """Its section with lines moved whose sites have gone with another device."""
        return raw

    def sizes(self, section: S, key: str) -> Sequence[float]:
        """The values that a number of its section comes in, such as a maker's sizes; empty if any."""
        return ()

    def sweep(self, section: S) -> Sweep | None:
        """The speed of its pump that can be swept, and its usual range; None without one."""
        return None

    def findings(
        self, names: Naming, outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float]
    ) -> list[Finding]:
        """Findings about a beat besides limits that it breaks, such as a label's range.

        Args:
            names: of one instance.
            outputs: of the beat, by name.
            circuit: of patient and devices, with fixed sites.
            values: of all parameters, with all that `values` of the device's own section gives.
        """
        return []

    def __repr__(self) -> str:
        return f"<device {self.key}>"


AnyDevice = Device[Any]


@dataclass(frozen=True)
class Naming:
    """How the names of a device become those of one instance of it.

    Args:
        device: what it is.
        name: such as "left" in `[lvad.left]`; empty for an only instance, `[lvad]`.
    """

    device: AnyDevice
    name: str = ""

    @property
    def key(self) -> str:
        """Name of its section, such as "lvad" or "lvad.left"; group of its compartments."""
        return instance_key(self.device.key, self.name)

    @property
    def label(self) -> str:
        """What to call it, such as "LVAD" or "LVAD left"."""
        return f"{self.device.name} {self.name}".strip()

    def place(self, name: str) -> str:
        """Name of one of its compartments or connections."""
        return f"{self.key}.{name}" if self.name else name

    def device_place(self, place: str) -> str | None:
        """The device's name for a compartment or connection of the circuit; None for another's."""
        if self.name:
            result = place.removeprefix(f"{self.key}.")
            return None if result == place else result
        return place if place in self.device.compartments or place in self.device.connections else None

    def signal(self, name: str) -> str:
        """Name of a waveform, such as "Pecmo.left.ecmodrain"; one of the patient as it is."""
        kind, place = name[0], name[1:]
        known = place in self.device.compartments or place in self.device.connections
        return kind + self.place(place) if known else name

    def output(self, name: str) -> str:
        """Name of one of its outputs, such as "lvad.left.flow" of "lvad_flow"."""
        return f"{self.key}.{name.removeprefix(f'{self.device.key}_')}" if self.name else name

    def place_label(self, signal: str) -> str:
        """What the place of one of its waveforms is called."""
        place = self.device_place(signal[1:]) or ""
        labels = self.device.connections if signal[0] == "Q" else self.device.compartments
        return f"{labels.get(place, place)} {self.name}".strip()

    def pumps(self) -> tuple[str, ...]:
        """Connections of it that are pumps."""
        marks = self.device.marks.items()
        return tuple(self.place(place) for place, mark in marks if mark.symbol in ("pump", "roller"))

    def flows(self) -> tuple[str, ...]:
        """Its outputs that are mean flows."""
        return tuple(self.output(entry.name) for entry in self.device.outputs if entry.unit == "L/min")

    def panels(self) -> tuple[Panel, ...]:
        """Its figure of waveforms, under its own names."""
        panels = self.device.panels or (
            Panel("Pressures", "mmHg", tuple(f"P{place}" for place in self.device.compartments)),
            Panel("Flows", self.device.views.flow_unit.unit, tuple(f"Q{p}" for p in self.device.connections)),
            Panel("Pump head", "mmHg", tuple(f"P{place}" for place in Naming(self.device).pumps())),
        )
        return tuple(replace(panel, names=tuple(map(self.signal, panel.names))) for panel in panels)

    def swept(self) -> tuple[Panel, ...]:
        """Its panels in the figure of a sweep, under its own names."""
        return tuple(
            replace(
                panel, title=f"{panel.title} {self.name}".strip(), names=tuple(map(self.output, panel.names))
            )
            for panel in self.device.swept
        )

    def tabled(self) -> list[tuple[str, tuple[str, ...]]]:
        """Titles and outputs in the table of results, under its own names."""
        others = tuple(o.name for o in self.device.outputs if o.unit != "L/min")
        groups = ((self.device.name, others),) if self.device.tabled is None else self.device.tabled
        return [(f"{title} {self.name}".strip(), tuple(map(self.output, names))) for title, names in groups]

    def parameter(self, name: str) -> str:
        """Name of one of its parameters; of others, such as the viscosity of blood, the name as it is."""
        if not self.name:
            return name
        if name.startswith(f"{self.device.key}."):
            return f"{self.key}.{name.removeprefix(f'{self.device.key}.')}"
        is_own = any(name == parameter.key for parameter in self.device.parameters)
        return f"{self.key}.{name}" if is_own else name

    def sites(self) -> dict[str, str]:
        """Its positions for other devices, as case files name them, and the compartment that stands there."""
        return {self.place(position): self.place(node) for position, node in self.device.positions.items()}

    def site_words(self) -> dict[str, str]:
        """The same positions in words."""
        labels = self.device.position_words
        return {
            self.place(position): f"{labels.get(position, position)} {self.name}".strip()
            for position in self.device.positions
        }

    def views(self) -> Views:
        """What the views of the page show of it, under its own names."""
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
    """One of the devices connected to a patient; `section` is its section of the case file."""

    section: Section = field(kw_only=True)

    def values(self, haemoglobin_g_dl: float | None = None, gases: bool = False) -> dict[str, float]:
        """Values of all its parameters, with what its section leaves to the patient's blood.

        Args:
            haemoglobin_g_dl: of the patient, where it is known.
            gases: whether the gases of the blood are followed.
        """
        values = {parameter.key: parameter.value for parameter in self.device.parameters}
        values |= self.device.values(self.section)
        if haemoglobin_g_dl is not None:
            values |= self.device.values_of_blood(self.section, haemoglobin_g_dl, gases)
        return {self.parameter(name): value for name, value in values.items()}

    def circuit(self) -> Circuit:
        """Its compartments and connections."""
        circuit = self.device.circuit(self.section)
        if not self.name:
            return circuit
        return circuit.renamed(self.place, self.parameter, lambda group: self.key)


@dataclass(frozen=True)
class CaseValues:
    """What is right of a case while it is checked.

    Args:
        patient: values of [patient].
        measurements: of [measurements].
        devices: of each connected device, by the key of its section.
        physiology: of the sections on what the patient has beyond the published model, by name.
    """

    patient: Raw
    measurements: Raw
    devices: Mapping[str, Raw]
    physiology: Mapping[str, Raw] = field(default_factory=dict)

    def of(self, device: str) -> dict[str, Raw]:
        """The instances of a device, by the key of their section."""
        return {key: values for key, values in self.devices.items() if device_key(key) == device}


class UnsolvedFlowError(ValueError):
    """A case that names the pump flow wanted, and no speed yet; says how to get it."""


def instance_key(device: str, name: str) -> str:
    """Key of a section, such as "lvad" or "lvad.left"."""
    return f"{device}.{name}" if name else device


def device_key(key: str) -> str:
    """The device of a section, such as "lvad" of "lvad.left"."""
    return key.partition(".")[0]
