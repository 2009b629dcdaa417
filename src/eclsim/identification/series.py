"""What the measurements of a followed patient have in common, whichever of them is looked at.

A patient has one set point for each reflex: left open, it is the first measurement of the series that tells
it, and later ones are answered from there. Bounds are those of the first case that reads a parameter.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from eclsim.cases.quantities import with_values
from eclsim.identification.settings import (
    MEASURED_AT_REST,
    CheckedFit,
    FitSettings,
    checked_fit,
    open_at_rest,
    ready,
)
from eclsim.inputs.mistakes import Mistake, shown

if TYPE_CHECKING:
    from eclsim.cases.case import Case


@dataclass
class Series:
    """What is known of a series from the cases looked at so far.

    Args:
        settings: free parameters, bounds.
        set_points: values of the set points that the cases leave open.
        notes: what there is to say of them.
    """

    settings: FitSettings
    set_points: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def learn(self, name: str, case: Case) -> None:
        """Take from a case what the series has not been told yet; `name`: of the measurement."""
        for key, value in open_at_rest(case).items():
            if key not in self.set_points:
                self.set_points[key] = value
                told = f"the {MEASURED_AT_REST[key]} of {name} ({shown(value)})"
                message = f"left open, so {told}: reflexes do nothing there, and answer to changes"
                self.notes.append(str(Mistake(key, message)))

    def checked(self, case: Case) -> tuple[Case, CheckedFit]:
        """A case as the series has it, and what can be fitted to it."""
        left_open = () if case.regulation is None else case.regulation.open_set_points
        case = with_values(case, {key: v for key, v in self.set_points.items() if key in left_open})
        checked = checked_fit(case, self.settings)
        return ready(case, self.settings), checked


def series_of(settings: FitSettings, points: Iterable[tuple[str, Case]]) -> Series:
    """What the measurements of a series, name and case of each in order, have in common."""
    series = Series(settings)
    for name, case in points:
        series.learn(name, case)
    return series
