"""Figures of fits: what they draw, and that gaps and missing values do not stop them."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from eclsim.identification.figures import (
    plot_boxes,
    plot_correlation,
    plot_profiles,
    plot_residuals,
    plot_scatter,
    plot_slices,
    plot_starts,
)
from eclsim.identification.track_figures import plot_outputs, plot_parameters
from eclsim.reporting.style import save_figure


def point(**values: tuple[float | None, float | None]) -> dict:
    return {"outputs": {n: {"measured": m, "simulated": s} for n, (m, s) in values.items()}}


RESULTS = [point(SP=(100.0, 98.0), MAP=(None, 70.0), CO=(4.0, 4.2)), point(SP=(80.0, 81.0), CO=(5.0, None))]


def test_scatter_draws_pairs_and_leaves_out_what_is_missing():
    fig = plot_scatter(RESULTS, {"pressures": 0.987, "flows": None})
    pressures, flows = fig.axes
    drawn = {line.get_label(): line.get_xydata().tolist() for line in pressures.lines[1:]}
    assert drawn == {"SP": [[100.0, 98.0], [80.0, 81.0]]}
    assert [line.get_xydata().tolist() for line in flows.lines[1:]] == [[[4.0, 4.2]]]
    assert "0.987" in pressures.get_title()
    assert flows.get_title() == "flows"
    assert pressures.get_xlabel() == "measured [mmHg]"
    assert pressures.get_xlim() == pressures.get_ylim()


def test_poor_fits_are_counted_above_the_pictures_that_hold_them():
    """A picture that is passed on by itself showed them, and R2 of all, without a word."""
    poor = [
        {**each, "verdict": {"level": level}} for each, level in zip(RESULTS, ("poor", "good"), strict=True)
    ]
    for fig in (plot_scatter(poor, {}), plot_boxes(poor)):
        assert fig.get_suptitle() == "1 of 2 fits is poor, and included"
    assert plot_scatter(RESULTS, {}).get_suptitle() == ""


def test_pressures_below_zero_are_in_the_picture():
    """A wedge pressure of -4 mmHg was below the axis."""
    results = [point(PCWP=(2.0, -4.0), MAP=(70.0, 70.0)), point(PCWP=(3.0, 1.0))]
    for fig in (plot_scatter(results, {}), plot_boxes(results)):
        assert fig.axes[0].get_ylim()[0] < -4.0


def test_boxes_stand_in_pairs():
    pressures, flows = plot_boxes(RESULTS).axes
    assert [t.get_text() for t in pressures.get_xticklabels()] == ["SP"]
    assert len(pressures.patches) == 2
    assert flows.get_ylabel() == "flow [L/min]"


@pytest.mark.parametrize("draw", [lambda: plot_scatter([], {}), lambda: plot_boxes([])])
def test_nothing_to_draw_is_an_empty_figure(draw, tmp_path):
    assert save_figure(draw(), tmp_path / "empty", ("png",))


def test_slices_mark_the_optimum_and_where_there_is_no_heartbeat(tmp_path):
    values = np.tile(np.logspace(-1, 1, 5), (4, 1))
    costs = np.ones((4, 5))
    costs[1, 0] = np.nan
    names = ("Rmc", "b", "c", "d")
    result = SimpleNamespace(names=names, values=values, costs=costs, optimum=np.ones(4), cost=0.5)
    fig = plot_slices(result)
    assert len(fig.axes) == 4
    assert [axes.get_xlabel() for axes in fig.axes] == ["Rmc [mmHg s/mL]", "b", "c", "d"]
    assert fig.axes[0].lines[1].get_xydata().tolist() == [[1.0, 0.5]]
    assert [len(axes.lines) for axes in fig.axes] == [2, 3, 2, 2]
    assert not fig.axes[1].lines[2].get_clip_on()  # a cross at the edge of its axes is drawn whole
    assert save_figure(fig, tmp_path / "slices", ("svg",))
    title = fig._suptitle.get_window_extent(FigureCanvasAgg(fig).get_renderer())
    assert title.width < 0.85 * fig.bbox.width  # a browser may draw it in a wider font, and cut it off


def test_profiles_show_the_limit_of_the_interval():
    values = np.tile(np.logspace(-1, 1, 5), (2, 1))
    costs = np.array([[9.0, 3.0, 2.0, 3.0, 9.0], [2.0, 2.0, 2.0, 2.0, 2.0]])
    result = SimpleNamespace(names=("a", "b"), values=values, costs=costs, optimum=np.ones(2), cost=2.0)
    fig = plot_profiles(result, result, 2.7)
    for axes in fig.axes:
        (limit,) = (line for line in axes.lines if line.get_label() == "limit of the 90 % interval")
        assert limit.get_ydata() == pytest.approx([4.7, 4.7])
        assert axes.get_ylim()[0] < 2.0


def test_profiles_mark_values_without_a_beat_and_call_only_the_lowest_point_the_likeliest():
    values = np.tile(np.logspace(-1, 1, 5), (2, 1))
    costs = np.array([[9.0, 3.0, 2.0, np.nan, 9.0], [2.0, 2.0, 2.0, 2.0, 2.0]])
    result = SimpleNamespace(names=("a", "b"), values=values, costs=costs, optimum=np.ones(2), cost=2.0)
    fig = plot_profiles(result, result, 2.7)
    (cross,) = (line for line in fig.axes[0].lines if line.get_marker() == "x")
    assert cross.get_xydata().tolist() == [[values[0, 3], 2.0]]
    assert not [line for line in fig.axes[1].lines if line.get_marker() == "x"]
    assert "likeliest" in [text.get_text() for text in fig.legends[0].get_texts()]
    above = SimpleNamespace(**vars(result) | {"cost": 2.5})
    texts = [text.get_text() for text in plot_profiles(above, above, 2.7).legends[0].get_texts()]
    assert "likeliest" not in texts


@pytest.mark.parametrize("size", [2, 7])
def test_a_correlation_fills_its_page(size: int):
    fig = plot_correlation([f"Emaxl{k}" for k in range(size)], np.eye(size))
    fig.draw_without_rendering()
    places = [axes.get_tightbbox().transformed(fig.transFigure.inverted()) for axes in fig.axes]
    assert min(p.x0 for p in places) < 0.08
    assert max(p.x1 for p in places) > 0.92


def test_a_correlation_has_no_negative_zero():
    fig = plot_correlation(["Rmc", "Edla"], np.array([[1.0, -0.0004], [-0.12, 1.0]]))
    assert [text.get_text() for text in fig.axes[0].texts] == ["1.00", "0.00", "−0.12", "1.00"]


def test_residuals_show_where_a_fit_is_doubtful_and_poor():
    outputs = {"MAP": {"measured": 70.0, "simulated": 76.0}, "CO": {"measured": None, "simulated": 4.0}}
    axes = plot_residuals(outputs, {"MAP": 3.0}, {"doubtful": 2.5, "poor": 4.0}).axes[0]
    assert [t.get_text() for t in axes.get_xticklabels()] == ["MAP"]
    assert {"doubtful beyond ±2.5", "poor beyond ±4"} <= {line.get_label() for line in axes.lines}
    assert axes.get_ylim()[1] > 4.0


def test_starts_are_told_apart_by_where_they_ended():
    starts = SimpleNamespace(
        end=np.array([[0.0, 1.0], [0.0, 1.0], [-1.0, 0.5]]),
        first_costs=np.array([3.0, 4.0, 5.0]), last_costs=np.array([0.1, 0.1, 0.4]),
        agreeing=np.array([True, True, False]),
    )  # fmt: skip
    left, right = plot_starts(starts, ("a", "b"), -np.ones(2), np.ones(2)).axes
    drawn = {line.get_label(): line.get_ydata().tolist() for line in left.lines}
    assert drawn["refined, the optimum"] == [0.1, 0.1]
    assert drawn["refined, another end"] == [0.4]
    assert [line.get_ydata().tolist() for line in right.lines] == [[0.0, 0.75], [0.5, 1.0], [0.5, 1.0]]


INTERVAL = {"lower": 1.0, "median": 2.0, "upper": 3.0}
POOR = {
    "level": "poor", "reasons": [],
    "goodness": {"differences": {"MPAP": 5.9}, "probability": 1e-6, "largest": "MPAP"},
}  # fmt: skip


def followed(**more) -> dict:
    return {
        "id": "1", "hours_since_last": 4.0, "parameters": {"Rmc": INTERVAL}, "expected": {},
        "outputs": {"MPAP": INTERVAL, "CO": INTERVAL}, "measurements": {}, "verdict": None, "failed": False,
        "message": "", "doubts": [], "doubtful": [], **more,
    }  # fmt: skip


def circles(figure) -> dict[str, list[float]]:
    """Positions of the open circles, by the label of their panel."""
    return {
        ax.get_ylabel(): [x for line in ax.lines if "doubtful" in line.get_label() for x in line.get_xdata()]
        for ax in figure.axes
    }


def test_what_the_tables_of_a_followed_patient_doubt_has_an_open_circle():
    """After a poor first estimate only outputs that were not met had one, and no parameter ever."""
    missed = {"doubts": ["MPAP: was used but not met"], "doubtful": ["MPAP"]}
    points = [followed(verdict=POOR), followed(**missed), followed()]
    series = {"id": "P", "points": points}
    hours = {"Rmc [mmHg s/mL]\ndoubtful": [4.0, 8.0]}
    assert circles(plot_parameters(series)) == hours
    assert circles(plot_outputs(series)) == {
        "MPAP [mmHg]\ndoubtful": [4.0, 8.0], "CO [L/min]\ndoubtful": [4.0]
    }  # fmt: skip
    good = {"id": "P", "points": [followed()]}
    assert circles(plot_parameters(good)) == {"Rmc [mmHg s/mL]": []}


@pytest.mark.slow
def test_labels_of_panels_below_each_other_do_not_overlap():
    """Names such as pre_oxygenator_pressure ran over the panels above and below."""
    names = (
        "MAP", "CO", "drainage_pressure", "pump_inlet_pressure", "pre_oxygenator_pressure",
        "post_oxygenator_pressure", "crrt_filter_pressure_drop", "crrt_return_pressure",
    )  # fmt: skip
    interval = {name: {"lower": 1.0, "median": 2.0, "upper": 3.0} for name in names}
    one = followed(outputs=interval, expected=interval)
    figure = plot_outputs({"id": "P", "points": [one, one]})
    FigureCanvasAgg(figure).draw()
    boxes = [ax.yaxis.label.get_window_extent() for ax in figure.axes]
    for first, second in itertools.combinations(boxes, 2):
        assert not first.overlaps(second)
