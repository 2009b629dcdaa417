"""Bands follow the beat they belong to, and say nothing of another patient."""

import asyncio
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from eclsim.app import studies, updates
from eclsim.app.beat import compute_beat, page_circuit
from eclsim.app.files import parse_posterior
from eclsim.app.knobs import connect, turn
from eclsim.app.posterior import BAND_MEMBERS, PosteriorDraws, read_posterior
from eclsim.app.state import PageState, key_of, link_of, state_of
from eclsim.app.texts import text
from eclsim.app.updates import PosteriorBands
from eclsim.cases.presets import PRESETS
from eclsim.cases.sections import Gas
from eclsim.inputs.mistakes import CaseError
from eclsim.orbit.status import Status
from patience import PATIENCE_S, until

CASE = PRESETS["paper"].case()
STATE = PageState(CASE, origin="fit", posterior="1")
RMC = CASE.parameters["Rmc"]
SPREAD = np.exp(np.random.default_rng(3).normal(0.0, 0.1, 48))
MADE_UP = PosteriorDraws(("Rmc",), RMC * SPREAD[:, None], {"Rmc": RMC}, "importance", ())


@dataclass
class StubBeat:
    converged: bool = True


class StubSession:
    """A session that shows a state and keeps what it is told."""

    def __init__(self, state: PageState):
        self.view, self.closed, self.sent = "monitor", False, []
        self.turned(state)

    def turned(self, state: PageState) -> None:
        self.state, self.shown = state, (state, StubBeat())

    def send(self, topic, data):
        self.sent.append((topic, data))

    def bands(self) -> list:
        return [data["of"] for topic, data in self.sent if topic in ("bands", "ramp_bands") and data]


class StubEngine:
    """Computes in a thread."""

    async def study(self, work):
        return await asyncio.to_thread(work)


@pytest.fixture
def quick(monkeypatch) -> list:
    """Bands that cost nothing; what they were computed for."""
    requests: list = []

    def computed(state, members, current):
        requests.append(state)
        return {"of": key_of(state)} if current() else None

    monkeypatch.setattr(updates, "PAUSE_S", 0.02)
    monkeypatch.setattr(studies, "beat_bands", computed)
    monkeypatch.setattr(studies, "ramp_bands", computed)
    return requests


def follow(action) -> StubSession:
    session = StubSession(STATE)

    async def run():
        await action(PosteriorBands(StubEngine(), session), session)  # type: ignore[arg-type]

    asyncio.run(run())
    return session


def faster(rpm: float) -> PageState:
    return STATE.with_case(turn(CASE, "ecmo.speed_rpm", rpm))


def test_bands_come_after_the_beat_and_only_once(quick):
    async def action(one, session):
        one()
        await asyncio.sleep(0.06)
        assert quick == []
        one.add("1", MADE_UP)
        one()
        await until(session.bands)
        one()
        await asyncio.sleep(0.06)

    session = follow(action)
    assert session.bands() == [key_of(STATE)]
    assert ("posterior", MADE_UP.as_object()) in session.sent


@pytest.mark.slow
def test_while_a_knob_is_turned_no_bands_are_computed(quick, monkeypatch):
    monkeypatch.setattr(updates, "PAUSE_S", 1.0)

    async def action(one, session):
        one.add("1", MADE_UP)
        for rpm in range(3000, 3020):
            session.turned(faster(rpm))
            one()
            await asyncio.sleep(0.005)
        await until(session.bands)

    assert follow(action).bands() == [key_of(faster(3019))]
    assert quick == [faster(3019)]


def test_bands_of_a_beat_that_is_no_longer_seen_are_dropped(quick, monkeypatch):
    async def action(one, session):
        began, go_on = asyncio.Event(), asyncio.Event()
        loop = asyncio.get_running_loop()

        def slow(state, members, current):
            loop.call_soon_threadsafe(began.set)
            asyncio.run_coroutine_threadsafe(go_on.wait(), loop).result(PATIENCE_S)
            return {"of": key_of(state)}

        monkeypatch.setattr(studies, "beat_bands", slow)
        one.add("1", MADE_UP)
        await began.wait()
        session.state = faster(3100)  # turned, its beat still on its way
        go_on.set()
        await asyncio.sleep(0.06)

    assert follow(action).bands() == []


