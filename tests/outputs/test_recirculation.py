import pytest

from eclsim.cases import read_mapping
from eclsim.circuit import Circuit
from eclsim.devices.crrt import crrt
from eclsim.devices.ecmo import ecmo
from eclsim.outputs.gas import recirculated_fractions
from eclsim.outputs.results import simulate
from eclsim.patient.circulation import circulation
from model_catalogue import CIRCUITS, SCHEMES, model

PATIENT = {"id": "P01", "sex": "female", "age_years": 70, "heart_rate_bpm": 90}
ECMO = {"pump": "Rotaflow", "speed_rpm": 3400, "oxygenator": "Quadrox-i Adult", "mode": "VA"}
PUMP, CRRT = 60.0, 200.0 / 60.0
ORDER = ("ecmodrain", "ecmotudp", "ecmotupo", "ecmooxy", "ecmotuor", "ecmoreturn")


def flows(circuit: Circuit, access: str, giving: str, pump: float = PUMP) -> dict[str, float]:
    """Mean flows that balance in every compartment: the CRRT flow is missing or doubled between its sites."""
    result = {c.name: CRRT if c.group == "crrt" else 100.0 for c in circuit.connections}
    net = pump
    for place in ("site", *ORDER):
        net += CRRT * ((place == giving) - (place == access))
        if place in ORDER:
            result[place] = net
    # The pump stands between two compartments and takes the flow out of the first of them.
    result["ecmopump"], result["ecmotudp"] = result["ecmotudp"], result["ecmodrain"]
    result["ecmodrain"] = pump
    return result


@pytest.mark.parametrize("scheme", ["b", "c", "g", "h", "i"])
def test_access_behind_the_return_takes_blood_twice(scheme):
    """Closed form: between return and access the circuit carries PF + Qc, of which Qc was there before."""
    access, giving = SCHEMES[scheme]
    circuit = circulation() + ecmo("ra", "ao") + crrt(access, giving)
    result = recirculated_fractions(circuit, flows(circuit, access, giving))["crrt"]
    assert result == pytest.approx(CRRT / (PUMP + CRRT), rel=1e-8)


@pytest.mark.parametrize("scheme", ["a", "d", "e", "f"])
def test_access_before_the_return_takes_fresh_blood(scheme):
    access, giving = SCHEMES[scheme]
    circuit = circulation() + ecmo("ra", "ao") + crrt(access, giving)
    result = recirculated_fractions(circuit, flows(circuit, access, giving))
    assert result["crrt"] == pytest.approx(0.0, abs=1e-9)


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
    assert recirculated_fractions(circuit, backwards)["crrt"] == pytest.approx(0.0, abs=1e-9)


def test_no_answer_without_crrt():
    circuit = CIRCUITS["V-A"]
    assert recirculated_fractions(circuit, {c.name: 1.0 for c in circuit.connections}) == {}


@pytest.mark.parametrize(
    ("access", "giving", "share"),
    [("svn", "svn", True), ("ra", "ra", True), ("ra", "svn", True), ("svn", "ra", False)],
)
def test_lines_on_the_patient_recirculate_as_one_mixed_vein_does(access, giving, share):
    """Closed form: a vein with both lines carries CO + Qc, of which Qc has just left the filter."""
    output = 80.0
    circuit = circulation() + crrt(access, giving)
    mean_flows = {c.name: CRRT if c.group == "crrt" else output for c in circuit.connections}
    if (access, giving) == ("ra", "svn"):
        mean_flows["svn"] += CRRT
    if (access, giving) == ("svn", "ra"):
        mean_flows["svn"] -= CRRT
    result = recirculated_fractions(circuit, mean_flows)["crrt"]
    assert result == pytest.approx(CRRT / (output + CRRT) if share else 0.0, rel=1e-8, abs=1e-9)


def test_blood_of_an_artery_recirculates_through_heart_and_lungs():
    """Closed form: the lungs carry CO, of which Qc was returned to the veins and passed no tissue."""
    output = 80.0
    circuit = circulation() + crrt("ao", "ra")
    mean_flows = {c.name: CRRT if c.group == "crrt" else output for c in circuit.connections}
    mean_flows |= dict.fromkeys(("ao", "sart", "svn"), output - CRRT)
    result = recirculated_fractions(circuit, mean_flows)["crrt"]
    assert result == pytest.approx(CRRT / output, rel=1e-6)


@pytest.mark.slow
def test_a_named_device_has_its_share_under_its_own_name():
    site = {"access_site": "post_oxy", "return_site": "pre_oxy", "flow_ml_min": 200}
    raw = {"ecmo": ECMO, "crrt": {"a": site, "b": site | {"access_site": "svn", "return_site": "ra"}}}
    result = simulate(read_mapping({"format": 1, "patient": PATIENT, **raw}).case)
    flow = float(result["PF"])
    share = 0.2 / (flow + 0.2)
    assert float(result["crrt.a.recirculated_fraction"]) == pytest.approx(share, rel=2e-3)
    assert float(result["crrt.b.recirculated_fraction"]) == pytest.approx(0.0, abs=1e-9)
