"""A circuit is two tables: compartments that store blood and connections that carry it.

A circuit is data. It is built from parts, joined with `+`, read on one screen with `print`, and compared and
hashed like any value; nothing in it computes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from eclsim.components.base import Key, Path, Storage, names_in


@dataclass(frozen=True)
class StartPressure:
    """Start: the compartment is filled to a pressure [mmHg] (`Key`: parameter or number)."""

    pressure: Key = 0.0


@dataclass(frozen=True)
class StartVolume:
    """Start: a stressed volume, `volume` [mL] or, with `fraction_of`, that share of another quantity [mL]."""

    volume: Key
    fraction_of: Key | None = None


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
        names: dict[str, None] = {}
        for compartment in self.compartments:
            names.update(dict.fromkeys(compartment.component.parameter_names()))
            names.update(dict.fromkeys(_start_names(compartment)))
        for connection in self.connections:
            names.update(dict.fromkeys(connection.component.parameter_names()))
            for site in (connection.source, connection.target):
                if isinstance(site, Choice):
                    names[site.parameter] = None
        return tuple(names)

    def with_chosen_sites(self, values: Mapping[str, float]) -> Circuit:
        """The circuit of one patient: a fixed site wherever the value of a parameter chooses it."""

        def site(of: Site) -> Site:
            if isinstance(of, str) or of.parameter not in values:
                return of
            return of.site(float(values[of.parameter]))

        paths = (replace(c, source=site(c.source), target=site(c.target)) for c in self.connections)
        return Circuit(self.compartments, tuple(paths))

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


def _start_names(compartment: Compartment) -> tuple[str, ...]:
    start = compartment.start
    names = names_in(compartment.total_fraction)
    if isinstance(start, StartPressure):
        return names + names_in(start.pressure)
    return names + names_in(start.volume) + names_in(start.fraction_of)
