"""Access control in front of the page: hosts, origins, password, size and time of requests, and headers.

It is a plain ASGI wrapper, so that it also sees websockets and no code of the page runs before access is
granted.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from eclsim.app.frames import UNREADABLE, CheckedSocket, is_readable_payload, is_readable_query
from eclsim.app.listening import plain_address
from eclsim.app.sign_in import SignIns, sign_in_page
from eclsim.app.texts import text

log = logging.getLogger("eclsim.app")
Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

LARGEST_BODY = 6_000_000
SLOWEST_BODY_S = 20.0
COOKIE = "eclsim_session"
SIGN_IN, SIGN_OUT = "/sign-in", "/sign-out"
OPEN_PATHS = ("/", "/favicon.ico", SIGN_IN, SIGN_OUT)
OPEN_PREFIX = "/_nicegui"
SOCKET_PREFIX = "/_nicegui_ws"
PORTS = {"http": 80, "https": 443}
FORWARDED = ("x-forwarded-", "forwarded", "x-real-ip")
"""Beginnings of the headers by which a proxy says who asks; a client can send them too."""
HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"same-origin"),
    (
        b"content-security-policy",
        b"default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
        b"style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
        b"connect-src 'self' ws: wss:; object-src 'none'; base-uri 'none'; form-action 'self'; "
        b"frame-ancestors 'none'",
    ),
)


class _TooLargeError(Exception):
    """The body of a request is larger than allowed."""


class _TooSlowError(Exception):
    """The body of a request did not arrive in time."""


@dataclass(frozen=True)
class Rules:
    """Rules of access.

    Args:
        hosts: host names under which the page may be requested (Host header, without the port).
        root_path: path under which a proxy serves the page; "" without a proxy path.
        signed_in: password and sessions; None if no password is required.
        proxies: addresses of reverse proxies, whose X-Forwarded-For and X-Forwarded-Proto are trusted.
    """

    hosts: frozenset[str]
    root_path: str = ""
    signed_in: SignIns | None = None
    proxies: frozenset[str] = frozenset()


class Guard:
    """ASGI wrapper that checks all requests to an application.

    Args:
        app: protected application.
        rules: rules of access.
    """

    def __init__(self, app: App, rules: Rules):
        self.app, self.rules = app, rules
        self._has_named_proxy = False

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it to the application."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        self._read_forwarded(scope)
        headers = _headers(scope)
        path = self._with_root_path(scope)
        refusal = self._refusal(scope, headers, path)
        if refusal is not None:
            await _refuse(scope, receive, send, *refusal)
        elif path == SIGN_IN:
            await self._sign_in(scope, receive, send, headers)
        elif path == SIGN_OUT:
            await self._sign_out(scope, receive, send, headers)
        elif self._must_sign_in(headers):
            await self._show_sign_in(scope, receive, send, path)
        elif scope["type"] == "http" and scope["method"] == "HEAD":
            await self._head(scope, receive, send, path)
        elif scope["type"] == "http":
            await self._http(scope, receive, send, path)
        else:
            socket = CheckedSocket(receive, send, lambda: not self._must_sign_in(headers))
            await self.app(scope, socket.receive, socket.send)

    def _read_forwarded(self, scope: Scope) -> None:
        """Take sender and scheme from the headers of a trusted proxy; remove them if anybody else sent them.

        The last address is the one that the proxy itself wrote; a client may have sent those before it.
        """
        headers, peer = _headers(scope), (scope.get("client") or ("", 0))
        if plain_address(peer[0]) not in self.rules.proxies:
            self._tell_unnamed_proxy(headers, peer[0])
            scope["headers"] = [one for one in scope["headers"] if not _is_forwarded(one[0])]
            return
        sender = plain_address(headers.get("x-forwarded-for", "").rpartition(",")[2].strip())
        if sender:
            scope["client"] = (sender, 0)

    def _tell_unnamed_proxy(self, headers: dict[str, str], peer: str) -> None:
        """Log once that there seems to be a proxy that was not named."""
        if "x-forwarded-for" in headers and not self._has_named_proxy:
            self._has_named_proxy = True
            log.warning(
                "X-Forwarded-For from %s is ignored: if this is your reverse proxy, add --proxy %s",
                peer,
                peer,
            )

    def _with_root_path(self, scope: Scope) -> str:
        """Put the root path where Starlette expects it, even if the proxy removed it; return the rest."""
        root, path = self.rules.root_path, scope["path"]
        inner = path[len(root) :] if root and (path == root or path.startswith(root + "/")) else path
        scope["root_path"] = root
        scope["path"] = root + (inner or "/")
        scope["raw_path"] = scope["path"].encode()
        return inner or "/"

    def _refusal(self, scope: Scope, headers: dict[str, str], path: str) -> tuple[int, str] | None:
        host = _host_name(headers.get("host", ""))
        if host not in self.rules.hosts:
            return 400, "unknown host name; see --allow-host"
        if self._is_cross_site(scope, headers, path):
            return 403, "another site may not use this page"
        is_open = path in OPEN_PATHS or path.startswith(OPEN_PREFIX)
        if not is_open or ".." in path.split("/"):
            return 404, "not found"
        if scope["type"] == "http" and scope["method"] not in ("GET", "HEAD", "POST", "OPTIONS"):
            return 405, "not allowed"
        if path.startswith(SOCKET_PREFIX) and not is_readable_query(_query(scope)):
            return 400, UNREADABLE
        size = headers.get("content-length", "0")
        if not size.isdigit() or int(size) > LARGEST_BODY:
            return 413, f"too large: up to {LARGEST_BODY // 1_000_000} MB"
        return None

    def _is_cross_site(self, scope: Scope, headers: dict[str, str], path: str) -> bool:
        """Whether the request comes from a page of another site and is not just a link that was followed."""
        socket = scope["type"] == "websocket" or path.startswith(SOCKET_PREFIX)
        writes = socket or scope["method"] not in ("GET", "HEAD")
        origin = headers.get("origin")
        if writes and origin is not None and not self._is_own_page(origin, scope, headers):
            return True
        if headers.get("sec-fetch-site") not in ("cross-site", "same-site"):
            return False
        return writes or headers.get("sec-fetch-mode", "navigate") != "navigate"

    def _is_own_page(self, origin: str, scope: Scope, headers: dict[str, str]) -> bool:
        """Whether an origin is the page itself: same host and port, and same scheme if known."""
        try:
            parts = urlsplit(origin)
            port, own_port = parts.port, urlsplit(f"//{headers.get('host', '')}").port
        except ValueError:
            return False
        host = _host_name(parts.netloc)
        if host not in self.rules.hosts or host != _host_name(headers.get("host", "")):
            return False
        forwarded = headers.get("x-forwarded-proto", "").partition(",")[0].strip()
        if forwarded or own_port is not None:
            known = forwarded or scope.get("scheme", "http").replace("ws", "http")
            return parts.scheme == known and (port or PORTS.get(known)) == (own_port or PORTS.get(known))
        return parts.scheme in PORTS and port in (None, PORTS[parts.scheme])

    def _must_sign_in(self, headers: dict[str, str]) -> bool:
        signed_in = self.rules.signed_in
        return signed_in is not None and not signed_in.is_signed_in(_cookie(headers.get("cookie", "")))

    async def _show_sign_in(self, scope: Scope, receive: Receive, send: Send, path: str) -> None:
        if scope["type"] == "http" and path == "/":
            await _redirect(send, self.rules.root_path + SIGN_IN)
        else:
            await _refuse(scope, receive, send, 401, "sign in first")

    async def _head(self, scope: Scope, receive: Receive, send: Send, path: str) -> None:
        """Answer as to GET, without a body, which the server drops; no page is built that nobody opens."""
        if path == "/":
            await _answer(send, 200, "", "text/html")
        else:
            await self._http({**scope, "method": "GET"}, receive, send, path)

    async def _http(self, scope: Scope, receive: Receive, send: Send, path: str) -> None:
        started, limited = False, _limited(receive)

        async def sent(message: MutableMapping[str, Any]) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                message = {**message, "headers": [*message.get("headers", ()), *HEADERS]}
            await send(message)

        try:
            if path.startswith(SOCKET_PREFIX) and scope["method"] == "POST":
                body = await _body(limited)
                if not is_readable_payload(body):
                    await _answer(send, 400, UNREADABLE)
                    return
                limited = _again(body, limited)
            await self.app(scope, limited, sent)
        except _TooLargeError:
            if not started:
                await _answer(send, 413, f"too large: up to {LARGEST_BODY // 1_000_000} MB")
        except RuntimeError as error:
            if str(error) != "No response returned.":  # Starlette's error if the visitor has left
                raise
        except _TooSlowError:
            if not started:
                await _answer(send, 408, "the request took too long")

    async def _sign_in(self, scope: Scope, receive: Receive, send: Send, headers: dict[str, str]) -> None:
        signed_in = self.rules.signed_in
        root = self.rules.root_path
        if scope["type"] != "http" or signed_in is None:
            await _refuse(scope, receive, send, 404, "not found")
            return
        if scope["method"] != "POST":
            await _answer(send, 200, sign_in_page(root + SIGN_IN), "text/html")
            return
        try:
            body = await _body(_limited(receive, 4096))
        except (_TooLargeError, _TooSlowError):
            await _answer(send, 413, "too large or too slow")
            return
        address = (scope.get("client") or ("",))[0]
        wait = signed_in.wait_s(address)
        if wait is None:
            await _answer(send, 429, sign_in_page(root + SIGN_IN, text("too_many")), "text/html")
            return
        await asyncio.sleep(wait)
        token, status, message = signed_in.try_body(body, address)
        if token is None:
            await _answer(send, status, sign_in_page(root + SIGN_IN, message), "text/html")
            return
        await _redirect(send, root + "/", (self._session_cookie(scope, headers, token),))

    async def _sign_out(self, scope: Scope, receive: Receive, send: Send, headers: dict[str, str]) -> None:
        """End the session of the browser; its sockets are closed at their next message."""
        signed_in = self.rules.signed_in
        if scope["type"] != "http" or scope["method"] != "POST" or signed_in is None:
            await _refuse(scope, receive, send, 404, "not found")
            return
        signed_in.sign_out(_cookie(headers.get("cookie", "")))
        expired = self._session_cookie(scope, headers, "", "; Max-Age=0")
        await _redirect(send, self.rules.root_path + SIGN_IN, (expired,))

    def _session_cookie(
        self, scope: Scope, headers: dict[str, str], token: str, more: str = ""
    ) -> tuple[bytes, bytes]:
        https = scope.get("scheme") == "https" or headers.get("x-forwarded-proto") == "https"
        flags = f"Path={self.rules.root_path or '/'}; HttpOnly; SameSite=Strict" + "; Secure" * https
        return b"set-cookie", f"{COOKIE}={token}; {flags}{more}".encode()


def _headers(scope: Scope) -> dict[str, str]:
    return {k.decode("latin-1").lower(): v.decode("latin-1") for k, v in scope["headers"]}


def _query(scope: Scope) -> str:
    return scope.get("query_string", b"").decode("latin-1")


def _is_forwarded(name: bytes) -> bool:
    return name.decode("latin-1").lower().startswith(FORWARDED)


def _limited(receive: Receive, largest: int = LARGEST_BODY) -> Receive:
    """Limit the size of a request's body and the time that it may take."""
    size, ends, complete = 0, asyncio.get_running_loop().time() + SLOWEST_BODY_S, False

    async def limited() -> MutableMapping[str, Any]:
        nonlocal size, complete
        if complete:
            return await receive()
        try:
            async with asyncio.timeout_at(ends):
                message = await receive()
        except TimeoutError:
            raise _TooSlowError from None
        size += len(message.get("body", b""))
        if size > largest:
            raise _TooLargeError
        complete = not message.get("more_body", False)
        return message

    return limited


