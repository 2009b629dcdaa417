"""Circuits as tables of compartments, connections, controllers, exchanges and surroundings.

A circuit is data: it computes nothing. Circuits are joined with `+`, prefixed where there are two of a kind,
shown with `print`, and compared and hashed by value.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, fields, replace
from enum import Enum
from functools import cached_property, lru_cache
from typing import NamedTuple

from eclsim.circuit.signals import Kind, Signal
from eclsim.components.base import (
    Component,
    Controller,
    Enclosure,
    Exchanger,
    Key,
    Path,
    Renaming,
    Storage,
    names_in,
    renamed,
)
from eclsim.components.exchangers import BLOOD
from eclsim.components.vessels import TubeVolume

HEART_RATE = "heart_rate_bpm"
"""Parameter that every circuit has in addition to those of its laws."""
BLOOD_VOLUME = "total_blood_volume_ml"
"""The patient's total blood volume [mL]; start volumes are shares of it."""
SHARED_PARAMETERS = ("etaB", "rhoB", *BLOOD)
"""Parameters of the blood that all circuits share; a prefix does not change their names."""


@dataclass(frozen=True)
class StartPressure(Component):
    """Start condition: the compartment is filled to a pressure; each entry is a parameter or a number.

    Args:
        pressure: pressure at the start [mmHg].
        given: blood [mL] added to that volume; negative if removed.
        unstressed: change of unstressed volume [mL] after filling, at constant total blood volume.
    """

    pressure: Key = 0.0
    given: Key = 0.0
    unstressed: Key = 0.0


@dataclass(frozen=True)
class StartVolume(Component):
    """Start condition: a stressed volume `volume` [mL], or that fraction of a volume `fraction_of` [mL]."""

    volume: Key
    fraction_of: Key | None = None


@dataclass(frozen=True)
class Compartment:
    """Named compartment that holds blood.

    Args:
        name: key of the compartment, as in the paper (`ao`, `ecmotudp`).
        component: its law.
        group: "patient", "ecmo", "crrt", "lvad" or another name of the part that it belongs to.
        start: start condition; the sum over a circuit of the stressed start volumes fixes the blood volume.
        total_fraction: share of the total blood volume at the start, for plots of absolute volumes; None if
            the stressed volume is the absolute volume.
        rest_volume: volume [mL] in addition to the stressed one, independent of pressure, as of a rigid shell
            or tube. Its blood takes part in transport, but not in pressures; see `total_volumes`.
    """

    name: str
    component: Storage
    group: str = "patient"
    start: StartPressure | StartVolume = field(default_factory=StartPressure)
    total_fraction: Key | None = None
    rest_volume: Key | TubeVolume = 0.0

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters of its law, its share of the total blood volume and its start."""
        return sum(map(names_in, (self.component, self.total_fraction, self.start)), ())

    def content_names(self) -> tuple[str, ...]:
        """Names of the parameters of its rest volume, which the heartbeat does not use."""
        return names_in(self.rest_volume)

    def renamed(self, name: Renaming, parameter: Renaming, group: Renaming) -> Compartment:
        """The same compartment with its names changed."""
        return Compartment(
            name(self.name),
            self.component.renamed(parameter),
            group(self.group),
            self.start.renamed(parameter),
            renamed(self.total_fraction, parameter),
            renamed(self.rest_volume, parameter),
        )


@dataclass(frozen=True)
class Choice:
    """One of several compartments, selected per patient by a parameter that holds the index in `sites`."""

    sites: tuple[str, ...]
    parameter: str

    def site(self, value: float) -> str:
        """The site with an index; raises `ValueError` if the index is out of range."""
        if value not in range(len(self.sites)):
            allowed = ", ".join(f"{k} ({name})" for k, name in enumerate(self.sites))
            raise ValueError(f"{self.parameter} = {value:g}: not a site of this circuit; allowed: {allowed}")
        return self.sites[int(value)]


Site = str | Choice


@dataclass(frozen=True)
class Connection:
    """Named path of blood from one compartment to another; positive flow leaves `source`.

    Args:
        name: key of the connection.
        component: its law.
        source: compartment at which it begins.
        target: compartment at which it ends.
        group: as of a compartment.
        mixing: blood that it draws where other groups return blood to its source: 1 for the source's mixed
            blood, 0 for the source's own inflows before they mix with the returned blood.
    """

    name: str
    component: Path
    source: Site
    target: Site
    group: str = "patient"
    mixing: Key = 1.0

    @property
    def sites(self) -> tuple[Site, Site]:
        """Both ends."""
        return (self.source, self.target)

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters of its law and of those that select its sites."""
        chosen = tuple(site.parameter for site in self.sites if isinstance(site, Choice))
        return self.component.parameter_names() + chosen

    def content_names(self) -> tuple[str, ...]:
        """Names of the parameters of `mixing`, which the heartbeat does not use."""
        return names_in(self.mixing)

    def renamed(self, name: Renaming, parameter: Renaming, group: Renaming, site: Renaming) -> Connection:
        """The same connection with its names changed; `site` renames the compartments at its ends."""

        def end(of: Site) -> Site:
            if isinstance(of, Choice):
                return Choice(tuple(map(site, of.sites)), parameter(of.parameter))
            return site(of)

        law, mixing = self.component.renamed(parameter), renamed(self.mixing, parameter)
        return Connection(name(self.name), law, end(self.source), end(self.target), group(self.group), mixing)


