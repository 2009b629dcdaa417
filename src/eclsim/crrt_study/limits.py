"""Limits of machine and circuit, and the largest ECMO flow up to which a scheme keeps them.

A speed without a steady beat has no margin (NaN); margins are not interpolated across it.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from eclsim.crrt_study.beats import Variables, speeds_text, speeds_without_solution, value
from eclsim.devices.crrt import ALARMS_MMHG, SANSOM_ACCESS_MMHG
from eclsim.devices.description import placed_sentence
from eclsim.devices.ecmo import SUCTION_MMHG
from eclsim.outputs.alarms import sentences
from eclsim.outputs.results import output_labels
from eclsim.outputs.signals import output_names, signal_labels

if TYPE_CHECKING:
    from eclsim.crrt_study.beats import StudyCircuits
    from eclsim.outputs.steady_beat import SteadyBeat

FINE_POINTS = 4001

BROKEN_ABOVE = "broken_above"
KEPT_TO_THE_END = "kept_to_the_end"
NOT_KNOWN_ABOVE = "not_known_above"
NEVER = "never"
NOT_KNOWN = "not_known"
"""How far a limit is kept: up to a flow where it is violated; up to the largest speed studied; up to a
flow above which beats were not found; at no speed; at no speed whose beat was found."""


@dataclass(frozen=True, slots=True)
class Limit:
    """A bound on a quantity of the steady beat.

    Args:
        name: key of the limit.
        quantity: variable of the study's means.
        low: smallest allowed value [mmHg], -inf for none.
        high: largest allowed value [mmHg], inf for none.
        meaning: meaning and source of the limit.
        of_crrt: whether CRRT schemes are judged by it.
    """

    name: str
    quantity: str
    low: float
    high: float
    meaning: str
    of_crrt: bool = True

    @property
    def unbounded(self) -> bool:
        """Whether the limit has no bound, so that every value keeps it."""
        return bool(np.isneginf(self.low) and np.isposinf(self.high))

    def margin(self, value: np.ndarray | float) -> np.ndarray:
        """Distance to the nearer bound [mmHg]; negative if the limit is violated."""
        return np.minimum(np.asarray(value) - self.low, self.high - np.asarray(value))


LIMITS = (
    Limit("access_alarm", "Pcrrttuin", *ALARMS_MMHG["access"], "usual alarms of the access line"),
    Limit("return_alarm", "Pcrrttuout", *ALARMS_MMHG["return"], "usual alarms of the return line"),
    Limit(
        "access_190", "Pcrrttuin", -np.inf, SANSOM_ACCESS_MMHG,
        "access pressure above which CRRT circuits failed early (Sansom et al. 2023)",
    ),
    Limit(
        "suction", "lowest_drainage_pressure", SUCTION_MMHG, np.inf,
        "drainage pressure below which suction and haemolysis are feared (a convention)", False,
    ),
)  # fmt: skip


def any_bounded(limits: Iterable[Limit]) -> bool:
    """Whether any limit has a bound."""
    return not all(limit.unbounded for limit in limits)


CRRT_LIMITS = "crrt"
"""Key of the combination of all limits by which a scheme is judged."""
USUAL_ALARMS = {
    "access": next(limit for limit in LIMITS if limit.name == "access_alarm"),
    "return": next(limit for limit in LIMITS if limit.name == "return_alarm"),
}
"""Usual alarms of the machine by line, which hold at the bedside whatever a centre's rule says."""
NO_LIMITS = "this rule sets no limits"


@dataclass(frozen=True, slots=True)
class LimitRange:
    """Range of pump speeds up to which a limit is kept.

    Args:
        state: one of the five words above.
        flow: largest ECMO flow known to keep the limit [L/min]; NaN if there is none.
        speed: pump speed at that flow [rpm].
        flow_at_most: largest flow that may keep the limit if beats above are not known [L/min]; inf without
            an upper bound, and equal to `flow` if that is certain.
        broken_below: lower speeds at which the limit is violated [rpm].
    """

    state: str
    flow: float
    speed: float
    flow_at_most: float
    broken_below: tuple[float, ...] = ()


