"""Access control in front of the page: hosts, origins, password, size and time of requests, and headers.

It is a plain ASGI wrapper, so that it also sees websockets and no code of the page runs before access is
granted. Sign-in sessions are kept in memory and end with the server.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import os
import secrets
import time
from collections import deque
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from eclsim.app.texts import text
from eclsim.reporting.html import render

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

LARGEST_BODY = 6_000_000
SLOWEST_BODY_S = 20.0
COOKIE = "eclsim_session"
SIGN_IN = "/sign-in"
OPEN_PATHS = ("/", "/favicon.ico", SIGN_IN)
OPEN_PREFIX = "/_nicegui"
SOCKET_PREFIX = "/_nicegui_ws"
PORTS = {"http": 80, "https": 443}
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
    """

    hosts: frozenset[str]
    root_path: str = ""
    signed_in: SignIns | None = None


class Guard:
    """ASGI wrapper that checks all requests to an application.

    Args:
        app: protected application.
        rules: rules of access.
    """

    def __init__(self, app: App, rules: Rules):
        self.app, self.rules = app, rules

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it to the application."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {k.decode("latin-1").lower(): v.decode("latin-1") for k, v in scope["headers"]}
        path = self._with_root_path(scope)
        refusal = self._refusal(scope, headers, path)
        if refusal is not None:
            await _refuse(scope, receive, send, *refusal)
        elif path == SIGN_IN:
            await self._sign_in(scope, receive, send, headers)
        elif self._must_sign_in(headers):
            await self._show_sign_in(scope, receive, send, path)
        elif scope["type"] == "http" and scope["method"] == "HEAD":
            await self._head(scope, receive, send, path)
        elif scope["type"] == "http":
            await self._http(scope, receive, send)
        else:
            await self.app(scope, receive, send)

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
            await self._http({**scope, "method": "GET"}, receive, send)

    async def _http(self, scope: Scope, receive: Receive, send: Send) -> None:
        started = False

        async def sent(message: MutableMapping[str, Any]) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                message = {**message, "headers": [*message.get("headers", ()), *HEADERS]}
            await send(message)

        try:
            await self.app(scope, _limited(receive), sent)
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
        token, status, text = signed_in.try_body(body, address)
        if token is None:
            await _answer(send, status, sign_in_page(root + SIGN_IN, text), "text/html")
            return
        https = scope.get("scheme") == "https" or headers.get("x-forwarded-proto") == "https"
        cookie = f"{COOKIE}={token}; Path={root or '/'}; HttpOnly; SameSite=Strict" + "; Secure" * https
        await _redirect(send, (root or "") + "/", ((b"set-cookie", cookie.encode()),))


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


SHORTEST_PASSWORD = 10
SESSION_LASTS_S = 12 * 3600.0
MOST_SESSIONS = 1000
MOST_FAILURES, FAILURES_WITHIN_S = 10, 60.0
MOST_ADDRESSES = 1000


class PasswordFileError(ValueError):
    """A password file that cannot be used; the message gives the reason."""


def read_password(path: str) -> str:
    """Return the password in the first line of a file.

    Raises:
        PasswordFileError: The file cannot be read, is readable by others, or its password is too short.
    """
    file = Path(path)
    try:
        mode = file.stat().st_mode
        written = file.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8"
        raise PasswordFileError(f"{path}: cannot be read: {reason}") from None
    if mode & 0o077 and os.name == "posix":  # on other systems the mode does not tell who may read the file
        raise PasswordFileError(f"{path}: other users can read it; protect it with chmod 600")
    password = written.split("\n")[0].rstrip("\r")
    if len(password) < SHORTEST_PASSWORD:
        raise PasswordFileError(
            f"{path}: the first line must be a password of at least {SHORTEST_PASSWORD} characters"
        )
    return password


class SignIns:
    """The password and the sessions of those who signed in.

    Args:
        password: the password, common to all users.
        clock: returns the time [s].
    """

    def __init__(self, password: str, clock: Callable[[], float] = time.monotonic):
        self._salt = secrets.token_bytes(16)
        self._hash = self._hashed(password)
        self._clock = clock
        self._sessions: dict[str, float] = {}
        self._failures: dict[str, deque[float]] = {}

    def is_signed_in(self, token: str) -> bool:
        """Whether a cookie belongs to a session that has not expired."""
        ends = self._sessions.get(hashlib.sha256(token.encode()).hexdigest()) if token else None
        return ends is not None and self._clock() < ends

    def try_body(self, body: bytes, address: str = "") -> tuple[str | None, int, str]:
        """Check a submitted form: return token, HTTP status and message; the token is None if it is refused.

        Args:
            body: body of the request.
            address: sender's address; too many failures from one address do not lock out others.
        """
        now = self._clock()
        failures = self._failures.get(address, ())
        if len(failures) == MOST_FAILURES and now - failures[0] < FAILURES_WITHIN_S:
            return None, 429, text("too_many")
        try:
            typed = parse_qs(body.decode(), max_num_fields=5, strict_parsing=True).get("password", [""])[0]
        except ValueError:
            typed = ""
        if not hmac.compare_digest(self._hashed(typed), self._hash):
            self._remember_failure(address, now)
            return None, 401, text("wrong_password")
        return self._new_session(now), 303, ""

    def _remember_failure(self, address: str, now: float) -> None:
        recent = {k: times for k, times in self._failures.items() if now - times[-1] < FAILURES_WITHIN_S}
        if address not in recent and len(recent) >= MOST_ADDRESSES:
            del recent[next(iter(recent))]
        recent.setdefault(address, deque(maxlen=MOST_FAILURES)).append(now)
        self._failures = recent

    def _new_session(self, now: float) -> str:
        self._sessions = {k: ends for k, ends in self._sessions.items() if ends > now}
        if len(self._sessions) >= MOST_SESSIONS:
            del self._sessions[next(iter(self._sessions))]
        token = secrets.token_urlsafe(32)
        self._sessions[hashlib.sha256(token.encode()).hexdigest()] = now + SESSION_LASTS_S
        return token

    def _hashed(self, password: str) -> bytes:
        return hashlib.scrypt(password.encode(), salt=self._salt, n=2**12, r=8, p=1)


def sign_in_page(action: str, message: str = "") -> str:
    """Return the page that asks for the password."""
    texts = {key: text(key) for key in ("title", "brand", "sign_in", "password", "notice")}
    return render("app/sign_in.html", action=action, message=message, **texts)
