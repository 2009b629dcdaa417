"""The package's names are loaded when they are used; tables of the layout load no matplotlib."""

import subprocess
import sys

import pytest

import eclsim.plotting

TABLES = """
import sys
from eclsim.plotting.schematic_layout import NODES
from eclsim.plotting.schematic_routes import route
sys.exit("matplotlib" in sys.modules)
"""


def test_every_public_name_is_there():
    assert all(getattr(eclsim.plotting, name) is not None for name in eclsim.plotting.__all__)
    assert set(eclsim.plotting.__all__) <= set(dir(eclsim.plotting))


def test_another_name_is_refused():
    with pytest.raises(AttributeError, match="plot_nothing"):
        eclsim.plotting.plot_nothing  # noqa: B018


def test_the_tables_of_the_layout_load_no_matplotlib():
    assert subprocess.run([sys.executable, "-c", TABLES], check=False).returncode == 0
