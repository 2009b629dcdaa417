"""Fits and posteriors in a separate process: they take seconds, and beats must not wait for them."""

from __future__ import annotations

import contextlib
import logging
import math
import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from eclsim.app.knobs import ASSUMED_SHUNTS
from eclsim.app.texts import in_page_words, text, with_minus
from eclsim.cases.quantities import quantity
from eclsim.cases.reading import read_mapping
from eclsim.cases.sections import Gas
from eclsim.inputs.mistakes import CaseError
from eclsim.parameters.regulation import EXTRA_VOLUME

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.context import SpawnProcess
    from multiprocessing.synchronize import Event

    from eclsim.cases.case import Case
    from eclsim.identification.fit import FitResult
    from eclsim.identification.settings import FitSettings
    from eclsim.orbit.model import VolumePolicy

log = logging.getLogger("eclsim.app")
PAGE_SEARCH = {"points_per_parameter": 36, "round_size": 2, "rediscoveries": 1}
"""A smaller search than that of `eclsim identify` (1000 points, 10 rediscoveries), to answer in seconds."""
COMPILING_SEARCH = {"points_per_parameter": 2, "round_size": 1, "rediscoveries": 1, "polishing": 0}
LONGEST_CANCEL_S = 20.0
"""Time after which a cancelled fit that has not stopped is terminated together with its process [s]."""
NICENESS = 5
FAILED = {"fit": "fit_failed", "posterior": "posterior_failed"}


Order = tuple[str, dict[str, Any], str, tuple[str, ...]]
"""Job, case, blood volume policy, and free parameters if already known."""


class FitError(RuntimeError):
    """Reason why there is no fit, in words."""


class CancelledError(Exception):
    """The fit was cancelled."""


class FitProcess:
    """The process for fits; it is started when first needed, and again if it has ended."""

    def __init__(self) -> None:
        self._spawn = multiprocessing.get_context("spawn")
        self._turn = threading.Lock()
        self._process: SpawnProcess | None = None
        self._line: tuple[Connection, Event] | None = None

    def prepare(self) -> None:
        """Start the process, which compiles what fits need; returns at once."""
        if self._turn.acquire(blocking=False):
            try:
                self._started()
            finally:
                self._turn.release()

    def run(
        self, job: str, case: Mapping[str, Any], policy: str, report: Callable[[str], None],
        stop: threading.Event, free: Sequence[str] = (),
    ) -> dict[str, Any]:  # fmt: skip
        """Run a job in the process; blocks. Jobs run one at a time, and others wait for their turn.

        Args:
            job: "fit" or "posterior".
            case: case with measurements, as in a case file.
            policy: blood volume policy.
            report: called with a description of the current step.
            stop: set to cancel the job.
            free: free parameters; empty to choose those worth fitting.

        Returns:
            The result as plain data; the fitted case is under "case".

        Raises:
            CancelledError: `stop` was set.
            FitError: There is no result.
        """
        while not self._turn.acquire(timeout=0.2):
            report(text("fit_waiting"))
            if stop.is_set():
                raise CancelledError
        try:
            return self._exchange((job, dict(case), policy, tuple(free)), report, stop)
        finally:
            self._turn.release()

    def stop(self) -> None:
        """End the process, and release its event, whose semaphores would outlast a stopped command."""
        if self._process is not None and self._process.is_alive():
            self._process.terminate()
        self._process = self._line = None

    def _started(self) -> Connection:
        """Return the pipe to the process; start the process if needed."""
        if self._process is None or not self._process.is_alive() or self._line is None:
            pipe, far = self._spawn.Pipe()
            self._line = pipe, self._spawn.Event()
            self._process = self._spawn.Process(target=_serve, args=(far, self._line[1]), daemon=True)
            self._process.start()
            far.close()
        self._line[1].clear()
        return self._line[0]

    def _exchange(self, order: Order, report: Callable[[str], None], stop: threading.Event) -> dict[str, Any]:
        pipe = self._started()
        cancelled_at = math.inf
        try:
            pipe.send(order)
            while True:
                if stop.is_set() and cancelled_at == math.inf:
                    cancelled_at = time.monotonic()
                    if self._line is not None:  # kept nowhere else, as its semaphores would outlast it
                        self._line[1].set()
                if time.monotonic() - cancelled_at > LONGEST_CANCEL_S:
                    self.stop()
                    raise CancelledError
                if pipe.poll(0.1):
                    kind, content = pipe.recv()
                    if kind == "done":
                        return content
                    if kind == "cancelled":
                        raise CancelledError
                    if kind == "failed":
                        raise FitError(content)
                    report(content)
        except (EOFError, OSError):
            self._process = None
            raise FitError(text("fit_failed")) from None


