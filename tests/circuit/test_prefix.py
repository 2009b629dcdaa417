"""Circuits under a prefix: two of a kind, and the same numbers under other names."""

from dataclasses import dataclass

import jax
import numpy as np
import pytest

from component_catalogue import PATHS, STORAGES
from eclsim.circuit import Choice, Circuit, Compartment, Connection, StartPressure, StartVolume
from eclsim.circuit.assembly import assemble
from eclsim.components import ElasticVessel, Path, Resistance
from eclsim.devices.ecmo import ecmo
from eclsim.devices.lvad import lvad
from eclsim.orbit.model import Model
from eclsim.outputs.results import simulate
from eclsim.patient.circulation import circulation
from model_catalogue import model


@pytest.mark.parametrize("name", [*PATHS, *STORAGES])
def test_a_law_is_renamed_with_all_its_parameters(name):
    law, values = (PATHS | STORAGES)[name]
    other = law.renamed(lambda parameter: "left." + parameter)
    assert other.parameter_names() == tuple("left." + parameter for parameter in law.parameter_names())
    renamed = other.constants({"left." + parameter: value for parameter, value in values.items()})
    np.testing.assert_array_equal(jax.tree.leaves(renamed), jax.tree.leaves(law.constants(values)))


def test_numbers_and_sums_of_names_are_renamed_too():
    law = Resistance(("R", "more")).renamed(str.upper)
    assert law == Resistance(("R", "MORE"))
    assert Resistance(0.5).renamed(str.upper) == Resistance(0.5)


def test_a_law_that_hides_its_names_cannot_be_renamed():
    @dataclass(frozen=True)
    class Hidden(Path):
        name: str

        def parameter_names(self):
            return (self.name,)

        def pressure_drop(self, flow, constants):
            return constants[self.name] * flow

    with pytest.raises(TypeError, match="Hidden: cannot rename R: annotate the fields"):
        Hidden("R").renamed(str.lower)


def test_a_prefix_comes_in_front_of_every_name_and_leaves_sites_outside():
    circuit = Circuit(
        (
            Compartment("bag", ElasticVessel("Cbag"), "kit", StartPressure("P0bag"), "share"),
            Compartment("pot", ElasticVessel("kit.C"), "kit", StartVolume("V0", "total")),
        ),
        (
            Connection("line", Resistance(("R", "etaB")), "vein", "bag", "kit"),
            Connection("hose", Resistance("kit.R"), "bag", Choice(("pot", "vein"), "kit.site"), "kit"),
        ),
    )
    assert circuit.prefixed("kit.left") == Circuit(
        (
            Compartment(
                "kit.left.bag", ElasticVessel("kit.left.Cbag"), "kit.left", StartPressure("kit.left.P0bag"),
                "kit.left.share",
            ),
            Compartment(
                "kit.left.pot", ElasticVessel("kit.left.C"), "kit.left",
                StartVolume("kit.left.V0", "kit.left.total"),
            ),
        ),
        (
            Connection(
                "kit.left.line", Resistance(("kit.left.R", "etaB")), "vein", "kit.left.bag", "kit.left"
            ),
            Connection(
                "kit.left.hose", Resistance("kit.left.R"), "kit.left.bag",
                Choice(("kit.left.pot", "vein"), "kit.left.site"), "kit.left",
            ),
        ),
    )  # fmt: skip
    assert circuit.prefixed("") is circuit


def under(prefix: str, circuit: Circuit, values: dict[str, float]) -> tuple[Circuit, dict[str, float]]:
    """A circuit under a prefix, and the values of its parameters."""
    other = circuit.prefixed(prefix)
    return other, {
        new: values[old] for new, old in zip(other.parameter_names(), circuit.parameter_names(), strict=True)
    }


def test_under_a_prefix_the_numbers_are_the_same():
    patient = model("V-A")
    first = simulate(patient)
    device, own = under("ecmo.left", ecmo("ra", "ao"), dict(patient.values))
    second = simulate(Model(circulation() + device, {**patient.values, **own}))
    for name in ("MAP", "CO", "EDVLV"):
        assert float(second[name]) == pytest.approx(float(first[name]), rel=1e-9)
    assert float(second["Qecmo.left.ecmopump"].mean()) == pytest.approx(
        float(first["Qecmopump"].mean()), rel=1e-9
    )


@pytest.mark.slow
def test_two_of_a_kind_stand_side_by_side():
    patient = model("LVAD")
    values = dict(patient.values)
    left, own_left = under("lvad.left", lvad(), values)
    right, own_right = under("lvad.right", lvad("rv", "pas"), values | {"lvad.speed_rpm": 1800.0})
    both = Model(circulation() + left + right, {**values, **own_left, **own_right})
    assert assemble(both.circuit).layout.names[-2:] == ("Qlvad.left.lvadpump", "Qlvad.right.lvadpump")
    result = simulate(both)
    assert result.attrs["converged"] == 1
    assert float(result["Qlvad.left.lvadpump"].mean()) > 0.0
    assert float(result["Qlvad.right.lvadpump"].mean()) > 0.0
