"""JAX set up once for the whole package: double precision, the processor and the compilation cache.

Every module that computes with JAX imports this one first. Where JAX sees a graphics processor too, the
default device becomes the CPU, unless one was chosen before (`jax_default_device`): a beat has hundreds of
small steps, and a graphics processor takes ten times as long for one patient (docs, page Numerics).

The compiled programs are kept in the cache folder (`ECLSIM_CACHE_DIR`, else `$XDG_CACHE_HOME/eclsim` or
`~/.cache/eclsim`), so that a second process starts without compiling. `ECLSIM_CACHE_DIR=off` switches the
cache off.
"""

from __future__ import annotations

import os
import platform
from pathlib import Path
from typing import Any

import jax

SETTINGS: Any = jax.config  # its attributes appear when it is made: no type checker sees them


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


def on_cpu() -> bool:
    """Whether programs are compiled for the CPU."""
    device = SETTINGS.jax_default_device
    if device is None:
        return jax.default_backend() == "cpu"
    return (device if isinstance(device, str) else device.platform) == "cpu"


def _configure() -> None:
    jax.config.update("jax_enable_x64", True)
    platforms = SETTINGS.jax_platforms
    if SETTINGS.jax_default_device is None and (not platforms or "cpu" in platforms.split(",")):
        jax.config.update("jax_default_device", "cpu")
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
