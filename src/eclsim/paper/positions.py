"""Figures 7, S-5, S-6, S-7: positions of the CRRT lines and pump speed as inputs of a sensitivity analysis.

The published code drew the positions at random over Saltelli's finished design, so that two runs that should
differ in one factor differ in the positions too. Ours has them as inputs of the design; once more they are
drawn, which shows what of the paper's statements comes from it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eclsim.execution import Distribution
from eclsim.paper.patient import Unstated, explained_case
from eclsim.paper.rows import Row, statement
from eclsim.sensitivity.analysis import SobolSettings, plan_analysis, run_analysis
from eclsim.sensitivity.inputs import ACCESS, RETURN, Categorical
from eclsim.sensitivity.results import Indices, SensitivityResult
from eclsim.sensitivity.runs import Analysis, Evaluator, Runs

SPEED = "ecmo.speed_rpm"
DRAWN_SEED = 7
NEGLIGIBLE = 0.05
PAIR = 0.05
_DRAWN = "an effect of drawing the positions over the finished design, as the published code did"


@dataclass(frozen=True)
class PositionsPart:
    """The analyses beside the paper.

    Args:
        rows: one for each number and statement.
        designed: with the positions as inputs of the design; the figures show it.
        drawn: with the positions drawn over the design, as the published code did.
        samples: rows N of each design.
    """

    rows: tuple[Row, ...]
    designed: SensitivityResult
    drawn: SensitivityResult
    samples: int


@dataclass(frozen=True)
class DrawnOver:
    """An evaluator that throws the choices of the design away and draws its own, per block."""

    evaluator: Evaluator
    choices: tuple[Categorical, ...]
    seed: int = DRAWN_SEED

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return self.evaluator.outputs

    def __call__(self, settings: Mapping[str, np.ndarray], count: int) -> Runs:
        """Run some points with other choices than those of the design."""
        first = int(np.frombuffer(next(iter(settings.values()))[:1].tobytes(), dtype=np.uint32)[0])
        random = np.random.default_rng([self.seed, first])
        drawn = dict(settings)
        for choice in self.choices:
            drawn |= choice.settings(random.random(count))
        return self.evaluator(drawn, count)

    def description(self) -> dict[str, Any]:
        """As plain data."""
        names = [choice.name for choice in self.choices]
        return self.evaluator.description() | {"drawn_over_the_design": names, "drawn_seed": self.seed}


def reproduce_positions(
    folder: Path,
    unstated: Unstated,
    samples: int,
    resume: bool,
    progress: Callable[[str], None] = lambda _: None,
) -> PositionsPart:
    """Run both analyses and compare.

    Args:
        folder: keeps the runs.
        unstated: of the patient, as found with the numbers of section 3.3.
        samples: rows N of each design, a power of two.
        resume: whether to go on with what the folder holds.
        progress: is told what is being computed.
    """
    case = explained_case(unstated)
    settings = SobolSettings(samples=samples, groups=("R", "C", "L", "E"), include=(ACCESS, RETURN, SPEED))
    plan = plan_analysis(case, settings)
    choices = tuple(i for i in plan.design.inputs if isinstance(i, Categorical))
    drawn_over = replace(plan, evaluator=DrawnOver(plan.evaluator, choices))

    def run(analysis: Analysis, name: str, title: str) -> SensitivityResult:
        with Distribution(resume=resume, force=not resume).running() as executor:
            return run_analysis(
                analysis, folder / name, executor,
                progress=lambda p: progress(f"{title}: {p.done} of {p.total} blocks"),
            )  # fmt: skip

    designed = run(plan, "designed", "sensitivity to the CRRT's positions")
    drawn = run(drawn_over, "drawn", "the same, positions drawn over the design")
    return PositionsPart(tuple(position_rows(designed, drawn)), designed, drawn, samples)


def position_rows(designed: SensitivityResult, drawn: SensitivityResult) -> list[Row]:
    """What the text says of Figures 7 and S-5 to S-7."""
    ours, theirs = designed.indices, drawn.indices
    seven, five = "3.3, Figure 7", "3.3, Figure S-5"
    said = (
        (seven, "pump speed has the largest sum of total orders", lambda i: next(iter(i.sums)) == SPEED),
        (seven, "the resistances come second", lambda i: list(i.sums)[1] == "R"),
        (seven, "on MPAP and CO, C and L matter at least half as much as the positions", _as_c_and_l),
        (seven, "on MPAP and CO, E matters at most twice as much as the return position", _as_e),
        (five, "the access position helps to make up 90 % of MPAP and CO", lambda i: _selected(i, ACCESS)),
        (five, "the return position helps to make up 90 % of MPAP and CO", lambda i: _selected(i, RETURN)),
        ("4", "first orders of both positions are below 0.05 on MPAP and CO", _no_first),
        ("4", "the strongest pair is that of both positions, or resistances and pump speed", _strongest_pair),
        ("4", "that pair is beyond its 95 % interval and above 0.05 for MPAP or CO", _strong_pair),
    )
    rows = [statement(where, words, holds(ours), _DRAWN, holds(theirs)) for where, words, holds in said]
    why = "neither as inputs of the design nor drawn; nothing is printed to compare with"
    rows = [row.because(why) if row.verdict == "differs" else row for row in rows]
    return rows + _ranges(designed, drawn)


def _ranges(designed: SensitivityResult, drawn: SensitivityResult) -> list[Row]:
    """Smallest and largest of what the samples give, printed in round numbers."""
    rows = []
    for name, unit, low, high, digits in (("MAP", "mmHg", 50.0, 100.0, -1), ("PF", "L/min", 2.0, 5.0, 0)):
        k = designed.indices.outputs.index(name)
        for words, printed, choose in (("smallest", low, np.min), ("largest", high, np.max)):
            ours, other = (float(choose(f.values[:, :, k])) for f in (designed, drawn))
            quantity, why = f"{words} {name} of the samples", "printed in round numbers"
            tolerance = 0.5 * 10.0**-digits
            row = Row("3.3, Figure S-6", quantity, unit, printed, ours, other, max(digits, 0), tolerance, why)
            rows.append(row.because("") if row.as_printed else row)
    return rows


def _total(indices: Indices, output: str, factor: str) -> float:
    return float(indices.estimates.ST[indices.outputs.index(output), indices.factors.index(factor)])


def _as_c_and_l(indices: Indices) -> bool:
    return all(
        min(_total(indices, output, "C"), _total(indices, output, "L"))
        >= 0.5 * max(_total(indices, output, ACCESS), _total(indices, output, RETURN))
        for output in ("MPAP", "CO")
    )


def _as_e(indices: Indices) -> bool:
    return all(_total(indices, o, "E") <= 2.0 * _total(indices, o, RETURN) for o in ("MPAP", "CO"))


def _selected(indices: Indices, factor: str) -> bool:
    return all(factor in indices.selected()[output] for output in ("MPAP", "CO"))


def _no_first(indices: Indices) -> bool:
    rows = [indices.outputs.index(o) for o in ("MPAP", "CO")]
    columns = [indices.factors.index(f) for f in (ACCESS, RETURN)]
    return bool((indices.estimates.S1[np.ix_(rows, columns)] < NEGLIGIBLE).all())


def _pairs(indices: Indices, output: str) -> list[tuple[float, float, frozenset[str]]]:
    e, k = indices.estimates, indices.outputs.index(output)
    assert e.S2 is not None
    assert e.S2_conf is not None
    found = [
        (float(e.S2[k, i, j]), float(e.S2_conf[k, i, j]), frozenset((indices.factors[i], indices.factors[j])))
        for i, j in zip(*np.triu_indices(len(indices.factors), 1), strict=True)
    ]
    return sorted(found, key=lambda one: -one[0])


_NAMED = (frozenset((ACCESS, RETURN)), frozenset(("R", SPEED)))


def _strongest_pair(indices: Indices) -> bool:
    return all(_pairs(indices, output)[0][2] in _NAMED for output in ("MPAP", "CO"))


def _strong_pair(indices: Indices) -> bool:
    return any(
        names in _NAMED and value > max(width, PAIR)
        for output in ("MPAP", "CO")
        for value, width, names in _pairs(indices, output)
    )
