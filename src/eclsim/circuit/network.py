"""A circuit is two tables: compartments that store blood and connections that carry it.

A circuit is data. It is joined to others with `+`, put under a prefix where there are two of a kind, read
on one screen with `print`, and compared and hashed like any value; nothing in it computes.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

from eclsim.components.base import Key, Path, Renaming, Storage, names_in, renamed_key

SHARED_PARAMETERS = ("etaB", "rhoB")
"""What the blood of all circuits has in common: these parameters keep their names under a prefix."""


@dataclass(frozen=True)
class StartPressure:
    """Start: the compartment is filled to a pressure [mmHg] (`Key`: parameter or number)."""

    pressure: Key = 0.0

    @property
    def keys(self) -> tuple[Key, ...]:
        """What it reads."""
        return (self.pressure,)

    def renamed(self, parameter: Renaming) -> StartPressure:
        """The same start from other parameters."""
        return StartPressure(renamed_key(self.pressure, parameter))


@dataclass(frozen=True)
class StartVolume:
    """Start: a stressed volume, `volume` [mL] or, with `fraction_of`, that share of another quantity [mL]."""

    volume: Key
    fraction_of: Key | None = None

    @property
    def keys(self) -> tuple[Key, ...]:
        """What it reads."""
        return (self.volume,) if self.fraction_of is None else (self.volume, self.fraction_of)

    def renamed(self, parameter: Renaming) -> StartVolume:
        """The same start from other parameters."""
        return StartVolume(*(renamed_key(key, parameter) for key in self.keys))


@dataclass(frozen=True)
class Compartment:
    """A named store of blood.

    Args:
        name: key of the compartment, as in the paper (`ao`, `ecmotudp`).
        component: its law.
        group: what it belongs to: "patient", "ecmo", "crrt", "lvad" or a name of your own.
        start: stressed volume at the start; the sum over a circuit fixes the blood volume.
        total_fraction: share of total blood volume held at the start, for plots of absolute volumes; None
            where the stressed volume is the absolute one.
    """

    name: str
    component: Storage
    group: str = "patient"
    start: StartPressure | StartVolume = field(default_factory=StartPressure)
    total_fraction: Key | None = None

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters of its law, of its share of all blood, and of its start."""
        keys = (*names_in(self.total_fraction), *self.start.keys)
        return self.component.parameter_names() + sum(map(names_in, keys), ())

    def renamed(self, name: Renaming, parameter: Renaming, group: Renaming) -> Compartment:
        """The same compartment under other names."""
        fraction = None if self.total_fraction is None else renamed_key(self.total_fraction, parameter)
        return Compartment(
            name(self.name), self.component.renamed(parameter), group(self.group),
            self.start.renamed(parameter), fraction,
        )  # fmt: skip


@dataclass(frozen=True)
class Choice:
    """One of several sites, chosen per patient by a parameter that holds the position in `sites`."""

    sites: tuple[str, ...]
    parameter: str

    def site(self, value: float) -> str:
        """The site at a position; `ValueError` where the value is none."""
        if value not in range(len(self.sites)):
            allowed = ", ".join(f"{k} ({name})" for k, name in enumerate(self.sites))
            raise ValueError(f"{self.parameter} = {value:g}: no site of this circuit; allowed: {allowed}")
        return self.sites[int(value)]


Site = str | Choice


