import pytest

from eclsim.circuit import Circuit
from eclsim.devices.crrt import crrt
from eclsim.devices.ecmo import ecmo
from eclsim.outputs.recirculation import recirculated_fraction
from eclsim.outputs.results import simulate
from eclsim.patient.circulation import circulation
from model_catalogue import CIRCUITS, SCHEMES, model

PUMP, CRRT = 60.0, 200.0 / 60.0
ORDER = ("ecmodrain", "ecmotudp", "ecmotupo", "ecmooxy", "ecmotuor", "ecmoreturn")


def flows(circuit: Circuit, access: str, giving: str, pump: float = PUMP) -> dict[str, float]:
    """Mean flows that balance in every compartment: the CRRT flow is missing or doubled between its sites."""
    found = {c.name: CRRT if c.group == "crrt" else 100.0 for c in circuit.connections}
    net = pump
    for place in ("site", *ORDER):
        net += CRRT * ((place == giving) - (place == access))
        if place in ORDER:
            found[place] = net
    # The pump stands between two compartments and takes the flow out of the first of them.
    found["ecmopump"], found["ecmotudp"] = found["ecmotudp"], found["ecmodrain"]
    found["ecmodrain"] = pump
    return found


@pytest.mark.parametrize("scheme", ["b", "c", "g", "h", "i"])
def test_access_behind_the_return_takes_blood_twice(scheme):
    """Closed form: between return and access the circuit carries PF + Qc, of which Qc was there before."""
    access, giving = SCHEMES[scheme]
    circuit = circulation() + ecmo("ra", "ao") + crrt(access, giving)
    found = recirculated_fraction(circuit, flows(circuit, access, giving))
    assert found == pytest.approx(CRRT / (PUMP + CRRT), rel=1e-12)


@pytest.mark.parametrize("scheme", ["a", "d", "e", "f"])
def test_access_before_the_return_takes_fresh_blood(scheme):
    access, giving = SCHEMES[scheme]
    circuit = circulation() + ecmo("ra", "ao") + crrt(access, giving)
    assert recirculated_fraction(circuit, flows(circuit, access, giving)) == pytest.approx(0.0, abs=1e-12)


def test_scheme_g_mixes_as_the_closed_form_says():
    result = simulate(model("V-A, CRRT g"))
    pump, machine = float(result["PF"]), 0.2
    expected = machine / (pump + machine)
    assert float(result["crrt_recirculated_fraction"]) == pytest.approx(expected, rel=2e-3)
    assert float(result["crrt_recirculated_flow"]) == pytest.approx(expected * machine, rel=2e-3)


def test_a_pump_that_runs_backwards_turns_the_order_round():
    access, giving = SCHEMES["g"]
    circuit = circulation() + ecmo("ra", "ao") + crrt(access, giving)
    backwards = flows(circuit, access, giving, pump=-PUMP)
    assert recirculated_fraction(circuit, backwards) == pytest.approx(0.0, abs=1e-12)


def test_no_answer_without_crrt_and_nothing_from_the_patient():
    circuit = CIRCUITS["V-A"]
    assert recirculated_fraction(circuit, {c.name: 1.0 for c in circuit.connections}) is None
    circuit = CIRCUITS["CRRT at the patient"]
    assert recirculated_fraction(circuit, {c.name: 1.0 for c in circuit.connections}) == 0.0
