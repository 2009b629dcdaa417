"""`eclsim app`: the bedside page in a browser."""

from __future__ import annotations

import re
from dataclasses import dataclass

import typer

from eclsim.cli.cases import read_all, with_speeds
from eclsim.cli.console import fail
from eclsim.cli.options import argument, option

_THIS_MACHINE = ("127.0.0.1", "localhost", "::1", "[::1]")


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
    max_sessions: int = option(40, "Largest number of open pages.", minimum=1, maximum=500)


def app(options: AppOptions) -> None:
    """Serve the bedside page: turn a knob and see what happens to the patient.

    Only this machine can open the page unless --host allows others; no data leave this machine.
    Research use only.
    """
    root_path = _checked_root(options.root_path)
    reading = with_speeds(read_all([options.case_file], []))[0] if options.case_file else None
    password = _password(options.password_file)
    host = options.host
    if host not in _THIS_MACHINE and password is None:
        fail(f"--host {host}: other machines can then reach the page; add --password-file")
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
    names = frozenset({*_THIS_MACHINE, host.lower(), *map(str.lower, options.allow_host)})
    typer.echo(f"eclsim: http://{host}:{options.port}{root_path}/  (Ctrl-C stops it)")
    serve(Options(state, host, options.port, root_path, names, password, options.max_sessions))


def _checked_root(path: str) -> str:
    """Return the root path with a leading slash and without a trailing one."""
    bare = path.strip("/")
    if bare and not re.fullmatch(r"\w[\w.~-]*(/\w[\w.~-]*)*", bare):
        fail(f"--root-path {path}: allowed: letters, digits, - and _ between slashes, such as /eclsim")
    return f"/{bare}" if bare else ""


def _password(file: str | None) -> str | None:
    if file is None:
        return None
    from eclsim.app.guard import PasswordFileError, read_password

    try:
        return read_password(file)
    except PasswordFileError as error:
        fail(f"--password-file {error}")
