"""Figures of the study that are laid out by hand: nothing runs over the edge, the best schemes are drawn."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.text import Text

from crrt_failures import with_failures
from eclsim.crrt_study.figures import (
    MOST_DRAWN,
    draw_schemes,
    plot_crrt_beat,
    plot_crrt_limits,
    plot_crrt_speeds,
    plot_crrt_uptake,
)
from eclsim.crrt_study.schemes import select_schemes
from eclsim.reporting.style import figure_style


def inside(fig) -> bool:
    with figure_style():
        fig.draw_without_rendering()
        box, (width, height) = fig.get_tightbbox(), fig.get_size_inches()
    return box.x0 >= -0.01 and box.y0 >= -0.01 and box.x1 <= width + 0.01 and box.y1 <= height + 0.01


@pytest.fixture(scope="module")
def figures(hostile_study):
    policy = hostile_study.policies[0]
    means = hostile_study.means.sel(policy=policy)
    return {
        "beat": plot_crrt_beat(hostile_study.waveforms.sel(policy=policy), means.sel(speed=3425.0)),
        "speeds": plot_crrt_speeds(means, 3425.0),
    }


@pytest.fixture(scope="module")
def gone(hostile_study):
    """Scheme h without a beat at the speed of the case, a and g without one above it."""
    failures = [("as_published", "h", 3425.0), *(("as_published", letter, 5000.0) for letter in "ag")]
    return with_failures(hostile_study, failures)


def words(fig) -> str:
    return " | ".join(text.get_text() for text in fig.findobj(Text))


@pytest.mark.slow
def test_curves_end_where_beats_were_not_found_and_the_legend_says_so(gone):
    means = gone.means.sel(policy="as_published")
    fig = plot_crrt_speeds(means, 3425.0)
    assert "not known beyond: no steady beat found" in words(fig)
    assert "no steady beat at the case's speed: h" in words(fig)
    assert "highest arterial pressure of those known" in words(fig)
    hollow = [line for line in fig.axes[2].lines if line.get_marker() == "o"]
    assert sorted(len(line.get_xdata()) for line in hollow) == [1, 1, 2], "h on both sides of its gap"
    curves = [line for line in fig.axes[2].lines if len(line.get_xdata()) == 4]
    assert sum(np.isnan(line.get_xdata()).sum() for line in curves) == 3, "no line runs across a gap"
    assert inside(fig)


@pytest.mark.slow
def test_the_legend_tells_other_schemes_from_the_flow_of_the_case(figures):
    (legend,) = figures["speeds"].legends
    pairs = zip(legend.get_texts(), legend.get_lines(), strict=True)
    lines = {words.get_text(): line.get_linestyle() for words, line in pairs}
    assert lines["other schemes"] != lines["ECMO flow of the case"]


@pytest.mark.slow
def test_a_beat_that_was_not_found_is_not_drawn_and_named(gone):
    waves = gone.waveforms.copy(deep=True)
    for name in waves.data_vars:
        waves[name].loc[{"policy": "as_published", "scheme": "h"}] = np.nan
    here = gone.means.sel(policy="as_published", speed=3425.0)
    fig = plot_crrt_beat(waves.sel(policy="as_published"), here)
    assert "no steady beat at the case's speed: h" in words(fig)
    assert inside(fig)
    everything = waves.sel(policy="as_published") * np.nan
    nothing = plot_crrt_beat(everything.assign_coords(waves.coords), here[["Psart"]] * np.nan)
    assert "highest" not in words(nothing)


@pytest.mark.slow
def test_what_is_not_known_of_a_limit_is_hatched(gone):
    limits = gone.limits.sel(policy="as_published")
    fig = plot_crrt_limits(limits, float("nan"), ["a", "g", "h"])
    assert "not known: no steady beat found" in words(fig)
    assert sum(bool(bar.get_hatch()) for bar in fig.axes[0].patches) >= 2
    assert "ECMO flow of the case" not in words(fig)


@pytest.mark.slow
def test_a_split_that_is_not_known_says_so_in_its_row(gone):
    uptake = gone.uptake.copy(deep=True)
    for name in ("Psart_flow", "Psart_uptake", "blood_taken_up"):
        uptake[name].loc[{"scheme": "h"}] = np.nan
    fig = plot_crrt_uptake(uptake, gone.means.sel(speed=3425.0), gone.without_crrt.sel(speed=3425.0))
    assert words(fig).count("not known: no steady beat") == 2
    assert "nan" not in words(fig)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["beat", "speeds"])
def test_no_text_runs_over_the_edge(figures, name):
    assert inside(figures[name])


@pytest.mark.slow
def test_panels_do_not_overlap(figures):
    for fig in figures.values():
        with figure_style():
            fig.draw_without_rendering()
        boxes = [axes.get_tightbbox() for axes in fig.axes]
        for k, one in enumerate(boxes):
            assert not any(one.overlaps(other) for other in boxes[k + 1 :])


def test_of_many_schemes_the_best_are_drawn():
    schemes = select_schemes("pairs")
    places = {scheme.letter: str(k + 1) for k, scheme in enumerate(reversed(schemes))}
    fig = draw_schemes(schemes, places)
    titles = {t.get_text() for t in fig.findobj(Text) if "rank" in t.get_text()}
    assert len(titles) == MOST_DRAWN
    assert {title.rpartition(" ")[2] for title in titles} == {str(k + 1) for k in range(MOST_DRAWN)}
    assert inside(draw_schemes(select_schemes("all")))


def test_limits_of_one_scheme_have_room_for_axes_and_legend():
    shape, flows = ("scheme", "limit"), np.full((1, 5), 3.8)
    names = ["access_alarm", "return_alarm", "access_190", "suction", "crrt"]
    limits = xr.Dataset(
        {
            "largest_flow": (shape, flows),
            "flow_at_most": (shape, flows),
            "state": (shape, np.full((1, 5), "broken_above")),
        },
        coords={"scheme": ["a"], "limit": names},
    )
    fig = plot_crrt_limits(limits, 3.5, ["a"])
    fig.draw_without_rendering()
    (ax,) = fig.get_axes()
    assert ax.get_window_extent().height > 0.4 * fig.bbox.height
