"""The numbers and words that stand in the schematic."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from eclsim.reporting.beat_values import beat_mean, case_name, in_unit, summary_lines
from eclsim.reporting.names import ECMO_POSITIONS, group_of
from eclsim.reporting.numbers import number
from eclsim.reporting.schematic_layout import NODES
from eclsim.reporting.style import plain_text

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Labels:
    """Labels of one circuit; without a result they hold names only."""

    result: "xr.Dataset | None"

    def node(self, name: str) -> tuple[str, str, str]:
        """Words, key and mean pressure of a compartment; the pressure is empty without a result."""
        words = NODES[name].words if name in NODES else plain_text(name, 18)
        key = name if name in NODES else ""
        if name in ECMO_POSITIONS:
            key = f"{ECMO_POSITIONS[name]} ({name})"
        return words, key, self._mean(f"P{name}", "mmHg", 1)

    def flow(self, name: str) -> str:
        """Mean flow of a connection: mL/min in CRRT, L/min elsewhere; empty without a result."""
        return (
            self._mean(f"Q{name}", "mL/min", 0)
            if group_of(name) == "crrt"
            else self._mean(f"Q{name}", "L/min", 2)
        )

    def head(self, pump: str) -> str:
        """Mean pressure rise over a pump."""
        mean = self._mean(f"P{pump}", "mmHg", 0)
        return f"rise {mean}" if mean else ""

    def title(self, title: str | None) -> str:
        """The given title, or the name of the case."""
        if title is not None:
            return plain_text(title, 60)
        return "Circuit" if self.result is None else case_name(self.result)

    def subtitle(self) -> str:
        """What the numbers are, and under which policy on blood volume they hold."""
        if self.result is None:
            return "Compartments (boxes) and connections (arrows)"
        policy = self.result.attrs.get("blood_volume_policy")
        means = "Mean pressures and mean flows over one beat"
        return f"{means}; blood volume: {plain_text(policy).replace('_', ' ')}" if policy else means

    def summary(self) -> Iterator[str]:
        """The main outputs, one a line."""
        return iter(()) if self.result is None else iter(summary_lines(self.result))

    def _mean(self, name: str, unit: str, digits: int) -> str:
        if self.result is None or name not in self.result:
            return ""
        return f"{number(in_unit(beat_mean(self.result, name), unit), digits)} {unit}"
