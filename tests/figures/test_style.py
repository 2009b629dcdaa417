import xml.etree.ElementTree as ElementTree

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

import eclsim
from eclsim.patient.circulation import circulation
from eclsim.reporting.schematic import draw_circuit
from eclsim.reporting.style import (
    CURVES,
    PlainLogLocator,
    curve_style,
    figure_style,
    new_figure,
    plain_log_ticks,
    plain_text,
    save_figure,
    turned_names,
    write_above,
)
from eclsim.simulation.figures import plot_overview


def luminance(colour: str) -> float:
    """Relative luminance of the sRGB colour, 0 black to 1 white."""
    channels = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_curves_are_told_apart_without_colour():
    assert len({str(line) for _, line in CURVES}) == len(CURVES)


def test_few_long_names_along_an_axis_are_turned():
    """Seven names of gas inputs were written over each other."""
    gas = ("gas.vo2_ml_min", "gas.haemoglobin_g_dl", "ecmo.sweep_l_min", "ecmo.speed_rpm", "Rmc", "Emaxlv")
    assert turned_names(gas) == 90.0
    assert turned_names(("Rmc", "Emaxlv", "Rpmc", "Emaxrv", "Csart", "Edla", "Rsvn")) == 0.0


def test_curves_stand_out_on_paper():
    assert all(1.05 / (luminance(colour) + 0.05) > 2.0 for colour, _ in CURVES)


def test_a_long_label_keeps_its_margin_in_the_file(tmp_path):
    """Text is wider at the resolution of the file than at that of the screen."""
    with figure_style():
        figure = new_figure(80, 40)
        axes = figure.subplots()
        axes.set_yticks([0, 1], ["tube from oxygenator", "lungs"])
        axes.tick_params(axis="y", length=0)
    (file,) = save_figure(figure, tmp_path / "label", ["png"])
    dark = np.asarray(Image.open(file).convert("L")) < 200
    assert int(np.flatnonzero(dark.any(axis=0))[0]) >= 8
    assert figure.dpi == 100


def test_more_curves_than_styles_start_again():
    assert curve_style(len(CURVES)) == curve_style(0)


@pytest.mark.slow
def test_figure_is_written_in_both_formats(tmp_path, healthy):
    svg, png = save_figure(plot_overview(healthy), tmp_path / "new" / "case 3.5")
    assert (svg.name, png.name) == ("case 3.5.svg", "case 3.5.png")
    assert ElementTree.parse(svg).getroot().tag.endswith("svg")
    with Image.open(png) as picture:
        assert picture.width == pytest.approx(170 / 25.4 * 200, abs=2)
    assert sorted(path.name for path in svg.parent.iterdir()) == ["case 3.5.png", "case 3.5.svg"]


def test_figures_state_version_and_intended_use(tmp_path):
    """They are passed on without the page that says so."""
    use = "for research only, not for treatment"
    svg, png = save_figure(new_figure(40, 20), tmp_path / "a")
    assert use in svg.read_text()
    assert f"eclsim {eclsim.__version__}" in svg.read_text()
    with Image.open(png) as picture:
        assert picture.info["Description"] == use
        assert picture.info["Software"] == f"eclsim {eclsim.__version__}"


@pytest.mark.slow
def test_same_result_gives_the_same_svg(tmp_path, healthy):
    (first,) = save_figure(plot_overview(healthy), tmp_path / "first", ["svg"])
    (second,) = save_figure(plot_overview(healthy), tmp_path / "second", ["svg"])
    assert first.read_bytes() == second.read_bytes()


def test_failed_writing_leaves_the_old_file_and_nothing_else(tmp_path):
    old = tmp_path / "a.svg"
    old.write_text("old")
    figure = Figure()
    figure.text(0.5, 0.5, "$\\broken$", parse_math=True)
    with pytest.raises(ValueError, match="broken"):
        save_figure(figure, tmp_path / "a", ["svg"])
    assert old.read_text() == "old"
    assert list(tmp_path.iterdir()) == [old]


def test_settings_of_the_user_are_restored_and_have_no_effect():
    with matplotlib.rc_context({"axes.labelsize": 33, "font.size": 33}):
        with figure_style():
            ax = new_figure().add_subplot()
        assert matplotlib.rcParams["font.size"] == 33
    assert ax.xaxis.label.get_fontsize() == 8


