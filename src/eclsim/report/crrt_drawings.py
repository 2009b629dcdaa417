"""The figures of the CRRT study as SVG text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eclsim.report.html import svg_text

if TYPE_CHECKING:
    from eclsim.studies.crrt_study import CrrtStudy


def drawings(study: CrrtStudy) -> dict[str, str]:
    """All figures by name; those of one blood volume policy show the first that was studied."""
    from eclsim.plotting.crrt_figures import (
        plot_crrt_beat,
        plot_crrt_limits,
        plot_crrt_speeds,
        plot_crrt_uptake,
    )
    from eclsim.plotting.crrt_schematic import draw_schemes

    policy, speed = study.policies[0], study.case_speed
    means = study.means.sel(policy=policy)
    ranked = study.ranking[policy]
    best_first = [one.letter for one in ranked]
    flow = float(study.without_crrt["PF"].sel(policy=policy, speed=speed))
    figures = {
        "schemes": draw_schemes(study.schemes, {one.letter: one.rank for one in ranked}),
        "beat": plot_crrt_beat(study.waveforms.sel(policy=policy), means.sel(speed=speed)),
        "speeds": plot_crrt_speeds(means, speed),
        "limits": plot_crrt_limits(study.limits.sel(policy=policy), flow, best_first),
    }
    if study.uptake is not None:
        figures["uptake"] = plot_crrt_uptake(
            study.uptake, study.means.sel(speed=speed), study.without_crrt.sel(speed=speed)
        )
    return {name: svg_text(drawing) for name, drawing in figures.items()}