def _serve(pipe: Connection, quit_now: Event) -> None:
    """Main function of the process: prepare, then run jobs from the pipe until its other end is closed."""
    with contextlib.suppress(OSError, AttributeError):
        os.nice(NICENESS)
    try:
        with contextlib.suppress(CancelledError):
            _prepare(pipe)
    except Exception:  # what could not be compiled in advance is compiled by the first fit
        log.exception("compiling what fits need failed")
    while True:
        try:
            job, case, policy, free = pipe.recv()
            pipe.send(_run_job(job, case, policy, free, lambda message: _report(pipe, quit_now, message)))
        except (EOFError, OSError):
            return


def _report(pipe: Connection, quit_now: Event, message: str) -> None:
    if quit_now.is_set():
        raise CancelledError
    pipe.send(("report", message))


def _prepare(pipe: Connection) -> None:
    """Compile what fits need, until a job arrives."""
    from eclsim.cases.presets import PRESETS

    preset = PRESETS["paper"]
    raw = preset.case().as_mapping()
    raw["measurements"] = {"SP": 83.0, "DP": 76.0, "MAP": 80.0, "MPAP": 11.0, "CO": 1.4, "PF": 3.5}
    for sections in (raw, {k: v for k, v in raw.items() if k not in preset.often}):
        _fit(sections, "as_published", COMPILING_SEARCH, lambda _: _lower_priority(pipe))


def _lower_priority(pipe: Connection) -> None:
    if pipe.poll():
        raise CancelledError


def _fit(
    raw: Mapping[str, Any], policy: VolumePolicy, search: Mapping[str, int], report: Callable[[str], None]
) -> FitResult:
    from eclsim.identification.fit import fit
    from eclsim.identification.multi_start import MultiStart

    case, settings = prepared_for_fit(raw, policy)
    settings = replace(settings, multi_start=MultiStart(**search))
    return fit(case, settings=settings, progress=lambda step: report(str(step)))


def prepared_for_fit(
    raw: Mapping[str, Any], policy: VolumePolicy, free: Sequence[str] = ()
) -> tuple[Case, FitSettings]:
    """Return the case and fit settings with the parameters worth fitting; with CVP also the blood volume.

    Args:
        raw: case with measurements, as in a case file.
        policy: blood volume policy.
        free: free parameters, if already known.
    """
    from eclsim.identification.settings import (
        FitSettings,
        crrt_parameters_informed_by_pressures,
        free_parameters,
    )

    settings = FitSettings(volume_policy=policy)
    usual = settings.parameters
    if "CVP" in raw["measurements"]:
        raw = {**raw, "fluid": raw.get("fluid", {})}
        usual = (*usual, EXTRA_VOLUME)
    case = _with_assumed_shunt(read_mapping(raw).case)
    usual = (*usual, *crrt_parameters_informed_by_pressures(case))
    return case, replace(settings, parameters=tuple(free) or free_parameters(case, usual, policy))


def _with_assumed_shunt(case: Case) -> Case:
    """Mark an unchanged shunt as assumed, since the page's sections contain all keys."""
    gas = case.gas
    if gas is None or gas.shunt_fraction not in ASSUMED_SHUNTS:
        return case
    given = gas.model_fields_set - {"shunt_fraction"}
    return case.model_copy(update={"gas": Gas.model_construct(given, **gas.model_dump())})


