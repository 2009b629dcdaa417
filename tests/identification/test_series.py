"""What the measurements of a followed patient have in common."""

import csv

import numpy as np
import pytest
import xarray as xr

from eclsim.cases.reading import read_mapping
from eclsim.identification.files import write_tracks
from eclsim.identification.series import (
    copied_measurements,
    falling_clotting,
    series_of,
    series_parameters,
)
from eclsim.identification.settings import FitSettings
from eclsim.identification.track_figures import plot_outputs
from eclsim.identification.track_report import track_page
from eclsim.identification.tracking import (
    Innovation,
    Interval,
    TrackedPoint,
    TrackResult,
    TrackSettings,
    track,
)
from eclsim.identification.verdict import Aspect, FitVerdict, Level, Reason, goodness_of
from eclsim.inputs.mistakes import CaseError
from eclsim.outputs.results import simulate
from eclsim.parameters.regulation import SET_POINT

PATIENT = {"id": "P", "sex": "male", "age_years": 60, "height_cm": 175, "weight_kg": 78}
MEASURED = ("SP", "DP", "MAP", "CO", "PCWP", "MPAP")


def case(**sections):
    patient = {**PATIENT, "heart_rate_bpm": 95}
    return read_mapping({"format": 1, "patient": patient, **sections}).case


def with_reflex(**measured):
    return case(regulation={"baroreflex": 1.0}, measurements=measured)


def test_a_series_has_one_set_point_the_pressure_measured_first():
    points = [("a", with_reflex(CO=4.0)), ("b", with_reflex(MAP=70.0)), ("c", with_reflex(MAP=50.0))]
    series = series_of(FitSettings(("Rmc",)), points)
    for _, each in points:
        followed, checked = series.checked(each)
        assert followed.regulation.set_point_mmHg == 70.0
        assert not [w for w in checked.warnings if w.key == SET_POINT]
    (note,) = series.notes
    assert "MAP of b (70)" in note


def test_a_set_point_that_a_case_gives_is_its_own():
    given = case(regulation={"baroreflex": 1.0, "set_point_mmHg": 85}, measurements={"MAP": 60.0})
    series = series_of(FitSettings(("Rmc",)), [("a", with_reflex(MAP=70.0)), ("b", given)])
    assert series.checked(given)[0].regulation.set_point_mmHg == 85


@pytest.mark.slow
def test_reflexes_do_nothing_in_the_patient_who_was_measured_at_rest():
    """A failing heart: with the set point of a healthy one it would be taken for a worse one."""
    truth = {"Emaxlv": 0.8, "Rmc": 0.45}
    beat = simulate(case(parameters=truth))
    measured = {name: float(beat[name]) for name in MEASURED}
    settings = TrackSettings(FitSettings(("Rmc", "Emaxlv")))
    result = track([(str(k), with_reflex(**measured)) for k in range(2)], settings=settings)
    first, second = result.points
    assert first.verdict.level == "good"
    assert second.probability > 0.5
    assert second.parameters["Emaxlv"].median == pytest.approx(truth["Emaxlv"], rel=0.03)
    assert result.as_object()["notes"] == list(result.notes) != []


SHUNT, VO2, VOLUME = "gas.shunt_fraction", "gas.vo2_ml_min", "fluid.extra_volume_ml"
VV = {
    "mode": "VV", "pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult", "drainage_fr": 25,
    "return_fr": 21,
}  # fmt: skip
GAS = {"haemoglobin_g_dl": 10.0, "fio2": 0.5, "alveolar_ventilation_l_min": 2.0}
TRUTH = {SHUNT: 0.75, VO2: 240.0}


def on_ecmo(**sections):
    gas = {"gas": {**GAS, **sections.pop("gas", {})}} if "gas" in sections else {}
    sweep = {"sweep_l_min": 3.0, "fdo2": 1.0} if gas else {}
    return case(ecmo={**VV, **sweep}, **gas, **sections)


@pytest.fixture(scope="module")
def mornings():
    """A patient who does not change; blood gases from the second morning on."""
    beat = simulate(on_ecmo(gas={"shunt_fraction": 0.75, "vo2_ml_min": 240.0}, parameters={"Rmc": 0.8}))
    pressures = {name: float(beat[name]) for name in ("SP", "DP", "MAP", "PF")}
    gases = {name: float(beat[name]) for name in ("SaO2", "PaO2", "SpreO2")}
    with_gases = on_ecmo(gas={}, measurements={**pressures, **gases})
    return [("1", on_ecmo(measurements=pressures)), ("2", with_gases), ("3", with_gases)]


def test_what_any_row_tells_of_is_free(mornings):
    usual = ("Rmc", "Emaxlv")
    assert series_parameters(mornings, usual) == (SHUNT, VO2, *usual)
    assert series_parameters(mornings[:1], usual) == usual
    known = on_ecmo(gas={"vo2_ml_min": 200}, measurements={"SvO2": 60.0, "CVP": 9.0})
    assert series_parameters([("a", known)], usual) == (VOLUME, *usual)


