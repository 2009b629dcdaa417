"""Frames of a websocket: those of browsers pass, others close the connection."""

import asyncio

import pytest

from eclsim.app.frames import CheckedSocket, is_readable, is_readable_payload, is_readable_query

EVENT = '42["event",{"id":12,"client_id":"c","listener_id":"l","args":%s}]'
SENT = (
    "2", "3", "5", "2probe", "3probe", "40", '40{"a":1}', "41", '430["ok"]', EVENT % "[]", '42["nonsense",1]',
    EVENT % r'["{\"key\":\"MAP\"}",null,"5"]',
    '420["handshake",{"client_id":"c","tab_id":"t","document_id":"d","next_message_id":7}]',
    '42["ack",{"client_id":"c","next_message_id":7}]',
    '42["javascript_response",{"client_id":"c","request_id":"r","result":null}]',
    '42["log",{"client_id":"c","level":"error","message":"m"}]',
)  # fmt: skip
NOT_SENT = (
    "", "4", "9zzz", "42", "42[", "42[]", "42{}", "42[1]", '42["event"]', '42["event",null]', "0", "7",
    EVENT % "[NaN]", EVENT % '["NaN"]', EVENT % '["{"]', EVENT % "[5]", EVENT % "5",
    '42["event",{"id":null,"client_id":"c","listener_id":"l"}]',
    '42["event",{"id":12,"client_id":null,"listener_id":"l"}]',
    '42["event",' + "[" * 5000 + "]" * 5000 + "]",
    '42["connect",{}]', '42["disconnect"]', '42["handshake",{}]', '42["javascript_response",{"a":1}]',
    '42["handshake",{"client_id":"c","tab_id":"t","document_id":"d","next_message_id":"z"}]',
    '42["ack",{"client_id":"c","next_message_id":"7"}]',
    '42["log",{"client_id":"c","level":"shout","message":"m"}]',
    "40[1]", '40/other,{"a":1}', "41x", "43", '451-["event",{"_placeholder":true,"num":0}]', "4²[]", "²",
)  # fmt: skip


@pytest.mark.parametrize("frame", SENT)
def test_what_browsers_send_is_readable(frame):
    assert is_readable(frame)
    assert is_readable_payload(f"{frame}\x1e2".encode())


@pytest.mark.parametrize("frame", NOT_SENT)
def test_what_no_browser_sends_is_not(frame):
    assert not is_readable(frame)
    assert not is_readable_payload(f"2\x1e{frame}".encode())


def test_a_request_holds_few_frames_of_text():
    assert not is_readable_payload(b"\xff\xfe")
    assert not is_readable_payload(b"\x1e".join([b"2"] * 17))


@pytest.mark.parametrize(
    ("query", "is_fine"),
    [
        ("EIO=4&transport=websocket", True),
        ("implicit_handshake=true&client_id=c&tab_id=t&document_id=d&next_message_id=0", True),
        ("implicit_handshake=true&client_id=c&tab_id=t&document_id=d&next_message_id=z", False),
        ("implicit_handshake=true&client_id=c&tab_id=t", False),
        ("implicit_handshake=true", False),
        ("a=1&" * 50, False),
    ],
)
def test_a_handshake_in_the_address_of_a_socket_is_whole(query, is_fine):
    assert is_readable_query(query) == is_fine


def follow(frames, is_allowed=lambda: True):
    """What the page receives of frames, and what is sent to the browser."""
    waiting, sent = [{"type": "websocket.connect"}, *frames], []

    async def receive():
        return waiting.pop(0)

    async def send(message):
        sent.append(message)

    async def run():
        socket = CheckedSocket(receive, send, is_allowed)
        received = [await socket.receive() for _ in range(len(waiting))]
        await socket.send({"type": "websocket.close"})
        return [one["type"] for one in received], sent

    return asyncio.run(run())


def test_a_connection_is_closed_at_the_first_frame_that_is_not_readable(caplog):
    text, raw = ({"type": "websocket.receive", "text": one} for one in ("2", "42[")), b"4"
    received, sent = follow([*text])
    assert received == ["websocket.connect", "websocket.receive", "websocket.disconnect"]
    assert [(one["type"], one.get("code")) for one in sent] == [("websocket.close", 1008)]
    assert [record.getMessage() for record in caplog.records] == [
        "a message from a browser could not be read: its connection is closed"
    ]
    assert follow([{"type": "websocket.receive", "bytes": raw}])[0][-1] == "websocket.disconnect"


def test_the_sockets_of_who_signed_out_are_closed_at_their_next_message(caplog):
    received, sent = follow([{"type": "websocket.receive", "text": "3"}], lambda: False)
    assert received == ["websocket.connect", "websocket.disconnect"]
    assert sent[0]["reason"] == "sign in first"
    assert caplog.records == []
