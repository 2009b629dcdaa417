"""All comparisons, in the order in which `eclsim validate` shows them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from eclsim.validation.rows import Check


@dataclass(frozen=True)
class Effort:
    """How much to compute.

    Args:
        quick: a case of each kind of circuit instead of all.
        points: points of the robustness sweep in each configuration.
    """

    quick: bool = False
    points: int = 512


def _reference(effort: Effort) -> list[Check]:
    from eclsim.validation import reference_cases

    return reference_cases.checks(effort.quick)


def _gradients(effort: Effort) -> list[Check]:
    from eclsim.validation import gradients

    return gradients.checks()


def _shi_hose(effort: Effort) -> list[Check]:
    from eclsim.validation import shi_hose

    return shi_hose.checks()


def _adaptive(effort: Effort) -> list[Check]:
    from eclsim.validation import cross_solver

    return [cross_solver.adaptive_check(effort.quick)]


def _invariants(effort: Effort) -> list[Check]:
    from eclsim.validation import cross_solver

    return [cross_solver.periodicity_check(effort.quick), cross_solver.conservation_check(effort.quick)]


def _robustness(effort: Effort) -> list[Check]:
    from eclsim.validation import robustness

    return robustness.checks(effort.points)


def _paper(effort: Effort) -> list[Check]:
    from eclsim.validation import paper

    return paper.checks()


def _devices(effort: Effort) -> list[Check]:
    from eclsim.validation import devices

    return devices.checks()


def _patients(effort: Effort) -> list[Check]:
    from eclsim.validation import effects, healthy

    return [*healthy.checks(), *effects.checks()]


PARTS: dict[str, Callable[[Effort], list[Check]]] = {
    "reference": _reference,
    "gradients": _gradients,
    "shi-hose": _shi_hose,
    "adaptive": _adaptive,
    "invariants": _invariants,
    "robustness": _robustness,
    "paper": _paper,
    "devices": _devices,
    "patients": _patients,
}
"""Parts of the validation by the name that `--only` takes."""


def run(
    effort: Effort, parts: Sequence[str] = (), announce: Callable[[str], None] = lambda _: None
) -> Iterator[Check]:
    """The checks of some parts, or of all, each as soon as it is done.

    Args:
        effort: how much to compute.
        parts: names of `PARTS`; left out, all.
        announce: is told the name of each part before it starts.
    """
    for name in parts or PARTS:
        announce(name)
        start = time.perf_counter()
        found = PARTS[name](effort)
        share = (time.perf_counter() - start) / max(len(found), 1)
        yield from (replace(check, seconds=share) for check in found)