@pytest.mark.slow
def test_a_row_without_gases_leaves_what_they_tell_of_as_it_was(mornings):
    settings = FitSettings(("Rmc", *TRUTH))
    result = track(mornings, settings=TrackSettings(settings))
    first, *_, last = result.points
    assert not any(point.failed or point.unusual for point in result.points)
    assert first.parameters[SHUNT].upper - first.parameters[SHUNT].lower > 0.8
    for name, value in TRUTH.items():
        assert last.parameters[name].lower < value < last.parameters[name].upper
    assert last.parameters[VO2].median == pytest.approx(240.0, rel=0.1)
    assert [point.doubtful for point in result.points] == [(), ("CO",), ("CO",)]
    assert all(
        doubt.startswith("CO: no measurement determines") for point in result.points for doubt in point.doubts
    )


def test_what_no_row_reads_is_named(mornings):
    with pytest.raises(CaseError, match=r"gas.shunt_fraction: not read"):
        track(mornings[:1], settings=TrackSettings(FitSettings(("Rmc", SHUNT))))


@pytest.mark.slow
def test_a_held_shunt_is_doubted_in_every_row_that_tells_of_it(mornings):
    points = track(mornings, settings=TrackSettings(FitSettings(("Rmc",)))).points
    assert points[0].doubts == ()
    for point in points[1:]:
        assert any("the shunt of the lungs is held" in doubt for doubt in point.doubts)
        assert point.as_object()["doubts"] == point.doubts
    assert "the shunt of the lungs is held" in points[1].message
    assert "the shunt of the lungs is held" not in points[2].message
    only = track(mornings[1:2], settings=TrackSettings(FitSettings(("Rmc",)))).points[0]
    assert only.verdict.level != "good"
    assert any("the shunt of the lungs is held" in reason.sentence for reason in only.verdict.doubts)


def test_an_output_that_nothing_tells_is_doubted_at_its_number():
    """It leans high: of five series with noise two missed the truth by more than 1.5 L/min."""
    gases = {"MAP": 70.0, "SaO2": 90.0, "SpreO2": 70.0}
    series = {
        "open": on_ecmo(gas={}, measurements=gases),
        "measured": on_ecmo(gas={}, measurements={**gases, "CO": 6.0}),
        "consumption given": on_ecmo(gas={"vo2_ml_min": 240.0}, measurements=gases),
        "no gases": on_ecmo(measurements={"MAP": 70.0}),
    }
    free, told = FitSettings(("Rmc", SHUNT, VO2)), {}
    for name, each in series.items():
        known = series_of(free, [("1", each)])
        told[name] = [d for d in known.doubts(*known.checked(each)) if d.startswith("CO: ")]
    assert [name for name, doubts in told.items() if doubts] == ["open"]
    interval = Interval(5.0, 6.0, 7.0)
    point = TrackedPoint("1", {}, {}, {"CO": interval, "MAP": interval}, 0.1, doubts=tuple(told["open"]))
    assert point.doubtful == ("CO",)
    page = track_page({"series": [{"id": "P", "points": [point.as_object()], "assumed_interval_hours": None}],
                       "refused": [], "settings": {"drifts": [0.1]}}, {})  # fmt: skip
    assert page.count("doubtful: see above") == 1


