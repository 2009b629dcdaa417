"""A beat that no patient has gives no number anywhere: not in a ramp, a scheme, a course or a comparison."""

from types import SimpleNamespace

import pytest
import xarray as xr

from eclsim.app import studies
from eclsim.app.beat import compute_beat
from eclsim.app.course import PageCourse, plain_course
from eclsim.app.knobs import connect, turn
from eclsim.app.state import preset_state

PAPER = preset_state("paper")
SPEED = "ecmo.speed_rpm"
FASTEST = PAPER.with_case(turn(PAPER.case, SPEED, 6000))

pytestmark = pytest.mark.slow


def test_a_ramp_has_no_numbers_at_impossible_speeds():
    ramp = studies.ramp(FASTEST)
    assert ramp is not None
    pressures = zip(ramp["speeds"], ramp["outputs"]["MAP"], strict=True)
    none = [speed for speed, value in pressures if value is None]
    assert none == ramp["impossible"]
    assert ramp["lost"] == []
    assert 6000 in none
    last = max(speed for speed in ramp["speeds"] if speed not in none)
    assert not compute_beat(PAPER.with_case(turn(PAPER.case, SPEED, min(none)))).possible
    assert compute_beat(PAPER.with_case(turn(PAPER.case, SPEED, last))).possible


def test_a_ramp_says_where_the_aortic_valve_stays_closed():
    state = preset_state("cardiogenic-shock")
    state = state.with_case(turn(connect(state.case, "ecmo"), "parameters.Emaxlv", 0.3))
    closed = studies.ramp(state)["closed"]
    speeds = studies.ramp(state)["speeds"]
    assert closed == [speed for speed in speeds if speed >= min(closed)]
    opens = max(speed for speed in speeds if speed not in closed)

    def peak(speed: float) -> float:
        return compute_beat(state.with_case(turn(state.case, SPEED, speed))).waves["Qlv"].max()

    assert peak(min(closed)) < 1.0
    assert peak(opens) > 10.0
    assert studies.ramp(PAPER)["closed"] == []


def test_a_scheme_that_cannot_be_has_no_waveforms():
    found = studies.schemes(FASTEST)
    assert found is not None
    impossible = [cell for cell in found["cells"] if not cell["possible"]]
    assert [cell["letter"] for cell in impossible] == ["a", "d", "e", "f", "g"]
    assert all(cell["converged"] and cell["access"]["wave"] == [] for cell in impossible)
    assert all(cell["possible"] for cell in studies.schemes(PAPER)["cells"])


def test_the_lanes_of_a_course_have_gaps_at_impossible_minutes():
    names = ("fluid.plasma_ml", "fluid.red_cells_ml", "MAP")
    columns = {name: [80.0] * 4 for name in names} | {"impossible": [0, 1, 1, 0]}
    result = xr.Dataset({name: ("time_min", column) for name, column in columns.items()})
    result = result.assign_coords(time_min=[0.0, 10.0, 20.0, 30.0])
    result.attrs = {"alarms": "[]", "balance": "{}", "seconds": 1.0}
    result.attrs |= {"message": "", "approximations": [], "cautions": []}
    course = PageCourse(PAPER, SimpleNamespace(result=result, at=None))  # type: ignore[arg-type]
    plain = plain_course(course, 30)
    rows = {row["name"]: row["values"] for row in plain["rows"]}
    assert rows["MAP"] == [80.0, None, None, 80.0]
