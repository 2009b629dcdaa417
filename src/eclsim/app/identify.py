"""The form of measurements: checked as it is typed, fitted beside the page, cancelled at once."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.app.fitting import CancelledError, FitError
from eclsim.app.knobs import as_written
from eclsim.app.members import Members
from eclsim.app.state import PageState
from eclsim.app.texts import text
from eclsim.patients.checking import Checked, check_case
from eclsim.patients.fields import SECTIONS
from eclsim.patients.mistakes import Mistake
from eclsim.patients.reading import read_mapping

if TYPE_CHECKING:
    from eclsim.app.fitting import Fitter
    from eclsim.app.session import Session
    from eclsim.app.uncertain import Uncertain
    from eclsim.patients.case import Case

EXPECTED_S, POSTERIOR_EXPECTED_S = 15.0, 12.0
"""Usual time of a fit and of a posterior [s]; the bar moves by it between their reports."""
PREPARING = {"fit": "fit_preparing", "posterior": "posterior_preparing"}
PATIENT = ("id", "sex", "age_years", "height_cm", "weight_kg", "heart_rate_bpm")


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
    """Fits and posteriors of one session; at most one of them runs.

    Args:
        session: whose patient is fitted.
        tell: hands a topic and plain data to the browser.
        fitter: where fits run.
        uncertain: keeps what posteriors were found.
    """

    def __init__(
        self, session: Session, tell: Callable[[str, Any], None], fitter: Fitter, uncertain: Uncertain
    ):
        self.session, self.tell, self.fitter, self.uncertain = session, tell, fitter, uncertain
        self.fitted: PageState | None = None
        self._stop: threading.Event | None = None
        self._said = ""

    @property
    def running(self) -> bool:
        """Whether something runs that somebody still wants."""
        return self._stop is not None

    def fill(self) -> None:
        """Show the session's patient, with what was measured or else what the model gives now."""
        self.fitter.prepare()
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
        raw = checked_form(self.session.state.case, typed).values | {"format": 1}
        policy = self.session.state.policy
        ended = await self._run("fit", raw, policy, EXPECTED_S)
        found = ended.pop("found", None)
        if found is not None:
            case = found.pop("case")
            fitted = read_mapping(case).case if found["usable"] else None
            key = self.uncertain.new_key()
            self.fitted = fitted and PageState(fitted, policy, "fit", key)
            ended = {"fit": found | {"seconds": ended["seconds"]}}
        self.tell("fit_ended", ended)

    async def find_posterior(self) -> None:
        """The posterior of the fitted patient; its bands are there as soon as that patient is in use."""
        if self.running or self.fitted is None:
            return
        fitted = self.fitted
        case = fitted.case
        ended = await self._run("posterior", case.as_mapping(), fitted.policy, POSTERIOR_EXPECTED_S)
        found = ended.pop("found", None)
        if found is not None:
            members = Members(
                tuple(found["names"]), np.array(found.pop("members")), {}, found["method"],
                tuple(found["doubts"]),
            ).of(case)  # fmt: skip
            self.uncertain.add(fitted.posterior, members)
            ended = {"posterior": found | members.as_object() | {"seconds": ended["seconds"]}}
        self.tell("posterior_ended", ended)

    def cancel(self) -> None:
        """Let go of what runs: it ends by itself at its next step."""
        if self._stop is not None:
            self._stop.set()
            self._stop = None

    def use(self) -> bool:
        """Show the fitted patient in all views."""
        if self.fitted is None:
            return False
        self.session.load(self.fitted)
        return True

    def use_members(self, members: Members) -> None:
        """Show the patient around a posterior that was loaded: its parameters become the central ones."""
        state = self.session.state
        raw = state.case.as_mapping()
        raw["parameters"] = {**raw.get("parameters", {}), **members.base}
        key = self.uncertain.new_key()
        self.uncertain.add(key, members)
        self.session.load(replace(state, case=read_mapping(raw).case, origin="posterior", posterior=key))

    async def _run(self, job: str, raw: dict[str, Any], policy: str, expected_s: float) -> dict[str, Any]:
        """Run a job of the fitter, with its progress told; what was found, or why nothing was."""
        self._stop = stop = threading.Event()
        self._said = text(PREPARING[job])
        started = time.monotonic()
        work = asyncio.ensure_future(
            asyncio.to_thread(getattr(self.fitter, job), raw, policy, self._say, stop)
        )
        work.add_done_callback(lambda done: done.cancelled() or done.exception())
        try:
            while not stop.is_set() and not work.done():
                spent = time.monotonic() - started
                share = 0.95 * (1.0 - 2.0 ** (-2.0 * spent / expected_s))
                self.tell(f"{job}_progress", {"share": share, "seconds": spent, "words": self._said})
                await asyncio.wait({work}, timeout=0.25)
            if stop.is_set():
                return {"message": text("fit_cancelled")}
            return {"found": await work, "seconds": round(time.monotonic() - started, 1)}
        except FitError as error:
            return {"message": str(error)}
        except CancelledError:
            return {"message": text("fit_cancelled")}
        finally:
            if self._stop is stop:
                self._stop = None

    def _say(self, words: str) -> None:
        self._said = words


def _by_field(mistakes: list[Mistake]) -> dict[str, str]:
    found: dict[str, str] = {}
    for m in mistakes:
        said = str(Mistake("", m.message, m.value, m.allowed, m.suggestion))
        found[m.key] = f"{found[m.key]} {said}" if m.key in found else said
    return found
