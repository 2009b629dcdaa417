"""The gas exchange of a circuit: from the mean flows of a beat to the gases of its blood.

A circuit's table of exchanges says where blood takes up or gives off gas; its connections say how blood gets
there. Every result is a `Quantity`; `gas_of` maps mean flows and parameters to all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Hashable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import lru_cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from eclsim.circuit.network import Choice, Circuit, Compartment, Exchange, sites_of
from eclsim.components.base import Values, names_in, value_of
from eclsim.components.exchangers import INLET_WEIGHTS, GasExchanger, NativeLung, Tissue
from eclsim.components.vessels import ElasticVessel, Resistance
from eclsim.gas.steady import GasState, Samples, SearchResult, solve
from eclsim.gas.transport import Drainage, Flows, HeldBlood, Mixtures, balanced, mixtures

PATIENT = "patient"
LAW = "severinghaus1979"
"""Law of the blood."""
SAMPLE_SITES = ("sart", "upper", "lower", "pas")
"""Compartments, if present in a circuit, whose blood gases are results."""
GASES = ("PO2", "PCO2", "pH", "SO2", "oxygen", "carbon_dioxide")
"""Quantities of a sample: mmHg, mmHg, -, 0 to 1, and contents [mL/dL]."""
CONTENTS = GASES[-2:]
"""Quantities that mix linearly and are known for the blood in every compartment."""
WORST_ERROR = 1e-8
SMALLEST_SUPPLY = 0.1
"""Share of the demand below which a tissue's oxygen supply is reported as missing."""
LARGEST_PCO2 = 300.0
"""PCO2 [mmHg] above which removal of CO2 is reported as missing; no law of blood is valid there."""


class GasStatus(IntEnum):
    """Outcome of solving for the steady gas state of one patient."""

    STEADY = 0
    NO_OXYGEN = 1
    NO_REMOVAL = 2
    NOT_CONVERGED = 3
    INVALID_INPUT = 4

    @property
    def word(self) -> str:
        """Name in lower case, as used in results and files."""
        return self.name.lower()

    @property
    def message(self) -> str:
        """Meaning of the status, and what to do."""
        return _MESSAGES[self]


_MESSAGES = {
    GasStatus.STEADY: "steady gas state found",
    GasStatus.NO_OXYGEN: (
        "no steady gas state: less than a tenth of the oxygen that it needs reaches a tissue, as in a loop "
        "of blood that passes no lung; raise the ventilation or the sweep, lower the shunt, or move a cannula"
    ),
    GasStatus.NO_REMOVAL: (
        "no steady gas state: carbon dioxide is produced and hardly removed (PCO2 above 300 mmHg); raise the "
        "sweep or the alveolar ventilation"
    ),
    GasStatus.NOT_CONVERGED: (
        "no steady gas state found: check the keys of [gas] and the sweep against their ranges"
    ),
    GasStatus.INVALID_INPUT: "no gases computed: a value is one that no blood or gas can have",
}


class Quantity(NamedTuple):
    """Name of a number of the gas state.

    Attributes:
        what: a name of `GASES`; for an exchange, the oxygen "gained" and "supplied" or the carbon dioxide
            "gained_co2" [mL/min STPD]; "recirculated", the share of drawn blood that comes from an
            exchange; "status"; or "unknown", an unknown of the search, from which derivatives are computed.
        where: "in" a compartment whose blood is analysed, "mixed" in any compartment (contents only), "drawn"
            by a connection, "behind" an exchange, "into" an exchange whose rate depends on the entering
            blood, "within" a lung (its alveoli), or "at" an exchange.
        place: name of the compartment or connection, or number of an unknown.
    """

    what: str
    where: str = ""
    place: str = ""


STATUS = Quantity("status")


def gas_exchanges(circuit: Circuit) -> tuple[Exchange, ...]:
    """Exchanges of oxygen and carbon dioxide in a circuit."""
    return tuple(e for e in circuit.exchanges if isinstance(e.component, GasExchanger))


def flows_of(
    circuit: Circuit, forward: Array, backward: Array, values: Values, held: HeldBlood | None = None
) -> Flows:
    """Balanced mean flows of a circuit.

    Args:
        circuit: the circuit; parameters may select its sites.
        forward: mean forward flow of each connection [L/min], in the order of the circuit.
        backward: mean backward flow of each connection [L/min], positive.
        values: values of the parameters that select sites (`switches`).
        held: blood held by compartments over a step in time; None for a steady beat.
    """
    place = {c.name: k for k, c in enumerate(circuit.compartments)}
    ends = []
    for sites in ([c.source for c in circuit.connections], [c.target for c in circuit.connections]):
        columns = []
        for site in sites:
            column = np.zeros((len(place), len(sites_of(site))))
            column[[place[name] for name in sites_of(site)], np.arange(len(sites_of(site)))] = 1.0
            chosen = (
                jnp.arange(column.shape[1]) == values[site.parameter] if isinstance(site, Choice) else [1.0]
            )
            columns.append(column @ jnp.asarray(chosen, dtype=float))
        ends.append(jnp.stack(columns, axis=1))
    return balanced(Flows(ends[0], ends[1], forward, backward), held)


