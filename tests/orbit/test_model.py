"""What is taken as a case and as a model, and what a model is made of."""

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest

from eclsim.cases import CaseError, read_case
from eclsim.circuit import Circuit, Connection
from eclsim.components import Resistance
from eclsim.devices.ecmo import ecmo
from eclsim.orbit.model import Model, UnknownValueError, as_case, as_model, model_of
from eclsim.patient.circulation import circulation

CASE = Path(__file__).parents[2] / "src/eclsim/validation/data/cases/s4_crrt_g_3425.toml"


@pytest.mark.parametrize("source", [CASE, str(CASE), read_case(CASE), read_case(CASE).case], ids=type)
def test_a_case_is_a_file_what_was_read_or_itself(source):
    assert as_case(source) == read_case(CASE).case
    assert as_model(source) == model_of(read_case(CASE).case)


def test_a_model_is_itself_and_no_case():
    model = model_of(read_case(CASE).case)
    assert as_model(model) is model
    with pytest.raises(TypeError, match="a Model is not a case; allowed: the path of a case file"):
        as_case(model)  # pyright: ignore[reportArgumentType]


def test_a_file_that_is_no_case_raises_its_mistakes(tmp_path: Path):
    with pytest.raises(CaseError) as raised:
        as_model(tmp_path / "missing.toml")
    assert "missing.toml" in str(raised.value.mistakes[0])


def test_a_circuit_has_published_values_unless_it_reads_parameters_of_its_own():
    model = Model.published(circulation() + ecmo("ra", "ao"))
    assert model.values["Rmc"] == 0.5
    own = Connection("bypass", Resistance("Rmine"), "ao", "ra")
    with pytest.raises(UnknownValueError, match="Rmine"):
        Model.published(circulation() + Circuit((), (own,)))


@pytest.mark.parametrize(
    "model",
    [Model.published(circulation()), Model.published(circulation()).with_values(Rmc=0.7), model_of(CASE)],
    ids=["published", "changed", "of a case"],
)
def test_a_model_can_be_pickled_and_copied(model: Model):
    """A published model had a mapping that neither can be done with."""
    for twin in (pickle.loads(pickle.dumps(model)), copy.deepcopy(model)):
        assert twin == model
        assert hash(twin) == hash(model)
        with pytest.raises(TypeError, match="the values of a model cannot be changed"):
            twin.values["Rmc"] = 0.9


def test_the_values_of_a_model_do_not_change():
    """A model kept the dict that it was made from, in which anything could be written later."""
    given = dict(Model.published(circulation()).values)
    model = Model(circulation(), given)
    given["Rmc"] = 1.5
    assert model.values["Rmc"] == 0.5
    values = model.with_values().values
    for change in (
        lambda: values.__setitem__("Rmc", "abc"),
        lambda: values.update(Rmc=1.0),
        lambda: values.pop("Rmc"),
        lambda: values.__ior__({"Rmc": 1.0}),
    ):
        with pytest.raises(TypeError, match=r"model.with_values\(...\) makes another model"):
            change()
    assert values["Rmc"] == 0.5


def test_a_model_names_the_parameters_that_can_be_varied():
    filtered = model_of(CASE)
    assert {"heart_rate_bpm", "Rmc", "crrt.flow_ml_min"} <= set(filtered.parameters)
    assert "physiology.aortic_stenosis_cm2" not in filtered.parameters
    assert not np.isnan([filtered.values[name] for name in filtered.parameters]).any()
    filtered.refuse_unknown(filtered.parameters)


def test_a_number_of_the_case_alone_is_said_to_be_one():
    with pytest.raises(UnknownValueError, match=r'number of the case: .*\["patient.weight_kg=..."\]'):
        model_of(CASE).with_values({"patient.weight_kg": 80.0})
    with pytest.raises(UnknownValueError, match=r"has no parameter 'nothing'$"):
        model_of(CASE).refuse_unknown(["nothing"])
