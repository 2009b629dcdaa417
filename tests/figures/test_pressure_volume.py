import numpy as np
import pytest

from eclsim.simulation.figures import plot_pressure_volume


def test_one_case_shows_both_ventricles_with_their_volumes(healthy):
    figure = plot_pressure_volume(healthy)
    assert [ax.get_title(loc="left") for ax in figure.axes] == ["Right ventricle", "Left ventricle"]
    assert [ax.get_xlabel() for ax in figure.axes] == ["Volume [mL]"] * 2
    assert [ax.get_ylabel() for ax in figure.axes] == ["Pressure [mmHg]"] * 2
    assert figure.axes[1].texts[0].get_text() == "● EDV 139 mL   ○ ESV 39 mL"


def test_marks_stand_at_largest_and_least_volume(healthy):
    loop, largest, least = plot_pressure_volume(healthy).axes[1].get_lines()
    volume = healthy["Vlv"].values
    assert np.asarray(loop.get_xdata()) == pytest.approx(volume)
    assert np.asarray(largest.get_xdata()) == pytest.approx(volume.max())
    assert np.asarray(least.get_xdata()) == pytest.approx(volume.min())
    assert figure_limits_hold_all(volume, loop)


def figure_limits_hold_all(volume: np.ndarray, loop) -> bool:
    low, high = loop.axes.get_xlim()
    return low <= volume.min() and volume.max() < high


def test_outputs_of_the_result_are_quoted_where_it_has_them(healthy):
    quoted = plot_pressure_volume(healthy.assign(EDVLV=140.4, ESVLV=38.6)).axes[1].texts[0].get_text()
    assert quoted == "● EDV 140 mL   ○ ESV 39 mL"


def test_cases_are_told_apart(healthy, ecmo, lvad):
    figure = plot_pressure_volume([healthy, ecmo, lvad], ["before", "<b>ECMO</b>", "LVAD"])
    loops = figure.axes[1].get_lines()[::3]
    assert len({str(line.get_color()) for line in loops}) == 3
    assert len({str(line.get_linestyle()) + str(line._dash_pattern) for line in loops}) == 3
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["before", "<b>ECMO</b>", "LVAD"]


def test_atria_are_drawn_on_request(healthy):
    titles = [ax.get_title(loc="left") for ax in plot_pressure_volume(healthy, atria=True).axes]
    assert titles == ["Right ventricle", "Left ventricle", "Right atrium", "Left atrium"]


def test_wrong_number_of_labels_is_refused(healthy):
    with pytest.raises(ValueError, match="2 labels for 1 results"):
        plot_pressure_volume([healthy], ["a", "b"])
    with pytest.raises(ValueError, match="no result"):
        plot_pressure_volume([])


def test_result_without_numbers_is_drawn(healthy):
    plot_pressure_volume(healthy * np.nan).draw_without_rendering()


CARE = "† to be read with care; the warnings of the results say why"


@pytest.fixture
def doubted(ecmo):
    """The terminal marks the volumes of the left ventricle with a star."""
    case = ecmo.assign(EDVLV=140.4, ESVLV=38.6)
    for name in ("EDVLV", "ESVLV"):
        case[name].attrs |= {"finding": "caution", "read_with_care": 1}
    return case


def test_volumes_to_be_read_with_care_have_a_dagger(doubted):
    figure = plot_pressure_volume(doubted)
    assert figure.axes[1].texts[0].get_text() == "● EDV † 140 mL   ○ ESV † 39 mL"
    assert "†" not in figure.axes[0].texts[0].get_text()
    assert figure.get_supxlabel() == CARE


def test_daggers_are_explained_beside_the_names_of_several_cases(doubted, healthy):
    figure = plot_pressure_volume([healthy, doubted])
    assert figure.axes[1].texts[0].get_text() == "● EDV †   ○ ESV †"
    assert figure.axes[0].texts[0].get_text() == "● EDV   ○ ESV"
    assert figure.legends[0].get_title().get_text() == CARE
