"""What the study does not know, in words: beats that were not found, and why.

The records hold no numbers for them (`eclsim.outputs.steady_beat`); here it is said which they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eclsim.orbit.model import POLICY_WORDS
from eclsim.orbit.status import Status

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.crrt_study.study import CrrtStudy

FOUND = Status.CONVERGED.name.lower()
WITHOUT_CRRT = "without CRRT"
WHY = {
    "no_ejection": "the native heart ejects next to nothing",
    "not_converged": "the search for it did not converge",
    "not_finite": "the pressures left the range of numbers",
    "one_of_many": "valves stay shut, so that the volumes depend on where the computation began",
    "invalid_input": "a value is not allowed",
}
"""Reason by status."""
MOST_SPEEDS_NAMED = 4


@dataclass(frozen=True, slots=True)
class Unsettled:
    """Beats of one scheme that were not found for one reason.

    Args:
        policy: blood volume policy.
        place: "scheme a" or "without CRRT".
        speeds: of the pump [rpm].
        status: how the search ended, in lower case.
        condition: what else was special about the beats.
    """

    policy: str
    place: str
    speeds: tuple[float, ...]
    status: str
    condition: str = ""

    @property
    def sentence(self) -> str:
        """Where there is no steady beat, and why."""
        where = f"{self.place} {self.condition}".strip()
        return f"{where}: {no_beat(self.speeds, [self.status] * len(self.speeds))}"

    @property
    def advice(self) -> str:
        """What the status means and what to do."""
        return Status[self.status.upper()].message


def no_beat(speeds: Sequence[float], statuses: Sequence[str]) -> str:
    """Speeds without a steady beat, and the reasons; empty where all are found.

    Args:
        speeds: of the pump [rpm].
        statuses: one for each speed; those that were found are left out.
    """
    reasons = dict.fromkeys(status for status in statuses if status != FOUND)
    messages = []
    for reason in reasons:
        here = [v for v, status in zip(speeds, statuses, strict=True) if status == reason]
        messages.append(f"no steady beat at {speeds_in_words(here)} ({WHY[reason]})")
    return ", ".join(messages)


def speeds_in_words(speeds: Sequence[float]) -> str:
    """A few speeds one by one, of more the first, the last and how many."""
    words = [f"{speed:.0f}" for speed in speeds]
    if len(words) > MOST_SPEEDS_NAMED:
        return f"{len(words)} speeds from {words[0]} to {words[-1]} rpm"
    return f"{listed(words)} rpm"


def listed(words: Sequence[str]) -> str:
    """Words with commas and an "and" before the last."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def unsettled(study: CrrtStudy) -> tuple[Unsettled, ...]:
    """All beats that were not found, by policy, scheme and reason."""
    result: list[Unsettled] = []
    for policy in study.policies:
        for letter in study.means["scheme"].values.astype(str):
            one = study.means["status"].sel(policy=policy, scheme=letter)
            result += _grouped(policy, f"scheme {letter}", one)
        result += _grouped(policy, WITHOUT_CRRT, study.without_crrt["status"].sel(policy=policy))
    return (*result, *_primed(study))


def _grouped(policy: str, place: str, status: xr.DataArray) -> Iterator[Unsettled]:
    """One entry for each reason."""
    words = status.values.astype(str)
    for reason in dict.fromkeys(word for word in words if word != FOUND):
        yield Unsettled(policy, place, tuple(status["speed"].values[words == reason].tolist()), reason)


def _primed(study: CrrtStudy) -> Iterator[Unsettled]:
    """Schemes whose beat with the volume of the patient without CRRT was not found."""
    if study.uptake is None:
        return
    for letter, status in zip(
        study.uptake["scheme"].values.astype(str), study.uptake["status"].values.astype(str), strict=True
    ):
        if status not in (FOUND, NOT_ASKED):
            yield Unsettled("patient_held", f"scheme {letter}", (study.case_speed,), status, PRIMED)


PRIMED = "with the volume of the patient without CRRT"
NOT_ASKED = "not_computed"
"""Status of a beat that was not computed since the one it is compared with was not found."""


def samples_without_a_beat(uncertainty: xr.Dataset) -> dict[str, int]:
    """Number of samples without a steady beat, by scheme; only those that have any."""
    count = np.rint((1.0 - uncertainty["settled"].values) * uncertainty.attrs["samples"]).astype(int)
    letters = uncertainty["scheme"].values.astype(str)
    return {str(letter): int(n) for letter, n in zip(letters, count, strict=True) if n}


MOST_LINES = 20


def not_known(study: CrrtStudy) -> list[str]:
    """Every beat that was not found, with its reason and what to do; empty if all were."""
    together: dict[tuple[str, str, tuple[float, ...], str], list[str]] = {}
    for one in study.unsettled:
        together.setdefault((one.policy, one.condition, one.speeds, one.status), []).append(one.place)
    lines = []
    for (policy, condition, speeds, status), places in together.items():
        how = condition or POLICY_WORDS[policy].partition(":")[0]
        where = f"{_places(places)}, {how}"
        lines.append(f"{where}: {no_beat(speeds, [status] * len(speeds))}")
    if len(lines) > MOST_LINES:
        lines = [*lines[:MOST_LINES], f"and {len(lines) - MOST_LINES} more, see the list in the JSON object"]
    if study.samples_without_a_beat and study.uncertainty is not None:
        count = ", ".join(f"{number} (scheme {k})" for k, number in study.samples_without_a_beat.items())
        every = study.uncertainty.attrs["samples"]
        lines.append(f"Samples of the patient's parameters without a steady beat, of {every}: {count}")
    return lines + [f"What this means: {words}" for words in dict.fromkeys(u.advice for u in study.unsettled)]


def _places(places: list[str]) -> str:
    """Places of one kind together: schemes a, b and c."""
    letters = [place.removeprefix("scheme ") for place in places if place.startswith("scheme ")]
    others = [place for place in places if not place.startswith("scheme ")]
    named = [schemes_named(letters)] if letters else []
    words = listed([*named, *others])
    return words[0].upper() + words[1:]


def schemes_named(letters: list[str]) -> str:
    """Scheme a, or Schemes a, b and c."""
    return f"Scheme{'s' if len(letters) > 1 else ''} {listed(letters)}"
