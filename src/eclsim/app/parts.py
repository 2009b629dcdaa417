"""The page's own components: each is one file in web/, told through the bridge what to show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nicegui.elements.plotly  # noqa: F401  (puts the Plotly that comes with NiceGUI within reach)
from nicegui.element import Element

_WEB = Path(__file__).parent / "web"


class Bridge(Element, component=_WEB / "bridge.js", esm={"eclsim-page": str(_WEB / "lib")}):
    """The line between session and browser, and the status beside the brand."""

    def __init__(self, texts: dict[str, str]):
        super().__init__()
        self._props["texts"] = texts

    def publish(self, topic: str, data: Any) -> None:
        """Hand data to every view that listens."""
        self.run_method("publish", topic, data)


class Provenance(Element, component=_WEB / "provenance.js"):
    """Where the numbers come from."""


class Knobs(Element, component=_WEB / "knobs.js"):
    """The panel of knobs."""


class Keys(Element, component=_WEB / "keys.js"):
    """The numbers that are always in sight."""


class Limits(Element, component=_WEB / "limits.js"):
    """Limits that are broken, in sight in every view."""


class Bands(Element, component=_WEB / "bands.js"):
    """What the bands of the views are, and whether they are to be trusted."""


class Monitor(Element, component=_WEB / "monitor.js"):
    """Sweeping waveforms."""


class Schematic(Element, component=_WEB / "schematic.js"):
    """The circuit."""


class Loops(Element, component=_WEB / "loops.js"):
    """Pressure-volume loops."""


class Ramp(Element, component=_WEB / "ramp.js"):
    """Outputs over the pump's speed."""


class Schemes(Element, component=_WEB / "schemes.js"):
    """The nine CRRT schemes."""


class Outputs(Element, component=_WEB / "outputs.js"):
    """The table of outputs."""

    def __init__(self, specs: dict[str, dict[str, Any]]):
        super().__init__()
        self._props["specs"] = specs


class Identify(Element, component=_WEB / "identify.js"):
    """The form of measurements."""

    def __init__(self, fields: list[dict[str, Any]]):
        super().__init__()
        self._props["fields"] = fields


class Compare(Element, component=_WEB / "compare.js"):
    """Saved states side by side."""

    def __init__(self, specs: dict[str, dict[str, Any]]):
        super().__init__()
        self._props["specs"] = specs
