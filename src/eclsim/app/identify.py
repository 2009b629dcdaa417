"""Form of measurements: checked while it is typed, fitted in the background, cancelled at once."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.app.fit_remarks import judged_again, remarks_of
from eclsim.app.fitting import CancelledError, FitError, doubts_about_draws, judged
from eclsim.app.knobs import ambiguous_number, as_written
from eclsim.app.posterior import PosteriorDraws
from eclsim.app.provenance import bare_id, fitted_case, fitted_with, title_of
from eclsim.app.state import PageState, link_of, state_of, subject_of
from eclsim.app.texts import beside_field, text
from eclsim.cases.checking import Checked, check_case
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import read_mapping
from eclsim.cases.sections import MEASURED, sections
from eclsim.inputs.mistakes import CaseError, Mistake
from eclsim.inputs.sections import NOT_FITTED

if TYPE_CHECKING:
    from eclsim.app.fitting import FitProcess
    from eclsim.app.session import Send, Session
    from eclsim.app.updates import PosteriorBands
    from eclsim.cases.case import Case

EXPECTED_S, POSTERIOR_EXPECTED_S = 15.0, 12.0
"""Usual duration of a fit and of a posterior [s], by which the progress bar moves between reports."""
MOST_FREE = 64
"""Largest number of parameters of a fit stored by the browser."""
PREPARING = {"fit": "fit_preparing", "posterior": "posterior_preparing"}
PATIENT = ("id", "sex", "age_years", "height_cm", "weight_kg", "heart_rate_bpm")


def fields() -> list[dict[str, Any]]:
    """Return the fields of the form as plain data."""
    return [
        {
            "key": f"{section}.{item.name}", "label": item.description, "unit": item.unit, "kind": item.kind,
            "symbol": item.name if section == "measurements" else "", "names": list(item.names),
        }
        for section in ("patient", "measurements")
        for item in sections()[section].fields().values()
    ]  # fmt: skip


def values_of(state: PageState) -> dict[str, Any]:
    """Return the form's values for a patient as opened, with the measurements as measured and no others.

    A preset has no id: the patient who was measured must be entered.
    """
    known = state.start.case.as_mapping()
    measured, person = known.get("measurements", {}), dict(known["patient"])
    if state.start.origin in PRESETS:
        del person["id"]
    else:
        person["id"] = bare_id(state.start.case)
    result = {f"patient.{name}": person.get(name, "") for name in PATIENT}
    return result | {f"measurements.{name}": measured.get(name, "") for name in MEASURED}


def checked_form(case: Case, typed: Mapping[str, Any]) -> Checked:
    """Check patient and measurements as typed, together with devices and parameters of the case."""
    raw = case.as_mapping()
    for section in ("patient", "measurements"):
        raw[section] = {}
        for item in sections()[section].fields().values():
            value = typed.get(f"{section}.{item.name}")
            if isinstance(value, bool) or not isinstance(value, (int, float, str)):
                continue
            if str(value).strip() != "":
                raw[section][item.name] = as_written(value) if item.kind == "number" else str(value)[:200]
    checked = check_case(raw)
    doubted = {key: suggestion for key, value in typed.items() if (suggestion := ambiguous_number(value))}
    checked.mistakes = [m for m in checked.mistakes if m.key not in doubted]
    checked.mistakes += [Mistake(key, suggestion) for key, suggestion in doubted.items()]
    if not raw["measurements"] and not checked.mistakes:
        checked.mistakes.append(Mistake("measurements", "nothing to fit", allowed="at least one measurement"))
    return checked


class Identification:
    """Fits and posteriors of one session, one at a time.

    Args:
        session: session whose patient is fitted.
        send: sends a topic and plain data to the browser.
        process: process in which fits run.
        bands: stores the posteriors found.
    """

    def __init__(self, session: Session, send: Send, process: FitProcess, bands: PosteriorBands):
        self.session, self.send, self.process, self.bands = session, send, process, bands
        self._fitted: dict[str, PageState] = {}
        self._fits: dict[str, Mapping[str, Any]] = {}
        self._subject = ""
        self._stop: threading.Event | None = None
        self._report = ""

    @property
    def running(self) -> bool:
        """Whether a job is running that was not cancelled."""
        return self._stop is not None

    def fill(self) -> None:
        """Prepare fits and fill the form with the displayed patient, when the form is shown."""
        self.process.prepare()
        self._show_form()

    def follow(self, opened: bool = False) -> None:
        """Show the form of another patient, and cancel a fit still running for the previous one.

        Args:
            opened: whether a patient was newly opened, so that earlier entries and fits for it are discarded.
        """
        subject = subject_of(self.session.state)
        if subject == self._subject and not opened:
            return
        self.cancel()
        if opened:
            self._fitted.pop(subject, None)
        self._show_form(opened)

    def _show_form(self, opened: bool = False) -> None:
        state = self.session.state
        self._subject = subject_of(state)
        preset = state.start.origin in PRESETS
        form = {
            "subject": self._subject, "name": text("fit_nobody") if preset else title_of(state.start),
            "values": values_of(state), "opened": opened, "preset": preset,
        }  # fmt: skip
        self.send("form", form)

    def check(self, typed: Mapping[str, Any]) -> bool:
        """Report errors and warnings by field; return whether the form can be fitted."""
        checked = checked_form(fitted_case(self.session.state), typed)
        left_out = [note for note in checked.notes if note.message == NOT_FITTED]
        self.send("form_check", {
            "mistakes": _by_field(checked.mistakes), "warnings": _by_field([*checked.warnings, *left_out]),
            "ready": not checked.mistakes,
        })  # fmt: skip
        return not checked.mistakes

    async def start(self, typed: Mapping[str, Any]) -> None:
        """Start a fit; does nothing while one is running."""
        if self.running or not self.check(typed):
            return
        state = self.session.state
        raw: dict[str, Any] = checked_form(fitted_case(state), typed).values | {"format": 1}
        subject, policy = subject_of(state), state.policy
        ended = await self._run("fit", raw, policy, EXPECTED_S)
        result = ended.pop("found", None)
        if result is not None:
            case = result.pop("case")
            of = text("fit_of", name=raw["patient"]["id"], circuit=fitted_with(state))
            fit = result | {"seconds": ended["seconds"], "of": of, "settings": [fitted_with(state)]}
            if result["usable"]:
                fitted = self._keep_fit(case, policy, subject, result)
                fit |= {"link": link_of(fitted), "settings": [*fit["settings"], fitted_with(fitted)]}
            ended = {"fit": fit}
        ended["subject"] = subject
        self.send("fit_ended", ended)

    def _keep_fit(
        self, raw: Mapping[str, Any], policy: str, subject: str, result: Mapping[str, Any]
    ) -> PageState:
        """Store and return the fitted patient."""
        case, verdict = read_mapping(raw).case, str((result.get("verdict") or {}).get("level", ""))
        state = PageState(
            case, policy, "fit", self.bands.new_key(), verdict=verdict, subject=subject,
            remarks=remarks_of(result), free=tuple(result.get("parameters") or ()),
        )  # fmt: skip
        self._fitted[subject], self._fits[subject] = state, result
        return state

    def _fit_of(self, link: str) -> PageState | None:
        """Return the fit of the displayed patient: that of this session, else that in the browser's link."""
        subject = subject_of(self.session.state)
        if subject not in self._fitted and link:
            try:
                state = state_of(link)
            except CaseError:
                return None
            if state.origin == "fit" and subject_of(state) == subject:
                self._fitted[subject] = replace(state, posterior=self.bands.new_key())
        return self._fitted.get(subject)

    async def compute_posterior(self, link: str = "", fit: Mapping[str, Any] | None = None) -> None:
        """Compute the posterior of the fitted patient; its bands appear once that patient is in use.

        Args:
            link: link of the fit, for a session without it.
            fit: "parameters" and "verdict" of the fit, for a session without it.
        """
        fitted = self._fit_of(link)
        if self.running or fitted is None:
            return
        case, fitted_by = fitted.case, self._fits.get(subject_of(fitted)) or fit or {}
        free = [str(name) for name in fitted_by.get("parameters") or ()][:MOST_FREE]
        ended = await self._run("posterior", case.as_mapping(), fitted.policy, POSTERIOR_EXPECTED_S, free)
        posterior = ended.pop("found", None)
        if posterior is not None:
            members = PosteriorDraws(
                tuple(posterior["names"]), np.array(posterior.pop("members")), {}, posterior["method"],
                (*posterior["doubts"], *doubts_about_draws(fitted_by)),
            ).of(case)  # fmt: skip
            ended = {"posterior": posterior | members.as_object() | {"seconds": ended["seconds"]}}
            ended |= self._update_verdict(fitted, fit, posterior["parameters"])
            self.bands.add(fitted.posterior, members)
        self.send("posterior_ended", ended | {"subject": subject_of(fitted)})

    def _update_verdict(
        self, fitted: PageState, result: Mapping[str, Any] | None, others: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Update the verdict on the fit by the posterior's intervals, also in the fitted patient's state."""
        subject = subject_of(fitted)
        try:
            verdict = judged(self._fits.get(subject) or dict(result or {}), others)
        except (TypeError, KeyError, ValueError, AttributeError):  # the browser stored other data
            return {}
        remarks = judged_again(fitted.remarks, verdict)
        new = replace(fitted, verdict=verdict["verdict"]["level"], remarks=remarks)
        self._fitted[subject] = new
        self.session.judge(fitted, new)
        return {"judged": verdict}

    def cancel(self) -> None:
        """Cancel the running job, which ends by itself at its next step."""
        if self._stop is not None:
            self._stop.set()
            self._stop = None

    def use(self, link: str = "") -> bool:
        """Show the fitted patient in all views; `link` as for `compute_posterior`."""
        fitted = self._fit_of(link)
        if fitted is None:
            return False
        self.session.load(fitted)
        return True

    def use_members(self, source: str, members: PosteriorDraws) -> None:
        """Show the patient with a posterior from a file, whose central parameters are used.

        Raises:
            CaseError: They are not parameters of this patient.
        """
        state = self.session.state
        case, subject = members.centred(state.case), subject_of(state)
        key = self.bands.new_key()
        self.bands.add(key, members)
        self.session.load(PageState(case, state.policy, "posterior", key, source=source, subject=subject))

    async def _run(
        self, job: str, raw: dict[str, Any], policy: str, expected_s: float, free: Sequence[str] = ()
    ) -> dict[str, Any]:
        """Run a job in the process and report its progress; return its result, or why there is none."""
        self._stop = stop = threading.Event()
        self._report = text(PREPARING[job])

        def report(message: str) -> None:
            self._report = message

        started = time.monotonic()
        work = asyncio.ensure_future(
            asyncio.to_thread(self.process.run, job, raw, policy, report, stop, free)
        )
        work.add_done_callback(lambda done: done.cancelled() or done.exception())
        try:
            while not stop.is_set() and not work.done():
                spent = time.monotonic() - started
                share = 0.95 * (1.0 - 2.0 ** (-2.0 * spent / expected_s))
                self.send(f"{job}_progress", {"share": share, "seconds": spent, "text": self._report})
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


def _by_field(mistakes: list[Mistake]) -> dict[str, str]:
    result: dict[str, str] = {}
    for m in mistakes:
        words = beside_field(m)
        result[m.key] = f"{result[m.key]} {words}" if m.key in result else words
    return result
