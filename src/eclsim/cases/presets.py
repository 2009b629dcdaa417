"""Preset patients: a case for each common situation at the bedside.

`aim` describes what a preset shows, `aims` gives the criteria as ranges, and `source` names their sources;
the tests check the simulated numbers against the ranges. Only the paper's patient was fitted to a real
patient. The others use the published parameters (Tables S-1 to S-3 of Thiel et al. 2025), except those that
characterise the situation (contractility, resistances, compliance and filling), chosen in November 2026 to
meet the ranges.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from eclsim.cases.case import Case
from eclsim.parameters.thiel2025 import TABLE_S4

CARDIAC_INDEX = "cardiac_index"
"""Cardiac output per body surface area after Mosteller [L/min/m2]."""


@dataclass(frozen=True)
class Preset:
    """A case to start from.

    Args:
        key: short name, also used in links.
        name: displayed name.
        aim: description of what the beat shows, with the usual criteria.
        source: sources of the criteria.
        aims: the criteria as ranges, by output or `CARDIAC_INDEX`, in their units.
        sections: the case, as in a case file.
        often: devices often connected or disconnected with this preset; the page prepares them.
    """

    key: str
    name: str
    aim: str
    source: str
    aims: Mapping[str, Sequence[float]]
    sections: Mapping[str, Any]
    often: Sequence[str] = ()

    def case(self) -> Case:
        """Return the checked case."""
        return Case.model_validate({"format": 1, **self.sections})


def _read() -> Iterator[Preset]:
    file = Path(__file__).with_suffix(".toml")
    for key, entry in tomllib.loads(file.read_text(encoding="utf-8")).items():
        sections = entry.pop("case")
        if key == "paper":
            sections["parameters"] = dict(TABLE_S4)
        yield Preset(key, sections=sections, **entry)


PRESETS: Mapping[str, Preset] = MappingProxyType({preset.key: preset for preset in _read()})
"""Preset cases, by key."""
