import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import xarray as xr

from eclsim.sensitivity import figures
from eclsim.sensitivity.design import Estimates
from eclsim.sensitivity.figures import (
    plot_bars,
    plot_convergence,
    plot_distributions,
    plot_heat_map,
    plot_pairs,
    plot_sums,
    write_sensitivity_figures,
)
from eclsim.sensitivity.inputs import CARDIOVASCULAR, OUTPUTS
from eclsim.sensitivity.results import Indices, SensitivityResult


@pytest.fixture
def indices() -> Indices:
    """The paper's factors and outputs with numbers of which each is known."""
    shape = len(OUTPUTS), len(CARDIOVASCULAR)
    total = np.linspace(0.0, 0.5, shape[0] * shape[1]).reshape(shape)
    pairs = np.full((*shape, shape[1]), 0.001)
    pairs[0, 22, 23] = 0.2  # SP: Emaxra with Emaxrv
    estimates = Estimates(0.5 * total, 0.1 * total, total, 0.1 * total, pairs, np.full_like(pairs, 0.05))
    return Indices(CARDIOVASCULAR, OUTPUTS, estimates, 64, 64 * 50, (), 64)


def labels(axes) -> list[str]:
    return [t.get_text() for t in axes.get_xticklabels()]


def test_a_heat_map_has_the_order_of_the_sums_or_of_the_paper(indices):
    by_sums, as_in_paper = (plot_heat_map(indices, "ST", layout).axes[0] for layout in ("sums", "paper"))
    assert labels(by_sums) == list(indices.sums)
    assert labels(as_in_paper) == list(CARDIOVASCULAR)
    assert as_in_paper.images[0].get_clim() == (0.0, 1.0)
    kinds = [t.get_text() for t in as_in_paper.texts if t.get_text().isalpha()]
    assert kinds == ["resistances", "compliances", "inertances", "elastances"]
    column = labels(by_sums).index("Emaxrv")
    assert by_sums.images[0].get_array()[6, column] == pytest.approx(0.5)


def test_published_sums_stand_beside_ours(indices):
    axes = plot_sums(indices, {"Rmc": 3.8, "Emaxlv": 1.6}).axes[0]
    marks = {labels(axes)[round(x)]: y for x, y in axes.collections[0].get_offsets()}
    assert marks == {"Rmc": 3.8, "Emaxlv": 1.6}
    assert not plot_sums(indices).axes[0].collections


def test_sums_have_half_widths_and_lost_rows_are_named_above_every_figure(indices, tmp_path, monkeypatch):
    spread = np.eye(len(CARDIOVASCULAR)) * 0.01
    wide = replace(indices, estimates=replace(indices.estimates, sum_covariance=spread))
    (lines,) = plot_sums(wide).axes[0].collections
    low, high = lines.get_segments()[0][:, 1]
    assert high - low == pytest.approx(2.0 * 1.96 * 0.1, rel=1e-3)
    drawn = []
    monkeypatch.setattr(figures, "_save", lambda figures, folder, doubts, title: drawn.append(doubts))
    lost = replace(indices, samples=128, rows_used=74)
    write_sensitivity_figures(SensitivityResult(None, lost, None), tmp_path)
    assert drawn == [
        [
            "The indices describe only the part of the ranges where the case has a steady beat: 54 of 128 "
            "rows are lost"
        ]
    ]


def test_the_patient_and_doubts_about_the_fit_stand_above_every_figure(indices, tmp_path, monkeypatch):
    doubt = "its parameters are a DOUBTFUL fit of eclsim identify: see why in its report"
    drawn = []
    monkeypatch.setattr(
        figures, "save_figure", lambda figure, path: drawn.append(figure.get_suptitle()) or []
    )
    figures._save({"sums": lambda: plot_sums(indices)}, tmp_path, [doubt], "P01 – sensitivity")
    assert drawn == [f"P01 – sensitivity\n{doubt}"]
    titles = []
    monkeypatch.setattr(figures, "_save", lambda *given: titles.append(given[-1]))
    case = json.dumps({"patient": {"id": "P01"}})
    write_sensitivity_figures(SensitivityResult(None, indices, None, case), tmp_path)
    write_sensitivity_figures(SensitivityResult(None, replace(indices, state="normal"), None, case), tmp_path)
    assert titles == ["P01 – sensitivity", "P01 – sensitivity, normal state"]


def test_only_pairs_beyond_their_interval_are_drawn(indices):
    panels = dict(zip(OUTPUTS, plot_pairs(indices).axes, strict=False))
    assert [len(panels[name].lines) for name in OUTPUTS] == [1, 0, 0, 0, 0, 0, 0]


def test_bars_without_a_ranking_say_which_inputs_they_show(indices):
    notes = [
        plot_bars(one).legends[0].get_title().get_text() for one in (indices, replace(indices, rows_used=8))
    ]
    assert "make up 90 %" in notes[0]
    assert ["not ranked" in note for note in notes] == [False, True]


