"""Figures of the study that are laid out by hand: nothing runs over the edge, the best schemes are drawn."""

import pytest
from matplotlib.text import Text

from eclsim.plotting.crrt_figures import plot_crrt_beat, plot_crrt_speeds
from eclsim.plotting.crrt_schematic import MOST_DRAWN, draw_schemes
from eclsim.plotting.style import figure_style
from eclsim.studies.crrt_schemes import select_schemes


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


@pytest.mark.parametrize("name", ["beat", "speeds"])
def test_no_text_runs_over_the_edge(figures, name):
    assert inside(figures[name])


def test_panels_do_not_overlap(figures):
    for fig in figures.values():
        with figure_style():
            fig.draw_without_rendering()
        boxes = [axes.get_tightbbox() for axes in fig.axes]
        for k, one in enumerate(boxes):
            assert not any(one.overlaps(other) for other in boxes[k + 1 :])


def test_of_many_schemes_the_best_are_drawn():
    schemes = select_schemes("pairs")
    ranks = {scheme.letter: len(schemes) - k for k, scheme in enumerate(schemes)}
    fig = draw_schemes(schemes, ranks)
    titles = {t.get_text() for t in fig.findobj(Text) if "rank" in t.get_text()}
    assert len(titles) == MOST_DRAWN
    assert {title.rpartition(" ")[2] for title in titles} == {str(k + 1) for k in range(MOST_DRAWN)}
    assert inside(draw_schemes(select_schemes("all")))