@pytest.mark.slow
def test_tables_picture_and_labelled_result_name_what_is_doubtful_or_was_not_used(tmp_path):
    """Only JSON and report had it: the numbers of a time without a steady beat looked like any other."""
    six = Interval(5.0, 6.0, 7.0)
    doubts = ("CO: nothing tells it", "the shunt is held")
    outputs, used = {"CO": six, "MAP": six}, {"MAP": Innovation(70.0)}
    first = TrackedPoint("1", used, {"Rmc": six}, outputs, 0.1, doubts=doubts)
    second = TrackedPoint("2", {"MAP": Innovation(9.0, used=False)}, {"Rmc": six}, {}, 0.1, failed=True,
                          message="no steady heartbeat")  # fmt: skip
    third = TrackedPoint("3", used, {"Rmc": six}, outputs, 0.1)
    result = TrackResult("P", (first, second, third), 24.0, ("the volume is held",))
    series = result.as_object()
    write_tracks(tmp_path, {"series": [series], "refused": [], "settings": {"drifts": [0.1]}})
    parameters, of_outputs = (
        [
            (r["id"], r.get("output"), r["unit"], r["doubts"])
            for r in csv.DictReader((tmp_path / name).read_text().splitlines())
        ]
        for name in ("parameters.csv", "outputs.csv")
    )
    lost = "not used: no steady heartbeat"
    unit = "mmHg s/mL"
    assert parameters == [
        ("1", None, unit, "; ".join(doubts)), ("2", None, unit, lost), ("3", None, unit, ""),
    ]  # fmt: skip
    flow, pressure = ("CO", "L/min"), ("MAP", "mmHg")
    assert of_outputs == [
        ("1", *flow, "; ".join(doubts)), ("1", *pressure, doubts[1]), ("2", *pressure, lost),
        ("3", *flow, ""), ("3", *pressure, ""),
    ]  # fmt: skip
    labels = [axes.get_ylabel() for axes in plot_outputs(series).axes]
    assert labels == ["CO [L/min]\ndoubtful", "MAP [mmHg]\ndoubtful"]
    result.dataset.to_netcdf(tmp_path / "track.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "track.nc", engine="h5netcdf") as read:
        assert read.attrs["made_by"].startswith("eclsim ")
        assert read["failed"].values.tolist() == [False, True, False]
        assert read["message"].values.tolist() == ["", "no steady heartbeat", ""]
        assert read["doubts"].values.tolist() == ["; ".join(doubts), "", ""]
        assert "the volume is held" in read.attrs["notes"]


def test_a_set_point_that_nobody_measured_is_doubted():
    blind = with_reflex(CO=4.0)
    series = series_of(FitSettings(("Rmc",)), [("a", blind)])
    (doubt,) = series.doubts(*series.checked(blind))
    assert "left open, so the start value is used" in doubt


def test_a_held_blood_volume_is_noted_once():
    series = series_of(FitSettings(("Rmc",)), [("a", case(measurements={"MAP": 70.0}))])
    (note,) = series.remarks(case())
    assert "the blood volume is held" in note


def a_point(name: str, clotted: tuple[float, float, float], **measured: float) -> TrackedPoint:
    known = {"ecmo.oxygenator.clotted_fraction": Interval(*clotted)}
    return TrackedPoint(name, {n: Innovation(v) for n, v in measured.items()}, known, {}, 0.1)


def test_a_membrane_that_clears_was_exchanged_or_a_gas_is_wrong():
    """An exchange on the seventh morning was followed without a word."""
    old = a_point("1", (0.33, 0.36, 0.40))
    message = falling_clotting(old, a_point("2", (0.05, 0.10, 0.16)))
    assert message.startswith("the clotted share of the oxygenator fell from 0.36 (0.33 to 0.40) to 0.10")
    assert "exchanged, or a gas measured behind it is wrong" in message
    assert not falling_clotting(a_point("1", (0.05, 0.38, 0.80)), a_point("2", (0.04, 0.30, 0.75)))
    assert not falling_clotting(old, a_point("2", (0.40, 0.44, 0.48)))


def test_measurements_that_are_copied_forward_count_twice():
    """Eight values the same to the last digit, five minutes later, were learnt from as new."""
    old = a_point("08:00", (0.1, 0.2, 0.3), MAP=82.2, SaO2=88.1, PaO2=61.7)
    word = copied_measurements(old, a_point("08:05", (0.1, 0.2, 0.3), MAP=82.2, SaO2=88.1, PaO2=61.7))
    assert word.startswith("all 3 measurements are the same as in 08:00: if copied forward, they count twice")
    assert not copied_measurements(old, a_point("08:05", (0.1, 0.2, 0.3), MAP=82.2, SaO2=88.1, PaO2=61.8))
    assert not copied_measurements(
        a_point("1", (0.1, 0.2, 0.3), MAP=82), a_point("2", (0.1, 0.2, 0.3), MAP=82)
    )


def test_a_poor_first_estimate_stands_above_each_figure(tmp_path):
    """It was in the tables, but a figure that is passed on by itself did not show it."""
    six = Interval(5.0, 6.0, 7.0)
    goodness = goodness_of({"MAP": 90.0}, {"MAP": 60.0}, {"MAP": 3.0}, np.zeros((1, 1)), np.eye(1))
    verdict = FitVerdict(goodness, (Reason(Aspect.AGREEMENT, Level.POOR, "MAP", "far off"),))
    point = TrackedPoint("1", {"MAP": Innovation(90.0)}, {"Rmc": six}, {"MAP": six}, 0.1, verdict=verdict)
    series = TrackResult("P", (point,), 24.0).as_object()
    figures = write_tracks(tmp_path, {"series": [series], "refused": [], "settings": {"drifts": [0.1]}})
    texts = [path.read_text(encoding="utf-8") for path in figures if path.suffix == ".svg"]
    assert len(texts) == 2
    assert all("first estimate (1): POOR FIT, not to be used" in text for text in texts)


def test_a_patient_without_a_steady_beat_at_any_time_has_no_figures(tmp_path):
    """A division by zero: nothing was written."""
    lost = {"MAP": Innovation(9.0, used=False)}
    point = TrackedPoint("1", lost, {}, {}, 0.1, failed=True, message="no steady heartbeat")
    series = TrackResult("P", (point,), 24.0).as_object()
    content = {"series": [series], "refused": [], "settings": {"drifts": [0.1]}}
    assert write_tracks(tmp_path, content) == []
    assert "no steady heartbeat" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "no steady heartbeat" in (tmp_path / "outputs.csv").read_text(encoding="utf-8")