def largest_flows(
    means: xr.Dataset, case_speed: float, rule_limits: tuple[Limit, ...] = LIMITS
) -> xr.Dataset:
    """Limits that each scheme keeps at the case's speed, and the ECMO flow up to which it keeps them.

    Args:
        means: means over `policy`, `scheme` and `speed`: pressures, `PF` [L/min] and `status`, NaN without a
            beat.
        case_speed: speed of the case, one of the speeds [rpm].
        rule_limits: limits of the rule.

    Returns:
        Over `policy`, `scheme` and `limit` (the last one, "crrt", combines all limits of the CRRT lines):
        `state`, `largest_flow` [L/min], `largest_speed` [rpm] and `flow_at_most` [L/min], see `LimitRange`;
        `kept_throughout`, whether the limit is kept at every speed studied; `in_words`; `margin` [mmHg] at
        the case's speed, negative if the limit is violated, NaN if the beat was not found.
    """
    keys = [limit.name for limit in rule_limits] + [CRRT_LIMITS]
    shape = (means.sizes["policy"], means.sizes["scheme"], len(keys))
    few = means[[*dict.fromkeys(limit.quantity for limit in rule_limits), "PF", "status"]]
    speeds = means["speed"].values
    margin, throughout = np.full(shape, np.nan), np.zeros(shape, dtype=bool)
    ranges, texts = np.empty(shape, dtype=object), np.empty(shape, dtype=object)
    for p, s in np.ndindex(shape[:2]):
        scheme_means = few.isel(policy=p, scheme=s)
        flow, statuses = scheme_means["PF"].values, scheme_means["status"].values.astype(str).tolist()
        missing = speeds_without_solution(speeds.tolist(), statuses)
        values = {limit.quantity: scheme_means[limit.quantity].values for limit in rule_limits}
        distances = _margins(values, rule_limits)
        for k, margins in enumerate(distances.values()):
            margin[p, s, k] = margins[speeds == case_speed][0]
            throughout[p, s, k] = bool((margins >= 0.0).all())
            of = [o for o in rule_limits if keys[k] == o.name or (keys[k] == CRRT_LIMITS and o.of_crrt)]
            ranges[p, s, k] = limit_range(speeds, flow, *(distances[o.name] for o in of))
            noun = "its limits" if keys[k] == CRRT_LIMITS else "it"
            texts[p, s, k] = limit_range_text(ranges[p, s, k], missing, noun)
            if not any_bounded(of):
                texts[p, s, k] = f"{NO_LIMITS}; {missing}" if missing else NO_LIMITS
    dims = ("policy", "scheme", "limit")
    data: Variables = {
        name: (dims, np.array([getattr(each, field) for each in ranges.flat]).reshape(shape), about)
        for name, (field, about) in _COLUMNS.items()
    }
    about = {"units": "mmHg", "long_name": "distance to the limit at the case's speed; negative: broken"}
    data["margin"] = (dims, margin, about)
    data["kept_throughout"] = (dims, throughout, {"long_name": "kept at every speed studied"})
    words = {"long_name": "up to which flow the limit is kept, in words"}
    data["in_words"] = (dims, texts.astype(str), words)
    return xr.Dataset(data, {"policy": means["policy"], "scheme": means["scheme"], "limit": keys})


_COLUMNS = {
    "largest_flow": ("flow", {"units": "L/min", "long_name": "largest ECMO flow known to keep the limit"}),
    "largest_speed": ("speed", {"units": "rpm", "long_name": "pump speed at that flow"}),
    "flow_at_most":
        ("flow_at_most", {"units": "L/min", "long_name": "flow that may keep the limit, at most"}),
    "state": ("state", {"long_name": "how far the limit is kept"}),
}  # fmt: skip


def _margins(values: Mapping[str, np.ndarray], rule_limits: tuple[Limit, ...]) -> dict[str, np.ndarray]:
    """Margin of each limit, and the smallest margin of the CRRT lines."""
    margins = {limit.name: limit.margin(values[limit.quantity]) for limit in rule_limits}
    margins[CRRT_LIMITS] = np.min([margins[limit.name] for limit in rule_limits if limit.of_crrt], axis=0)
    return margins


