"""Components written outside the package take part in every solver without touching it."""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
import pytest

from eclsim.circuit import Circuit, Compartment, Connection, StartPressure
from eclsim.circuit.volumes import start_volume, unstressed_volume
from eclsim.components import Artery, ElasticVessel, HeartValve, Path, Resistance
from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.model import Model, nominal_values
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch
from eclsim.outputs.results import simulate, simulate_adaptive, simulate_many
from eclsim.outputs.steady_beat import steady_beat
from model_catalogue import CIRCUITS, model
from user_components import StenosedValve, StiffeningDevice, ValveWithInertia


def with_aortic_valve(law) -> Circuit:
    circuit = CIRCUITS["none"]
    return replace(
        circuit,
        connections=tuple(replace(c, component=law) if c.name == "lv" else c for c in circuit.connections),
    )


def patient(circuit, **more) -> Model:
    return Model(circuit, {**model("none").values, **more})


STENOSIS = {"Rvalve": 1e-3, "CQvalve": 120.0}
TIGHT = OrbitOptions(tolerance=1e-12, error_tolerance=1e-12)
CLINICAL = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO", "EDVLV")


@pytest.fixture(scope="module")
def stenosed() -> Model:
    return patient(with_aortic_valve(StenosedValve("Rvalve", "CQvalve")), **STENOSIS)


def test_a_law_given_by_its_drop_alone_is_inverted():
    law = StenosedValve("Rvalve", "CQvalve")
    flows = np.linspace(-3.0, 400.0, 60)
    driving = 0.03 * flows + np.asarray(law.pressure_drop(flows, STENOSIS))
    np.testing.assert_allclose(law.flow(driving, 0.03, STENOSIS), flows, rtol=1e-6, atol=1e-6)


@dataclass(frozen=True)
class Exponential(Path):
    """A drop that rises exponentially: Newton's method alone overshoots, and returns one scale a step."""

    scale: float

    def pressure_drop(self, flow, constants):
        return self.scale * jnp.sinh(flow / self.scale)


