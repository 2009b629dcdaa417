"""Peaks of valve flows with the published code's two numerical laws in eclsim's circuit.

    python benchmarks/published_laws.py "s4_crrt_g_1500 Qla max" ...

The published code rounds its valves off, Q = CQ sqrt(dp t + 1e-8) (1 + t) / 2 with t = tanh(dp / 0.01 mmHg)
(function Q_valves in state_eq.py of github.com/nikithiel/ECLIPSE), and its chamber pressures follow their
volumes with a time constant of 0.08 ms. Here the circuit is integrated with both (Dopri8) from eclsim's
steady beat on, and the statistics asked for are taken from the last beat. Without arguments it does so for
all statistics that miss; the lines it prints are those of src/eclsim/validation/data/published_laws.csv.
"""

import sys
from functools import lru_cache

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from eclsim.circuit.assembly import Constants
from eclsim.orbit.independent import ExplicitCircuit, explicit_circuit
from eclsim.orbit.steady import Batch, solve
from eclsim.validation.reference_cases import case_names, reference_model, waveform_rows

ROUNDING_MMHG = 0.01
ROUNDING_OF_ROOT = 1e-8
LAG_S = 8e-5
BEATS = 40
POINTS = 8001
TOLERANCE = 1e-8


class Published:
    """The published code's rates: volumes and inertial flows, then the pressures of the chambers."""

    def __init__(self, explicit: ExplicitCircuit, constants: Constants, period: float):
        self.explicit, self.constants, self.period = explicit, constants, period
        self.assembly = explicit.assembly
        stores = self.assembly.circuit.compartments
        self.chambers = [k for k, c in enumerate(stores) if c.component.activation is not None]

    def rates(self, time, state, _):
        assembly, n = self.assembly, self.assembly.layout.size
        phase = time / self.period % 1.0
        at_rest = self.explicit._pressures(state[:n], phase, self.constants)
        pressures = list(at_rest)
        for place, k in enumerate(self.chambers):
            pressures[k] = state[n + place]
        flows = self.flows(state, pressures)
        changes = [0.0] * len(assembly.circuit.compartments)
        for flow, (source, target) in zip(flows, assembly.ends, strict=True):
            assembly.add_at(source, changes, -flow, self.constants)
            assembly.add_at(target, changes, flow, self.constants)
        for j in assembly.inertial:
            law, own = assembly.circuit.connections[j].component, self.constants.paths[j]
            push = self.explicit._push(j, pressures, self.constants)
            changes.append((push - law.pressure_drop(flows[j], own)) / law.inertance(own))
        changes += [(at_rest[k] - pressures[k]) / LAG_S for k in self.chambers]
        return jnp.stack([c + 0.0 * state[0] for c in changes])

    def flows(self, state, pressures):
        found = self.explicit.flows(state[: self.assembly.layout.size], pressures, self.constants)
        for j, connection in enumerate(self.assembly.circuit.connections):
            if connection.component.one_way:
                drop = self.explicit._push(j, pressures, self.constants)
                step = jnp.tanh(drop / ROUNDING_MMHG)
                root = jnp.sqrt((drop * step + ROUNDING_OF_ROOT) / self.constants.paths[j])
                found[j] = 2.0 * root * 0.5 * (1.0 + step)
        return found


@lru_cache(maxsize=1)
def last_beat(case: str) -> dict[str, np.ndarray]:
    """Flows over the last beat, each of shape (points,)."""
    model = reference_model(case)
    period = 60.0 / model.values["heart_rate_bpm"]
    explicit = explicit_circuit(model.circuit)
    law = Published(explicit, explicit.assembly.constants(model.values), period)
    start = jnp.asarray(solve(Batch.of(model)).states[:, 0])
    pressures = explicit._pressures(start, 0.0, law.constants)
    state = jnp.concatenate([start, jnp.stack([pressures[k] + 0.0 * start[0] for k in law.chambers])])

    def run(state, save):
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(law.rates), diffrax.Dopri8(), 0.0, period, 1e-5, state, saveat=save,
            stepsize_controller=diffrax.PIDController(TOLERANCE, TOLERANCE, pcoeff=0.3, icoeff=0.4),
            max_steps=200_000,
        )  # fmt: skip
        return found.ys

    beat = jax.jit(lambda s: run(s, diffrax.SaveAt(t1=True))[-1])
    for _ in range(BEATS):
        state = beat(state)
    times = jnp.linspace(0.0, period, POINTS)
    states = jax.jit(lambda s: run(s, diffrax.SaveAt(ts=times)))(state)

    def all_flows(state):
        pressures = list(explicit._pressures(state[: explicit.assembly.layout.size], 0.0, law.constants))
        for place, k in enumerate(law.chambers):
            pressures[k] = state[explicit.assembly.layout.size + place]
        return jnp.stack(law.flows(state, pressures))

    flows = np.asarray(jax.jit(jax.vmap(all_flows))(states)).T
    names = [c.name for c in explicit.assembly.circuit.connections]
    return {"Q" + name: row for name, row in zip(names, flows, strict=True)}


def main(wanted: list[str]) -> None:
    """Print the given statistics, or all that do not agree."""
    if not wanted:
        rows = (row for case in case_names() for row in waveform_rows(case) if not row.holds)
        wanted = [row.name for row in rows]
    print("statistic,value,eclsim,unit")
    for statistic in wanted:
        case, signal, kind = statistic.split()
        value = {"max": np.max, "min": np.min}[kind](last_beat(case)[signal])
        own = next(row.got for row in waveform_rows(case) if row.name == statistic)
        print(f"{statistic},{value:.6g},{own:.6g},mL/s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
