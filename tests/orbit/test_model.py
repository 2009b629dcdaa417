"""What is taken as a case and as a model."""

from pathlib import Path

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
