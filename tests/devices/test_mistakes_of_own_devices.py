"""Mistakes that the author of a device makes are said by name, or have no effect."""

from typing import Annotated, ClassVar

import numpy as np
import pytest

from eclsim.cases import read_mapping, write_case
from eclsim.circuit import Circuit, Compartment, Connection
from eclsim.cli import main
from eclsim.components import ElasticVessel, Resistance
from eclsim.devices import Device, Output, Parameter, Section, mean_flow, number
from eclsim.devices.registry import DeviceError, forget_device, register_device
from eclsim.orbit.model import UnknownValueError, model_of
from eclsim.outputs.results import derivatives, simulate, simulate_many

FLOW = number("Resistance", "mmHg s/mL", 0.01, 10, 1)
PATIENT = {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75}
ROOTED = Output("fistula_root", "root", "1", "root", ("Qfistula",), lambda m: np.sqrt(m.mean("Qfistula")))


class Fistula(Section):
    section = "fistula"
    resistance: Annotated[float, FLOW]
    spare: Annotated[float, FLOW] = 2.0


class FistulaDevice(Device[Fistula]):
    """From the aorta through a chamber to the right atrium, in no group."""

    key, name, section = "fistula", "Fistula", Fistula
    compartments: ClassVar = {"fistula": "chamber"}
    connections: ClassVar = {"fistula": "inlet", "fistulaout": "outlet"}
    parameters = (Parameter("Cfistula", 1.0, "mL/mmHg", "C", "assumed", 0.1, 10.0, "fistula"),)
    outputs = (mean_flow("fistula_flow", "flow", "Qfistula"),)

    def circuit(self, section):
        return Circuit(
            (Compartment("fistula", ElasticVessel("Cfistula")),),
            (
                Connection("fistula", Resistance("fistula.resistance"), "ao", "fistula"),
                Connection("fistulaout", Resistance(1.0), "fistula", "ra"),
            ),
        )


@pytest.fixture
def registered():
    def register(**changes):
        register_device(type("Changed", (FistulaDevice,), changes))

    yield register
    forget_device("fistula")


def case_with(**section):
    return read_mapping({"format": 1, "patient": PATIENT, "fistula": section or {"resistance": 2.0}}).case


def test_a_key_with_a_default_may_be_left_out(registered):
    """It was asked for."""
    registered()
    assert case_with().setting("fistula", "spare") == 2.0
    assert model_of(case_with()).values["fistula.resistance"] == 2.0


def test_a_key_that_may_be_left_out_needs_a_default(registered):
    optional = number("Resistance", "mmHg s/mL", 0.01, 10, 1, required=False)
    section = type(
        "Own", (Section,), {"section": "fistula", "__annotations__": {"r": Annotated[float, optional]}}
    )
    with pytest.raises(DeviceError, match=r"device fistula, Own.r: may be left out, but has no default"):
        registered(section=section)


def test_its_parts_are_in_its_group(registered):
    """Parts without a group were the patient's own: their blood was held, too."""
    registered()
    circuit = model_of(case_with()).circuit
    groups = {part.group for part in (*circuit.compartments, *circuit.connections) if "fistula" in part.name}
    assert groups == {"fistula"}


def test_two_of_a_kind_share_no_value(registered):
    """Both had the resistance of the last."""
    registered(values=lambda self, section: {"Rfistula": section.resistance})
    with pytest.raises(
        DeviceError, match=r"'Rfistula': two of a kind would share it; allowed: .*'fistula\.'"
    ):
        model_of(case_with(a={"resistance": 1.0}, b={"resistance": 5.0}))


def test_a_command_says_so_without_a_traceback(registered, capsys, tmp_path):
    registered(values=lambda self, section: {"Rfistula": section.resistance})
    file = tmp_path / "case.toml"
    write_case(case_with(), file)
    with pytest.raises(SystemExit) as left:
        main(["simulate", str(file)])
    assert left.value.code == 2
    assert "error: --device: device fistula, value 'Rfistula': two of a kind" in capsys.readouterr().err


def test_a_parameter_without_a_value_is_named(registered):
    registered(values=lambda self, section: {})
    with pytest.raises(UnknownValueError, match=r"no value for fistula\.resistance: .*a device gives"):
        model_of(case_with())


def test_an_output_that_cannot_be_differentiated_is_named(registered):
    registered(outputs=(*FistulaDevice.outputs, ROOTED))
    model = model_of(case_with())
    assert float(simulate(model)["fistula_root"]) > 0.0
    with pytest.raises(DeviceError, match=r"output 'fistula_root': TypeError.*m\.apply\(function"):
        derivatives(model, ("MAP",), ("Rmc",))


def test_an_output_that_reads_what_it_does_not_need_is_named(registered):
    other = Output("fistula_own", "own", "mmHg", "mean", ("Qfistula",), lambda m: m.mean("Pother"))
    registered(outputs=(other,))
    with pytest.raises(DeviceError, match=r"output 'fistula_own': KeyError: 'Pother'; allowed: .*`needs`"):
        simulate_many(model_of(case_with()), {"Rmc": [0.5]}, ("fistula_own",))


def test_an_output_without_a_number_leaves_the_beat_its_numbers(registered):
    """The beat was "not finite: pressures or flows became infinite"."""
    nothing = Output(
        "fistula_none", "none", "1", "0 / 0", ("Qfistula",), lambda m: 0.0 * m.mean("Qfistula") / 0.0
    )
    registered(outputs=(*FistulaDevice.outputs, nothing))
    with np.errstate(divide="ignore", invalid="ignore"):
        beat = simulate(model_of(case_with()))
    assert beat.attrs["status"] == "converged"
    assert np.isnan(float(beat["fistula_none"]))
    assert float(beat["fistula_flow"]) > 1.0
