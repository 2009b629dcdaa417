"""Limits in few words, with the labels of the page."""

from __future__ import annotations

import pytest

from eclsim.app.brief import brief_findings
from eclsim.app.display import PATIENT
from eclsim.app.texts import ENGLISH, in_knob_labels
from eclsim.devices.description import Finding
from eclsim.outputs.alarms import breach
from eclsim.outputs.limits import limits_of
from eclsim.outputs.registry import find_output, output


@pytest.mark.parametrize(
    ("quantity", "side", "value", "words"),
    [
        ("PCWP", "above", 28.3, "Wedge 28 mmHg, too high"),
        ("MAP", "below", 47.8, "Arterial 48 mmHg, too low"),
        ("pulse_pressure", "below", 3.7, "Pulse pressure 4 mmHg, too low"),
        ("pHa", "below", 6.9, "pH 6.90, too low"),
        ("PF", "below", -0.5, "ECMO pump flow \u22120.50 L/min, too low"),
    ],
)
def test_a_broken_limit_has_label_value_and_side(quantity, side, value, words):
    """The last has a tile only in a circuit with ECMO."""
    limit = next(one for one in limits_of(quantity) if one.side == side)
    entry = output(quantity)
    assert brief_findings([breach(limit, value, entry.long_name, entry.unit)], PATIENT.figures) == [words]


def test_other_findings_are_named_by_their_subject():
    sentence = "aortic valve flow -0.200 L/min: the valve leaks; raise Emaxlv"
    finding = Finding("alarm", "aortic_valve_flow", -0.2, -0.1, sentence)
    assert brief_findings([finding], ()) == ["aortic valve flow \u22120.200 L/min"]


def test_names_of_case_files_become_labels_of_knobs():
    assert in_knob_labels("raise Emaxlv or Rmc2") == f"raise {ENGLISH['parameters.Emaxlv']} or Rmc2"


def test_short_names_are_of_outputs_that_exist():
    names = [key.removeprefix("short_") for key in ENGLISH if key.startswith("short_")]
    assert [name for name in names if find_output(name) is None] == []
