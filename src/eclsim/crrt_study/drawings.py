"""The figures of the CRRT study as SVG text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eclsim.crrt_study.words import main_policy, place
from eclsim.reporting.html import svg_text

if TYPE_CHECKING:
    from eclsim.crrt_study.study import CrrtStudy


def drawings(study: CrrtStudy, policy: str | None = None) -> dict[str, str]:
    """All figures by name.

    Args:
        study: results.
        policy: blood volume policy of the figures that show one; left out, the first studied.
    """
    from eclsim.crrt_study.connection_drawings import draw_schemes
    from eclsim.crrt_study.figures import (
        plot_crrt_beat,
        plot_crrt_limits,
        plot_crrt_speeds,
        plot_crrt_uptake,
    )

    policy, speed = main_policy(study, policy), study.case_speed
    means = study.means.sel(policy=policy)
    ranked = study.ranking[policy]
    best_first = [one.letter for one in ranked]
    flow = float(study.without_crrt["PF"].sel(policy=policy, speed=speed))
    figures = {
        "schemes": draw_schemes(study.schemes, {one.letter: place(one) for one in ranked}),
        "beat": plot_crrt_beat(study.waveforms.sel(policy=policy), means.sel(speed=speed)),
        "speeds": plot_crrt_speeds(means, speed),
        "limits": plot_crrt_limits(study.limits.sel(policy=policy), flow, best_first),
    }
    if study.uptake is not None:
        figures["uptake"] = plot_crrt_uptake(
            study.uptake, study.means.sel(speed=speed), study.without_crrt.sel(speed=speed)
        )
    return {name: svg_text(drawing) for name, drawing in figures.items()}
