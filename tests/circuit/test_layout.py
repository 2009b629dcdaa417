"""What the numbers of a state are: blocks of volumes and flows."""

import numpy as np

from eclsim.circuit.assembly import assemble
from model_catalogue import model


def test_volumes_come_before_flows_and_each_has_its_name_and_scale():
    layout = assemble(model("LVAD").circuit).layout
    assert layout.names[:2] == ("Vra", "Vrv")
    assert layout.names[layout.flows.first :] == ("Qpas", "Qpart", "Qao", "Qsart", "Qlvadpump")
    assert [layout.names[k] for k in layout.volumes.positions] == list(layout.names[layout.volumes.where])
    assert set(layout.scales[layout.volumes.where]) == {1.0}
    assert set(layout.scales[layout.flows.where]) == {10.0}


def test_only_volumes_count_as_blood():
    layout = assemble(model("V-A").circuit).layout
    state = np.arange(1.0, layout.size + 1.0)
    compartments = len(layout.volumes.states)
    assert layout.conserved() @ state == sum(range(1, compartments + 1))
    assert layout.conserved() @ layout.spread == 1.0
    assert layout.conserved(np.arange(compartments) < 2) @ state == 3.0


def test_a_start_state_has_start_volumes_and_no_flow():
    patient = model("V-A")
    assembly = assemble(patient.circuit)
    start = assembly.start_state(patient.values)
    assert assembly.volumes(start) == assembly.start_volumes(patient.values)
    assert set(assembly.inertial_flows(start).values()) == {0.0}
