"""`eclsim app`: the bedside page in a browser."""

from __future__ import annotations

from typing import Annotated

import typer

_THIS_MACHINE = ("127.0.0.1", "localhost", "::1", "[::1]")


def app(
    case_file: Annotated[
        str | None,
        typer.Argument(metavar="[CASE.toml]", help="Case to start with; left out, a healthy adult."),
    ] = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen on.")] = 8080,
    host: Annotated[
        str,
        typer.Option(help="Address to listen on. Any but this machine's own needs --password-file."),
    ] = "127.0.0.1",
    root_path: Annotated[
        str, typer.Option("--root-path", metavar="/PATH", help="Path under which a proxy serves the page.")
    ] = "",
    password_file: Annotated[
        str | None,
        typer.Option(
            metavar="FILE", help="File whose first line is the password that is asked for (chmod 600)."
        ),
    ] = None,
    allow_host: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Name by which a browser may call the page, as behind a proxy. May be repeated.",
        ),
    ] = None,
    max_sessions: Annotated[int, typer.Option(min=1, max=500, help="Pages open at a time.")] = 40,
) -> None:
    """Open the bedside page: turn a knob, see the patient.

    The page is served on this machine alone unless --host says otherwise; no data leaves it.
    Research use only.
    """
    from eclsim.cli.cases import read_all, with_speeds
    from eclsim.cli.messages import fail

    root_path = _checked_root(root_path)
    reading = with_speeds(read_all([case_file], []))[0] if case_file else None
    password = _password(password_file)
    if host not in _THIS_MACHINE and password is None:
        fail(f"--host {host}: others can reach the page then; give --password-file too")
    try:
        from eclsim.app.server import Options, serve
    except ModuleNotFoundError as error:
        fail(f'the page needs {error.name}: pip install "eclsim[app]"')
    from eclsim.app.files import shown_name
    from eclsim.app.state import PageState, preset_state

    state = preset_state("healthy")
    if reading:
        state = PageState(
            reading.case, reading.case.volume_policy, origin="file", source=shown_name(reading.file)
        )
    names = {*_THIS_MACHINE, host.lower(), *(name.lower() for name in allow_host or ())}
    typer.echo(f"eclsim: http://{host}:{port}{root_path}/  (Ctrl-C stops it)")
    serve(Options(state, host, port, root_path, frozenset(names), password, max_sessions))


def _checked_root(path: str) -> str:
    """The root path with a slash in front and none behind."""
    import re

    from eclsim.cli.messages import fail

    bare = path.strip("/")
    if bare and not re.fullmatch(r"\w[\w.~-]*(/\w[\w.~-]*)*", bare):
        fail(f"--root-path {path}: allowed: letters, digits, - and _ between slashes, such as /eclsim")
    return f"/{bare}" if bare else ""


def _password(file: str | None) -> str | None:
    if file is None:
        return None
    from eclsim.app.guard import PasswordFileError, read_password
    from eclsim.cli.messages import fail

    try:
        return read_password(file)
    except PasswordFileError as error:
        fail(f"--password-file {error}")