def test_another_patient_has_no_bands(quick):
    async def action(one, session):
        one.add("1", MADE_UP)
        await until(session.bands)
        session.turned(PageState(PRESETS["healthy"].case(), origin="healthy"))
        one()
        await asyncio.sleep(0.06)

    session = follow(action)
    assert session.bands() == [key_of(STATE)]
    assert session.sent[-1] == ("posterior", None)


def test_hidden_bands_are_taken_away_and_not_computed(quick):
    async def action(one, session):
        one.show(False)
        one.add("1", MADE_UP)
        await asyncio.sleep(0.06)
        assert quick == []
        one.show(True)
        await until(session.bands)

    session = follow(action)
    assert ("bands", None) in session.sent
    assert session.bands() == [key_of(STATE)]


def test_bands_that_fail_say_so(monkeypatch):
    monkeypatch.setattr(updates, "PAUSE_S", 0.01)
    monkeypatch.setattr(studies, "beat_bands", lambda *_: 1 / 0)

    async def action(one, session):
        one.add("1", MADE_UP)
        await until(session.bands)

    assert follow(action).sent[-1] == ("bands", {"of": key_of(STATE), "failed": text("study_failed")})


def test_a_link_names_no_posterior():
    assert state_of(link_of(STATE)).posterior == ""


def test_a_knob_turns_a_fitted_parameter_in_all_members():
    values = MADE_UP.values({"Rmc": 2.0 * RMC, "Rpmc": 0.1}, 10)
    assert values["Rmc"] == pytest.approx(2.0 * RMC * SPREAD[:10])
    assert values["Rpmc"] == 0.1


@pytest.mark.slow
def test_bands_of_a_beat_are_quantiles_of_its_members():
    result = studies.beat_bands(STATE, MADE_UP, lambda: True)
    assert result is not None
    single = [
        compute_beat(STATE.with_case(turn(CASE, "parameters.Rmc", RMC * s))).outputs["MAP"] for s in SPREAD
    ]
    assert result["outputs"]["MAP"] == pytest.approx(np.quantile(single, (0.05, 0.95)), rel=1e-3)
    own = compute_beat(STATE)
    low, high = (np.array(side) for side in result["waves"]["Pao"])
    middle = own.waves["Pao"][::2]
    assert ((low < middle) & (middle < high)).all()
    assert result["lost"] == 0
    assert len(result["loops"]["lv"]) == studies.MOST_LOOPS
    assert studies.beat_bands(STATE, MADE_UP, lambda: False) is None


@pytest.mark.slow
def test_draws_that_no_patient_can_be_are_left_out_of_the_bands_and_counted():
    """Each draw is judged as the page judges the one beat that it shows."""
    state = faster(4500).with_case(turn(faster(4500).case, "volume_ml", -200.0))
    assert not compute_beat(state).possible
    wide = replace(MADE_UP, draws=RMC * SPREAD[:, None] ** 5)
    beats = [
        compute_beat(state.with_case(turn(state.case, "parameters.Rmc", float(value[0]))))
        for value in wide.draws
    ]
    converged = [beat for beat in beats if beat.converged and beat.status is Status.CONVERGED]
    possible = [beat for beat in converged if beat.possible]
    assert studies.FEWEST_DRAWS < len(possible) < len(converged)
    result = studies.beat_bands(state, wide, lambda: True)
    assert result is not None
    assert result["lost"] == len(beats) - len(converged)
    assert result["impossible"] == len(converged) - len(possible)
    assert result["fewest"] == len(possible)
    for name in ("MAP", "ejection_fraction_rv"):
        single = [beat.outputs[name] for beat in possible]
        assert result["outputs"][name] == pytest.approx(np.quantile(single, (0.05, 0.95)), rel=1e-3, abs=1e-2)
    ramp = studies.ramp_bands(state, wide, lambda: True)
    assert ramp is not None
    assert ramp["impossible"] > 0
    assert ramp["fewest"] <= len(wide.draws) - ramp["impossible"]


