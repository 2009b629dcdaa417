"""Configuration of JAX for the whole package: double precision, default device and compilation cache.

Every module that computes with JAX imports this one first. If JAX also finds a GPU, the default device is set
to the CPU, unless one was chosen before (`jax_default_device`): a beat consists of hundreds of small steps,
and a GPU takes ten times as long for one patient (docs, page Numerics).

Compiled programs are stored in the cache folder (`ECLSIM_CACHE_DIR`, else `$XDG_CACHE_HOME/eclsim` or
`~/.cache/eclsim`), so that a second process starts without compiling. `ECLSIM_CACHE_DIR=off` turns the cache
off.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # XLA reads it as it writes its first line

import jax
from jax.experimental.xla_metadata import set_xla_metadata

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
SETTINGS: Any = jax.config  # JAX creates these attributes at run time, so type checkers do not know them


def cache_folder() -> Path | None:
    """Return the folder of compiled programs, one per type of processor; None if the cache is turned off."""
    chosen = os.environ.get("ECLSIM_CACHE_DIR")
    if chosen is not None and chosen.strip().lower() in {"", "off", "0", "none"}:
        return None
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "eclsim"
    return (Path(chosen) if chosen else base) / f"{platform.machine()}-{_processor_key()}"


def _processor_key() -> str:
    """Return a short key of the CPU's instruction sets: a program compiled for one may not run on another."""
    import hashlib

    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        flags = next((line for line in lines if line.startswith(("flags", "Features"))), platform.processor())
    except OSError:
        flags = platform.processor()
    return hashlib.sha256(flags.encode()).hexdigest()[:12]


def refuse_single_precision() -> None:
    """Raise an error if double precision has been turned off since the import.

    Raises:
        RuntimeError: Says how to turn it on again.
    """
    if not SETTINGS.jax_enable_x64:
        raise RuntimeError(
            "eclsim computes in double precision, and JAX's setting jax_enable_x64 is False: "
            'jax.config.update("jax_enable_x64", True), or `with jax.enable_x64(True):` around the call'
        )


def on_cpu() -> bool:
    """Whether programs are compiled for the CPU."""
    device = SETTINGS.jax_default_device
    if device is None:
        return jax.default_backend() == "cpu"
    return (device if isinstance(device, str) else device.platform) == "cpu"


def not_inlined(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Return a function of arrays that compiled code calls, for use within functions that are compiled.

    The compiler otherwise merges operations with those that read their results and repeats them in each: the
    exponentials of a law of blood in dozens of products. With its results stored once, code is smaller,
    compiles in less time and runs faster. The arguments and results are arrays or collections of arrays.
    """
    compiled = jax.jit(function)

    def call(*arguments: Arguments.args, **named: Arguments.kwargs) -> Result:
        result = compiled(*arguments, **named)
        if not on_cpu():
            return result
        marked: Any = set_xla_metadata(result, inlineable="false")
        return marked

    return call


def _configure() -> None:
    jax.config.update("jax_enable_x64", True)
    platforms = SETTINGS.jax_platforms
    if SETTINGS.jax_default_device is None and (not platforms or "cpu" in platforms.split(",")):
        jax.config.update("jax_default_device", "cpu")
    # Asynchronously dispatched programs occupy the threads that they wait for, so two at a time can deadlock.
    jax.config.update("jax_cpu_enable_async_dispatch", False)
    folder = cache_folder()
    if folder is None:
        return
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


_configure()
