"""`eclsim app`: the bedside page in a browser."""

from __future__ import annotations

from typing import Annotated

import typer


def app(
    case_file: Annotated[
        str | None,
        typer.Argument(metavar="[CASE.toml]", help="Case to start with; left out, a healthy adult."),
    ] = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen on.")] = 8080,
    host: Annotated[
        str,
        typer.Option(help="Address to listen on. Anything but this machine's own needs --password-file."),
    ] = "127.0.0.1",
    root_path: Annotated[
        str, typer.Option("--root-path", metavar="/PATH", help="Path under which a proxy serves the page.")
    ] = "",
) -> None:
    """Open the bedside page: turn a knob, see the patient.

    The page is served on this machine alone unless --host says otherwise; no data leaves it.
    """
    from eclsim.cli.cases import read_all
    from eclsim.cli.messages import fail

    reading = read_all([case_file], [])[0] if case_file else None
    try:
        from eclsim.app.server import Options, serve
    except ModuleNotFoundError as error:
        fail(f"the page needs {error.name}: install eclsim[app]")
        return
    from eclsim.app.state import PageState
    from eclsim.patients.presets import PRESETS

    state = (
        PageState(reading.case, origin="file")
        if reading
        else PageState(PRESETS["healthy"].case(), origin="healthy")
    )
    typer.echo(f"eclsim: http://{host}:{port}{root_path or ''}/  (Ctrl-C stops it)")
    serve(Options(state, host, port, root_path))
