import os
import pickle
import subprocess
import sys

import pytest

from eclsim.circuit import Choice, Circuit, CircuitError, Compartment, Connection, StartPressure, StartVolume
from eclsim.circuit.assembly import assemble
from eclsim.components import Artery, ElasticVessel, Resistance
from eclsim.devices.ecmo import ecmo
from eclsim.patient.circulation import circulation
from model_catalogue import CIRCUITS
from user_components import PressureSource


def vessel(name, start=None):
    return Compartment(name, ElasticVessel("C"), start=start or StartPressure(1.0))


def joined(name, source, target):
    return Connection(name, Resistance("R"), source, target)


def mistakes_of(circuit):
    with pytest.raises(CircuitError) as caught:
        assemble(circuit)
    return caught.value.mistakes


def test_all_mistakes_are_named_at_once():
    circuit = Circuit(
        (vessel("artery"), vessel("artery"), vessel("vein"), vessel("pouch")),
        (joined("a", "artery", "vain"), joined("b", "vein", "vein"), joined("b", "artery", "vein")),
    )
    result = mistakes_of(circuit)
    assert result == [
        "compartment 'artery' appears 2 times: names are unique",
        "connection 'b' appears 2 times: names are unique",
        "connection 'a': target 'vain' is not a compartment of the circuit; "
        "allowed: artery, artery, vein, pouch; did you mean vein?",
        "connection 'b': source and target are both 'vein': a connection joins two different compartments",
        "compartment 'pouch' has no connection: join it or leave it out",
    ]


def test_a_device_without_its_patient_is_a_mistake():
    result = mistakes_of(ecmo("ra", "ao"))
    assert len(result) == 2
    assert "source 'ra' is not a compartment" in result[0]
    assert "target 'ao' is not a compartment" in result[1]


def test_every_site_of_a_choice_must_exist():
    choice = Choice(("artery", "nowhere"), "site")
    circuit = Circuit((vessel("artery"), vessel("vein")), (joined("a", choice, "vein"),))
    (only,) = mistakes_of(circuit)
    assert "source 'nowhere'" in only


def test_an_empty_circuit_is_a_mistake():
    assert mistakes_of(Circuit()) == ["the circuit has no compartments: add at least one store of blood"]


def test_the_same_device_twice_needs_other_names():
    twice = circulation() + ecmo("ra", "ao") + ecmo("svn", "sart")
    assert any("compartment 'ecmooxy' appears 2 times" in mistake for mistake in mistakes_of(twice))


@pytest.mark.parametrize("name", CIRCUITS)
def test_every_configuration_hangs_together(name):
    circuit = CIRCUITS[name]
    assembly = assemble(circuit)
    inertial = [c.name for c in circuit.connections if c.component.inertial]
    volumes = ["V" + c.name for c in circuit.compartments]
    assert assembly.layout.names == (*volumes, *("Q" + n for n in inertial))
    assert assembly.layout.size == len(volumes) + len(inertial)


def test_the_circulation_of_the_paper_has_14_states():
    assert assemble(circulation()).layout.size == 14


def test_circuits_are_values():
    assert circulation() + ecmo("ra", "ao") == circulation() + ecmo("ra", "ao")
    assert hash(circulation()) == hash(circulation())
    assert circulation() + ecmo("ra", "ao") != circulation() + ecmo("ra", "sart")
    assert {c.group for c in (circulation() + ecmo("ra", "ao")).compartments} == {"patient", "ecmo"}


def test_a_circuit_reads_each_parameter_once_in_order():
    circuit = Circuit(
        (vessel("a", StartVolume("share", "total")), vessel("b", StartPressure("P0"))),
        (
            Connection("x", Artery(("R", "more"), "L"), "a", "b"),
            joined("y", Choice(("a", "b"), "site"), "b"),
        ),
    )
    assert circuit.parameter_names() == ("C", "share", "total", "P0", "R", "more", "L", "site")


def test_both_tables_are_printed():
    lines = str(CIRCUITS["V-A, CRRT anywhere"]).splitlines()
    assert any(line.split()[:2] == ["ao", "patient"] for line in lines)
    assert any("ecmopump" in line and "ecmotudp -> ecmotupo" in line for line in lines)
    assert any("by crrt.access_site} -> crrttuin" in line for line in lines)


def test_start_volumes_follow_pressure_volume_or_share():
    source = Compartment("s", PressureSource(3.0), start=StartVolume(7.0))
    circuit = Circuit(
        (vessel("p", StartPressure("P0")), vessel("q", StartVolume("share", "total")), source),
        (joined("x", "p", "q"), joined("y", "q", "s")),
    )
    values = {"C": 2.0, "R": 1.0, "P0": 80.0, "share": 0.1, "total": 5000.0}
    assert assemble(circuit).start_volumes(values) == [160.0, 500.0, 7.0]


def test_equal_circuits_share_what_is_looked_up_in_caches():
    one, other = (circulation() + ecmo("ra", "ao") for _ in range(2))
    assert one is not other
    assert one.canonical is other.canonical
    assert one.canonical is not circulation().canonical
    exchanging = next(circuit for circuit in CIRCUITS.values() if circuit.exchanges)
    assert exchanging.without_exchanges() is exchanging.without_exchanges()
    assert exchanging.without_exchanges().exchanges == ()


@pytest.mark.slow
def test_a_circuit_sent_to_another_process_is_found_in_its_caches():
    circuit = circulation()
    hash(circuit), circuit.parameter_names(), circuit.canonical
    program = (
        "import pickle, sys; from eclsim.patient.circulation import circulation; "
        "sent = pickle.load(sys.stdin.buffer); own = circulation(); "
        "assert sent == own and hash(sent) == hash(own)"
    )
    there = os.environ | {"PYTHONHASHSEED": "77"}
    subprocess.run([sys.executable, "-c", program], input=pickle.dumps(circuit), env=there, check=True)


def test_choices_without_a_value_stay_open():
    circuit = CIRCUITS["V-A, CRRT anywhere"]
    assert circuit.with_chosen_sites({}) == circuit
    chosen = circuit.with_chosen_sites({"crrt.access_site": 1.0, "crrt.return_site": 2.0})
    assert not any(isinstance(site, Choice) for c in chosen.connections for site in c.sites)
    with pytest.raises(ValueError, match="not a site of this circuit"):
        circuit.with_chosen_sites({"crrt.access_site": 0.5})