class Statistic(Enum):
    """Statistic of a signal over a beat."""

    MEAN = "mean"
    MAXIMUM = "maximum"
    MINIMUM = "minimum"


class Reading(NamedTuple):
    """Input of a controller from one beat: a statistic of a signal at the ends of all steps."""

    statistic: Statistic
    signal: Signal

    def __str__(self) -> str:
        return f"{self.statistic.value} {self.signal}"


def mean_of(signal: str) -> Reading:
    """Reading of the mean of a signal over the beat, as in the outputs."""
    return Reading(Statistic.MEAN, Signal.parse(signal))


def maximum_of(signal: str) -> Reading:
    """Reading of the largest value of a signal at the end of a step."""
    return Reading(Statistic.MAXIMUM, Signal.parse(signal))


def minimum_of(signal: str) -> Reading:
    """Reading of the smallest value of a signal at the end of a step."""
    return Reading(Statistic.MINIMUM, Signal.parse(signal))


@dataclass(frozen=True)
class Control:
    """Named controller: its readings from one beat and the parameters that it acts on in the next beat.

    Args:
        name: name of the controller; its states are named name + "." + state.
        component: its law.
        reads: readings, in the order in which the law expects them.
        acts_on: parameters of the circuit, or `HEART_RATE`, in the order in which the law expects them.
        group: part that it belongs to, as of a compartment.
    """

    name: str
    component: Controller
    reads: tuple[Reading, ...]
    acts_on: tuple[str, ...]
    group: str = "patient"

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters of its law."""
        return self.component.parameter_names()

    def renamed(self, name: Renaming, parameter: Renaming, group: Renaming, site: Renaming) -> Control:
        """The same controller with its names changed; `site` renames the places of its signals."""
        reads = (r._replace(signal=r.signal._replace(place=site(r.signal.place))) for r in self.reads)
        acts_on = (n if n == HEART_RATE else parameter(n) for n in self.acts_on)
        law = self.component.renamed(parameter)
        return Control(name(self.name), law, tuple(reads), tuple(acts_on), group(self.group))


@dataclass(frozen=True)
class Exchange:
    """Named site where gases or solutes enter or leave the blood.

    Args:
        name: name of the exchange.
        component: its law.
        at: compartment whose blood takes part, or connection along which the exchange happens.
        group: as of a compartment.
    """

    name: str
    component: Exchanger
    at: str
    group: str = "patient"

    def content_names(self) -> tuple[str, ...]:
        """Names of the parameters of its law, which the heartbeat does not use."""
        return self.component.parameter_names()

    def renamed(self, name: Renaming, parameter: Renaming, group: Renaming, site: Renaming) -> Exchange:
        """The same exchange with its names changed; `site` renames its place."""
        return Exchange(name(self.name), self.component.renamed(parameter), site(self.at), group(self.group))


@dataclass(frozen=True)
class Surrounding:
    """Named enclosure, such as the pericardium, that adds one pressure to all compartments in it.

    Args:
        name: name of the enclosure; its pressure is the signal "P" + name.
        component: its law.
        members: names of the compartments in it.
        group: as of a compartment.
    """

    name: str
    component: Enclosure
    members: tuple[str, ...]
    group: str = "patient"

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters of its law."""
        return self.component.parameter_names()

    def renamed(self, name: Renaming, parameter: Renaming, group: Renaming, site: Renaming) -> Surrounding:
        """The same enclosure with its names changed; `site` renames its members."""
        members = tuple(map(site, self.members))
        return Surrounding(name(self.name), self.component.renamed(parameter), members, group(self.group))