def _run_job(
    job: str, raw: Mapping[str, Any], policy: VolumePolicy, free: Sequence[str], report: Callable[[str], None]
) -> tuple[str, Any]:
    from eclsim.app.posterior import plain_posterior

    try:
        if job == "posterior":
            return "done", plain_posterior(raw, policy, report, free)
        return "done", plain_fit(_fit(raw, policy, PAGE_SEARCH, report))
    except CancelledError:
        return "cancelled", None
    except CaseError as error:
        return "failed", with_minus(str(error))
    except Exception as error:  # the page must receive any error, but without values of the patient
        return "failed", f"{text(FAILED[job])} ({type(error).__name__})"


def plain_fit(fit: FitResult) -> dict[str, Any]:
    """Return a fit as plain data: the output of `eclsim identify`, with units, bounds and the fitted case."""
    from eclsim.identification.verdict import headline

    result = fit.as_object() | {"usable": bool(fit.simulated), "case": fit.case.as_mapping()}
    result["message"] = with_minus(result["message"])
    result["headline"] = headline(result["verdict"])
    result["verdict"]["reasons"] = [_on_the_page(reason) for reason in result["verdict"]["reasons"]]
    for name, parameter in result["parameters"].items():
        known = quantity(name)
        assert known is not None  # every fitted parameter is a number of a case
        parameter |= {"unit": "" if known.unit == "1" else known.unit, "text": known.description}
        parameter["reason"] = with_minus(parameter["reason"])
        if name in fit.box.names:
            k = fit.box.names.index(name)
            parameter["bounds"] = [fit.box.scale.value(k, side[k]) for side in (fit.box.lower, fit.box.upper)]
    return result


def _on_the_page(reason: Mapping[str, Any]) -> dict[str, Any]:
    """Return a reason of a verdict in the words of the page."""
    return {**reason, "sentence": in_page_words(reason["sentence"])}


def doubts_about_draws(fit: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what a fit's verdict says against its draws, as `eclsim identify` does: held values, a poor fit.

    Args:
        fit: "verdict" of `plain_fit`, or what a browser kept of it; empty if it is not known.
    """
    from eclsim.identification.verdict import Aspect, Level, headline

    try:
        verdict = fit["verdict"]
        held = [r for r in verdict["reasons"] if r["aspect"] == Aspect.HELD and r["level"] != Level.GOOD]
        poor = [headline(verdict)] if verdict["level"] == Level.POOR else []
        return tuple(str(sentence) for sentence in (*poor, *(r["sentence"] for r in held)))
    except (TypeError, KeyError, ValueError, AttributeError):  # the browser stored other data
        return ()


def judged(fit: Mapping[str, Any], others: Mapping[str, Any]) -> dict[str, Any]:
    """Return the verdict on a fit updated with the posterior's intervals.

    Args:
        fit: "parameters" and "verdict" of `plain_fit`.
        others: intervals of the parameters in the posterior, with "lower" and "upper".

    Returns:
        "verdict", its "headline", and under "parameters" those that are no longer considered identifiable.
    """
    from eclsim.identification.verdict import Level, headline, interval_agreement

    contradictions = interval_agreement(fit["parameters"], others, "posterior")
    reasons = [_on_the_page(reason.as_object()) for reason in contradictions]
    order = [str(level) for level in Level]
    reasons_sorted = sorted([*reasons, *fit["verdict"]["reasons"]], key=lambda r: -order.index(r["level"]))
    level = max([fit["verdict"]["level"], *(r["level"] for r in reasons)], key=order.index)
    verdict = {**fit["verdict"], "level": level, "reasons": reasons_sorted}
    doubted = {r["about"]: {"identifiable": False, "reason": r["sentence"]} for r in reasons}
    return {"verdict": verdict, "headline": headline(verdict), "parameters": doubted}
