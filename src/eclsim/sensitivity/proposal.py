"""A set of parameters worth fitting, and for every other one the reason why it is not in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eclsim.sensitivity.identifiability import ScaledSensitivities, relative_errors


@dataclass(frozen=True)
class Proposal:
    """A set to fit.

    Args:
        chosen: parameters, in the order in which they were taken: each time the one that says most beyond
            the others.
        excluded: reason for each parameter left out.
        collinearity: index of the set.
        relative_errors: smallest standard error of each [share of its value] if all are fitted together.
    """

    chosen: tuple[str, ...]
    excluded: dict[str, str]
    collinearity: float
    relative_errors: dict[str, float]


def propose(scaled: ScaledSensitivities, limit: float = 10.0, threshold: float = 1.0) -> Proposal:
    """Take, one by one, the parameter with the most effect that the ones taken do not have.

    Args:
        scaled: scaled sensitivities.
        limit: largest collinearity index of the set (Brun et al. 2001 found sets above 10 to 15 not
            identifiable).
        threshold: smallest effect, in standard uncertainties for a change of 100 %.
    """
    effect = dict(zip(scaled.parameters, scaled.effect.tolist(), strict=True))
    weak = [p for p in scaled.parameters if effect[p] < threshold]
    chosen: list[str] = []
    left = [p for p in scaled.parameters if p not in weak]
    while left and len(chosen) < len(scaled.outputs):
        ranked = sorted(left, key=lambda p: -_own_effect(scaled, chosen, p))
        best = next((p for p in ranked if _fits(scaled, [*chosen, p], limit, threshold)), None)
        if best is None:
            break
        chosen.append(best)
        left.remove(best)
    excluded = {p: _weak_reason(scaled, p, effect[p], threshold) for p in weak}
    excluded |= {p: _reason(scaled, chosen, p, limit, threshold) for p in left}
    ordered = {p: excluded[p] for p in sorted(excluded, key=lambda p: -effect[p])}
    gamma = scaled.collinearity(chosen) if chosen else float("nan")
    return Proposal(tuple(chosen), ordered, gamma, relative_errors(scaled, chosen))


def _own_effect(scaled: ScaledSensitivities, chosen: list[str], name: str) -> float:
    """Effect of a parameter that no combination of the chosen ones has."""
    target = scaled.matrix[:, scaled.parameters.index(name)]
    if not chosen:
        return float(np.linalg.norm(target))
    return scaled.closest([*chosen, name], name)[0] * float(np.linalg.norm(target))


def _fits(scaled: ScaledSensitivities, chosen: list[str], limit: float, threshold: float) -> bool:
    return scaled.collinearity(chosen) <= limit and _own_effect(scaled, chosen[:-1], chosen[-1]) >= threshold


def _weak_reason(scaled: ScaledSensitivities, name: str, effect: float, threshold: float) -> str:
    column = np.abs(scaled.matrix[:, scaled.parameters.index(name)])
    most = scaled.outputs[int(column.argmax())]
    if effect == 0.0:
        return "no effect on any measurement"
    return (
        f"too little effect: a change of 100 % moves {most} most, by {column.max():.2g} of its uncertainty "
        f"(all together {effect:.2g}, needed {threshold:g})"
    )


def _reason(scaled: ScaledSensitivities, chosen: list[str], name: str, limit: float, threshold: float) -> str:
    left, others = scaled.closest([*chosen, name], name)
    like = " and ".join(others)
    if len(chosen) >= len(scaled.outputs):
        return f"as many parameters as measurements ({len(chosen)}) are taken; its effect is that of {like}"
    gamma = scaled.collinearity([*chosen, name])
    if gamma > limit:
        cosine = scaled.cosines[scaled.parameters.index(name), scaled.parameters.index(others[0])]
        return (
            f"cannot be told from {like}: collinearity index {gamma:.3g} with the set (limit {limit:g}), "
            f"cosine {cosine:+.3f} with {others[0]}"
        )
    own = left * float(np.linalg.norm(scaled.matrix[:, scaled.parameters.index(name)]))
    return (
        f"nearly all its effect is that of {like}: {own:.2g} uncertainties are its own (needed {threshold:g})"
    )
