"""One password for the page, from a file; sessions live in memory and end with the server."""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from urllib.parse import parse_qs

from eclsim.app.texts import text
from eclsim.reporting.html import render

SHORTEST = 10
LASTS_S = 12 * 3600.0
MOST_SESSIONS = 1000
MOST_FAILURES, WITHIN_S = 10, 60.0
MOST_ADDRESSES = 1000


class PasswordFileError(ValueError):
    """A password file that cannot be used; says why."""


def read_password(path: str) -> str:
    """The password of a file: its first line.

    Raises:
        PasswordFileError: If it cannot be read, is too short, or may be read by others.
    """
    file = Path(path)
    try:
        mode = file.stat().st_mode
        written = file.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8"
        raise PasswordFileError(f"{path}: cannot be read: {reason}") from None
    if mode & 0o077 and os.name == "posix":  # elsewhere the mode says nothing about who may read
        raise PasswordFileError(f"{path}: others may read it; allowed: chmod 600")
    password = written.split("\n")[0].rstrip("\r")
    if len(password) < SHORTEST:
        raise PasswordFileError(f"{path}: the first line is no password of at least {SHORTEST} characters")
    return password


class SignIns:
    """Who has signed in.

    Args:
        password: the one password.
        clock: time [s].
    """

    def __init__(self, password: str, clock: Callable[[], float] = time.monotonic):
        self._salt = secrets.token_bytes(16)
        self._hash = self._hashed(password)
        self._clock = clock
        self._sessions: dict[str, float] = {}
        self._failures: dict[str, deque[float]] = {}

    def knows(self, token: str) -> bool:
        """Whether a cookie is that of somebody who signed in and has not been away too long."""
        ends = self._sessions.get(hashlib.sha256(token.encode()).hexdigest()) if token else None
        return ends is not None and self._clock() < ends

    def try_body(self, body: bytes, address: str = "") -> tuple[str | None, int, str]:
        """A form that was sent: token, status and what to say; no token where it is refused.

        Args:
            body: of the request.
            address: where it came from; who tries too often from one keeps nobody else out.
        """
        now = self._clock()
        failures = self._failures.get(address, ())
        if len(failures) == MOST_FAILURES and now - failures[0] < WITHIN_S:
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
        recent = {k: times for k, times in self._failures.items() if now - times[-1] < WITHIN_S}
        if address not in recent and len(recent) >= MOST_ADDRESSES:
            del recent[next(iter(recent))]
        recent.setdefault(address, deque(maxlen=MOST_FAILURES)).append(now)
        self._failures = recent

    def _new_session(self, now: float) -> str:
        self._sessions = {k: ends for k, ends in self._sessions.items() if ends > now}
        if len(self._sessions) >= MOST_SESSIONS:
            del self._sessions[next(iter(self._sessions))]
        token = secrets.token_urlsafe(32)
        self._sessions[hashlib.sha256(token.encode()).hexdigest()] = now + LASTS_S
        return token

    def _hashed(self, password: str) -> bytes:
        return hashlib.scrypt(password.encode(), salt=self._salt, n=2**12, r=8, p=1)


def sign_in_page(action: str, said: str = "") -> str:
    """The page that asks for the password."""
    words = {key: text(key) for key in ("title", "brand", "sign_in", "password", "notice")}
    return render("app/sign_in.html", action=action, message=said, **words)
