"""Circuits whose course is known in closed form, followed by both solvers."""

import numpy as np
import pytest

from eclsim.beat.heartbeat import beat_program
from eclsim.circuit import Circuit, Compartment, Connection, StartPressure, StartVolume
from eclsim.components import Artery, ElasticVessel, Resistance, RotaryPump, Tube
from eclsim.devices import ecmo, lvad
from eclsim.orbit.model import Model
from eclsim.orbit.transient import ADAPTIVE, SEMI_IMPLICIT, follow
from user_components import PressureSource

PUMPS = {**ecmo.PUMPS, **lvad.PUMPS}

# Largest error relative to the largest value: of the fixed grid, and of the tight tolerance.
ACCURACY = {SEMI_IMPLICIT: 5e-4, ADAPTIVE: 1e-7}
both_solvers = pytest.mark.parametrize("solver", ACCURACY)


def two_vessels(path) -> Circuit:
    """Full vessel -- path -- empty vessel."""
    full = Compartment("full", ElasticVessel("C1"), start=StartPressure(100.0))
    empty = Compartment("empty", ElasticVessel("C2"))
    return Circuit((full, empty), (Connection("path", path, "full", "empty"),))


def source(name, mean, amplitude=0.0) -> Compartment:
    """A pressure that nothing can change."""
    return Compartment(name, PressureSource(mean, amplitude), start=StartVolume(0.0))


def between_sources(path, upstream, downstream) -> Circuit:
    """Two pressures and a path."""
    ends = (source("up", upstream), source("down", downstream))
    return Circuit(ends, (Connection("path", path, "up", "down"),))


def model(circuit, **values) -> Model:
    return Model(circuit, {"heart_rate_bpm": 60.0, **values})


def close(found, expected, solver):
    assert np.abs(found - expected).max() <= ACCURACY[solver] * np.abs(expected).max()


rc = two_vessels(Resistance("R"))
rlc = two_vessels(Artery("R", "L"))
C1, C2 = 0.9, 2.1
SERIES = C1 * C2 / (C1 + C2)


@both_solvers
def test_two_vessels_level_out_exponentially(solver):
    course = follow(model(rc, C1=C1, C2=C2, R=0.5), 2.0, ("Pfull", "Pempty", "Qpath"), solver=solver)
    decay = np.exp(-course.time / (0.5 * SERIES))
    level = 100.0 * C1 / (C1 + C2)
    close(course.signals[:, 0], level + (100.0 - level) * decay, solver)
    close(course.signals[:, 1], level * (1.0 - decay), solver)
    close(course.signals[:, 2], 200.0 * decay, solver)


@both_solvers
@pytest.mark.parametrize("resistance", [0.0, 0.02, 0.4])
def test_inertia_makes_two_vessels_ring(resistance, solver):
    inertance = 0.004
    course = follow(model(rlc, C1=C1, C2=C2, R=resistance, L=inertance), 1.0, ("Qpath",), solver=solver)
    damping = resistance / (2.0 * inertance)
    frequency = np.sqrt(complex(1.0 / (inertance * SERIES) - damping**2))
    wave = np.real(np.exp(-damping * course.time) * np.sin(frequency * course.time) / frequency)
    expected = 100.0 / inertance * wave
    # After three periods the fixed grid lags by a thousandth of a period and more where its steps are long.
    allowed = 1.5e-2 if solver == SEMI_IMPLICIT else ACCURACY[solver]
    assert np.abs(course.signals[:, 0] - expected).max() <= allowed * np.abs(expected).max()


def test_undamped_ringing_keeps_its_blood_and_does_not_grow():
    course = follow(model(rlc, C1=C1, C2=C2, R=0.0, L=0.004), 20.0, ("Vfull", "Vempty", "Qpath"))
    assert course.signals[:, :2].sum(axis=1) == pytest.approx(90.0, rel=1e-12)
    first, last = (np.abs(course.signals[part, 2]).max() for part in (course.time < 1.0, course.time > 19.0))
    assert last <= first


@pytest.mark.slow
@both_solvers
def test_windkessel_with_sine_inflow(solver):
    # A huge pressure behind a huge resistance gives a flow: 80 + 60 sin(w t) mL/s into C, out through R.
    behind, ohmic, compliance = 1e7, 0.9, 1.3
    pump, vein = source("pump", 80.0 * behind, 60.0 * behind), source("vein", 5.0)
    flows = (
        Connection("inflow", Resistance("behind"), "pump", "artery"),
        Connection("outflow", Resistance("R"), "artery", "vein"),
    )
    conductance = 1.0 / behind + 1.0 / ohmic
    omega = 2.0 * np.pi
    swing = 60.0 / (conductance + 1j * omega * compliance)
    mean = (80.0 + 5.0 / ohmic) / conductance
    pressure = lambda t: mean + np.imag(swing * np.exp(1j * omega * t))  # noqa: E731  (the closed form)
    artery = Compartment("artery", ElasticVessel("C"), start=StartPressure(float(pressure(0.0))))
    circuit = Circuit((pump, artery, vein), flows)
    course = follow(
        model(circuit, behind=behind, R=ohmic, C=compliance), 3.0, ("Partery", "Qoutflow"), solver=solver
    )
    close(course.signals[:, 0], pressure(course.time), solver)
    close(course.signals[:, 1], (pressure(course.time) - 5.0) / ohmic, solver)


@pytest.mark.slow
@both_solvers
def test_flow_in_a_tube_rises_to_hagen_poiseuille(solver):
    length, bore = 2.0, 0.009625
    tube = between_sources(Tube("l", "d"), 100.0, 0.0)
    values = {"l": 100.0 * length, "d": 100.0 * bore, "etaB": 0.003, "rhoB": 0.00106}
    course = follow(model(tube, **values), 30.0, ("Qpath",), solver=solver)
    pascal = 100.0 * 133.322387415
    steady = np.pi * (bore / 2) ** 4 * pascal / (8 * 0.003 * length) * 1e6
    seconds = 1060.0 * bore**2 / (32 * 0.003)
    close(course.signals[:, 0], steady * (1.0 - np.exp(-course.time / seconds)), solver)


@pytest.mark.parametrize("name", PUMPS)
@pytest.mark.parametrize("head", [30.0, 90.0])
def test_a_pump_against_a_fixed_head_runs_on_its_characteristic(name, head):
    pump = PUMPS[name]
    speed = sum(pump.speed_range_rpm) / 2
    law = RotaryPump("w", "pump.", periphery=pump.use == "LVAD")
    circuit = between_sources(law, 0.0, head)
    constants = {"pump." + key: value for key, value in pump.constants.items()}
    course = follow(model(circuit, w=speed, **constants), 10.0, ("Qpath",))
    litres = course.signals[-1, 0] * 0.06
    graft = (pump.Rper or 0.0) * litres * abs(litres)
    assert pump.head_mmhg(speed, litres) - graft == pytest.approx(head, abs=1e-6)


def test_the_step_is_of_second_order():
    ringing = model(rlc, C1=C1, C2=C2, R=0.02, L=0.004)
    state = np.array([100.0 * C1, 0.0, 0.0])

    def after_a_beat(resolution):
        program = beat_program(rlc, resolution)
        packed = np.array([ringing.values[name] for name in program.names])
        return np.asarray(program.trace(())(state, packed)[0])

    coarse, middle, fine = (after_a_beat(r) for r in (2, 4, 8))
    ratio = np.linalg.norm(coarse - middle) / np.linalg.norm(middle - fine)
    assert 3.7 < ratio < 4.3