@dataclass(frozen=True)
class Circuit:
    """Compartments, connections between them, controllers of their parameters, exchanges, surroundings."""

    compartments: tuple[Compartment, ...] = ()
    connections: tuple[Connection, ...] = ()
    controllers: tuple[Control, ...] = ()
    exchanges: tuple[Exchange, ...] = ()
    surroundings: tuple[Surrounding, ...] = ()

    def __hash__(self) -> int:
        """Hash of all tables, computed once because every cache of compiled programs uses it."""
        if "_hash" not in self.__dict__:
            object.__setattr__(self, "_hash", hash(tuple(getattr(self, one.name) for one in fields(self))))
        return self.__dict__["_hash"]

    def __getstate__(self) -> dict[str, object]:
        """State for pickling: the tables without the hash, as strings hash differently in another process."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def __add__(self, other: Circuit) -> Circuit:
        """Join two circuits; a device names the patient's compartments to which it is attached."""
        if not isinstance(other, Circuit):
            return NotImplemented
        return Circuit(
            self.compartments + other.compartments,
            self.connections + other.connections,
            self.controllers + other.controllers,
            self.exchanges + other.exchanges,
            self.surroundings + other.surroundings,
        )

    def __str__(self) -> str:
        """All tables as text, one line per entry."""
        stores = [f"  {c.name:<12} {c.group:<8} {c.component}" for c in self.compartments]
        paths = [
            f"  {c.name:<12} {c.group:<8} {site_text(c.source)} -> {site_text(c.target)}  {c.component}"
            for c in self.connections
        ]
        lines = ["compartments", *stores, "connections", *paths]
        if self.controllers:
            lines += [
                "controllers",
                *(f"  {c.name:<12} {c.group:<8} {_reads_and_acts_on(c)}" for c in self.controllers),
            ]
        if self.exchanges:
            lines += [
                "exchanges",
                *(f"  {e.name:<12} {e.group:<8} {e.at}  {e.component}" for e in self.exchanges),
            ]
        if self.surroundings:
            around = (
                f"  {s.name:<12} {s.group:<8} {', '.join(s.members)}  {s.component}"
                for s in self.surroundings
            )
            lines += ["surroundings", *around]
        return "\n".join(lines)

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters that the heartbeat reads beside the heart rate, each once, in order."""
        return self._names_read

    @cached_property
    def _names_read(self) -> tuple[str, ...]:
        entries = (*self.compartments, *self.connections, *self.controllers, *self.surroundings)
        names = dict.fromkeys(name for entry in entries for name in entry.parameter_names())
        return tuple(name for name in names if name != HEART_RATE)

    def content_names(self) -> tuple[str, ...]:
        """Names of the parameters of rest volumes, mixing and exchanges, which the heartbeat does not use."""
        return self._contents

    @cached_property
    def _contents(self) -> tuple[str, ...]:
        entries = (*self.compartments, *self.connections, *self.exchanges)
        return tuple(dict.fromkeys(name for entry in entries for name in entry.content_names()))

    def without_exchanges(self) -> Circuit:
        """The circuit without its exchanges, as the heartbeat needs it."""
        return self._of_beat

    @cached_property
    def _of_beat(self) -> Circuit:
        return replace(self, exchanges=()).canonical if self.exchanges else self

    @cached_property
    def canonical(self) -> Circuit:
        """The first circuit created that equals this one; caches then need not compare tables."""
        return _first_equal(self)

    def renamed(self, name: Renaming, parameter: Renaming, group: Renaming) -> Circuit:
        """The same circuit with its names changed; sites outside the circuit keep their names.

        Args:
            name: maps the name of an entry of a table.
            parameter: maps the name of a parameter.
            group: maps the name of a group.
        """
        compartments, connections = ({c.name for c in t} for t in (self.compartments, self.connections))

        def if_in(own: set[str]) -> Renaming:
            return lambda n: name(n) if n in own else n

        names, site, place = (name, parameter, group), if_in(compartments), if_in(compartments | connections)
        return Circuit(
            tuple(c.renamed(*names) for c in self.compartments),
            tuple(c.renamed(*names, site) for c in self.connections),
            tuple(c.renamed(*names, place) for c in self.controllers),
            tuple(e.renamed(*names, place) for e in self.exchanges),
            tuple(s.renamed(*names, site) for s in self.surroundings),
        )

    def prefixed(self, prefix: str, shared: Collection[str] = SHARED_PARAMETERS) -> Circuit:
        """The same circuit with a prefix for one of two devices of a kind, such as "lvad.left".

        The prefix is put before every name. In a name that already begins with the first word of the prefix,
        such as the parameter "lvad.speed_rpm" or the group "lvad", it replaces that word:
        "lvad.left.speed_rpm", "lvad.left".

        Args:
            prefix: prefix without a final dot; an empty string leaves the circuit unchanged.
            shared: parameters that all circuits share and that keep their names.
        """
        kind = prefix.partition(".")[0]

        def put(name: str) -> str:
            rest = name.removeprefix(kind)
            return prefix + rest if rest != name and rest[:1] in ("", ".") else f"{prefix}.{name}"

        return self.renamed(put, lambda n: n if n in shared else put(n), put) if prefix else self

    def with_chosen_sites(self, values: Mapping[str, float]) -> Circuit:
        """The circuit of one patient: sites that parameters select are replaced by the selected ones."""
        given = {name: float(values[name]) for name in self._choosing if name in values}
        return _with_sites(self, tuple(given.items())) if given else self

    def parts_without(self, shut: Collection[str]) -> list[tuple[str, ...]]:
        """Groups of compartments that the other connections join, in the order of the table."""
        part_of = {c.name: c.name for c in self.compartments}
        for connection in self.connections:
            if connection.name in shut:
                continue
            joined, gone = part_of[str(connection.source)], part_of[str(connection.target)]
            part_of = {name: joined if part == gone else part for name, part in part_of.items()}
        return [tuple(n for n in part_of if part_of[n] == part) for part in dict.fromkeys(part_of.values())]

    @cached_property
    def _choosing(self) -> tuple[str, ...]:
        """Names of the parameters that select a site."""
        sites = (site for c in self.connections for site in (c.source, c.target))
        return tuple(dict.fromkeys(site.parameter for site in sites if not isinstance(site, str)))

    def signals(self) -> tuple[Signal, ...]:
        """All signals: P and V of compartments, Q of connections, P of surroundings and connections.

        The P of a connection is its head; a connection named like a compartment has none.
        """
        stores, paths = ([entry.name for entry in table] for table in (self.compartments, self.connections))
        heads = [name for name in paths if name not in stores]
        heads += [surrounding.name for surrounding in self.surroundings]
        places = ((Kind.PRESSURE, stores + heads), (Kind.FLOW, paths), (Kind.VOLUME, stores))
        return tuple(Signal(kind, place) for kind, names in places for place in names)

    def compartment(self, name: str) -> Compartment:
        """The compartment with the given name."""
        return next(c for c in self.compartments if c.name == name)

    def connection(self, name: str) -> Connection:
        """The connection with the given name."""
        return next(c for c in self.connections if c.name == name)


@lru_cache(maxsize=4096)
def _first_equal(circuit: Circuit) -> Circuit:
    return circuit


@lru_cache(maxsize=256)
def _with_sites(circuit: Circuit, given: tuple[tuple[str, float], ...]) -> Circuit:
    """The circuit with its sites replaced by those that the given parameter values select."""
    values = dict(given)

    def site(of: Site) -> Site:
        if isinstance(of, str) or of.parameter not in values:
            return of
        return of.site(values[of.parameter])

    paths = (replace(c, source=site(c.source), target=site(c.target)) for c in circuit.connections)
    return replace(circuit, connections=tuple(paths))


def sites_of(site: Site) -> tuple[str, ...]:
    """All compartments that a site may stand for."""
    return site.sites if isinstance(site, Choice) else (site,)


def site_text(site: Site) -> str:
    """Text for a site."""
    return f"{{{' | '.join(site.sites)} by {site.parameter}}}" if isinstance(site, Choice) else site


def _reads_and_acts_on(control: Control) -> str:
    """Text for the inputs and outputs of a controller."""
    return f"{', '.join(map(str, control.reads))} -> {', '.join(control.acts_on)}  {control.component}"