def switches(circuit: Circuit) -> tuple[str, ...]:
    """Names of the parameters that select the sites of connections."""
    ends = (site for c in circuit.connections for site in c.sites)
    return tuple(dict.fromkeys(site.parameter for site in ends if isinstance(site, Choice)))


def drainages(circuit: Circuit) -> tuple[Drainage, ...]:
    """Connections that may draw blood before returned blood has mixed with that of their source."""
    groups = {c.name: c.group for c in circuit.compartments}
    result = []
    for j, connection in enumerate(circuit.connections):
        source = connection.source
        if connection.mixing == 1.0 or not isinstance(source, str):
            continue
        returns = tuple(
            k
            for k, other in enumerate(circuit.connections)
            if source in sites_of(other.target) and other.group != groups[source]
        )
        if returns:
            result.append(Drainage(j, returns, connection.mixing))
    return tuple(result)


@dataclass(frozen=True)
class FlowFunction:
    """Function of mean flows and parameters, such as contents of blood.

    Args:
        connections: connections whose mean forward, then backward flows are the first arguments [L/min].
        parameters: parameters that are the next arguments.
        compute: the function, from an array of all arguments to an array of results.
        key: unique identifier.
        without_search: the same function of the arguments and the results of `compute`, without the search;
            used for derivatives.
    """

    connections: tuple[str, ...]
    parameters: tuple[str, ...]
    compute: Callable[[Array], Array]
    key: tuple[Hashable, ...]
    without_search: Callable[[Array, Array], Array] | None = None


@dataclass(frozen=True)
class GasFunction(FlowFunction):
    """Gas state of a circuit as a function of mean flows and parameters.

    For a step in time the further arguments are the volumes of all compartments before and after it, divided
    by its length [L/min], contents of oxygen and of carbon dioxide before it [mL/dL], and for each of
    `lungs_of` the volume of gas divided by the length [L/min BTPS] and its PO2 and PCO2 before [mmHg].

    Args:
        quantities: results, in order.
    """

    quantities: tuple[Quantity, ...] = ()


@lru_cache(maxsize=256)
def transport_of(circuit: Circuit, exchanges: bool = True) -> Circuit:
    """Structure of a circuit for transport: compartments, connections and exchanges.

    Laws of pressures and flows, reflexes and drugs are omitted, so that circuits that differ only in these
    share compiled programs for transport.
    """
    stores = tuple(Compartment(c.name, ElasticVessel(1.0), c.group) for c in circuit.compartments)
    paths = tuple(replace(c, component=Resistance(1.0)) for c in circuit.connections)
    return Circuit(stores, paths, exchanges=circuit.exchanges if exchanges else ()).canonical


def gas_of(circuit: Circuit, in_time: bool = False) -> GasFunction:
    """Gas state of a circuit with exchanges: steady, or after a step in time.

    In a step in time, compartments hold blood and lungs hold gas. Other exchangers (membranes, and tissues
    apart from stores that may hold their PCO2) hold nothing and respond at once to the blood that reaches
    them.
    """
    return _gas_of(transport_of(circuit), in_time)


