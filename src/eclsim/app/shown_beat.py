"""A pinned or saved beat: that of a state, or of a later minute of its course."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from eclsim.app.course import case_at, compute_course, plain_events
from eclsim.app.display import compared_of, named_specs, panel_of, waves_of
from eclsim.app.knobs import knobs_of
from eclsim.app.provenance import provenance
from eclsim.app.state import START, Moment, PageState, key_of

if TYPE_CHECKING:
    from eclsim.app.beat import Beat
    from eclsim.app.engine import Engine
    from eclsim.cases.case import Case


class ShownBeat(NamedTuple):
    """A beat as displayed.

    Attributes:
        state: state from which it was computed.
        beat: the steady beat of the state, or that of a later minute of its course.
        moment: minute and length of the course.
    """

    state: PageState
    beat: Beat
    moment: Moment = START

    def plain(self) -> dict[str, Any]:
        """Return the beat with everything in which it can differ from others, for the browser."""
        from eclsim.app.beat import plain

        case, minute, origin = self.state.case, self.moment.minute, provenance(self.state)
        key = f"{key_of(self.state)}@{minute:g}" if minute else key_of(self.state)
        return {
            **plain(self.beat, waves_of(case)), "of": key, "name": origin["title"], "minute": minute,
            "badge": origin["badge"], "level": origin["level"],
            "values": knobs_at(case, minute), "panel": panel_of(case), "policy": self.state.policy,
            "events": plain_events(case), "compared": compared_of(case), "specs": named_specs(case),
        }  # fmt: skip


def knobs_at(case: Case, minute: float) -> dict[str, Any]:
    """Return the values of the knobs as events have left them at a minute of the course."""
    return knobs_of(case_at(case, minute) if minute else case)


async def recomputed(engine: Engine, state: PageState, moment: Moment) -> ShownBeat:
    """Recompute a beat that was stored before the page was reloaded.

    Raises:
        CaseError: The course of the state cannot be computed.
    """
    if not moment.minute:
        return ShownBeat(state, await engine.beat(state, None))

    def work() -> Beat:
        return compute_course(state, moment.length).beat(moment.minute)

    return ShownBeat(state, await engine.study(work), moment)