def limit_range(speeds: np.ndarray, flows: np.ndarray, *distances: np.ndarray) -> LimitRange:
    """Range up to which all limits are kept: the last speed that keeps them, and what is known above it.

    Margins are interpolated between neighbouring speeds, but not across a speed without a beat. Those of
    several limits are interpolated one by one, so that all limits are not kept further than any of them: the
    smallest of the margins has kinks, which a smooth curve rounds off.

    Args:
        speeds: increasing speeds [rpm].
        flows: ECMO flow at each speed [L/min].
        distances: margins of each limit [mmHg], negative if it is violated, inf without bounds, NaN if not
            known.
    """
    margins = np.min(distances, axis=0)
    known = ~np.isnan(margins) & np.isfinite(flows)
    keeping = np.flatnonzero(known & (np.where(known, margins, -1.0) >= 0.0))
    last = int(keeping[-1]) if len(keeping) else -1
    above = np.arange(last + 1, len(speeds))
    broken, missing = above[known[above]], above[~known[above]]
    if last < 0:
        if not len(missing):
            return LimitRange(NEVER, np.nan, np.nan, np.nan)
        return LimitRange(NOT_KNOWN, np.nan, np.nan, _next_flow(flows, broken[broken > missing[-1]]))
    lower = tuple(float(v) for v in speeds[:last][margins[:last] < 0.0])
    if not len(above):
        return LimitRange(KEPT_TO_THE_END, float(flows[last]), float(speeds[last]), float(flows[last]), lower)
    if len(broken) and broken[0] == last + 1:
        between = float(speeds[last]), float(speeds[last + 1])
        speed, flow = min(
            _crossing(speeds[known], flows[known], margins[known], between)
            for margins in distances
            if margins[last + 1] < 0.0
        )
        return LimitRange(BROKEN_ABOVE, flow, speed, flow, lower)
    at_most = max(_next_flow(flows, broken), float(flows[last]))
    return LimitRange(NOT_KNOWN_ABOVE, float(flows[last]), float(speeds[last]), at_most, lower)


def _next_flow(flows: np.ndarray, broken: np.ndarray) -> float:
    """Flow at the first speed that violates a limit; inf if there is none."""
    return float(flows[broken[0]]) if len(broken) else np.inf


def _crossing(
    speeds: np.ndarray, flows: np.ndarray, margins: np.ndarray, between: tuple[float, float]
) -> tuple[float, float]:
    """Speed and flow, between two speeds, from which the margin is negative, by monotone cubics."""
    from scipy.interpolate import PchipInterpolator

    kept, broken = between
    fine = np.linspace(speeds[0], speeds[-1], FINE_POINTS)
    fine = fine[fine <= broken]
    keeping = fine[PchipInterpolator(speeds, margins)(fine) >= 0.0]
    speed = float(max(kept, keeping[-1])) if len(keeping) else kept
    return speed, float(PchipInterpolator(speeds, flows)(speed))


def limit_range_text(reach: LimitRange, missing: str, noun: str = "its limits") -> str:
    """Return a sentence on the range of a limit, without its full stop.

    Args:
        reach: range up to which the limit is kept.
        missing: beats that were not found, with the reason; empty if all were found.
        noun: name of the limits in the sentence.
    """
    doubt = f"; {missing}" if missing else ""
    if reach.state == NEVER:
        return f"keeps {noun} at no speed studied"
    if reach.state == NOT_KNOWN:
        return f"keeps {noun} at no speed whose beat was found{doubt}"
    text = f"keeps {noun} up to {reach.flow:.1f} L/min"
    if reach.state == NOT_KNOWN_ABOVE:
        further = f" up to {reach.flow_at_most:.1f} L/min, where it is broken"
        further = further if reach.flow_at_most < np.inf else ""
        text += f" ({reach.speed:.0f} rpm); above that it is not known{further}: {missing}"
    elif reach.state == KEPT_TO_THE_END:
        text += f", the largest flow studied{doubt}"
    else:
        text += f" of ECMO flow{doubt}"
    return text + (f"; broken at {speeds_text(reach.broken_below)}" if reach.broken_below else "")


def limit_flow_text(flow: float, flow_at_most: float, to_the_end: bool, limited: bool = True) -> str:
    """ECMO flow that keeps a limit as text: "+" if kept at the largest speed, "≥" if not known above.

    Args:
        flow: largest flow known to keep it [L/min].
        flow_at_most: largest flow that may keep it [L/min].
        to_the_end: whether it is kept at the largest speed studied.
        limited: whether the rule sets such a limit at all.
    """
    if not limited:
        return "no limit"
    if math.isnan(flow):
        return "never" if math.isnan(flow_at_most) else "not known"
    if flow != flow_at_most:
        return f"≥ {flow:.1f}"
    return f"{flow:.1f}{'+' if to_the_end else ''}"


# --- probability of keeping limits, over samples of the patient's parameters ----------------------


QUANTITIES = ("Psart", "Pcrrttuin", "Pcrrttuout", "PF")
QUANTILES = (0.05, 0.5, 0.95)


