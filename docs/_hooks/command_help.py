"""Appends the help of every command to the page of the command line, so that the two cannot differ."""

import os
import subprocess
import sys
from collections.abc import Iterator

from typer.main import get_command

from eclsim.cli.application import app


def commands(command, names: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Names of the commands below one, as typed."""
    for name, child in getattr(command, "commands", {}).items():
        yield (*names, name)
        yield from commands(child, (*names, name))


def help_of(names: tuple[str, ...]) -> str:
    """What `--help` prints."""
    call = [sys.executable, "-c", "from eclsim.cli import main; main()", *names, "--help"]
    environment = os.environ | {"COLUMNS": "100", "NO_COLOR": "1"}
    return subprocess.run(call, capture_output=True, text=True, check=True, env=environment).stdout


def on_page_markdown(markdown: str, page, **_: object) -> str:
    """Add one section a command."""
    if page.file.src_uri != "command-line.md":
        return markdown
    sections = [
        f"## eclsim {' '.join(names)}\n\n```text\n{help_of(names)}```\n"
        for names in commands(get_command(app))
    ]
    return "\n".join([markdown, *sections])
