"""Pressures and gases of a patient at rest, which are the set points of the reflexes."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np

from eclsim.beat.compilation import compiled
from eclsim.beat.heartbeat import beat_program
from eclsim.beat.recording import MEAN, has_mean, one_way_mean, step_weights
from eclsim.circuit.network import Circuit
from eclsim.gas.network import Quantity, gas_of
from eclsim.orbit.model import Model, model_of
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch, SolvedOrbits, solve
from eclsim.parameters import regulation as keys
from eclsim.parameters.regulation import SET_POINT, VENOUS_SET_POINT
from eclsim.regulation.attach import RIGHT_ATRIUM
from eclsim.regulation.oxygen import LUNG_SETTINGS, lung_resistance, venous_content

if TYPE_CHECKING:
    from eclsim.cases.case import Case

CLOSED_VALVE_L_MIN = 1e-6
"""Mean flow of a valve that the search cannot distinguish from zero: about 1e-5 mL per beat [L/min]."""
MEASURED_SET_POINTS = {SET_POINT: "Pao", VENOUS_SET_POINT: "Pra"}
"""Set points and the waveforms whose means define them; that of the atrium is a transmural pressure."""


def resting_pressures(case: Case) -> Mapping[str, float]:
    """Mean pressures [mmHg] of a case's steady beat without regulation, by set point.

    Computed for the case as written, with its devices, without changed settings and without extra volume. NaN
    if it has no steady beat, or one of many; regulation then cannot be computed.
    """
    model = model_of(case.at_rest())
    return _means(model.circuit, tuple(model.values.items()), model.policy)


def resting_gases(case: Case) -> Mapping[str, float]:
    """Set points of the responses to blood gases, from a case's steady beat at rest, by key.

    They are PO2 and PCO2 of the blood at the chemoreceptors, oxygen content and PCO2 of each bed, and the
    lung's resistance relative to that without hypoxia. NaN if there is no steady gas state, or no steady beat
    that the case determines. The gases of a case written without [gas] are those of the section that it was
    given.
    """
    rest = case.at_rest()
    model = model_of(rest if rest.gas is not None else rest.model_copy(update={"gas": case.gas}))
    return _gases(model.circuit, tuple(model.values.items()), model.policy)


@lru_cache(maxsize=64)
def _gases(circuit: Circuit, values: tuple[tuple[str, float], ...], policy: str) -> Mapping[str, float]:
    model = Model(circuit, dict(values), policy=policy)
    orbits, function = solve(Batch.of(model)), gas_of(circuit)
    gases = dict.fromkeys(function.quantities, float("nan"))
    if _is_determined(orbits):
        flows = _flows(orbits, function.connections)
        numbers = np.concatenate([*flows, [model.values[name] for name in function.parameters]])
        program = compiled(function.compute, ("alone", *function.key))
        gases = dict(zip(gases, np.asarray(program(jnp.asarray(numbers))).tolist(), strict=True))
    beds = [bed for bed in keys.BEDS if Quantity("supplied", "at", bed) in gases]
    first = gases[Quantity("PO2", "in", beds[0])], gases[Quantity("PCO2", "in", beds[0])]
    set_points: dict[str, float] = dict(zip(keys.CHEMOREFLEX_SET_POINTS, first, strict=True))
    for bed in beds:
        supplied, gained = (gases[Quantity(what, "at", bed)] for what in ("supplied", "gained"))
        set_points[keys.paco2_set_point(bed)] = gases[Quantity("PCO2", "in", bed)]
        content = venous_content(gases[Quantity("oxygen", "mixed", bed)], supplied, gained)
        set_points[keys.of_bed(keys.VENOUS_O2_SET_POINT, bed)] = float(content)
    gained, gained_co2 = (gases[Quantity(what, "at", "part")] for what in ("gained", "gained_co2"))
    settings = tuple(model.values[name] for name in LUNG_SETTINGS)
    set_points[keys.LUNG_AT_REST] = float(
        lung_resistance(gases[Quantity("PO2", "in", "pas")], gained, gained_co2, settings)
    )
    return MappingProxyType(set_points)


def _is_determined(orbits: SolvedOrbits) -> bool:
    """Whether there is a steady beat in which no valves that stay shut isolate blood (as in `sealed`)."""
    if orbits.status[0] != Status.CONVERGED:
        return False
    circuit, values = orbits.batch.circuit, orbits.batch.member(0)
    laws = {c.name: c.component for c in circuit.connections if c.group == "patient"}
    valves = tuple(n for n, law in laws.items() if law.one_way and not law.is_leaking(values))
    forward, backward = _flows(orbits, valves)
    shut = [n for n, net in zip(valves, forward - backward, strict=True) if net < CLOSED_VALVE_L_MIN]
    return len(circuit.parts_without(shut)) == 1


def _flows(orbits: SolvedOrbits, connections: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Mean forward and backward flow of each connection [L/min]."""
    series, weights = _recorded(orbits, tuple("Q" + name for name in connections))
    columns = range(len(connections))
    forward, backward = (
        np.array([one_way_mean(series[:, k], weights[:, k], sign) for k in columns]) for sign in (1.0, -1.0)
    )
    return forward, backward


def _recorded(orbits: SolvedOrbits, signals: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Signals of a single patient's steady beat and their weights in a mean, both (steps, signals)."""
    circuit = orbits.batch.circuit
    program = beat_program(circuit, int(orbits.resolution[0]))
    moved = [has_mean(circuit, name) for name in signals]
    names = tuple(name + (MEAN if is_mean else "") for name, is_mean in zip(signals, moved, strict=True))
    # Reuse the program that found the beat: a program for these signals takes seconds to compile.
    state, packed = orbits.states[:, :1], orbits.batch.packed(program)[:, :1]
    recorded_names, recorded = orbits.search(0).record(state, packed, names)
    columns = [recorded_names.index(name) for name in names]
    return recorded[:, columns, 0], step_weights(np.diff(program.grid.phases), moved)


@lru_cache(maxsize=64)
def _means(circuit: Circuit, values: tuple[tuple[str, float], ...], policy: str) -> Mapping[str, float]:
    result = solve(Batch.of(Model(circuit, dict(values), policy=policy)))
    if not _is_determined(result):
        return MappingProxyType(dict.fromkeys(MEASURED_SET_POINTS, float("nan")))
    around = tuple(f"P{s.name}" for s in circuit.surroundings if RIGHT_ATRIUM in s.members)
    series, weights = _recorded(result, (*MEASURED_SET_POINTS.values(), *around))
    means = (weights * series).sum(axis=0).tolist()
    set_points = dict(zip(MEASURED_SET_POINTS, means, strict=False))
    set_points[VENOUS_SET_POINT] -= sum(means[len(MEASURED_SET_POINTS) :])
    return MappingProxyType(set_points)
