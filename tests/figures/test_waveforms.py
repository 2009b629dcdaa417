import re
import tomllib
from itertools import combinations

import numpy as np
import pytest
from matplotlib.figure import Figure

from eclsim.cases.case import Case
from eclsim.cases.reading import read_mapping
from eclsim.simulation.figures import available_parts, plot_overview, plot_waveforms
from eclsim.simulation.single import simulate
from small_patient import ON_ECMO, PATIENT

UNIT = re.compile(r"\[(s|mmHg|mL/s|mL/min|L/min|mL)\]$")


def curves(figure: Figure) -> dict[str, list[str]]:
    """Title of each pair of axes and the labels of its lines."""
    return {
        ax.get_title(loc="left"): [str(line.get_label()) for line in ax.get_lines()] for ax in figure.axes
    }


def case_of(text: str) -> Case:
    return read_mapping(tomllib.loads(text)).case


def test_parts_are_those_of_the_circuit(healthy, ecmo, ecmo_crrt, lvad):
    patient = ["heart", "systemic", "pulmonary"]
    assert available_parts(healthy) == patient
    assert available_parts(ecmo) == [*patient, "ecmo"]
    assert available_parts(ecmo_crrt) == [*patient, "ecmo", "crrt"]
    assert available_parts(lvad) == [*patient, "lvad"]


@pytest.mark.parametrize("case", ["healthy", "ecmo", "ecmo_crrt", "lvad"])
def test_every_axis_has_its_unit(case: str, request):
    result = request.getfixturevalue(case)
    figures = [plot_overview(result), *(plot_waveforms(result, part) for part in available_parts(result))]
    for ax in (ax for figure in figures for ax in figure.axes):
        assert UNIT.search(ax.get_xlabel())
        assert UNIT.search(ax.get_ylabel())


def test_heart_shows_pressures_flows_and_volumes_of_both_sides(healthy):
    assert curves(plot_waveforms(healthy, "heart")) == {
        "Right heart": ["right ventricle", "right atrium", "pulmonary sinus"],
        "Left heart": ["left ventricle", "left atrium", "aorta"],
        "Right valves": ["pulmonary valve", "tricuspid valve"],
        "Left valves": ["aortic valve", "mitral valve"],
        "Right chambers": ["right ventricle", "right atrium"],
        "Left chambers": ["left ventricle", "left atrium"],
    }


def test_crrt_flows_are_in_ml_per_minute(ecmo_crrt):
    axes = {ax.get_title(loc="left"): ax for ax in plot_waveforms(ecmo_crrt, "crrt").axes}
    flows = axes["Flows"]
    assert flows.get_ylabel() == "Flow [mL/min]"
    pump = next(line for line in flows.get_lines() if line.get_label() == "CRRT pump")
    assert np.asarray(pump.get_ydata()) == pytest.approx(200.0, rel=1e-3)


def test_two_equal_beats_are_shown(healthy):
    pressure = plot_waveforms(healthy, "systemic").axes[0].get_lines()[0]
    time, values = np.asarray(pressure.get_xdata()), np.asarray(pressure.get_ydata())
    assert time[-1] == pytest.approx(1.6)
    assert np.all(np.diff(time) > 0)
    samples = healthy.sizes["phase"]
    assert values[:samples] == pytest.approx(healthy["Pao"].values)
    assert values[samples:] == pytest.approx(healthy["Pao"].values[1:])


def test_only_waveforms_of_the_result_are_drawn(healthy):
    fewer = healthy.drop_vars(["Pra", "Qao", "Qsart", "Qsvn"])
    assert curves(plot_waveforms(fewer, "systemic")) == {
        "Arteries": ["aorta", "systemic arteries"],
        "Veins": ["systemic veins"],
        "Volumes": [
            "aorta (mean 197 mL)",
            "systemic arteries (mean 525 mL)",
            "systemic veins (mean 3631 mL)",
        ],
    }


def test_vessel_volumes_are_shown_around_their_mean(healthy):
    volumes = next(ax for ax in plot_waveforms(healthy, "systemic").axes if "minus mean" in ax.get_ylabel())
    for line in volumes.get_lines():
        assert abs(np.trapezoid(np.asarray(line.get_ydata()), np.asarray(line.get_xdata()))) < 1e-6


@pytest.mark.parametrize(
    ("part", "reason"), [("ecmo", "not in this result"), ("Herz", "not a part of the circuit")]
)
def test_missing_part_names_those_there_are(healthy, part: str, reason: str):
    with pytest.raises(ValueError, match=f"{reason}.*heart, systemic, pulmonary"):
        plot_waveforms(healthy, part)


def test_overview_gives_the_main_outputs(ecmo):
    figure = plot_overview(ecmo)
    words = " ".join(text.get_text() for text in figure.findobj(lambda artist: hasattr(artist, "get_text")))
    assert "heart rate 120 /min" in words
    assert "aortic pressure 107/70 (88) mmHg" in words
    assert "PF 3.56 L/min" in words


