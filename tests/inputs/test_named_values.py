"""Options that name their values: their parts, and the messages of the three that are read from them."""

import pytest

from eclsim.identification.settings import read_bounds
from eclsim.inputs.mistakes import InputError
from eclsim.inputs.named_values import named_texts
from eclsim.sensitivity.inputs import read_uncertainties
from eclsim.sensitivity.ranges import read_ranges


def test_parts_of_an_option_are_names_and_texts():
    parts = list(named_texts([" Rmc = 0.1:2 ,,Csart", "A=b=c"]))
    assert [(part.name, part.text) for part in parts] == [("Rmc", "0.1:2"), ("Csart", ""), ("A", "b=c")]
    assert [part.written for part in parts] == ["Rmc = 0.1:2", "Csart", "A=b=c"]


@pytest.mark.parametrize(
    ("read", "text", "messages"),
    [
        (read_bounds, "Rmc=1:2,Rmc=x,Rsvn", [
            "--bounds Rmc=x: Rmc is given twice; leave one of them out",
            "--bounds Rsvn: allowed: NAME=LOWER:UPPER, such as Rmc=0.1:2",
        ]),
        (read_uncertainties, "SP=4,SP=x,SP=500%,CO=500%", [
            "--uncertainty SP=x: allowed: NAME=VALUE or NAME=PERCENT%, above 0, such as CO=10%",
            "--uncertainty SP=500%: SP is given twice; leave one of them out",
            "--uncertainty CO=500%: so large an uncertainty carries no information; allowed: up to 100%, or "
            "leave the measurement out",
        ]),
        (lambda text: read_ranges([text]), "Rmc=1:2,Rmc=x,Rmc=3:4", [
            "--range Rmc=x: allowed: NAME=LOW:HIGH or NAME=LOW:HIGH:log, as Rmc=0.5:1.5",
            "--range Rmc=3:4: Rmc is given twice; leave one of them out",
        ]),
    ],
    ids=["bounds", "uncertainty", "range"],
)  # fmt: skip
def test_every_wrong_part_has_one_message(read, text, messages):
    with pytest.raises(InputError) as error:
        read(text)
    assert list(error.value.mistakes) == messages
