"""Command line: one module per command, each importing heavy packages only when it runs."""

from __future__ import annotations

from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `eclsim` with given arguments, or those of the process, and exit with its exit status."""
    import gc
    import os

    # The search for pydantic plugins reads every installed package: 50 ms without any benefit.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    # Commands compute on the CPU, so no GPU needs to be initialised.
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    # On a busy machine XLA logs compiling for two minutes as an error. Failures of XLA are Python exceptions,
    # and what ends the process is still written.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    # Imports and programs leave 500,000 objects: a frequent search for garbage takes a seventh of the time.
    gc.set_threshold(50_000, 20, 20)
    from eclsim.cli.application import run

    run(arguments)
