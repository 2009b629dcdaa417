"""A session of the page whose beats are computed at once."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from eclsim.app.beat import Beat, page_circuit
from eclsim.app.session import Session
from eclsim.app.state import PageState
from eclsim.cases.presets import PRESETS
from eclsim.orbit.status import Status


@dataclass
class StubEngine:
    """Answers with the speed of the pump as the mean pressure, after a while."""

    delay: float = 0.01
    computed: list[float] = field(default_factory=list)
    fail: bool = False
    effort: int = 0
    begun_at: list[float | None] = field(default_factory=list)
    studying: int = 0

    async def study(self, work: Callable[[], object]) -> object:
        self.studying += 1
        return await asyncio.to_thread(work)

    async def prepare_nearby_searches(self, state: PageState, beat: Beat) -> None:
        await asyncio.sleep(self.delay)

    async def beat(
        self, state: PageState, prepare_nearby_searches: Beat | None, compiling: object = None
    ) -> Beat:
        self.begun_at.append(prepare_nearby_searches and prepare_nearby_searches.outputs["MAP"])
        await asyncio.sleep(self.delay)
        if self.fail:
            raise RuntimeError("no")
        self.computed.append(state.case.patient.heart_rate_bpm)
        circuit, values = page_circuit(state.case)
        outputs = {"MAP": state.case.patient.heart_rate_bpm}
        return Beat(
            circuit, values, 1.0, {"Pao": np.zeros(4)}, {"Pao": 80.0}, outputs, (), Status.CONVERGED, "",
            effort=self.effort,
        )  # fmt: skip


def session(engine: StubEngine, sent: list) -> Session:
    state = PageState(PRESETS["healthy"].case(), origin="healthy")
    return Session(engine, state, lambda topic, data: sent.append((topic, data)))  # type: ignore[arg-type]


def beats(sent: list) -> list:
    return [data for topic, data in sent if topic == "beat"]