def uncertainty(
    circuits: StudyCircuits,
    speed: float,
    policy: str,
    samples: Mapping[str, Sequence[float]],
    rule_limits: tuple[Limit, ...] = LIMITS,
) -> xr.Dataset:
    """Compute the probability that each scheme keeps each limit, and the spread of its pressures.

    Args:
        circuits: circuits of the study.
        speed: pump speed [rpm].
        policy: blood volume policy.
        samples: values by parameter, one per sample.
        rule_limits: limits of the rule.

    Returns:
        Over `scheme`: `settled`, the share of the samples with a steady beat that a patient can have (no
        chamber without blood, no vein sucked shut). From these samples only: `probability_kept` over `scheme`
        and `limit`, and `<quantity>_quantiles` over `scheme` and `quantile`; NaN if there are none. The share
        of all samples is between `probability_at_least`, if those without a beat violate the limit, and
        `probability_at_most`, if they keep it.
    """
    patients = {name: np.asarray(values, dtype=float) for name, values in samples.items()}
    records = circuits.run(np.array([speed]), policy, patients=patients)
    shape = (len(circuits.schemes), -1)
    possible = records.determined & ~records.collapsed
    settled = possible.reshape(shape)

    def values(name: str) -> np.ndarray:
        return np.where(possible, value(records, name), np.nan).reshape(shape)

    margins = _margins({o.quantity: values(o.quantity) for o in rule_limits}, rule_limits)
    counts = np.stack([(m >= 0.0).sum(axis=1) for m in margins.values()], axis=1)
    known, total = settled.sum(axis=1)[:, None], settled.shape[1]
    dims = ("scheme", "limit")
    of_known = np.where(known > 0, counts / np.maximum(known, 1), np.nan)
    data: Variables = {
        "probability_kept": (dims, of_known, {"units": "1"}),
        "probability_at_least": (dims, counts / total, {"units": "1"}),
        "probability_at_most": (dims, (counts + total - known) / total, {"units": "1"}),
        "settled": (("scheme",), settled.mean(axis=1), {"units": "1"}),
    }
    for name in QUANTITIES:
        with warnings.catch_warnings():  # NaN if no beat was found
            warnings.filterwarnings("ignore", message="All-NaN")
            quantiles = np.nanquantile(values(name), QUANTILES, axis=1).T
        of_output = name in output_names(circuits.circuit)
        labels = output_labels(name) if of_output else signal_labels(circuits.circuit, name)
        data[f"{name}_quantiles"] = (("scheme", "quantile"), quantiles, labels)
    letters = [s.letter for s in circuits.schemes]
    coordinates = {"scheme": letters, "limit": list(margins), "quantile": list(QUANTILES)}
    attributes = {"blood_volume_policy": policy, "samples": settled.shape[1], "speed_rpm": speed}
    return xr.Dataset(data, coordinates, attributes)


LIMITED_OUTPUTS = ("crrt_access_pressure", "crrt_return_pressure", "lowest_drainage_pressure")
"""Outputs with limits that the study shows in tables."""


def beat_warnings(
    circuits: StudyCircuits,
    run: SteadyBeat,
    members: Sequence[int],
    without_crrt: SteadyBeat,
    assumed: Sequence[str],
) -> tuple[str, ...]:
    """Warnings about the beats at the case's speed: without CRRT, and additional ones of schemes.

    Args:
        circuits: circuits of the study.
        run: beats of the schemes.
        members: indices of the members at the case's speed, one for each scheme; the first is also the index
            of the speed.
        without_crrt: beats of the patient on ECMO alone.
        assumed: sentences that are already shown.
    """
    alone = without_crrt.findings(members[0]) if without_crrt.determined[members[0]] else []
    schemes: dict[tuple[str, str], list[str]] = {}
    first: dict[tuple[str, str], str] = {}
    for scheme, member in zip(circuits.schemes, members, strict=True):
        for finding in run.findings(member) if run.determined[member] else ():
            key = finding.kind, finding.quantity
            if finding.quantity not in LIMITED_OUTPUTS and finding.sentence not in assumed:
                schemes.setdefault(key, []).append(scheme.letter)
                first.setdefault(key, *sentences([finding]))
    known = {(finding.kind, finding.quantity) for finding in alone}
    further = (finding for finding in alone if finding.quantity not in LIMITED_OUTPUTS)
    own = (placed_sentence("without CRRT", sentence) for sentence in sentences(further))
    more = (
        placed_sentence(f"scheme {', '.join(schemes[key])}", sentence)
        for key, sentence in first.items()
        if key not in known
    )
    return (*own, *more)
