"""The package's names are loaded when they are used; tables of the layout load no matplotlib."""

import subprocess
import sys

TABLES = """
import sys
from eclsim.reporting.schematic_layout import plan_of
from eclsim.reporting.schematic_routes import route
sys.exit("matplotlib" in sys.modules)
"""


def test_the_tables_of_the_layout_load_no_matplotlib():
    assert subprocess.run([sys.executable, "-c", TABLES], check=False).returncode == 0
