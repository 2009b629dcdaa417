"""Sensitivity, positions and cohort: what is said of them, and that long parts can be gone on with."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eclsim.execution import Distribution
from eclsim.paper.cohort import SYNTHETIC, reproduce_cohort
from eclsim.paper.comparison import Verdict
from eclsim.paper.printed import TABLE_2
from eclsim.paper.reproduction import ITEMS, file_names
from eclsim.paper.sensitivity import (
    CARDIOVASCULAR,
    RedrawnChoices,
    _statements,
    _table_2,
    healthy_parameters_case,
    reproduce_circulation,
)
from eclsim.sensitivity.design import Estimates
from eclsim.sensitivity.inputs import Categorical, Continuous
from eclsim.sensitivity.results import Indices
from eclsim.sensitivity.runs import Analysis
from known_indices import runs_of

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_every_numbered_figure_and_table_of_the_paper_is_there():
    titles = [item.title for item in ITEMS]
    figures = [*map(str, range(1, 8)), *(f"S-{k}" for k in range(1, 8))]
    tables = ["1", "2", *(f"S-{k}" for k in range(1, 5))]
    assert titles == [f"Figure {n}" for n in figures] + [f"Table {n}" for n in tables]
    assert len(set(file_names())) == len(file_names())


def test_the_embedded_cohort_is_the_one_of_the_examples():
    assert SYNTHETIC.read_bytes() == (EXAMPLES / "synthetic_cohort.csv").read_bytes()


def test_the_average_man_has_more_blood_than_the_assumed_woman():
    from eclsim.cases.resolve import blood_volume_ml

    woman, man = (healthy_parameters_case(average) for average in (False, True))
    assert blood_volume_ml(man.patient) > blood_volume_ml(woman.patient) + 500.0
    assert man.crrt is None
    assert man.parameters == {}


class Doubles:
    """An evaluator that gives its inputs back."""

    outputs = ("x", "site")

    def __call__(self, settings, count):
        return runs_of(np.stack([settings["x"], settings["site"]], axis=1))

    def description(self):
        return {}


def test_positions_drawn_over_the_design_differ_within_a_row_and_are_the_same_again():
    from eclsim.sensitivity.design import Design

    site = Categorical("site", tuple("abcdef"), (("site", tuple(map(float, range(6)))),))
    design = Design((Continuous("x", 1.0, 2.0), site), 64)
    drawn = RedrawnChoices(Doubles(), (site,))
    once, again, plain = (Analysis(design, e).block(0).values for e in (drawn, drawn, Doubles()))
    np.testing.assert_array_equal(once, again)
    np.testing.assert_array_equal(once[:, 0], plain[:, 0])
    rows = plain.reshape(64, -1, 2)
    assert (rows[:, 0, 1] == rows[:, 1, 1]).all()  # AB of x shares the site with A: what estimators rely on
    rows = once.reshape(64, -1, 2)
    assert (rows[:, 0, 1] != rows[:, 1, 1]).mean() > 0.6
    assert set(once[:, 1]) == set(range(6))


def indices(sums: dict[str, float]) -> Indices:
    total = np.zeros((7, len(CARDIOVASCULAR)))
    for name, value in sums.items():
        total[:, CARDIOVASCULAR.index(name)] = value / 7.0
    width = np.full_like(total, 0.001)
    estimates = Estimates(total, width, total, width)
    outputs = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO", "PF")
    return Indices(CARDIOVASCULAR, outputs, estimates, 64, 64 * 26, (), 64)


def test_table_2_is_compared_within_the_interval_of_ours():
    rows = _table_2(indices({**TABLE_2, "Rmc": 3.79, "Csart": 0.4}), indices(TABLE_2))
    verdicts = {row.name.rpartition(" ")[2]: row.verdict for row in rows}
    assert verdicts == {
        **dict.fromkeys(TABLE_2, Verdict.AGREES),
        "Csart": Verdict.EXPLAINED,
    }


def test_statements_about_the_sensitivity_are_read_off_the_indices():
    from types import SimpleNamespace

    flat = SimpleNamespace(indices=indices(TABLE_2))
    rows = {row.name: row for row in _statements(flat, flat, {"normal": flat})}  # pyright: ignore
    assert rows["the seven of Table 2 have the largest sums, in its order"].got == 1.0
    assert rows["Edla acts on PCWP alone (others below 0.1)"].got == 0.0
    assert rows["runs at N = 2048 for 24 parameters"].holds
    lacking = rows["Rmc and Emaxlv are among those that make up 90 % of every output"]
    assert lacking.holds
    turned = SimpleNamespace(indices=indices({"Rmc": 7.0}))
    rows = {row.name: row for row in _statements(turned, flat, {"normal": turned})}  # pyright: ignore
    lacking = rows[lacking.name]
    assert lacking.verdict is Verdict.EXPLAINED
    assert "Emaxlv of SP" in lacking.reason


@pytest.mark.slow
def test_a_stopped_analysis_is_gone_on_with(tmp_path):
    message = []
    with Distribution(force=True).running() as executor:
        first = reproduce_circulation(tmp_path, 8, executor, message.append)
    assert len(first.rows) == len(TABLE_2) + 12
    (kept,) = (tmp_path / "assumed").glob("samples.parquet")
    before = kept.stat().st_mtime_ns
    with Distribution(resume=True).running() as executor:
        again = reproduce_circulation(tmp_path, 8, executor)
    assert kept.stat().st_mtime_ns == before
    assert [row.got for row in again.rows] == [row.got for row in first.rows]


@pytest.mark.slow
def test_a_cohort_of_two_points_is_fitted_compared_and_kept(tmp_path):
    lines = SYNTHETIC.read_text().splitlines()
    table = tmp_path / "two.csv"
    table.write_text("\n".join([lines[0], *lines[1:3]]) + "\n")
    with Distribution().running() as executor:
        result = reproduce_cohort(tmp_path / "fits", table, 8, executor)
    assert not result.synthetic
    assert np.nanmin(result.slices.costs) >= 0.99 * result.slices.cost
    rows = {(row.source, row.name): row for row in result.rows}
    assert rows["Table 1", "SP, median"].got == 101.0
    assert rows["2.1", "number of data points"].got == 2
    assert rows["3.2", "R² of pressures"].got > 0.95
    message: list[str] = []
    with Distribution(resume=True).running() as executor:
        again = reproduce_cohort(tmp_path / "fits", table, 8, executor, message.append)
    assert again.results == result.results
    assert message == ["cohort: fits: 1 of 1 groups of data points"]  # and no task is run
    assert replace(again, slices=result.slices) == replace(result, slices=result.slices)


@pytest.mark.parametrize(
    ("unit", "ours", "message"),
    [("1", 0.21, "paper 0.2, ours 0.21"), ("mmHg", 71.0, "paper 0.2 mmHg, ours 71 mmHg")],
)
def test_a_row_of_the_terminal_keeps_all_digits_of_our_number(unit: str, ours: float, message: str):
    from eclsim.cli.paper import both_values
    from eclsim.paper.comparison import printed_number

    assert both_values(printed_number("3.1", "a share", unit, 0.2, ours, decimals=1)) == message
