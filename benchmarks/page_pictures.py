"""The pictures of the bedside page in its documentation, taken anew.

    python benchmarks/page_pictures.py docs/images

Needs Chromium on the PATH.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path

from page_latency import launched, served
from playwright.sync_api import Page

ROOT = Path(__file__).parents[1]
CRRT = """
[crrt]
flow_ml_min = 200
access_site = "post_oxy"
return_site = "pre_oxy"
"""
HEALTHY = """
format = 1
[patient]
id = "Healthy adult"
sex = "male"
age_years = 35
height_cm = 178
weight_kg = 75
heart_rate_bpm = 70
[parameters]
Emaxlv = 1.95
Emaxrv = 0.5
Rmc = 0.88
Rpmc = 0.05
Csart = 1.3
[[events]]
at_min = 90
give = { bleed_ml = 750 }
over_min = 15
[[events]]
at_min = 180
give = { crystalloid_ml = 1000 }
over_min = 30
[[events]]
at_min = 270
set = { Rmc = 0.6 }
ramp_min = 10
"""
SETTLED_MS = 2500


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder of the pictures")
    folder: Path = parser.parse_args().folder
    example = (ROOT / "examples" / "differential_hypoxaemia.toml").read_text(encoding="utf-8")
    pictures = (
        ("bedside-page", example + CRRT, (1280, 860), show_gases),
        ("bedside-timeline", HEALTHY, (1280, 900), show_bleeding),
    )
    for name, case, (width, height), show in pictures:
        with tempfile.TemporaryDirectory() as place:
            path = Path(place) / "patient.toml"
            path.write_text(case, encoding="utf-8")
            command = ("-m", "eclsim", "app", str(path), "--port")
            with served(*command, stdout=subprocess.DEVNULL) as (url, _), launched() as browser:
                page = browser.new_page(viewport={"width": width, "height": height})
                page.goto(url)
                page.wait_for_function("eclsim.bus.last('beat') !== undefined")
                show(page)
                page.wait_for_timeout(SETTLED_MS)
                page.screenshot(path=folder / f"{name}.png")


def show_gases(page: Page) -> None:
    """Open the view of blood gases."""
    page.get_by_role("tab", name="Gases", exact=True).click()


def show_bleeding(page: Page) -> None:
    """Open the timeline of six hours, and go to the first limit that the bleeding breaks."""
    page.get_by_role("button", name="Open the timeline").click()
    page.get_by_label("Length").select_option(label="6 h")
    page.get_by_text("Computed in").wait_for(timeout=180_000)
    page.locator(".counts button").first.click()
    page.get_by_role("button", name="Close the timeline").scroll_into_view_if_needed()


if __name__ == "__main__":
    main()