@pytest.mark.parametrize("rows_used", [64, 8])
@pytest.mark.parametrize("width", [0.1, 1.2])
def test_bars_with_names_of_devices_can_be_read(indices, rows_used, width):
    """The legend was cut off at the right, and tick labels stood on each other."""
    names = ("Rmc", "Emaxlv", "Csart", "Rpmc", "Lsart", "ecmo.speed_rpm")
    total = np.linspace(0.0, 0.9, 7 * 6).reshape(7, 6)
    conf = np.full((7, 6), width)
    few = replace(indices, factors=names, estimates=Estimates(0.9 * total, conf, total, conf))
    fig = plot_bars(replace(few, rows_used=rows_used))
    fig.canvas.draw()
    assert within(fig, fig.legends[0])
    for axes in fig.axes:
        low, high = axes.get_xlim()
        shown = [t for t in axes.get_xticklabels() if low <= t.get_position()[0] <= high]
        assert len(shown) > 1
        assert apart(shown)


def apart(texts) -> bool:
    """Whether texts beside each other do not overlap."""
    boxes = [text.get_window_extent() for text in texts]
    return all(left.x1 < right.x0 for left, right in pairwise(boxes))


def within(fig, artist) -> bool:
    box = artist.get_window_extent()
    return box.x0 >= 0.0 and box.x1 <= fig.bbox.width


@pytest.mark.parametrize(
    ("sizes", "named"), [(3, "16 32 64"), (4, "16 32 64 128"), (6, "32 128 512"), (11, "32 256 2048 16384")]
)
def test_convergence_names_sample_sizes_and_marks_each(sizes, named):
    """Only the last size was named, and there were no marks at the others."""
    rows = [16 << k for k in range(sizes)]
    factors = ("ecmo.speed_rpm", *(f"crrt.filtration_flow_{k}" for k in range(8)))
    shape = sizes, 2, len(OUTPUTS), len(factors)
    dims = ("rows", "index", "output", "factor")
    names = dict(zip(dims, (rows, ["S1", "ST"], list(OUTPUTS), list(factors)), strict=True))
    data = {name: (dims, np.full(shape, 0.2)) for name in ("mean", "spread", "mean_conf")}
    fig = plot_convergence(xr.Dataset(data, names))
    fig.canvas.draw()
    assert within(fig, fig.legends[0])
    for axes in fig.axes:
        assert axes.get_xticks().tolist() == rows
        assert apart([t for t in axes.get_xticklabels() if t.get_text()])
        assert " ".join(filter(None, labels(axes))) == named
        assert all(line.get_marker() == "o" for line in axes.lines)


def test_the_interval_of_a_single_sample_size_is_drawn():
    """A band over one sample size has no width: the caption spoke of intervals that could not be seen."""
    names = ["Rmc", "Emaxlv", "Csart"]
    dims, shape = ("index", "rows", "output", "factor"), (1, 1, 1, len(names))
    coordinates = {"rows": [16], "output": ["MAP"], "factor": names, "index": ["ST"]}
    data = {"mean": [0.95, 0.4, 0.1], "spread": [np.nan] * 3, "mean_conf": [0.49] * 3}
    variables = {name: (dims, np.reshape(each, shape)) for name, each in data.items()}
    (axes,) = plot_convergence(xr.Dataset(variables, coordinates)).axes
    segments = [lines.get_segments()[0] for lines in axes.collections]
    assert [ends[1, 1] - ends[0, 1] for ends in segments] == pytest.approx([2 * 0.49 / 1.96] * 3)
    assert len({ends[0, 0] for ends in segments}) == len(names)


@pytest.mark.parametrize("draw", ["distributions", "bars"])
def test_long_names_of_outputs_stay_on_the_page(indices, draw):
    """ "lowest_drainage_pressure [mmHg]" ran off the page."""
    outputs = ("SP", "DP", "MAP", "lowest_drainage_pressure", "PF", "ecmo.va_femoral.drainage_pressure", "CO")
    long = replace(indices, outputs=outputs)
    values = np.random.default_rng(1).normal(size=(32, 2, len(outputs)))
    figure = plot_bars(long) if draw == "bars" else plot_distributions(long, values)
    figure.draw_without_rendering()
    for axes in figure.axes:
        for text in (axes.title, axes.xaxis.label):
            extent = text.get_window_extent()
            assert extent.x1 <= figure.bbox.x1, text.get_text()
            assert extent.x0 >= figure.bbox.x0, text.get_text()
    titles = [axes.get_title().replace("\n", "") for axes in figure.axes]
    assert titles[: len(outputs)] == list(outputs)


def test_long_names_of_pairs_stay_within_the_figure(indices):
    """The left end of gas.shunt_fraction was cut off."""
    names = tuple(f"gas.haemoglobin_g_{k:02d}" for k in range(len(indices.factors)))
    fig = plot_pairs(replace(indices, factors=names))
    fig.canvas.draw()
    texts = [t for axes in fig.axes for t in axes.texts if "haemoglobin" in t.get_text()]
    assert len(texts) >= 10
    assert all(t.get_text().startswith("gas.\nhaemoglobin_\ng_") for t in texts)
    assert all(t.get_window_extent().x0 >= 0.0 for t in texts)
