"""The command line: one module per command, each importing heavy packages only when it runs."""

from __future__ import annotations

from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `eclsim` with the arguments of the process, or those given, and leave with its exit status."""
    import os

    # Looking for plugins reads every installed package: 50 ms that no command needs.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    # Commands compute on the CPU: no graphics processor has to be started for them.
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    from eclsim.cli.application import run

    run(arguments)
