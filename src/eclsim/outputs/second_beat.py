"""A second steady beat where veins collapse: full or sucked empty at the same settings of the pump.

A patient whose veins collapse may have two steady beats at the same values: one with full veins, and one with
veins that the pump has emptied, less flow and more blood in the heart and lungs. Which of the two a search
finds depends on where it starts. Here the beat that was found is followed with faster pumps and, if the veins
have collapsed in it, with slower ones; the pumps are then set back, and a search begins where that leads.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from eclsim.beat.heartbeat import beat_program
from eclsim.circuit.assembly import assemble
from eclsim.devices.description import CAUTION, Finding
from eclsim.orbit.equation import Anchor, OrbitOptions, OrbitProblem
from eclsim.orbit.iteration import CompiledSearch, compiled_search
from eclsim.orbit.search import inverse_at, solve_orbits
from eclsim.orbit.status import Status
from eclsim.outputs.steady_beat import SteadyBeat, steady_beat

PUMP_SETTINGS = ("speed_rpm", "roller_l_min")
"""Ends of the names of parameters by which pumps are driven."""
FILLINGS = ("caval_filling", "superior_caval_filling", "inferior_caval_filling")
SUCTION = "lowest_drainage_pressure"
COLLAPSED_PERCENT = 40.0
"""Filling of a vein below which it has collapsed, as in the limits of beats [%]."""
FULL_PERCENT = 120.0
"""Filling of the emptiest vein above which no second beat was ever found, so that none is sought [%]."""
FASTER, SLOWER = 1.6, 0.4
"""Speed of the pumps before they are set back, relative to their own."""
BEATS_AWAY, BEATS_BACK = 60, 10
SHORT_SEARCH = OrbitOptions(newton_iterations=3, exact_iterations=0)
SAME_FLOW_SHARE = 0.02
"""Change of a flow, relative to the larger one, below which two beats are the same."""
DISPLACED_ML, STAYING_BEATS = 1.0, (20, 200)
"""Blood moved to test whether a beat is stable, and numbers of beats after which its way back is compared."""


def second_beat(beat: SteadyBeat, wanted: Callable[[], bool] = lambda: True) -> SteadyBeat | None:
    """Return another stable steady beat of the first member at the same values; None if none was found.

    It is sought only for a unique beat of a circuit with collapsible veins and a pump, without parameters
    that are solved for together with gases and without trapped blood. None does not prove that there is no
    other.

    Args:
        beat: steady beats, of which the first is asked for.
        wanted: returns whether the result is still needed; called between steps. If not, None is returned.
    """
    if 0 in beat.trapped:
        return None
    batch = beat.batch.take(np.array([0]))
    assembly = assemble(batch.circuit)
    resolution = int(beat.orbits.resolution[0])
    program = beat_program(batch.circuit, resolution)
    pumps = [k for k, name in enumerate(program.names) if name.rpartition(".")[2] in PUMP_SETTINGS]
    if not (assembly.narrowing and pumps and beat.determined[0] and "PF" in beat.names) or beat.coupled:
        return None
    problem = OrbitProblem(program, batch.packed(program), batch.volume())
    search, found = compiled_search(program, 1), beat.orbits.states[:, [0]]
    emptiest = min((float(beat.output(name)[0]) for name in FILLINGS if name in beat.names), default=0.0)
    if emptiest > FULL_PERCENT:
        return None
    for factor in (FASTER, SLOWER) if emptiest < COLLAPSED_PERCENT else (FASTER,):
        driven = problem.packed.copy()
        driven[pumps] *= factor
        away = search.wait(search.wait(found, driven, BEATS_AWAY), problem.packed, BEATS_BACK)
        if not wanted():
            return None
        if not np.isfinite(away).all():
            continue
        inverse = inverse_at(problem, away[:, 0], 1)
        orbits = solve_orbits(problem, Anchor(away, inverse[..., None]), SHORT_SEARCH)
        if not wanted():
            return None
        if orbits.status[0] != Status.CONVERGED:
            continue
        there = Anchor(orbits.states, inverse[..., None])
        other = steady_beat(batch, beat.names, start=there, resolution=resolution)
        if not wanted():
            return None
        if _differs(beat, other) and _is_stable(search, problem, other.orbits.states, assembly.narrowing):
            return other
    return None


def findings_of_second_beat(beat: SteadyBeat) -> list[Finding]:
    """Return a caution, with the flows of both, if the first member has a second steady beat."""
    other = second_beat(beat)
    return [] if other is None else [caution_of_two(beat, other)]


def caution_of_two(beat: SteadyBeat, other: SteadyBeat) -> Finding:
    """Return the caution on a patient who has another steady beat at the same values."""
    flow = float(beat.output("PF")[0])
    parts = [flows_in_words(beat), flows_in_words(other)]
    sentence = (
        "this patient has two steady beats at the same settings, since veins collapse: "
        f"{parts[0]} (shown), and {parts[1]}. Which of them lasts depends on what came before: a vein may "
        "stay collapsed although the pump was set back to a speed at which it was full. All numbers are "
        "those of the first alone"
    )
    return Finding.without_limit(CAUTION, "PF", flow, sentence, "PF", "CO", "MAP")


def flows_in_words(beat: SteadyBeat) -> str:
    """Return flows, suction, and filling of the emptiest vein of a beat as text."""
    by_name = beat.outputs()
    fillings = [by_name[name] for name in FILLINGS if name in by_name]
    native = f", CO {by_name['CO']:.2f}" if "CO" in by_name else ""
    suction = f", drainage down to {by_name[SUCTION]:.0f} mmHg" if SUCTION in by_name else ""
    filling = f" with the vena cava filled to {min(fillings):.0f} %" if fillings else ""
    return f"PF {by_name['PF']:.2f}{native} L/min{suction}{filling}"


def _differs(beat: SteadyBeat, other: SteadyBeat) -> bool:
    """Whether another beat is unique and its pump flow differs."""
    if not other.determined[0]:
        return False
    one, two = float(beat.output("PF")[0]), float(other.output("PF")[0])
    return abs(one - two) > SAME_FLOW_SHARE * max(abs(one), abs(two))


def _is_stable(
    search: CompiledSearch, problem: OrbitProblem, state: np.ndarray, veins: tuple[int, ...]
) -> bool:
    """Whether a beat is returned to when a little blood is moved from one compartment to another."""
    volumes = problem.program.assembly.layout.volumes.where
    moved = np.zeros_like(state[volumes])
    moved[veins[0]] = DISPLACED_ML
    moved[int(np.argmax(state[volumes]))] -= DISPLACED_ML
    displaced = state.copy()
    displaced[volumes] += moved
    first, last = STAYING_BEATS
    soon = search.wait(displaced, problem.packed, first)
    late = search.wait(soon, problem.packed, last - first)
    near, far = (float(np.abs(x - state)[volumes].max()) for x in (late, soon))
    return near < max(far, 0.05 * DISPLACED_ML)
