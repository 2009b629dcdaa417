"""The order in which connections are solved follows from the circuit, not from its tables."""

import numpy as np
import pytest

from eclsim.circuit import Circuit, Compartment, Connection
from eclsim.circuit.assembly import sweep_order
from eclsim.components import ElasticVessel, Resistance
from eclsim.orbit.model import Model
from eclsim.outputs.results import simulate
from eclsim.patient.circulation import shi_hose_circulation
from model_catalogue import CIRCUITS, model

ALL = {**CIRCUITS, "Shi and Hose": shi_hose_circulation()}
PUBLISHED = {name: circuit for name, circuit in ALL.items() if "regions" not in name}


def reordered(circuit: Circuit, seed: int | None = None) -> Circuit:
    """Both tables backwards, or shuffled."""
    if seed is None:
        return Circuit(circuit.compartments[::-1], circuit.connections[::-1])
    draw = np.random.default_rng(seed).permutation
    tables = (circuit.compartments, circuit.connections)
    return Circuit(*(tuple(table[k] for k in draw(len(table))) for table in tables))


def names_in_order(circuit: Circuit) -> list[str]:
    return [circuit.connections[k].name for k in sweep_order(circuit)]


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_published_tables_are_in_the_order_of_the_sweep(name):
    circuit = PUBLISHED[name]
    assert sweep_order(circuit) == tuple(range(len(circuit.connections)))


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("seed", [None, 1, 2])
def test_the_order_of_the_tables_does_not_matter(name, seed):
    assert names_in_order(reordered(ALL[name], seed)) == names_in_order(ALL[name])


def test_every_connection_is_solved_once_in_any_circuit():
    """Branches, a loop without an entrance and a group that touches nothing of its own."""
    places = ("a", "b", "c", "d")
    pairs = ("ab", "bc", "ca", "cd", "db", "ad", "ab")
    paths = [Connection(f"{k}", Resistance("R"), s, t) for k, (s, t) in enumerate(pairs)]
    paths.append(Connection("bypass", Resistance("R"), "a", "c", group="device"))
    circuit = Circuit(tuple(Compartment(p, ElasticVessel("C")) for p in places), tuple(paths))
    assert sorted(sweep_order(circuit)) == list(range(len(paths)))
    for seed in range(5):
        assert names_in_order(reordered(circuit, seed)) == names_in_order(circuit)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), [("V-A", None), ("V-A, CRRT g", 3)])
def test_a_patient_is_the_same_however_the_tables_are_sorted(name, seed):
    patient = model(name)
    other = Model(reordered(patient.circuit, seed), patient.values)
    first, second = simulate(patient), simulate(other)
    assert second.attrs["converged"] == 1
    for output, value in first.data_vars.items():
        if value.ndim == 0:
            assert float(second[output]) == pytest.approx(float(value), rel=1e-9, abs=1e-9), output