@dataclass(frozen=True)
class Connection:
    """A named path for blood from one compartment to another; a positive flow leaves `source`."""

    name: str
    component: Path
    source: Site
    target: Site
    group: str = "patient"

    @property
    def sites(self) -> tuple[Site, Site]:
        """Both ends."""
        return (self.source, self.target)

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters of its law and of those that choose its sites."""
        chosen = tuple(site.parameter for site in self.sites if isinstance(site, Choice))
        return self.component.parameter_names() + chosen


@dataclass(frozen=True)
class Circuit:
    """Compartments and the connections between them."""

    compartments: tuple[Compartment, ...] = ()
    connections: tuple[Connection, ...] = ()

    def __hash__(self) -> int:
        """Computed once: every cache of compiled programs asks for it."""
        if "_hash" not in self.__dict__:
            object.__setattr__(self, "_hash", hash((self.compartments, self.connections)))
        return self.__dict__["_hash"]

    def __add__(self, other: Circuit) -> Circuit:
        """Both circuits as one; devices name the compartments they attach to."""
        return Circuit(self.compartments + other.compartments, self.connections + other.connections)

    def __str__(self) -> str:
        """Both tables, one line an entry."""
        stores = [f"  {c.name:<12} {c.group:<8} {c.component}" for c in self.compartments]
        paths = [
            f"  {c.name:<12} {c.group:<8} {site_text(c.source)} -> {site_text(c.target)}  {c.component}"
            for c in self.connections
        ]
        return "\n".join(["compartments", *stores, "connections", *paths])

    def parameter_names(self) -> tuple[str, ...]:
        """Names of all parameters that the circuit reads, each once, in order of appearance."""
        entries = (*self.compartments, *self.connections)
        return tuple(dict.fromkeys(name for entry in entries for name in entry.parameter_names()))

    def renamed(self, name: Renaming, parameter: Renaming, group: Renaming) -> Circuit:
        """The same circuit under other names; sites outside of it keep theirs.

        Args:
            name: of a compartment or connection.
            parameter: of a parameter.
            group: of a group.
        """
        own = {compartment.name for compartment in self.compartments}

        def site(of: str) -> str:
            return name(of) if of in own else of

        def end(of: Site) -> Site:
            if isinstance(of, Choice):
                return Choice(tuple(map(site, of.sites)), parameter(of.parameter))
            return site(of)

        compartments = (c.renamed(name, parameter, group) for c in self.compartments)
        connections = (
            Connection(
                name(c.name), c.component.renamed(parameter), end(c.source), end(c.target), group(c.group)
            )
            for c in self.connections
        )
        return Circuit(tuple(compartments), tuple(connections))

    def prefixed(self, prefix: str, shared: Collection[str] = SHARED_PARAMETERS) -> Circuit:
        """The same circuit as one of two of a kind, such as "lvad.left".

        The prefix comes in front of every name; what begins with its first word already, such as the
        parameter "lvad.speed_rpm" or the group "lvad", becomes "lvad.left.speed_rpm" or "lvad.left".

        Args:
            prefix: without a dot at its end; empty for the circuit as it is.
            shared: parameters that are those of all circuits.
        """
        kind = prefix.partition(".")[0]

        def put(name: str) -> str:
            rest = name.removeprefix(kind)
            return prefix + rest if rest != name and rest[:1] in ("", ".") else f"{prefix}.{name}"

        return self.renamed(put, lambda n: n if n in shared else put(n), put) if prefix else self

    def with_chosen_sites(self, values: Mapping[str, float]) -> Circuit:
        """The circuit of one patient: a fixed site wherever the value of a parameter chooses it."""

        def site(of: Site) -> Site:
            if isinstance(of, str) or of.parameter not in values:
                return of
            return of.site(float(values[of.parameter]))

        paths = (replace(c, source=site(c.source), target=site(c.target)) for c in self.connections)
        return replace(self, connections=tuple(paths))

    def compartment(self, name: str) -> Compartment:
        """The compartment of that name."""
        return next(c for c in self.compartments if c.name == name)

    def connection(self, name: str) -> Connection:
        """The connection of that name."""
        return next(c for c in self.connections if c.name == name)

    def has(self, group: str) -> bool:
        """Whether any part belongs to a group, such as "ecmo"."""
        return any(part.group == group for part in (*self.compartments, *self.connections))


def sites_of(site: Site) -> tuple[str, ...]:
    """All compartments that a site may stand for."""
    return site.sites if isinstance(site, Choice) else (site,)


def site_text(site: Site) -> str:
    """A site in words."""
    return f"{{{' | '.join(site.sites)} by {site.parameter}}}" if isinstance(site, Choice) else site
