"""Error of gas transport by the beat's mean flows, compared with transport resolved in time within the beat.

    python benchmarks/gas_phase_resolved.py CASE.toml

Blood of unit content leaves one exchanger after the other, and every compartment mixes it with the flow and
the volume of each instant of the stored beat, until the beat repeats. Flow-weighted means of the inflows of
exchangers and samples replace the shares that follow from mean flows; the gas state is solved with both.
`ecmo.drainage_mixing` is 1.
"""

import sys

import jax.numpy as jnp
import numpy as np

from eclsim.cases import read_case
from eclsim.gas.network import flows_of, gas_exchanges, switches
from eclsim.gas.steady import Samples, solve
from eclsim.gas.transport import Mixtures, mixtures
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.steady_beat import steady_beat
from eclsim.units import ML_S_PER_L_MIN

SUBSTEPS = 20
UNSTRESSED_ML = {
    "ao": 21.0, "arch": 5.0, "descending": 26.0, "upper": 200.0, "lower": 520.0, "sart": 751.0, "lv": 55.0,
    "rv": 46.0, "la": 24.0, "ra": 14.0, "pas": 80.0, "part": 80.0, "pvn": 430.0, "svc": 661.0, "ivc": 2004.0,
    "svn": 2665.0,
}  # fmt: skip
"""Volumes at zero pressure (Heldt 2004), which also mix; the published circulation has stressed ones only."""


def instants(beat, circuit, values):
    """Flows [mL/s] at the middles of fine steps, volumes there, and the steps' lengths [s]."""
    wave = beat.waveforms[0]
    period = 60.0 / values["heart_rate_bpm"]
    fine = np.unique(
        np.concatenate(
            [np.linspace(a, b, SUBSTEPS + 1) for a, b in zip(wave.phases[:-1], wave.phases[1:], strict=True)]
        )
    )
    middle = 0.5 * (fine[1:] + fine[:-1])

    def series(kind, entries):
        columns = [beat.waveform(kind + e.name) for e in entries]
        return np.stack([np.interp(middle, wave.phases, c) for c in columns], axis=1)

    return series("Q", circuit.connections), series("V", circuit.compartments), period * np.diff(fine)


def followed(circuit, at, flows, volumes, steps):
    """Flow-weighted shares of each exchanger's outflow: (compartments, inlets, largest swing in a beat)."""
    names = [c.name for c in circuit.compartments]
    ends = np.array([[names.index(c.source), names.index(c.target)] for c in circuit.connections])
    count, kinds = len(names), len(at)
    forward_acts = flows[:, at].mean(axis=0) > 0.0
    map_matrix, map_offset, trail = np.eye(count), np.zeros((count, kinds)), []
    for q, v, dt in zip(flows, volumes, steps, strict=True):
        rate, given = np.zeros((count, count)), np.zeros((count, kinds))
        for j, (source, target) in enumerate(ends):
            up, down = (source, target) if q[j] >= 0.0 else (target, source)
            rate[down, down] -= abs(q[j])
            if j in at and (q[j] >= 0.0) == forward_acts[at.index(j)]:
                given[down, at.index(j)] += abs(q[j])
            else:
                rate[down, up] += abs(q[j])
        left = np.eye(count) - dt * rate / v[:, None]
        step, offset = np.linalg.solve(left, np.eye(count)), np.linalg.solve(left, dt * given / v[:, None])
        map_matrix, map_offset = step @ map_matrix, step @ map_offset + offset
        trail.append((step, offset))
    shares = np.linalg.solve(np.eye(count) - map_matrix, map_offset)
    course = []
    for step, offset in trail:
        shares = step @ shares + offset
        course.append(shares)
    course = np.array(course)
    out = np.zeros((len(steps), count))
    for j, (source, target) in enumerate(ends):
        out[:, source] += np.maximum(flows[:, j], 0.0)
        out[:, target] += np.maximum(-flows[:, j], 0.0)
    weights = out * steps[:, None]
    compartments = np.einsum("tc,tck->ck", weights, course) / weights.sum(axis=0)[:, None]
    inlets = []
    for j, ahead in zip(at, forward_acts, strict=True):
        flow = np.maximum(flows[:, j] if ahead else -flows[:, j], 0.0) * steps
        inlets.append(np.einsum("t,tk->k", flow, course[:, ends[j, 0 if ahead else 1]]) / flow.sum())
    return compartments, np.array(inlets), np.ptp(course, axis=0).max(axis=1)


def main() -> None:
    model = model_of(read_case(sys.argv[1]).case).with_values({"ecmo.drainage_mixing": 1.0})
    values, circuit = dict(model.values), model.circuit.with_chosen_sites(model.values)
    beat = steady_beat(Batch.of(model), waveforms=None, keep=None)
    flows, volumes, steps = instants(beat, circuit, values)
    exchanges, names = gas_exchanges(circuit), [c.name for c in circuit.connections]
    at, stores = [names.index(e.at) for e in exchanges], [c.name for c in circuit.compartments]
    mean = [
        np.average(np.maximum(s * flows, 0.0), axis=0, weights=steps) / ML_S_PER_L_MIN for s in (1.0, -1.0)
    ]
    by_means = mixtures(
        flows_of(circuit, *map(jnp.asarray, mean), {n: values[n] for n in switches(circuit)}), at
    )
    mixed, extra = {"means": by_means}, np.array([UNSTRESSED_ML.get(name, 0.0) for name in stores])
    for word, added in (("all blood", extra), ("stressed blood", 0.0)):
        compartments, inlets, swing = followed(circuit, at, flows, volumes + added, steps)
        mixed[word] = Mixtures(
            jnp.asarray(compartments), by_means.drawn, jnp.asarray(inlets), by_means.streams
        )
        most = ", ".join(f"{stores[i]} {swing[i]:.2f}" for i in np.argsort(-swing)[:4])
        print(f"{word} mixes: inlets change by {np.abs(by_means.inlets - inlets).max():.3f}; swings {most}")
    samples = [stores.index(n) for n in ("upper", "sart", "lower", "pas") if n in stores]
    laws = [e.component for e in exchanges]
    for word, one in mixed.items():
        state = solve(laws, one, values, "severinghaus1979", Samples(one.compartments[np.array(samples)]))
        last = slice(-len(samples), None)
        found = zip(samples, 100.0 * state.saturation[last], *jnp.exp(state.pressure[:, last]), strict=True)
        text = "; ".join(f"{stores[i]} SO2 {s:.1f} %, PO2 {o:.1f}, PCO2 {c:.1f} mmHg" for i, s, o, c in found)
        print(f"{word:15} {text}")


if __name__ == "__main__":
    main()