@pytest.mark.parametrize(
    ("given", "drawn"),
    [
        ("P01", "P01"),
        ("cost $5 and $6", r"cost \$5 and \$6"),
        ("two\nlines\tand\x00null\u202e", "two lines and null"),
        ("x" * 100, "x" * 69 + "…"),
    ],
)
def test_text_from_outside_is_drawn_as_it_is(given: str, drawn: str):
    assert plain_text(given) == drawn


DOUBT = "its parameters are a DOUBTFUL fit of eclsim identify: see why in its report"


def boxes(figure: Figure) -> dict[str, tuple[float, float]]:
    """Lowest and highest edge of every text of a figure, in dots."""
    with figure_style():
        figure.draw_without_rendering()
        shown = [text for text in figure.findobj(Text) if text.get_text()]
        return {text.get_text(): (e.y0, e.y1) for text in shown if (e := text.get_window_extent())}


def test_a_doubt_stands_above_the_title_that_a_circuit_draws_itself(healthy):
    """It lay in the middle of the grey subtitle."""
    figure = draw_circuit(circulation(), healthy)
    write_above(figure, [DOUBT])
    places = boxes(figure)
    low, _ = places.pop(DOUBT)
    assert low > max(high for _, high in places.values())
    (text,) = (text for text in figure.texts if text.get_text() == DOUBT)
    assert (text.get_ha(), text.get_weight()) == ("left", "bold")


def test_a_figure_with_fixed_axes_grows_by_the_words_above_it():
    figure = new_figure(170, 60)
    figure.set_layout_engine(None)
    axes = figure.add_axes((0.1, 0.1, 0.8, 0.8))
    before = axes.get_window_extent()
    write_above(figure, [DOUBT], "P01 – beat")
    after = axes.get_window_extent()
    assert (after.width, after.height) == pytest.approx((before.width, before.height))
    assert figure.get_suptitle().splitlines() == ["P01 – beat", DOUBT]


@pytest.mark.parametrize("own", ["", "P01"])
@pytest.mark.parametrize("width_mm", [80, 170])
def test_long_words_above_a_figure_end_within_the_page(own, width_mm):
    figure = new_figure(width_mm, 60)
    if own:
        with figure_style():
            figure.suptitle(own)
    write_above(figure, ["DOUBTFUL: mean pressures and mean flows are summed over WIDE MARGINS " * 4])
    with figure_style():
        figure.draw_without_rendering()
    (text,) = figure.texts
    assert text.get_window_extent().x1 < figure.bbox.x1


def test_a_doubt_stands_below_the_title_of_a_figure_once():
    figure = new_figure()
    figure.suptitle("P01", x=0.01, ha="left")
    write_above(figure, [DOUBT], "first line")
    assert figure.get_suptitle().splitlines() == ["first line", "P01", DOUBT]
    assert len(figure.texts) == 1


@pytest.mark.slow
def test_scripts_that_the_font_lacks_do_not_stop_a_figure(tmp_path, healthy):
    named = healthy.assign_attrs(id="患者 🫀")
    svg, _ = save_figure(plot_overview(named), tmp_path / "a")
    assert "患者" in svg.read_text(encoding="utf-8")


# --- ticks of logarithmic axes ---


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.5, 1.3), (1.9, 2.4), (0.001, 0.1), (0.03, 2.0), (3.1, 3.3), (0.9, 40.0), (2.01, 2.02)],
)
def test_a_few_numbers_far_enough_apart(low, high):
    ticks = PlainLogLocator(0.25).tick_values(low, high)
    assert 2 <= len(ticks) <= 5
    assert low <= min(ticks)
    assert max(ticks) <= high
    assert (np.diff(np.log(ticks)) >= 0.25 * np.log(high / low) - 1e-12).all()


def test_labels_are_plain_numbers():
    """Not 2.6 times 10 to the power of 0, which a logarithmic axis shorter than a decade has otherwise."""
    from matplotlib.figure import Figure

    ax = Figure().subplots()
    ax.plot([1, 2], [2.4, 2.9])
    ax.set_yscale("log")
    plain_log_ticks(ax.yaxis)
    ax.figure.draw_without_rendering()
    labels = [t.get_text() for t in ax.get_yticklabels(which="both") if t.get_text()]
    assert len(labels) >= 2
    assert all("10^" not in label and 2.3 < float(label) < 3.0 for label in labels)