def _again(body: bytes, receive: Receive) -> Receive:
    """Return a body that was read, and then what is received after it."""
    waiting = [{"type": "http.request", "body": body, "more_body": False}]

    async def received() -> MutableMapping[str, Any]:
        return waiting.pop() if waiting else await receive()

    return received


async def _body(receive: Receive) -> bytes:
    result = b""
    while True:
        message = await receive()
        result += message.get("body", b"")
        if not message.get("more_body", False):
            return result


def _host_name(host: str) -> str:
    """Return a host without its port, in lower case."""
    host = host.strip().lower()
    if host.startswith("["):
        return host.partition("]")[0] + "]"
    return host.rpartition(":")[0] if host.count(":") == 1 else host


def _cookie(header: str) -> str:
    for part in header.split(";"):
        name, _, value = part.strip().partition("=")
        if name == COOKIE:
            return value
    return ""


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, text: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008, "reason": text})
        return
    await _answer(send, status, text)


async def _redirect(send: Send, to: str, more: tuple[tuple[bytes, bytes], ...] = ()) -> None:
    await _answer(send, 303, "", more=((b"location", to.encode()), *more))


async def _answer(
    send: Send, status: int, text: str, kind: str = "text/plain", more: tuple[tuple[bytes, bytes], ...] = ()
) -> None:
    body = text.encode()
    about = [
        (b"content-type", f"{kind}; charset=utf-8".encode()),
        (b"content-length", str(len(body)).encode()),
    ]
    closing = [(b"connection", b"close")] if status in (408, 413) else []
    headers = [*about, (b"cache-control", b"no-store"), *HEADERS, *closing, *more]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