@lru_cache(maxsize=64)
def _gas_of(circuit: Circuit, in_time: bool) -> GasFunction:
    exchanges, names = gas_exchanges(circuit), tuple(c.name for c in circuit.connections)
    laws = [e.component for e in exchanges if isinstance(e.component, GasExchanger)]
    of_exchanges = [n for e in exchanges for n in e.component.parameter_names()]
    mixing = [n for d in drainages(circuit) for n in names_in(d.mixing)]
    parameters = tuple(dict.fromkeys((*of_exchanges, *mixing, *switches(circuit))))
    in_lungs = [f"{what} {e.at}" for e in lungs_of(circuit) for what in _IN_LUNGS] if in_time else []
    over_time = [_over_a_step(e) for e in exchanges] if in_time else laws
    samples = _samples(circuit)
    quantities = tuple(Quantity(gas, where, at) for where, at in samples for gas in GASES)
    quantities += tuple(Quantity(gas, "into", exchanges[k].at) for k, _ in _entered(laws) for gas in GASES)
    quantities += tuple(Quantity(gas, "within", exchanges[k].at) for k, _ in _alveoli(laws) for gas in GASES)
    quantities += tuple(Quantity("recirculated", "drawn", at) for at, _ in _drawn(circuit))
    quantities += tuple(Quantity(gas, "mixed", c.name) for gas in CONTENTS for c in circuit.compartments)
    quantities += tuple(
        Quantity(what, "at", e.at) for e in exchanges for what in ("gained", "gained_co2", "supplied")
    )

    points = sum(law.points for law in laws) + len(samples)
    unknowns = () if in_time else tuple(Quantity("unknown", place=str(k)) for k in range(3 * points + 1))

    def compute(numbers: Array, given: Array | None = None) -> Array:
        count = len(names)
        last = 2 * count + len(parameters)
        values = dict(zip(parameters, numbers[2 * count : last], strict=True))
        blood = last + 4 * len(circuit.compartments)
        before, after, *contents = numbers[last:blood].reshape(4, -1) if in_time else [jnp.zeros(0)] * 4
        values |= dict(zip(in_lungs, numbers[blood:], strict=True))
        held = HeldBlood(before, after, jnp.stack(contents, axis=1)) if in_time else None
        flows = flows_of(circuit, numbers[:count], numbers[count : 2 * count], values, held)
        at = [names.index(e.at) for e in exchanges]
        drawn = [(d, jnp.asarray(value_of(values, d.mixing))) for d in drainages(circuit)]
        mixed = mixtures(flows, at, drawn, held)
        known = None if given is None else _known(given[-len(unknowns) :], points)
        state = solve(over_time, mixed, values, LAW, _shares(circuit, samples, mixed), known)
        inside = [point for _, point in (*_entered(laws), *_alveoli(laws))]
        sampled = np.r_[points - len(samples) : points, inside].astype(int)
        gases = (*jnp.exp(state.pressure), state.ph, state.saturation, *state.content)
        recirculated = _recirculated(circuit, balanced(flows) if in_time else flows, drawn)
        from_held = 0.0 if mixed.kept is None else mixed.kept[0].T
        result = jnp.concatenate(
            [jnp.stack(gases)[:, sampled].T.reshape(-1), recirculated]
            + [(state.outlets @ mixed.compartments.T + from_held).reshape(-1)]
            + [_exchanged(k, mixed, state) for k in range(len(exchanges))]
        )
        status = _status(exchanges, state, values)
        # Unlike in a steady state, a tissue may lack oxygen for some time.
        valid = state.error < WORST_ERROR if in_time else status == GasStatus.STEADY
        unknowns_of_search = [] if in_time else [*state.pressure, state.ph, state.error[None]]
        return jnp.concatenate([jnp.where(valid, result, jnp.nan), status[None], *unknowns_of_search])

    key = ("gas", circuit, LAW, in_time)
    without_search = None if in_time else compute
    return GasFunction(names, parameters, compute, key, without_search, (*quantities, STATUS, *unknowns))


def _known(unknowns: Array, points: int) -> SearchResult:
    """Rebuild the result of a search from the unknowns that `gas_of` returns with its results."""
    pressure, ph, error = unknowns[: 2 * points].reshape(2, points), unknowns[2 * points : -1], unknowns[-1]
    return SearchResult(pressure, ph, jnp.zeros((), dtype=int), error)


def _drawn(circuit: Circuit) -> list[tuple[str, int]]:
    """Connections that draw patient blood into a group with an analysed exchange, and its index."""
    groups = {c.name: c.group for c in circuit.compartments}
    return [
        (c.name, k)
        for k, exchange in enumerate(gas_exchanges(circuit))
        for c in circuit.connections
        if _analysed(exchange) and c.group == exchange.group
        if all(groups[site] == PATIENT for site in sites_of(c.source))
    ]


def _returns(circuit: Circuit, groups: Container[str]) -> list[str]:
    """Connections through which devices of some groups return blood to the patient."""
    group_of = {c.name: c.group for c in circuit.compartments}
    return [
        c.name
        for c in circuit.connections
        if c.group in groups
        and all(group_of[site] != PATIENT for site in sites_of(c.source))
        and all(group_of[site] == PATIENT for site in sites_of(c.target))
    ]


def _recirculated(circuit: Circuit, flows: Flows, mixing: Sequence[tuple[Drainage, Array]]) -> Array:
    """Share of the blood in each connection of `_drawn` that came straight from its device's return.

    Blood is marked as it returns, so that neither a second exchanger behind the oxygenator nor a filter
    beside it hides any.
    """
    names, exchanges = [c.name for c in circuit.connections], gas_exchanges(circuit)
    body = [names.index(e.at) for e in exchanges if e.group == PATIENT]
    drawn = [(names.index(at), exchanges[k].group) for at, k in _drawn(circuit)]
    returned: dict[str, Array] = {}
    for group in dict.fromkeys(group for _, group in drawn):
        back = [names.index(name) for name in _returns(circuit, {group})]
        returned[group] = mixtures(flows, [*back, *body], mixing).drawn[:, : len(back)].sum(axis=1)
    return jnp.array([returned[group][at] for at, group in drawn])


