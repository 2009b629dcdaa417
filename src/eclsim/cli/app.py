"""`eclsim app`: the bedside page in a browser."""

from __future__ import annotations

import re
import socket
from dataclasses import dataclass

import typer

from eclsim.cli.cases import read_all, with_speeds
from eclsim.cli.console import fail
from eclsim.cli.options import argument, option


@dataclass(frozen=True, kw_only=True)
class AppOptions:
    """Options of `eclsim app`."""

    case_file: str | None = argument(None, "[CASE.toml]", "Case to start with; default: a healthy adult.")
    port: int = option(8080, "Port to listen on.", minimum=1, maximum=65535)
    host: str = option(
        "127.0.0.1", "Address to listen on; any other than this machine's own needs --password-file."
    )
    root_path: str = option("", "Path under which a proxy serves the page.", "--root-path", metavar="/PATH")
    password_file: str | None = option(
        None, "File with the password in its first line (chmod 600).", metavar="FILE"
    )
    allow_host: list[str] = option(
        [], "Host name in the browser's address, such as that of a proxy. May be repeated.", metavar="NAME"
    )
    proxy: list[str] = option(
        [], "Address of a reverse proxy that replaces X-Forwarded-For and X-Forwarded-Proto, which are then "
        "trusted. May be repeated.", metavar="ADDRESS",
    )  # fmt: skip
    max_sessions: int = option(40, "Largest number of open pages.", minimum=1, maximum=500)


def app(options: AppOptions) -> None:
    """Serve the bedside page: turn a knob and see what happens to the patient.

    Only this machine can open the page unless --host allows others; no data leave this machine.
    Research use only.
    """
    from eclsim.app.listening import is_this_machine, served_names, start_lines

    root_path = _checked_root(options.root_path)
    proxies = _checked_proxies(options.proxy)
    reading = with_speeds(read_all([options.case_file], []))[0] if options.case_file else None
    password = _password(options.password_file)
    host = options.host
    if not is_this_machine(host) and password is None:
        fail(f"--host {host}: other machines can then reach the page; add --password-file")
    sockets = _listening(host, options.port)
    try:
        from eclsim.app.server import Options, serve
    except ModuleNotFoundError as error:
        fail(f'the page needs {error.name}: pip install "eclsim[app]"')
    from eclsim.app.files import shown_name
    from eclsim.app.provenance import opened_state
    from eclsim.app.state import preset_state

    state = preset_state("healthy")
    if reading:
        state = opened_state(reading.case, shown_name(reading.file))
    for line in start_lines(host, options.port, root_path, options.allow_host, proxies):
        typer.echo(f"eclsim: {line}")
    names = served_names(host, options.allow_host)
    serve(Options(state, root_path, names, password, options.max_sessions, proxies), sockets)


def _listening(host: str, port: int) -> list[socket.socket]:
    from eclsim.app.listening import ListenError, listen

    try:
        return listen(host, port)
    except ListenError as error:
        fail(str(error))


def _checked_proxies(addresses: list[str]) -> frozenset[str]:
    from eclsim.app.listening import plain_address

    for address in addresses:
        if not plain_address(address):
            fail(f"--proxy {address}: allowed: the IP address from which the proxy connects, as 127.0.0.1")
    return frozenset(map(plain_address, addresses))


def _checked_root(path: str) -> str:
    """Return the root path with a leading slash and without a trailing one."""
    bare = path.strip("/")
    if bare and not re.fullmatch(r"\w[\w.~-]*(/\w[\w.~-]*)*", bare):
        fail(f"--root-path {path}: allowed: letters, digits, - and _ between slashes, such as /eclsim")
    return f"/{bare}" if bare else ""


def _password(file: str | None) -> str | None:
    if file is None:
        return None
    from eclsim.app.sign_in import PasswordFileError, read_password

    try:
        return read_password(file)
    except PasswordFileError as error:
        fail(f"--password-file {error}")
