"""The command line: one module per command, each importing heavy packages only when it runs."""

from __future__ import annotations

from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `eclsim` with the arguments of the process, or those given, and leave with its exit status."""
    from eclsim.cli.application import run

    run(arguments)