def _samples(circuit: Circuit) -> tuple[tuple[str, str], ...]:
    """Sampling sites: kind ("in", "behind" or "drawn") and name of the compartment or connection."""
    compartments = [("in", c.name) for c in circuit.compartments if c.name in SAMPLE_SITES]
    behind = [("behind", e.at) for e in gas_exchanges(circuit) if _analysed(e) or _stores(e)]
    drawn = dict.fromkeys(("drawn", name) for name, _ in _drawn(circuit))
    paths = {c.name: c for c in circuit.connections}
    drained = dict.fromkeys(("in", site) for _, name in drawn for site in sites_of(paths[name].target))
    exchanging = {e.group for e in gas_exchanges(circuit) if _analysed(e)}
    returned = [("drawn", name) for name in _returns(circuit, exchanging)]
    return (*compartments, *drawn, *behind, *returned, *drained)


def _analysed(exchange: Exchange) -> bool:
    """Whether blood before and after an exchange is analysed; only exchanges of devices are."""
    law = exchange.component
    return exchange.group != PATIENT and isinstance(law, GasExchanger) and law.analysed


def _stores(exchange: Exchange) -> bool:
    """Whether an exchange is a tissue whose stores can hold its PCO2."""
    return isinstance(exchange.component, Tissue) and exchange.component.held != 0.0


def _entered(laws: Sequence[GasExchanger]) -> list[tuple[int, int]]:
    """Exchanges whose first point is the entering blood: index of the exchange and of that point."""
    first = np.cumsum([0, *(law.points for law in laws)]).tolist()
    return [(k, first[k]) for k, law in enumerate(laws) if law.collocation[1] is INLET_WEIGHTS]


def lungs_of(circuit: Circuit) -> tuple[Exchange, ...]:
    """Exchanges that hold gas over a step in time: the native lungs."""
    return tuple(e for e in gas_exchanges(circuit) if isinstance(e.component, NativeLung))


_IN_LUNGS = ("gas over the step", "PO2 before", "PCO2 before")


def _over_a_step(exchange: Exchange) -> GasExchanger:
    """The law of an exchange over a step in time."""
    held, oxygen, carbon_dioxide = (f"{what} {exchange.at}" for what in _IN_LUNGS)
    law = exchange.component
    assert isinstance(law, GasExchanger)
    return law.over_a_step(held, (oxygen, carbon_dioxide))


def _alveoli(laws: Sequence[GasExchanger]) -> list[tuple[int, int]]:
    """Lungs: index of the exchange, and of the point in equilibrium with the alveoli."""
    ends = np.cumsum([law.points for law in laws]).tolist()
    return [(k, ends[k] - 1) for k, law in enumerate(laws) if isinstance(law, NativeLung)]


def _shares(circuit: Circuit, samples: Sequence[tuple[str, str]], mixed: Mixtures) -> Samples:
    """Composition of the samples."""
    stores, paths = ([entry.name for entry in t] for t in (circuit.compartments, circuit.connections))
    sources = [e.at for e in gas_exchanges(circuit)]

    def rows(compartments: Array, drawn: Array, behind: Array) -> Array:
        tables = {"in": (compartments, stores), "drawn": (drawn, paths), "behind": (behind, sources)}
        return jnp.stack([tables[where][0][tables[where][1].index(at)] for where, at in samples])

    shares = rows(mixed.compartments, mixed.drawn, jnp.eye(len(sources)))
    return Samples(shares, mixed.kept and rows(*mixed.kept[:2], jnp.zeros((len(sources), 2))))


def _exchanged(k: int, mixed: Mixtures, state: GasState) -> Array:
    """Gas gained and oxygen supplied at an exchange [mL/min STPD]."""
    return jnp.stack([*state.gained[:, k], 10.0 * mixed.streams[k] * state.inlets[0, k]])


def _status(exchanges: Sequence[Exchange], state: GasState, values: Values) -> Array:
    """Evaluate the `GasStatus`."""
    tissues = [(k, e.component) for k, e in enumerate(exchanges) if isinstance(e.component, Tissue)]
    met = jnp.stack(
        [-state.gained[0, k] / law.oxygen_demand(values) for k, law in tissues] or [jnp.ones(())]
    ).min()
    pco2 = jnp.exp(state.pressure[1]).max()
    return jnp.where(
        met < SMALLEST_SUPPLY,
        GasStatus.NO_OXYGEN,
        jnp.where(
            pco2 > LARGEST_PCO2,
            GasStatus.NO_REMOVAL,
            jnp.where(state.error < WORST_ERROR, GasStatus.STEADY, GasStatus.NOT_CONVERGED),
        ),
    )
