"""A key varied over values: every beat is that of the case itself, what has none is a gap with a reason."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from eclsim.cases import read_mapping
from eclsim.cases.settings import apply_settings
from eclsim.simulation.figures import plot_sweep
from eclsim.simulation.panels import legend_of_bars, panels_of
from eclsim.simulation.single import simulate
from eclsim.simulation.summary import sweep_text
from eclsim.simulation.sweep import (
    LARGEST_COUNT,
    Sweep,
    SweepError,
    as_table,
    parse_sweep,
    remarks_on_last_values,
    sweep_cases,
    sweep_object,
    write_csv,
    write_netcdf,
)
from eclsim.simulation.target_flow import solved_speed_of

CASE = read_mapping(
    {
        "format": 1,
        "patient": {
            "id": "P01", "sex": "female", "age_years": 70, "height_cm": 165, "weight_kg": 60,
            "heart_rate_bpm": 90,
        },
        "ecmo": {"pump": "Rotaflow", "oxygenator": "Quadrox-i Adult", "mode": "VA", "speed_rpm": 3425},
    }
).case  # fmt: skip


def swept(key: str, *values: float | str, unit: str = "") -> Sweep:
    cases = {value: apply_settings(CASE, [f"{key}={value}"]) for value in values}
    return sweep_cases(key, unit, None, cases, "as_published")


@pytest.fixture(scope="module")
def flows() -> Sweep:
    """Three flows, the last out of reach."""
    return swept("ecmo.flow_l_min", 2.0, 4.0, 9.0, unit="L/min")


@pytest.mark.parametrize(
    ("text", "key", "values"),
    [
        ("ecmo.speed_rpm=2000:3000:500", "ecmo.speed_rpm", ("2000", "2500", "3000")),
        ("Rmc = 0.1:0.35:0.1", "Rmc", ("0.1", "0.2", "0.3")),
        ("Rmc=0.8,0.5,0.8", "Rmc", ("0.8", "0.5")),
        ("ecmo.flow_l_min=5:3:-1", "ecmo.flow_l_min", ("5", "4", "3")),
        ("ecmo.pump=Rotaflow,DP3", "ecmo.pump", ("Rotaflow", "DP3")),
    ],
)
def test_ranges_and_lists_are_read(text, key, values):
    assert parse_sweep(text) == (key, values)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Rmc", "is not a sweep"), ("Rmc=", "is not a sweep"), ("=1,2", "is not a sweep"),
        ("Rmc=1:2", "is not a sweep"),
        ("Rmc=1:2:0", "a step of 0 never reaches the last value"), ("Rmc=1:nan:1", "is not a sweep"),
        ("Rmc=1:2:-1", "leads away"),
        ("Rmc=0:1:0.001", f"up to {LARGEST_COUNT}"), ("Rmc=1:inf:1", "is not a sweep"),
        ("Rmc=1,,2", "not a sweep"),
    ],
)  # fmt: skip
def test_what_is_no_sweep_says_what_is(text, words):
    with pytest.raises(SweepError, match=words):
        parse_sweep(text)


@pytest.mark.parametrize(("key", "values"), [("Rmc", (0.7, 1.1)), ("patient.weight_kg", (50.0, 80.0))])
def test_every_beat_is_that_of_the_case_by_itself(key, values):
    sweep = swept(key, *values)
    for value, result in zip(sweep.values, sweep.results, strict=True):
        single = simulate(apply_settings(CASE, [f"{key}={value}"]))
        for name in ("MAP", "CO", "PF", "EDVLV"):
            assert float(result[name]) == pytest.approx(float(single[name]), rel=1e-6)
        assert result.attrs["warnings"] == single.attrs["warnings"]
    assert float(sweep.results[0]["MAP"]) != pytest.approx(float(sweep.results[1]["MAP"]), rel=1e-3)


def test_names_can_be_swept_too():
    sweep = swept("ecmo.oxygenator", "Quadrox-i Adult", "Quadrox-i Small Adult")
    assert not sweep.numeric
    single = [simulate(apply_settings(CASE, [f"ecmo.oxygenator={value}"])) for value in sweep.values]
    flows = [float(result["PF"]) for result in sweep.results]
    assert flows == pytest.approx([float(result["PF"]) for result in single], rel=1e-6)
    assert abs(flows[0] - flows[1]) > 0.01
    assert [result.attrs["warnings"] for result in sweep.results] == [r.attrs["warnings"] for r in single]
    assert [label.get_text() for label in plot_sweep(as_table(sweep)).axes[0].get_xticklabels()] == [
        "Quadrox-i Adult",
        "Quadrox-i Small Adu…",
    ]


def test_a_flow_outside_the_label_is_said_wherever_numbers_of_a_case_go():
    from eclsim.simulation.single import derivatives, simulate_many

    label = "is above 5 L/min: outside the label of its oxygenator, 0.5 to 5 L/min"
    fast = swept("ecmo.speed_rpm", 3000.0, 5000.0)
    assert not any(label in line for result in fast.results for line in result.attrs["warnings"])
    small = apply_settings(CASE, ["ecmo.oxygenator=Quadrox-i Small Adult"])
    (message,) = (
        s for s in simulate(apply_settings(small, ["ecmo.speed_rpm=5000"])).attrs["warnings"] if label in s
    )
    assert message.startswith("ECMO flow ")
    cases = {speed: apply_settings(small, [f"ecmo.speed_rpm={speed}"]) for speed in (3000.0, 5000.0)}
    sweep = sweep_cases("ecmo.speed_rpm", "rpm", None, cases)
    assert [message in result.attrs["warnings"] for result in sweep.results] == [False, True]
    many = simulate_many(small, {"ecmo.speed_rpm": [3000.0, 5000.0]}, ["PF"])
    assert [message in text.split("\n") for text in many["warnings"].values] == [False, True]
    assert message not in derivatives(cases[3000.0], ["PF"], ["Rmc"]).attrs["warnings"]
    assert message in derivatives(cases[5000.0], ["PF"], ["Rmc"]).attrs["warnings"]


@pytest.mark.parametrize(
    ("key", "values", "text"),
    [
        ("ecmo.return_site", ("ao", "sart"), "sart connects the circuit in another way than ao"),
        ("measurements.SP", (80.0, 90.0), "changes nothing that the simulation reads"),
    ],
)
def test_another_circuit_and_a_key_without_effect_are_refused(key, values, text):
    with pytest.raises(SweepError, match=text):
        swept(key, *values)


def test_a_flow_is_solved_for_at_each_value_and_what_is_out_of_reach_is_blank(flows):
    assert [bool(result.attrs["converged"]) for result in flows.results] == [True, True, False]
    speeds = [solved_speed_of(result).speed_rpm for result in flows.results[:2]]
    assert 1000 < speeds[0] < speeds[1] < 5000
    table = as_table(flows)
    np.testing.assert_allclose(table["PF"], [2.0, 4.0, np.nan], atol=1e-6)
    assert "highest flow reached" in str(table["message"].values[2])
    assert table.attrs["failed"] == 1


@pytest.mark.slow
def test_the_files_hold_the_reason_and_no_number_without_a_beat(flows, tmp_path):
    import xarray as xr

    written = sweep_object(flows)
    assert written["sweep"]["failed"] == [9.0]
    assert [case["swept"] for case in written["cases"]] == [{"ecmo.flow_l_min": v} for v in (2.0, 4.0, 9.0)]
    assert written["cases"][2]["outputs"] == {}
    assert written["cases"][1]["solved"]["ecmo.speed_rpm"] == solved_speed_of(flows.results[1]).speed_rpm
    write_csv(flows, tmp_path / "sweep.csv")
    rows = pd.read_csv(tmp_path / "sweep.csv")
    assert list(rows["ecmo.flow_l_min [L/min]"]) == [2.0, 4.0, 9.0]
    assert list(rows["status"]) == ["converged", "converged", "flow_not_reached"]
    assert np.isnan(rows["MAP [mmHg]"][2])
    write_netcdf(flows, tmp_path / "sweep.nc")
    stored = xr.load_dataset(tmp_path / "sweep.nc", engine="h5netcdf")
    assert stored["value"].attrs["units"] == "L/min"
    np.testing.assert_allclose(stored["MAP"], as_table(flows)["MAP"])


def test_the_figure_has_a_gap_and_a_cross_where_there_is_no_beat(flows):
    table = as_table(flows)
    figure = plot_sweep(table)
    shown = panels_of(table)
    assert [ax.get_title(loc="left") for ax in figure.axes] == [panel.title for panel in shown]
    for ax in figure.axes:
        assert "[L/min]" in ax.get_xlabel()
        assert "[" in ax.get_ylabel()
        *curves, cross = ax.get_lines()
        assert np.asarray(cross.get_xdata()).tolist() == [9.0]
        assert all(np.isnan(np.asarray(curve.get_ydata())[2]) for curve in curves)
        assert len({curve.get_color() for curve in curves}) == len(curves)
    assert "no steady beat (1 of 3 values)" in figure.get_supxlabel()


def test_outputs_to_be_read_with_care_have_a_dagger(flows):
    """The terminal marks them with a star; the figure showed them like any other."""
    table = as_table(flows)
    assert table["PCWP"].attrs["read_with_care"] == 1
    figure = plot_sweep(table)
    labels = {text.get_text() for ax in figure.axes for text in ax.get_legend().get_texts()}
    assert {"wedge †", "left, end-diastolic †", "right atrial (CVP)", "right, end-diastolic"} <= labels
    assert "† to be read with care; the warnings of the results say why" in figure.get_supxlabel()
    for name in table.data_vars:
        table[name].attrs.pop("read_with_care", None)
    assert "†" not in plot_sweep(table).get_supxlabel()


def test_the_table_has_the_warnings_of_each_value_and_doubts_about_the_fit(flows, tmp_path):
    doubt = "its parameters are a DOUBTFUL fit of eclsim identify: see why in its report"
    results = [r.assign_attrs(warnings=[doubt, *r.attrs["warnings"]]) for r in flows.results]
    write_csv(replace(flows, results=tuple(results)), tmp_path / "sweep.csv")
    rows = pd.read_csv(tmp_path / "sweep.csv")
    assert list(rows["warnings"]) == ["; ".join(result.attrs["warnings"]) for result in results]
    assert set(rows["doubts"]) == {doubt}
    assert set(rows["id"]) == {flows.case_id}
    write_csv(flows, tmp_path / "sweep.csv")
    assert "doubts" not in pd.read_csv(tmp_path / "sweep.csv")


def test_an_impossible_beat_has_hollow_markers(flows):
    table = as_table(flows)
    table["impossible"].values[0] = 1
    ax = plot_sweep(table).axes[0]
    hollow = [line for line in ax.get_lines() if line.get_markerfacecolor() == "white"]
    assert [np.asarray(line.get_xdata()).tolist() for line in hollow] == [[2.0]] * 3


def test_bars_mark_the_values_with_a_broken_limit(flows):
    table = as_table(flows)
    broken = [
        {"quantity": "CVP", "kind": "alarm", "at": [0, 1]},
        {"quantity": "MAP", "kind": "warning", "at": [1]},
    ]
    broken += [{"quantity": "pHa", "kind": kind, "at": [0]} for kind in ("alarm", "collapse")]
    table.attrs["broken"] = json.dumps(broken)
    figure = plot_sweep(table)
    bars = {
        ax.get_title(loc="left"): [line for line in ax.get_lines() if [*line.get_ydata()] == [0.02, 0.02]]
        for ax in figure.axes
    }
    (alarm,), (warning,) = bars["Filling pressures"], bars["Arterial pressure"]
    assert (alarm.get_xdata(), warning.get_xdata()) == ((1.0, 6.5), (3.0, 6.5))  # swept: 2, 4, 9
    assert (alarm.get_linestyle(), warning.get_linestyle()) == ("-", "--")
    assert sum(map(len, bars.values())) == 2
    words = " ".join(figure.get_supxlabel().split())
    assert "outputs that are not drawn: pH of the right radial artery (impossible and alarm)" in words
    assert legend_of_bars(panels_of(table), ()) == []


def test_warnings_of_two_outputs_are_one_dashed_bar(flows):
    """The dashes of SP filled the gaps of those of MAP, so that both looked like an alarm in grey print."""
    table = as_table(flows)
    limits = [
        {"quantity": "MAP", "kind": "warning", "at": [0, 1]},
        {"quantity": "SP", "kind": "warning", "at": [1, 2]},
        {"quantity": "DP", "kind": "alarm", "at": [1]},
    ]
    table.attrs["broken"] = json.dumps(limits)
    (ax,) = (ax for ax in plot_sweep(table).axes if ax.get_title(loc="left") == "Arterial pressure")
    bars = [line for line in ax.get_lines() if [*line.get_ydata()] == [0.02, 0.02]]
    assert [bar.get_linestyle() for bar in bars] == ["--", "-"]
    assert [tuple(bar.get_xdata()) for bar in bars] == [(1.0, 11.5), (3.0, 6.5)]


def test_limits_that_the_beats_break_are_in_the_table(flows):
    results = [r.copy() for r in flows.results]
    for result in results[:2]:
        result["CVP"].attrs["finding"] = "alarm"
        result["PCWP"].attrs["finding"] = "caution"
    broken = json.loads(as_table(replace(flows, results=tuple(results))).attrs["broken"])
    assert {"quantity": "CVP", "kind": "alarm", "at": [0, 1]} in broken
    assert all(one["quantity"] != "PCWP" and 2 not in one["at"] for one in broken)


def test_a_swept_gas_is_drawn():
    names = ("SaO2", "PaCO2_lower", "DO2", "upper_body_flow")
    titles = [panel.title for panel in panels_of(xr.Dataset(dict.fromkeys(names, 1.0)))]
    assert titles == ["Mean flows", "Oxygen saturation", "Oxygen delivery", "Carbon dioxide"]


def test_a_range_that_misses_its_last_value_is_said():
    (message,) = remarks_on_last_values("Rmc=0.5:0.8:0.2,1")
    assert message == "--sweep: 0.5:0.8:0.2 ends at 0.7: 0.8 is not a whole number of steps away"
    assert (
        remarks_on_last_values("ecmo.speed_rpm=2000:4500:250")
        == remarks_on_last_values("Rmc=0.1:0.7:0.1")
        == []
    )


@pytest.mark.slow
def test_a_swept_gas_has_its_columns_and_says_where_there_is_no_steady_gas_state():
    gas = {"gas": {"alveolar_ventilation_l_min": 0.0, "shunt_fraction": 0.8}}
    case = read_mapping(CASE.as_mapping() | gas).case
    cases = {value: apply_settings(case, [f"ecmo.sweep_l_min={value}"]) for value in (0.0, 3.0)}
    text = sweep_text(sweep_cases("ecmo.sweep_l_min", "L/min", None, cases))
    title, head, *_ = text.splitlines()
    assert title.endswith("mmHg, flows in L/min, SaO2 in %")
    assert head.split()[-3:] == ["SaO2", "PaCO2", "beat"]
    without, with_sweep = (next(r for r in text.splitlines() if r.split()[0] == v) for v in ("0", "3"))
    assert without.split()[-6:] == ["-", "-", "steady,", "gases:", "no", "oxygen"]
    assert with_sweep.endswith("steady")
    assert float(with_sweep.split()[-3].rstrip("!*")) > 50.0
