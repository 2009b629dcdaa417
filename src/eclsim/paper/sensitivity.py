"""Sensitivity analyses of the paper: of the circulation on V-A ECMO, and of the positions of the CRRT lines.

Figures 3, S-1, S-3, S-4 and Table 2: the paper names three states (normal, hypertensive, hypotensive) but
prints no start values. The analysis here is for the patient of section 3.3 with the parameters of Table S-1,
and is repeated for a man of average size.

Figures 7, S-5, S-6 and S-7: the published code drew the positions at random over Saltelli's finished design,
so two runs that should differ in one factor also differ in the positions. Here the positions are inputs of
the design. The analysis is repeated with drawn positions, which shows their effect on the paper's statements.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from eclsim.cases.case import Case
from eclsim.execution import Executor
from eclsim.orbit.model import model_of
from eclsim.paper.comparison import Row, Verdict, printed_number, statement, statements
from eclsim.paper.crrt import UnprintedValues, explained_case, paper_case
from eclsim.paper.printed import RUNS, SAMPLES, TABLE_2
from eclsim.sensitivity.analysis import (
    TARGETS,
    SobolSettings,
    plan_analysis,
    run_analysis,
    sensitivity,
    state_values,
)
from eclsim.sensitivity.inputs import CARDIOVASCULAR, Categorical, Description
from eclsim.sensitivity.results import Indices, SensitivityResult
from eclsim.sensitivity.runs import Analysis, Evaluator, Runs

ADDITIVE, SMALL = 0.05, 0.1
SPEED, ACCESS, RETURN = "ecmo.speed_rpm", "crrt.access_site", "crrt.return_site"
DRAWN_SEED = 7
NEGLIGIBLE, PAIR = 0.05, 0.05
_CUT = "which rows make up 90 % of PCWP is decided at the cut, see the documentation, page Sensitivity"
_DRAWN = "an effect of drawing the positions over the finished design, as the published code did"
_NEITHER = "neither as inputs of the design nor drawn; nothing is printed to compare with"

Progress = Callable[[str], None]


@dataclass(frozen=True)
class SobolComparison:
    """Analyses compared with the paper.

    Args:
        rows: one row for each number and statement.
        shown: analysis that the figures show, of a man of average size or with the positions as inputs of the
            design.
        samples: number of rows N of each design.
    """

    rows: tuple[Row, ...]
    shown: SensitivityResult
    samples: int


def healthy_parameters_case(average: bool) -> Case:
    """Return V-A ECMO with the parameters of Table S-1: the assumed woman, or a man of 170 cm and 70 kg."""
    case = paper_case()
    patient = case.patient.model_copy(update={"id": "Thiel 2025, Table S-1"})
    if average:
        patient = patient.model_copy(
            update={"id": "man of average size", "sex": "male", "height_cm": 170.0, "weight_kg": 70.0}
        )
    return case.model_copy(update={"patient": patient, "crrt": None, "parameters": {}})


def reproduce_circulation(
    folder: Path, samples: int, executor: Executor, progress: Progress = lambda _: None
) -> SobolComparison:
    """Run the analyses and compare them with the paper.

    Args:
        folder: folder that stores the runs.
        samples: number of rows N of each design, a power of two.
        executor: executor of the runs.
        progress: called with a description of the current step.
    """

    def run(name: str, case: Case, state: str = "") -> SensitivityResult:
        label = f"sensitivity, {name}" + (f", {state}" if state else "")
        values = state_values(model_of(case), state) if state else None
        return sensitivity(
            case,
            settings=SobolSettings(samples=samples, second_order=False, values=values),
            folder=folder / f"{name}{'_' if state else ''}{state}",
            distribution=executor,
            progress=lambda p: progress(f"{label}: {p.done} of {p.total} blocks"),
        )

    woman, man = healthy_parameters_case(False), healthy_parameters_case(True)
    analyses = [partial(run, "assumed", woman), *(partial(run, "average", man, s) for s in ("", *TARGETS))]
    assumed, average, *others = executor.run_each(analyses)
    states = dict(zip(TARGETS, others, strict=True))
    rows = (*_table_2(assumed.indices, average.indices), *_statements(assumed, average, states))
    return SobolComparison(rows, average, samples)


def _table_2(assumed: Indices, average: Indices) -> list[Row]:
    rows = []
    for name, printed in TABLE_2.items():
        (ours, width), (result, _) = _sum(assumed, name), _sum(average, name)
        reason = f"start values are not printed; N = {assumed.samples}, 95 % interval ± {width:.2f}"
        rows.append(
            printed_number("Table 2", f"sum of the total orders of {name}", "1", printed, ours, decimals=2,
                           tolerance=0.005 + width, explained=result, reason=reason)
        )  # fmt: skip
    return rows


def _sum(indices: Indices, name: str) -> tuple[float, float]:
    """Sum of the total orders of a parameter, and half width of its 95 % interval.

    The outputs come from the same runs, so their errors are added.
    """
    k = indices.factors.index(name)
    return indices.sums[name], float(indices.estimates.ST_conf[:, k].sum())


def _statements(
    assumed: SensitivityResult, average: SensitivityResult, states: dict[str, SensitivityResult]
) -> list[Row]:
    first, second = assumed.indices, average.indices
    runs = SAMPLES * (2 * len(CARDIOVASCULAR) + 2)
    union = {name for analysis in states.values() for name in analysis.indices.union()}
    more = ", ".join(sorted(union - set(TABLE_2)))
    messages = (
        ("3.1", "Csart acts on SP and DP more than on the others",
         lambda i: _top_outputs(i, "Csart") == {"SP", "DP"}),
        ("3.1", "Edla acts on PCWP alone (others below 0.1)", _edla_acts_on_wedge_pressure_only),
        ("3.1", "Emaxrv acts on MPAP and PCWP more than on the others",
         lambda i: _top_outputs(i, "Emaxrv") == {"MPAP", "PCWP"}),
        ("3.1", "Rsvn acts on MPAP and PCWP more than on the others",
         lambda i: _top_outputs(i, "Rsvn") == {"MPAP", "PCWP"}),
        ("3.1", "Rpmc acts on MPAP more than on the others", lambda i: "MPAP" in _top_outputs(i, "Rpmc", 1)),
        ("3.1", "the seven of Table 2 have the largest sums, in its order",
         lambda i: list(i.sums)[: len(TABLE_2)] == list(TABLE_2)),
        ("3.1, Figure S-3", "parameters act independently (total less first order below 0.05)",
         lambda i: float(np.max(i.estimates.ST - i.estimates.S1)) < ADDITIVE),
    )  # fmt: skip
    reason, lacking = "start values are not printed", _outputs_without_rmc_or_emaxlv(first)
    return [
        printed_number("2.3", "runs at N = 2048 for 24 parameters", "1", RUNS, runs),
        statement("3.1", "Rmc and Emaxlv are among those that make up 90 % of every output", not lacking,
                  f"{lacking} is not", not _outputs_without_rmc_or_emaxlv(second)),
        *statements(messages, first, second, reason),
        statement("3.1", "the seven are selected over the three states", set(TABLE_2) <= union),
        printed_number("3.1", "number of parameters selected over the three states", "1", len(TABLE_2),
                       len(union), reason=f"besides the seven: {more}; {_CUT}" if more else ""),
        statement("2.3", "leading total orders have standard deviations below 5 %", _leading_precise(first),
                  f"at N = {first.samples}; the paper's N is {SAMPLES}", _leading_precise(second)),
    ]  # fmt: skip


def _outputs_without_rmc_or_emaxlv(indices: Indices) -> str:
    """Which of Rmc and Emaxlv is not among the factors that make up 90 % of an output, as text."""
    selected, two = indices.selected(), ("Rmc", "Emaxlv")
    result = [f"{name} of {o}" for o, names in selected.items() for name in two if name not in names]
    return ", ".join(result)


def _top_outputs(indices: Indices, name: str, count: int = 2) -> set[str]:
    """Outputs with the largest total orders of a parameter."""
    total = indices.estimates.ST[:, indices.factors.index(name)]
    return {indices.outputs[k] for k in np.argsort(-total)[:count]}


def _edla_acts_on_wedge_pressure_only(indices: Indices) -> bool:
    total = indices.estimates.ST[:, indices.factors.index("Edla")]
    return all(
        (value > SMALL) == (name == "PCWP") for name, value in zip(indices.outputs, total, strict=True)
    )


def _leading_precise(indices: Indices) -> bool:
    """Whether the leading total order of every output has a relative standard deviation below 5 %."""
    e = indices.estimates
    leading = np.argmax(e.ST, axis=1)[:, None]
    deviation = np.take_along_axis(e.ST_conf, leading, 1) / 1.96 / np.take_along_axis(e.ST, leading, 1)
    return float(deviation.max()) < 0.05


# --- positions of the CRRT lines as inputs --------------------------------------------------------


@dataclass(frozen=True)
class RedrawnChoices:
    """An evaluator that replaces the choices of the design by random ones, separately for each block."""

    evaluator: Evaluator
    choices: tuple[Categorical, ...]
    seed: int = DRAWN_SEED

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return self.evaluator.outputs

    def __call__(self, settings: Mapping[str, np.ndarray], count: int) -> Runs:
        """Run several points with other choices than those of the design."""
        first = int(np.frombuffer(next(iter(settings.values()))[:1].tobytes(), dtype=np.uint32)[0])
        random = np.random.default_rng([self.seed, first])
        drawn = dict(settings)
        for choice in self.choices:
            drawn |= choice.settings(random.random(count))
        return self.evaluator(drawn, count)

    def description(self) -> Description:
        """Plain data that describe the inputs."""
        names = [choice.name for choice in self.choices]
        return self.evaluator.description() | {"drawn_over_the_design": names, "drawn_seed": self.seed}


def reproduce_positions(
    folder: Path,
    unprinted: UnprintedValues,
    samples: int,
    executor: Executor,
    progress: Progress = lambda _: None,
) -> SobolComparison:
    """Run both analyses and compare them with the paper.

    Args:
        folder: folder that stores the runs.
        unprinted: values of the patient that were estimated from the numbers of section 3.3.
        samples: number of rows N of each design, a power of two.
        executor: executor of the runs.
        progress: called with a description of the current step.
    """
    case = explained_case(unprinted)
    settings = SobolSettings(samples=samples, groups=("R", "C", "L", "E"), include=(ACCESS, RETURN, SPEED))
    plan = plan_analysis(case, settings)
    choices = tuple(i for i in plan.design.inputs if isinstance(i, Categorical))
    redrawn = replace(plan, evaluator=RedrawnChoices(plan.evaluator, choices))

    def run(analysis: Analysis, name: str, title: str) -> SensitivityResult:
        return run_analysis(
            analysis, folder / name, executor,
            progress=lambda p: progress(f"{title}: {p.done} of {p.total} blocks"),
        )  # fmt: skip

    designed, drawn = executor.run_each((
        partial(run, plan, "designed", "sensitivity to the CRRT's positions"),
        partial(run, redrawn, "drawn", "the same, positions drawn over the design"),
    ))  # fmt: skip
    return SobolComparison(tuple(position_rows(designed, drawn)), designed, samples)


def position_rows(designed: SensitivityResult, drawn: SensitivityResult) -> list[Row]:
    """Rows for the statements of the text on Figures 7 and S-5 to S-7."""
    ours, theirs = designed.indices, drawn.indices
    seven, five = "3.3, Figure 7", "3.3, Figure S-5"
    messages = (
        (seven, "pump speed has the largest sum of total orders", lambda i: next(iter(i.sums)) == SPEED),
        (seven, "the resistances come second", lambda i: list(i.sums)[1] == "R"),
        (seven, "on MPAP and CO, C and L matter at least half as much as the positions", _c_and_l_comparable),
        (seven, "on MPAP and CO, E matters at most twice as much as the return position",
         lambda i: all(_total(i, o, "E") <= 2.0 * _total(i, o, RETURN) for o in ("MPAP", "CO"))),
        (five, "the access position helps to make up 90 % of MPAP and CO",
         lambda i: _is_selected_for_flow(i, ACCESS)),
        (five, "the return position helps to make up 90 % of MPAP and CO",
         lambda i: _is_selected_for_flow(i, RETURN)),
        ("4", "first orders of both positions are below 0.05 on MPAP and CO", _positions_have_no_first_order),
        ("4", "the strongest pair is that of both positions, or resistances and pump speed",
         lambda i: all(_pairs(i, output)[0][2] in _EXPECTED_PAIRS for output in ("MPAP", "CO"))),
        ("4", "that pair is beyond its 95 % interval and above 0.05 for MPAP or CO",
         _strongest_pair_is_significant),
    )  # fmt: skip
    rows = statements(messages, ours, theirs, _DRAWN)
    rows = [row.because(_NEITHER) if row.verdict is Verdict.DIFFERS else row for row in rows]
    return rows + _ranges(designed, drawn)


def _ranges(designed: SensitivityResult, drawn: SensitivityResult) -> list[Row]:
    """Rows for the smallest and largest sampled values, which the paper prints as round numbers."""
    rows = []
    for name, unit, low, high, decimals in (("MAP", "mmHg", 50.0, 100.0, -1), ("PF", "L/min", 2.0, 5.0, 0)):
        k = designed.indices.outputs.index(name)
        for label, printed, choose in (("smallest", low, np.min), ("largest", high, np.max)):
            ours, other = (float(choose(f.values[:, :, k])) for f in (designed, drawn))
            rows.append(
                printed_number("3.3, Figure S-6", f"{label} {name} of the samples", unit, printed, ours,
                               decimals=decimals, explained=other, reason="printed in round numbers")
            )  # fmt: skip
    return rows


def _total(indices: Indices, output: str, factor: str) -> float:
    return float(indices.estimates.ST[indices.outputs.index(output), indices.factors.index(factor)])


def _c_and_l_comparable(indices: Indices) -> bool:
    return all(
        min(_total(indices, output, "C"), _total(indices, output, "L"))
        >= 0.5 * max(_total(indices, output, ACCESS), _total(indices, output, RETURN))
        for output in ("MPAP", "CO")
    )


def _is_selected_for_flow(indices: Indices, factor: str) -> bool:
    return all(factor in indices.selected()[output] for output in ("MPAP", "CO"))


def _positions_have_no_first_order(indices: Indices) -> bool:
    rows = [indices.outputs.index(o) for o in ("MPAP", "CO")]
    columns = [indices.factors.index(f) for f in (ACCESS, RETURN)]
    return bool((indices.estimates.S1[np.ix_(rows, columns)] < NEGLIGIBLE).all())


def _pairs(indices: Indices, output: str) -> list[tuple[float, float, frozenset[str]]]:
    """Second order of each pair of factors, with half width; the largest first."""
    table = indices.pairs
    assert table is not None
    rows = table.sort_values("S2", ascending=False, kind="stable").query("output == @output")
    names = map(frozenset, zip(rows["factor"], rows["other_factor"], strict=True))
    return list(zip(rows["S2"], rows["S2_conf"], names, strict=True))


_EXPECTED_PAIRS = (frozenset((ACCESS, RETURN)), frozenset(("R", SPEED)))


def _strongest_pair_is_significant(indices: Indices) -> bool:
    return any(
        names in _EXPECTED_PAIRS and value > max(width, PAIR)
        for output in ("MPAP", "CO")
        for value, width, names in _pairs(indices, output)
    )
