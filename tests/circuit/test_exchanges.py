"""Places where something dissolved enters or leaves blood, and volumes that make no pressure."""

from dataclasses import dataclass

import numpy as np
import pytest

from eclsim.beat.heartbeat import beat_program
from eclsim.circuit import Circuit, CircuitError, Compartment, Connection, Exchange
from eclsim.circuit.assembly import assemble
from eclsim.circuit.volumes import total_volumes, unstressed_volume
from eclsim.components import ElasticVessel, Exchanger, Resistance, TubeVolume
from eclsim.components.base import Key
from eclsim.devices.ecmo import ecmo
from model_catalogue import CIRCUITS, model


@dataclass(frozen=True)
class Membrane(Exchanger):
    """Blood meets gas across an area [m^2]."""

    area: Key


OXYGENATOR = Exchange("oxygenator", Membrane("area"), "ecmooxy", "ecmo")
LUNG = Exchange("lung", Membrane(70.0), "part")


def with_exchanges(name, *exchanges):
    return CIRCUITS[name].without_exchanges() + Circuit(exchanges=exchanges)


def test_exchanges_are_joined_printed_and_hashed_with_the_circuit():
    circuit = with_exchanges("V-A", OXYGENATOR) + Circuit(exchanges=(LUNG,))
    assert circuit.exchanges == (OXYGENATOR, LUNG)
    assert "exchanges\n  oxygenator   ecmo     ecmooxy  Membrane(area='area')\n  lung" in str(circuit)
    assert circuit != CIRCUITS["V-A"]
    assert hash(circuit) != hash(CIRCUITS["V-A"])
    assert circuit.with_chosen_sites({}).exchanges == circuit.exchanges


def test_the_beat_does_not_ask_for_them():
    circuit = with_exchanges("V-A", OXYGENATOR)
    assert "area" not in circuit.parameter_names()
    assert "area" in circuit.content_names()
    assert beat_program(circuit) is beat_program(CIRCUITS["V-A"])


def test_under_a_prefix_they_go_along():
    circuit = ecmo("ra", "ao").without_exchanges() + Circuit(exchanges=(OXYGENATOR, LUNG))
    own, outside = circuit.prefixed("ecmo.left").exchanges
    assert own == Exchange(
        "ecmo.left.oxygenator", Membrane("ecmo.left.area"), "ecmo.left.ecmooxy", "ecmo.left"
    )
    assert outside.at == "part"


def test_a_place_that_does_not_exist_is_a_mistake():
    circuit = with_exchanges("V-A", Exchange("a", Membrane(1.0), "ecmoxy"), LUNG, LUNG)
    with pytest.raises(CircuitError) as caught:
        assemble(circuit)
    assert caught.value.mistakes == [
        "exchange 'lung' appears 2 times: names are unique",
        "exchange 'a': 'ecmoxy' is not a compartment or connection of the circuit; did you mean ecmooxy?",
    ]


def test_total_volume_is_stressed_unstressed_and_rest_volume():
    bag = Compartment("bag", ElasticVessel("C"), rest_volume="shell")
    tube = Compartment("tube", ElasticVessel("C"), rest_volume=TubeVolume("length", "bore"))
    circuit = Circuit((bag, tube), (Connection("path", Resistance("R"), "bag", "tube"),))
    assert circuit.parameter_names() == ("C", "R")
    assert circuit.content_names() == ("shell", "length", "bore")
    values = {"C": 1.0, "R": 1.0, "shell": 335.0, "length": 100.0, "bore": np.array([1.0, 2.0])}
    first, second = total_volumes(circuit, values, [2.0, 3.0])
    assert first == 337.0
    np.testing.assert_allclose(second, 3.0 + np.pi / 4.0 * 100.0 * np.array([1.0, 4.0]))
    moved = circuit.prefixed("kit.left")
    assert moved.content_names() == ("kit.left.shell", "kit.left.length", "kit.left.bore")


def test_a_patient_and_their_devices_hold_all_of_their_blood():
    patient = model("V-A, CRRT g", **{"ecmo.oxygenator_ml": 335.0})
    start = assemble(patient.circuit).start_volumes(patient.values)
    total = dict(
        zip(
            [c.name for c in patient.circuit.compartments],
            total_volumes(patient.circuit, patient.values, start),
            strict=True,
        )
    )
    own = sum(total[c.name] for c in patient.circuit.compartments if c.group == "patient")
    # The capillaries' 7 % have no compartment.
    assert own == pytest.approx(0.93 * patient.values["total_blood_volume_ml"])
    assert total["ecmooxy"] == pytest.approx(335.0)
    assert total["crrtfil"] == pytest.approx(105.0)
    assert 50.0 < total["ecmotudp"] < 500.0
    assert unstressed_volume(patient.circuit, "ecmooxy", patient.values) == 0.0
