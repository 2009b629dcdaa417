"""Messages of a browser over its websocket, checked before the libraries that read them.

Those log a traceback for a message that no browser sends, and a handler of NiceGUI takes its keys for
granted. Formats: Engine.IO 4 and Socket.IO 5, of which a page uses text without attachments.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from typing import Any
from urllib.parse import parse_qs

from nicegui import json  # with the parser by which the libraries read what is checked here

Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]

log = logging.getLogger("eclsim.app")
UNREADABLE = "a message from a browser could not be read"
POLICY_VIOLATION = 1008
MOST_FRAMES = 16
"""Largest number of frames in one request that polls, as in Engine.IO."""
_CONTROL = re.compile("[12356](probe)?")
_PACKET = re.compile("4([0123])([0-9]{0,9})(.*)", re.DOTALL)
_WHOLE = re.compile("[0-9]{1,15}")
_CONNECT, _DISCONNECT, _EVENT, _ACK = "0123"
_RESERVED = frozenset({"connect", "disconnect"})
_TEXT, _NUMBER = (str,), (int, float)
_KEYS: Mapping[str, Mapping[str, tuple[type, ...]]] = {
    "event": {"client_id": _TEXT, "id": (str, *_NUMBER), "listener_id": _TEXT},
    "handshake": {"client_id": _TEXT, "tab_id": _TEXT, "document_id": _TEXT},
    "javascript_response": {"client_id": _TEXT, "request_id": _TEXT},
    "ack": {"client_id": _TEXT, "next_message_id": _NUMBER},
    "log": {"client_id": _TEXT, "level": _TEXT, "message": _TEXT},
}
"""Keys that NiceGUI takes for granted in each of its messages, with their types."""
_LEVELS = ("debug", "info", "warning", "error")


def is_readable(frame: str) -> bool:
    """Whether a frame is one that a browser sends."""
    if _CONTROL.fullmatch(frame):
        return True
    packet = _PACKET.fullmatch(frame)
    if packet is None:
        return False
    kind, _, written = packet.groups()
    try:
        data = json.loads(written) if written else None
    except (ValueError, RecursionError):
        return False
    if kind == _CONNECT:
        return data is None or isinstance(data, dict)
    if kind == _DISCONNECT:
        return not written
    return isinstance(data, list) and (kind == _ACK or _is_event(data))


def is_readable_payload(body: bytes) -> bool:
    """Whether the body of a request that polls consists of such frames."""
    try:
        frames = body.decode().split("\x1e")
    except UnicodeDecodeError:
        return False
    return len(frames) <= MOST_FRAMES and all(map(is_readable, frames))


def is_readable_query(query: str) -> bool:
    """Whether the query with which a socket is opened is one of a browser: it may contain the handshake."""
    try:
        given = {key: values[0] for key, values in parse_qs(query, max_num_fields=20).items()}
    except ValueError:
        return False
    return given.get("implicit_handshake") != "true" or _is_message("handshake", given)


def _is_event(data: list[Any]) -> bool:
    if not data or not isinstance(data[0], str) or data[0] in _RESERVED:
        return False
    if data[0] not in _KEYS:
        return True  # without a handler, it is ignored
    return len(data) == 2 and isinstance(data[1], dict) and _is_message(data[0], data[1])


def _is_message(name: str, message: Mapping[str, Any]) -> bool:
    """Whether a message of NiceGUI has what its handler takes for granted."""
    if not all(_is_of(message.get(key), types) for key, types in _KEYS[name].items()):
        return False
    if name == "log":
        return message["level"] in _LEVELS
    if name == "handshake":
        following = message.get("next_message_id")
        return following is None or _WHOLE.fullmatch(str(following)) is not None
    return name != "event" or _are_arguments(message.get("args", []))


def _is_of(value: object, types: tuple[type, ...]) -> bool:
    return isinstance(value, types) and not isinstance(value, bool)


def _are_arguments(args: object) -> bool:
    """Whether these are the arguments of an event: JSON texts, or null."""
    if not isinstance(args, list):
        return False
    for one in args:
        if one is None:
            continue
        try:
            json.loads(one)
        except (TypeError, ValueError, RecursionError):
            return False
    return True


class CheckedSocket:
    """Websocket that is closed at the first message which is not readable, or no longer allowed.

    Args:
        receive: receives from the browser.
        send: sends to the browser.
        is_allowed: whether the browser may still use the page.
    """

    def __init__(self, receive: Receive, send: Send, is_allowed: Callable[[], bool]):
        self._receive, self._send, self._is_allowed = receive, send, is_allowed
        self._closed = False

    async def receive(self) -> MutableMapping[str, Any]:
        """Return the next message, or that the connection has ended."""
        message = await self._receive()
        if message["type"] != "websocket.receive":
            return message
        frame = message.get("text")
        if not self._is_allowed():
            return await self._close("sign in first")
        if frame is None or not is_readable(frame):
            log.warning("%s: its connection is closed", UNREADABLE)
            return await self._close(UNREADABLE)
        return message

    async def send(self, message: MutableMapping[str, Any]) -> None:
        """Send a message unless the connection was closed here."""
        if not self._closed:
            await self._send(message)

    async def _close(self, reason: str) -> MutableMapping[str, Any]:
        if not self._closed:
            self._closed = True
            await self._send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": reason})
        return {"type": "websocket.disconnect", "code": POLICY_VIOLATION, "reason": reason}