def test_whatever_makes_one_beat_impossible_makes_one_of_many_impossible():
    """The ramp and the bands once knew nothing of the suction of the drainage cannula."""
    circuit, _ = page_circuit(CASE)
    judged, watched = studies._judging(circuit)
    assert {"lowest_drainage_pressure", "ejection_fraction_rv"} <= {*judged}
    assert {"Vra", "Prv"} <= {*watched}


@pytest.mark.slow
def test_the_ramp_has_bands_at_its_own_speed_range():
    result = studies.ramp_bands(STATE, MADE_UP, lambda: True)
    assert result is not None
    low, high = result["outputs"]["PF"]
    assert all(a < b for a, b in zip(low, high, strict=True))
    assert low == sorted(low)
    assert studies.ramp_bands(PageState(PRESETS["healthy"].case()), MADE_UP, lambda: True) is None


def written(folder: Path, name: str = "Rmc", values=SPREAD, **attributes) -> bytes:
    data = xr.Dataset({name: (("chain", "draw"), values.reshape(2, -1))}, attrs=attributes)
    data.to_netcdf(folder / "posterior.nc", group="posterior", engine="h5netcdf")
    return (folder / "posterior.nc").read_bytes()


def test_a_posterior_of_the_command_line_is_read(tmp_path):
    result = parse_posterior("a/posterior.NC", written(tmp_path, sampler="nuts", trusted=1, doubts=""))
    assert sorted(result.draws[:, 0]) == pytest.approx(sorted(SPREAD))
    assert result.base["Rmc"] == pytest.approx(np.median(SPREAD), rel=0.05)
    assert result.as_object() | {"method": ""} == {
        "method": "", "trusted": True, "checked": True, "doubts": [], "count": 48,
    }  # fmt: skip


def test_of_many_draws_some_are_taken(tmp_path):
    many = np.tile(SPREAD, 50)
    assert len(read_posterior("p.nc", written(tmp_path, values=many)).draws) == BAND_MEMBERS


@pytest.mark.parametrize("attributes", [{"trusted": 0, "doubts": "R-hat 1.2"}, {"trusted": 0}, {}])
def test_doubts_of_the_file_are_kept(tmp_path, attributes):
    assert not read_posterior("p.nc", written(tmp_path, **attributes)).as_object()["trusted"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "Rxyz"}, "of a parameter that no case file has"),
        ({"name": "gas.shunt_fraction", "values": SPREAD + 1.0}, "gas.shunt_fraction has values outside"),
        ({"values": -SPREAD}, "Rmc has values outside"),
        ({"values": SPREAD * np.nan}, "Rmc has values outside"),
    ],
)
def test_what_is_no_posterior_is_refused(tmp_path, change, message):
    with pytest.raises(CaseError, match=message):
        read_posterior("p.nc", written(tmp_path, **change))


def test_draws_of_gas_keys_go_with_a_patient_that_has_gases(tmp_path):
    shares = np.linspace(0.0, 0.6, 48)
    result = read_posterior("p.nc", written(tmp_path, "gas.shunt_fraction", shares))
    with pytest.raises(CaseError, match="first open the patient"):
        result.centred(CASE)
    case = result.centred(connect(CASE, "gas"))
    assert case.gas is not None
    assert case.gas.shunt_fraction == pytest.approx(0.3, abs=0.02)
    turned = result.values({"gas.shunt_fraction": result.base["gas.shunt_fraction"] + 0.7}, 48)
    most = Gas.fields()["shunt_fraction"].maximum
    assert sorted(turned["gas.shunt_fraction"]) == pytest.approx(np.minimum(shares + 0.7, most))
    assert turned["gas.shunt_fraction"].max() == most


@pytest.mark.parametrize("content", [b"nonsense", b"\x89HDF\r\n\x1a\n" + b"\0" * 200, b""])
def test_a_damaged_file_is_refused(content):
    with pytest.raises(CaseError):
        parse_posterior("posterior.nc", content)


def test_members_keep_around_another_case():
    case = CASE.model_copy(update={"parameters": {**CASE.parameters, "Rmc": 1.5}})
    assert replace(MADE_UP, base={}).of(case).base == {"Rmc": 1.5}
