"""Password and sessions of those who signed in, kept in memory until the server ends."""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import os
import secrets
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from urllib.parse import parse_qs

from eclsim.app.texts import text
from eclsim.reporting.html import render

SHORTEST_PASSWORD = 10
SESSION_LASTS_S = 12 * 3600.0
MOST_SESSIONS = 1000
MOST_FAILURES, FAILURES_WITHIN_S = 10, 60.0
MOST_FAILURES_TOGETHER = 60
"""Failures of all addresses together within `FAILURES_WITHIN_S` after which attempts take turns."""
TURN_S, LONGEST_WAIT_S = 1.0, 10.0
"""Time between two turns, and the longest wait for one [s]."""
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
        self._all_failures: deque[float] = deque(maxlen=MOST_FAILURES_TOGETHER)
        self._next_turn = 0.0

    def is_signed_in(self, token: str) -> bool:
        """Whether a cookie belongs to a session that has not expired."""
        ends = self._sessions.get(_digest(token)) if token else None
        return ends is not None and self._clock() < ends

    def sign_out(self, token: str) -> None:
        """End the session of a cookie."""
        self._sessions.pop(_digest(token), None)

    def wait_s(self, address: str = "") -> float | None:
        """Take a turn: return the time [s] until an attempt may be checked; None if it is refused.

        After many failures from all addresses together, attempts take turns. Each has the same chance of one,
        so guessing from many addresses delays the right password but never locks it out for good.
        """
        now = self._clock()
        if _is_recent(self._failures.get(_network(address), ()), MOST_FAILURES, now):
            return None
        if not _is_recent(self._all_failures, MOST_FAILURES_TOGETHER, now):
            return 0.0
        turn = max(now, self._next_turn)
        if turn - now > LONGEST_WAIT_S:
            return None
        self._next_turn = turn + TURN_S
        return turn - now

    def try_body(self, body: bytes, address: str = "") -> tuple[str | None, int, str]:
        """Check a submitted form: return token, HTTP status and message; the token is None if it is refused.

        Args:
            body: body of the request.
            address: sender's address; too many failures from one address do not lock out others.
        """
        now = self._clock()
        if _is_recent(self._failures.get(_network(address), ()), MOST_FAILURES, now):
            return None, 429, text("too_many")
        try:
            typed = parse_qs(body.decode(), max_num_fields=5, strict_parsing=True).get("password", [""])[0]
        except ValueError:
            typed = ""
        if not hmac.compare_digest(self._hashed(typed), self._hash):
            self._remember_failure(_network(address), now)
            return None, 401, text("wrong_password")
        return self._new_session(now), 303, ""

    def _remember_failure(self, address: str, now: float) -> None:
        self._all_failures.append(now)
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
        self._sessions[_digest(token)] = now + SESSION_LASTS_S
        return token

    def _hashed(self, password: str) -> bytes:
        return hashlib.scrypt(password.encode(), salt=self._salt, n=2**12, r=8, p=1)


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()


def _is_recent(failures: Sequence[float], most: int, now: float) -> bool:
    """Whether as many failures as allowed lie within the time in which they count."""
    return len(failures) == most and now - failures[0] < FAILURES_WITHIN_S


def _network(address: str) -> str:
    """Return what counts as one sender: an IPv4 address, or the /64 network that one IPv6 user has."""
    try:
        known = ipaddress.ip_address(address)
    except ValueError:
        return address
    if known.version == 4:
        return str(known)
    return str(known.ipv4_mapped or ipaddress.ip_network((int(known) >> 64 << 64, 64)))


def sign_in_page(action: str, message: str = "") -> str:
    """Return the page that asks for the password."""
    texts = {key: text(key) for key in ("title", "brand", "sign_in", "password", "notice")}
    return render("app/sign_in.html", action=action, message=message, **texts)