@pytest.mark.parametrize("scale", [0.5, 2.0, 5.0, 20.0])
def test_a_drop_that_rises_exponentially_is_inverted(scale):
    """A flow of 2300 mL/s was returned for 38 mL/s, or none."""
    law, flows = Exponential(scale), scale * np.linspace(-9.0, 9.0, 19)
    driving = 0.01 * flows + np.asarray(law.pressure_drop(flows, {}))
    np.testing.assert_allclose(law.flow(driving, 0.01, {}), flows, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_a_stenosed_valve_costs_pressure(stenosed):
    healthy, sick = simulate(model("none")), simulate(stenosed)
    assert sick.attrs["converged"] == 1
    assert (
        float(sick["peak_pressure_lv"] - sick["SP"])
        > float(healthy["peak_pressure_lv"] - healthy["SP"]) + 3.0
    )
    assert float(sick["CO"]) < float(healthy["CO"])


@pytest.mark.slow
def test_its_parameters_can_be_differentiated(stenosed):
    outputs, step = ("CO", "SP"), 0.02
    exact = steady_beat(Batch.of(stenosed), options=TIGHT).linearise(outputs, ("CQvalve",)).slopes
    high, low = (simulate(stenosed.with_values(CQvalve=120.0 + s), options=TIGHT) for s in (step, -step))
    for name, slope in zip(outputs, exact[:, 0], strict=True):
        numeric = (float(high[name]) - float(low[name])) / (2 * step)
        assert slope == pytest.approx(numeric, rel=1e-5)


@pytest.mark.slow
def test_a_valve_with_inertia_is_a_state_more():
    circuit = with_aortic_valve(ValveWithInertia("Rvalve", "CQvalve"))
    result = simulate(patient(circuit, CQvalve=350.0, Rvalve=1e-4, inertia=1e-5))
    plain = simulate(model("none"))
    assert result.attrs["converged"] == 1
    assert "Qlv" in result
    for name in ("SP", "MAP", "CO"):
        assert float(result[name]) == pytest.approx(float(plain[name]), rel=0.05)


@pytest.mark.slow
def test_a_lung_kidney_device_between_artery_and_vein():
    """The device fills, stiffens and lets blood pass; both solvers agree on it."""
    device = Circuit(
        (Compartment("device", StiffeningDevice("soft", "stiff"), group="device"),),
        (
            Connection("graft", Artery("Rgraft", "Lgraft"), "ao", "device", group="device"),
            Connection("device", HeartValve("CQdevice"), "device", "ra", group="device"),
        ),
    )
    values = {"soft": 0.4, "stiff": 1e-4, "Rgraft": 1.2, "Lgraft": 1e-3, "CQdevice": 10.0}
    fitted = patient(CIRCUITS["none"] + device, **values)
    result, check = simulate(fitted), simulate_adaptive(fitted)
    assert result.attrs["converged"] == check.attrs["converged"] == 1
    flow = float(np.trapezoid(result["Qdevice"], result["phase"]))
    assert 5.0 < flow < 100.0
    assert flow == pytest.approx(float(np.trapezoid(result["Qgraft"], result["phase"])), rel=2e-3)
    for name in CLINICAL:
        assert float(result[name]) == pytest.approx(float(check[name]), rel=2e-3)


def test_a_patients_vein_that_stiffens_starts_with_its_share_of_all_blood():
    """Its share less that of a vein of the stiffness at rest was taken for its unstressed volume."""
    circuit = CIRCUITS["none"]
    vein = replace(circuit.compartment("svn"), component=StiffeningDevice("soft", "stiff"))
    parts = tuple(vein if c.name == "svn" else c for c in circuit.compartments)
    stiff = patient(replace(circuit, compartments=parts), soft=0.05, stiff=1e-5)
    whole = start_volume(vein, stiff.values) + unstressed_volume(stiff.circuit, "svn", stiff.values)
    share = stiff.values["volume_fraction_svn"] * stiff.values["total_blood_volume_ml"]
    assert float(whole) == pytest.approx(share, abs=1e-9)


BAD_FIRST = {
    "not a number": ("Rmc", np.nan, "invalid_input"),
    "below zero": ("Rmc", -1.0, "invalid_input"),
    "allowed and hopeless": ("LV_Pd_kappa", 50.0, "not_converged"),
}


@pytest.mark.slow
@pytest.mark.parametrize(("key", "bad", "status"), BAD_FIRST.values(), ids=BAD_FIRST)
def test_a_bad_first_member_costs_the_others_nothing(stenosed, key, bad, status):
    """Such a circuit has no nominal values, so that searches begin at the beat of the shared values."""
    assert nominal_values(stenosed.circuit) is None
    good = {"Rmc": [0.5, 0.7], key: [stenosed.values[key]] * 2} | {"CQvalve": [120.0, 90.0]}
    single = simulate_many(stenosed, good, ("MAP", "CO"))
    beside = {k: [bad if k == key else stenosed.values[k], *v] for k, v in good.items()}
    together = simulate_many(stenosed, beside, ("MAP", "CO"))
    assert list(together["status"].values) == [status, "converged", "converged"]
    for name in ("MAP", "CO"):
        np.testing.assert_array_equal(together[name].values[1:], single[name].values)


@pytest.mark.slow
def test_a_batch_by_itself_begins_every_search_at_the_members_own_values(stenosed):
    values = {**stenosed.values, "Rmc": np.array([np.nan, 0.5, 0.7]), "CQvalve": np.array([1.0, 120.0, 90.0])}
    beat = steady_beat(Batch(stenosed.circuit, values, 3), ("MAP",))
    assert [Status(k).word for k in beat.status] == ["invalid_input", "converged", "converged"]
    single = steady_beat(Batch.of(stenosed.with_values(Rmc=0.7, CQvalve=90.0)), ("MAP",))
    np.testing.assert_array_equal(beat.values[:, 2], single.values[:, 0])


def test_a_batch_without_a_good_member_says_why(stenosed):
    result = simulate_many(stenosed, {"Rmc": [-1.0, np.nan]}, ("MAP",))
    assert list(result["status"].values) == ["invalid_input"] * 2
    assert "Rmc = -1: allowed: zero or above" in str(result["message"].values[0])


def test_a_circuit_of_which_no_output_is_known_has_its_status_alone():
    loop = Circuit(
        (
            Compartment("artery", ElasticVessel("Ca"), start=StartPressure(100.0)),
            Compartment("vein", ElasticVessel("Cv"), start=StartPressure(5.0)),
        ),
        (
            Connection("artery", Resistance("R"), "artery", "vein"),
            Connection("vein", Resistance("R"), "vein", "artery"),
        ),
    )
    still = Model(loop, {"Ca": 1.5, "Cv": 20.0, "R": 1.0, "heart_rate_bpm": 60.0})
    result = simulate_many(still, {"R": np.array([1.0, np.nan])})
    assert list(result["status"].values) == ["converged", "invalid_input"]
