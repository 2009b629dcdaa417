"""The circuit and its labels on the page are those of the minute that is shown."""

import asyncio

from eclsim.app.knobs import connect
from eclsim.app.state import PageState, key_of, preset_state
from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from patience import until
from stub_session import StubEngine, beats, session


def test_the_circuit_is_drawn_as_it_is_at_the_minute_that_is_shown():
    """With CRRT moved at 00:30, the drawing of 00:40 still joined its access to the first site."""
    engine, messages, ends = StubEngine(), [], []

    def drawn():
        drawings = [data for topic, data in messages if topic == "drawing"]
        ends.append({line["name"]: line["site"] for line in drawings[-1]["lines"]}["crrttuin"])

    async def turns():
        one = session(engine, messages)
        one.load(preset_state("paper"))
        one.add_event({"at_min": 30, "set": {"crrt.access_site": "post_dc"}})
        await until(lambda: beats(messages) and beats(messages)[-1]["of"] == key_of(one.state))
        drawn()
        for minute in (40.0, 20.0, 40.0):
            one.at_minute(minute)
            one.show_moment(one.state, one.shown[1], minute)
            drawn()
        one.record(True)
        one.turn("crrt.access_site", "post_pump")
        drawn()
        one.at_minute(0.0)
        one.show_start()
        drawn()

    asyncio.run(turns())
    start, moved = "ecmotuor", "ecmodrain"
    assert ends == [start, moved, start, moved, "ecmotupo", start]


def test_the_tiles_of_a_later_minute_are_named_by_its_circuit():
    labels = []

    async def turns():
        messages: list = []
        one = session(StubEngine(), messages)
        one.load(PageState(connect(PRESETS["healthy"].case(), "lvad")))
        one.add_event({"at_min": 30, "set": {"lvad.inlet_site": "rv", "lvad.outlet_site": "part"}})
        await until(lambda: beats(messages) and beats(messages)[-1]["of"] == key_of(one.state))
        for minute in (0.0, 40.0):
            one.at_minute(minute)
            one.show_moment(one.state, one.shown[1], minute)
            figures = [data for topic, data in messages if topic == "display"][-1]["figures"]
            labels.append({figure["key"]: figure["label"] for figure in figures}["CO"])

    asyncio.run(turns())
    assert labels == [text("key_CO"), text("key_CO_artery")]
