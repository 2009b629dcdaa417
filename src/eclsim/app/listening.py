"""Addresses: on which the server listens, what is printed of them, and those of reverse proxies."""

from __future__ import annotations

import errno
import ipaddress
import socket
from collections.abc import Collection, Sequence

THIS_MACHINE = ("127.0.0.1", "localhost", "[::1]")
"""Names by which a browser on this machine requests the page."""


class ListenError(OSError):
    """An address on which the server cannot listen; the message names options and values."""


def plain_address(address: str) -> str:
    """Return an IP address as it is usually written, an IPv4 one without an IPv6 prefix; else empty."""
    try:
        known = ipaddress.ip_address(address.strip("[]"))
    except ValueError:
        return ""
    return str(getattr(known, "ipv4_mapped", None) or known)


def is_every_address(host: str) -> bool:
    """Whether a host stands for all addresses of the machine: 0.0.0.0 or ::."""
    return plain_address(host) in ("0.0.0.0", "::")


def is_this_machine(host: str) -> bool:
    """Whether only this machine can reach a host."""
    return host_in_url(host) in THIS_MACHINE


def host_in_url(host: str) -> str:
    """Return a host as in an address of a browser: lower case, an IPv6 address in brackets."""
    plain = plain_address(host)
    return f"[{plain}]" if ":" in plain else plain or host.lower()


def served_names(host: str, allowed: Collection[str]) -> frozenset[str]:
    """Return the host names under which browsers may request the page."""
    own = () if is_every_address(host) else (host_in_url(host),)
    return frozenset({*THIS_MACHINE, *own, *map(host_in_url, allowed)})


def start_lines(
    host: str, port: int, root_path: str, allowed: Sequence[str], proxies: Collection[str]
) -> list[str]:
    """Return what is said at the start: the page's address, the names it is served under, and a warning."""
    shown = (
        host_in_url(allowed[0] if allowed else "127.0.0.1") if is_every_address(host) else host_in_url(host)
    )
    lines = [f"http://{shown}:{port}{root_path}/  (Ctrl-C stops it)"]
    if is_this_machine(host):
        return lines
    names = ", ".join(sorted(served_names(host, allowed)))
    lines.append(f"served only under the names {names}; add --allow-host NAME for each other name or address")
    if not proxies:
        lines.append(
            "without HTTPS, passwords and patients are sent unencrypted: use a reverse proxy, see --proxy"
        )
    return lines


def listen(host: str, port: int) -> list[socket.socket]:
    """Listen on all addresses of a host.

    Raises:
        ListenError: The port is in use, or the host is not an address of this machine.
    """
    sockets: list[socket.socket] = []
    try:
        found = socket.getaddrinfo(host.strip("[]"), port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        for family, *_, address in dict.fromkeys(found):
            try:
                sockets.append(socket.create_server(address, family=family, backlog=2048))
            except OSError as error:  # a name such as localhost may have an address of a family that is off
                if error.errno not in (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT) or len(found) == 1:
                    raise
        if not sockets:
            raise OSError(errno.EADDRNOTAVAIL, "no address")
    except OSError as error:
        for one in sockets:
            one.close()
        raise ListenError(_reason(host, port, error)) from None
    return sockets


def _reason(host: str, port: int, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"--port {port}: already in use at {host}; stop the other program, or choose another --port"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"--port {port}: not allowed for this user; choose a --port from 1024"
    if isinstance(error, socket.gaierror) or error.errno in (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT):
        return f"--host {host}: not an address of this machine; 127.0.0.1, or 0.0.0.0 for all its addresses"
    return f"--host {host} --port {port}: {error.strerror or error}"
