"""JAX set up once for the whole package: double precision and the compilation cache.

Every module that computes with JAX imports this one first. The compiled programs are kept in the user's
cache folder (`ECLSIM_CACHE_DIR`, else `$XDG_CACHE_HOME/eclsim` or `~/.cache/eclsim`), so that a second
process starts without compiling. `ECLSIM_CACHE_DIR=off` switches the cache off.
"""

from __future__ import annotations

import os
import platform
from pathlib import Path

import jax


def cache_folder() -> Path | None:
    """Folder of compiled programs, private to the user and to the kind of processor; None if switched off."""
    chosen = os.environ.get("ECLSIM_CACHE_DIR")
    if chosen is not None and chosen.strip().lower() in {"", "off", "0", "none"}:
        return None
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "eclsim"
    return (Path(chosen) if chosen else base) / f"{platform.machine()}-{_processor_key()}"


def _processor_key() -> str:
    """Short key of the processor's instruction sets: a program compiled for one may not run on another."""
    import hashlib

    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        flags = next((line for line in lines if line.startswith(("flags", "Features"))), platform.processor())
    except OSError:
        flags = platform.processor()
    return hashlib.sha256(flags.encode()).hexdigest()[:12]


def _configure() -> None:
    jax.config.update("jax_enable_x64", True)
    # Dispatched programs wait in the threads that they need themselves: two at a time can wait for ever.
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
