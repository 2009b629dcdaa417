import pytest

from eclsim.beat.recording import Recorder, UnknownSignalError
from eclsim.circuit.assembly import assemble
from eclsim.patient.circulation import circulation


def test_an_unknown_signal_is_refused_with_the_nearest_names():
    with pytest.raises(UnknownSignalError, match=r"this circuit has no signal 'Paoo'; allowed: .*Pao"):
        Recorder(assemble(circulation()), ("Paoo",))