def test_result_that_did_not_converge_says_so(healthy):
    failed = healthy.assign_attrs(converged=0)
    for figure in (plot_overview(failed), plot_waveforms(failed, "heart")):
        assert "NOT CONVERGED" in figure.get_suptitle()


def test_result_without_numbers_is_drawn(healthy):
    plot_overview(healthy * np.nan).draw_without_rendering()


@pytest.mark.slow
def test_legends_and_titles_do_not_overlap(ecmo_crrt):
    for part in ("heart", "systemic", "ecmo"):
        figure = plot_waveforms(ecmo_crrt, part)
        figure.draw_without_rendering()
        boxes = []
        for ax in figure.axes:
            legend = ax.get_legend()
            boxes += [
                legend.get_window_extent(),
                *(label.get_window_extent() for label in (ax.xaxis.label, ax.yaxis.label)),
            ]
            title = next(
                t for t in ax.get_children() if getattr(t, "get_text", str)() == ax.get_title(loc="left")
            )
            boxes.append(title.get_window_extent())
        assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))


@pytest.mark.slow
def test_no_legend_runs_to_the_edge_of_the_page(ecmo_crrt):
    for part in ("heart", "systemic", "ecmo", "crrt"):
        figure = plot_waveforms(ecmo_crrt, part)
        figure.draw_without_rendering()
        for ax in figure.axes:
            assert ax.get_legend().get_window_extent().x1 <= ax.get_window_extent().x1 + 1.0, (
                part,
                ax.get_title(),
            )


def test_an_assist_device_is_shown_beside_the_heart_it_drains():
    pump = 'pump = "HVAD"\nspeed_rpm = 2000\n'
    right = f'[lvad.right]\n{pump}inlet_site = "rv"\noutlet_site = "part"\n'
    left = f'[lvad.left]\n{pump}inlet_site = "lv"\noutlet_site = "ao"\n'
    result = simulate(case_of(PATIENT + right + left))
    assert curves(plot_waveforms(result, "lvad.right")) == {
        "Pressures": ["right ventricle", "pulmonary arteries"],
        "Pump head": ["pressure rise over the pump"],
        "Flows": ["LVAD pump", "pulmonary valve"],
        "Right ventricle": ["right ventricle"],
    }
    assert curves(plot_waveforms(result, "lvad.left"))["Flows"] == ["LVAD pump", "aortic valve"]


def test_flows_of_an_ecmo_with_a_second_return_cannula_add_up():
    without_crrt = ON_ECMO.partition("[crrt]")[0]
    result = simulate(case_of(without_crrt + 'second_return_site = "rv"\nsecond_return_fr = 17\n'))
    figure = plot_waveforms(result, "ecmo")
    flows = next(ax for ax in figure.axes if ax.get_title(loc="left") == "Flows")
    drawn = {str(line.get_label()): np.asarray(line.get_xydata()).T for line in flows.get_lines()}
    mean = {label: np.trapezoid(flow, time) / np.ptp(time) for label, (time, flow) in drawn.items()}
    assert len(mean) == 5
    returned = mean["return cannula"] + mean["second return cannula"]
    assert returned == pytest.approx(mean["ECMO pump"], rel=1e-3)


def test_a_legend_of_one_column_stands_beside_the_label_of_its_axis(ecmo):
    """ "Volume minus mean [mL]" ran through "inferior vena cava (mean 3627 mL)" in patients with regions."""
    volume = ecmo["Vsvn"]
    regional = ecmo.drop_vars("Vsvn").assign(Vsvc=volume, Vivc=volume)
    figure = plot_waveforms(regional, "systemic")
    figure.draw_without_rendering()
    (ax,) = (ax for ax in figure.axes if ax.get_title(loc="left") == "Volumes")
    legend, label = ax.get_legend().get_window_extent(), ax.yaxis.label.get_window_extent()
    assert "inferior vena cava" in ax.get_legend().get_texts()[-1].get_text()
    assert not legend.overlaps(label)
    assert legend.x1 <= figure.bbox.x1


def test_a_long_id_is_cut_only_where_the_line_is_full(ecmo):
    """Ids ended after 44 letters, with half of the line free."""
    names = ["Patient 17 of the cohort with a rather long pseudonym, day 3", "W" * 100, "i" * 200]
    for name in names:
        figure = plot_waveforms(ecmo.assign_attrs(id=name), "systemic")
        figure.draw_without_rendering()
        (title,) = (t for t in figure.texts if t.get_text() == figure.get_suptitle())
        assert title.get_window_extent().x1 <= figure.bbox.x1
        assert title.get_text().endswith(" – systemic")
        assert (name in title.get_text()) == (name == names[0])
        assert title.get_window_extent().x1 > 0.7 * figure.bbox.x1
