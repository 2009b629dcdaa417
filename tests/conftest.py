"""What all tests share: short names, one worker for each file, compiled programs dropped in time."""

import ctypes
import functools
import gc
import os
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

LARGEST_MB = 3000
LONGEST_ID = 60
GARBAGE_THRESHOLDS = (50_000, 20, 20)
"""As in the command line: with Python's own a tenth of the time and more goes into the search for garbage."""

os.environ.setdefault("XLA_FLAGS", "--xla_disable_hlo_passes=while-loop-invariant-code-motion")
"""As in all programs of eclsim (`beat.compilation`): plain ones compile in three quarters of the time."""


def pytest_configure(config: pytest.Config) -> None:
    gc.set_threshold(*GARBAGE_THRESHOLDS)


def pytest_make_parametrize_id(config: pytest.Config, val: object, argname: str) -> str | None:
    """Names a long text or file by its length, so that lists of tests stay readable."""
    if isinstance(val, (str, bytes)) and len(val) > LONGEST_ID:
        return f"{argname} of {len(val)} characters"
    return None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keeps a file on one worker, so that fixtures and programs are made once; files that take long first."""
    if not hasattr(config, "workerinput"):
        return
    for item in items:
        if item.get_closest_marker("xdist_group") is None:
            item.add_marker(pytest.mark.xdist_group(f"{item.path.parent.name}.{item.path.stem}"))
    slow = Counter(_group(item) for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: -slow[_group(item)])


def _group(item: pytest.Item) -> str:
    mark = item.get_closest_marker("xdist_group")
    return "" if mark is None else mark.args[0]


def resident_mb() -> int:
    """Memory of this process [MB]; 0 where the system does not tell."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next(int(line.split()[1]) // 1024 for line in lines if line.startswith("VmRSS"))


@pytest.fixture(autouse=True, scope="module")
def _compiled_programs_are_dropped() -> Iterator[None]:
    """Compiled programs and the compiler's memory go back; the cache on disk keeps them cheap."""
    yield
    if "jax" in sys.modules and resident_mb() > LARGEST_MB:
        sys.modules["jax"].clear_caches()
        for cache in gc.get_objects():
            if isinstance(cache, functools._lru_cache_wrapper) and cache.__module__.startswith("eclsim."):
                cache.cache_clear()
        gc.collect()
        if sys.platform == "linux":
            ctypes.CDLL(None).malloc_trim(0)
