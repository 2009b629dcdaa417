"""The form of measurements: checked as it is typed, fitted in a thread of its own, cancelled at once."""

from __future__ import annotations

import asyncio
import logging
import math
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from eclsim.app.knobs import as_written
from eclsim.app.texts import text
from eclsim.patients.checking import Checked, check_case
from eclsim.patients.fields import SECTIONS
from eclsim.patients.mistakes import CaseError, Mistake

if TYPE_CHECKING:
    from eclsim.app.session import Session
    from eclsim.patients.case import Case
    from eclsim.studies.identification import Fit

log = logging.getLogger("eclsim.app")
LOOKING = {"points_per_parameter": 120, "round_size": 4, "rediscoveries": 2}
"""A narrower search than that of `eclsim identify` (1000 points, 10 rediscoveries), to answer in seconds."""
EXPECTED_S = 10.0
"""Usual time of a fit [s]; the bar moves by it between the reports of the fit."""
PATIENT = ("id", "sex", "age_years", "height_cm", "weight_kg", "heart_rate_bpm")
_fits = ThreadPoolExecutor(1, thread_name_prefix="fit")


class _CancelledError(Exception):
    """Somebody does not want the fit any more."""


def fields() -> list[dict[str, Any]]:
    """The fields of the form as plain data."""
    return [
        {
            "key": f"{section}.{item.name}", "label": item.description, "unit": item.unit, "kind": item.kind,
            "short": item.name if section == "measurements" else "", "names": list(item.names),
        }
        for section in ("patient", "measurements")
        for item in SECTIONS[section]
    ]  # fmt: skip


def values_of(case: Case) -> dict[str, Any]:
    """What the form shows for a case."""
    known = case.as_mapping()
    found = {f"patient.{name}": known["patient"].get(name, "") for name in PATIENT}
    measured = known.get("measurements", {})
    return found | {f"measurements.{f.name}": measured.get(f.name, "") for f in SECTIONS["measurements"]}


def checked_form(case: Case, typed: Mapping[str, Any]) -> Checked:
    """Patient and measurements as typed, with devices and parameters of the case."""
    raw = case.as_mapping()
    for section in ("patient", "measurements"):
        raw[section] = {}
        for item in SECTIONS[section]:
            value = typed.get(f"{section}.{item.name}")
            if isinstance(value, bool) or not isinstance(value, (int, float, str)):
                continue
            if str(value).strip() != "":
                raw[section][item.name] = as_written(value) if item.kind == "number" else str(value)[:200]
    checked = check_case(raw)
    if not raw["measurements"] and not checked.mistakes:
        checked.mistakes.append(Mistake("measurements", "nothing to fit", allowed="at least one measurement"))
    return checked


class Identification:
    """Fits of one session; at most one runs.

    Args:
        session: whose patient is fitted.
        tell: hands a topic and plain data to the browser.
    """

    def __init__(self, session: Session, tell: Callable[[str, Any], None]):
        self.session, self.tell = session, tell
        self.fit: Fit | None = None
        self._stop: threading.Event | None = None
        self._said = ""

    @property
    def running(self) -> bool:
        """Whether a fit runs that somebody still wants."""
        return self._stop is not None

    def fill(self) -> None:
        """Show the session's patient, with what was measured or else what the model gives now."""
        values = values_of(self.session.state.case)
        beat = self.session.beat
        if beat is not None and self.session.state.case.measurements is None:
            for item in SECTIONS["measurements"]:
                if item.name in beat.outputs:
                    values[f"measurements.{item.name}"] = float(f"{beat.outputs[item.name]:.3g}")
        self.tell("form", values)

    def check(self, typed: Mapping[str, Any]) -> bool:
        """Say what is wrong or doubtful, field by field; whether it can be fitted."""
        checked = checked_form(self.session.state.case, typed)
        self.tell("form_check", {
            "mistakes": _by_field(checked.mistakes), "warnings": _by_field(checked.warnings),
            "ready": not checked.mistakes,
        })  # fmt: skip
        return not checked.mistakes

    async def start(self, typed: Mapping[str, Any]) -> None:
        """Fit; a second press while one runs does nothing."""
        if self.running or not self.check(typed):
            return
        from eclsim.patients.case import Case

        case = Case.model_validate(checked_form(self.session.state.case, typed).values)
        self._stop = stop = threading.Event()
        self._said, started = text("fit_running"), time.monotonic()
        work = asyncio.get_running_loop().run_in_executor(_fits, lambda: self._work(case, stop))
        try:
            while not stop.is_set() and not work.done():
                spent = time.monotonic() - started
                share = 0.95 * (1.0 - 2.0 ** (-2.0 * spent / EXPECTED_S))
                self.tell("fit_progress", {"share": share, "seconds": spent, "words": self._said})
                await asyncio.wait({work}, timeout=0.25)
            if stop.is_set():
                self.tell("fit_ended", {"message": text("fit_cancelled")})
                return
            self.fit = await work
            self.tell("fit_ended", {"fit": self._plain(self.fit, time.monotonic() - started)})
        except CaseError as error:
            self.tell("fit_ended", {"message": str(error)})
        except Exception:  # a fit that fails must not end the page
            log.exception("a fit failed")
            self.tell("fit_ended", {"message": text("failed")})
        finally:
            if self._stop is stop:
                self._stop = None

    def cancel(self) -> None:
        """Let go of the fit that runs: its thread ends at its next report."""
        if self._stop is not None:
            self._stop.set()
            self._stop = None

    def use(self) -> bool:
        """Show the fitted patient in all views."""
        if self.fit is None or self.fit.optimum.status.value == "no_steady_beat":
            return False
        self.session.load(replace(self.session.state, case=self.fit.case, origin="fit"))
        return True

    def _work(self, case: Case, stop: threading.Event) -> Fit:
        from eclsim.identification.multi_start import MultiStart
        from eclsim.studies.fit_settings import FitSettings
        from eclsim.studies.identification import fit_case

        def report(words: str) -> None:
            self._said = words
            if stop.is_set():
                raise _CancelledError

        report(text("fit_running"))
        looking = MultiStart(**LOOKING)
        settings = FitSettings(multi_start=looking, policy=self.session.state.policy)
        return fit_case(case, settings, report)

    @staticmethod
    def _plain(fit: Fit, seconds: float) -> dict[str, Any]:
        from eclsim.parameters import default

        usable = fit.status.value != "no_steady_beat"
        found = fit.as_object() | {"seconds": round(seconds, 1), "usable": usable}
        for name, parameter in found["parameters"].items():
            known = default(name)
            parameter |= {"unit": known.unit, "words": known.description}
            if name in fit.box.names:
                k = fit.box.names.index(name)
                parameter["bounds"] = [math.exp(fit.box.lower[k]), math.exp(fit.box.upper[k])]
        return found


def _by_field(mistakes: list[Mistake]) -> dict[str, str]:
    found: dict[str, str] = {}
    for m in mistakes:
        said = str(Mistake("", m.message, m.value, m.allowed, m.suggestion))
        found[m.key] = f"{found[m.key]} {said}" if m.key in found else said
    return found
