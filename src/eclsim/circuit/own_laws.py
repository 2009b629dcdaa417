"""Check of laws from outside the package at given parameter values, before anything is computed with them.

The solver finds a flow as the root of a pressure drop that rises with the flow. With a drop that falls
somewhere it may settle between two roots: the beat then closes, but blood appears or vanishes. The laws of
the package are tested to rise; others are sampled here over the flows that occur in adults.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from eclsim.circuit.network import Circuit
from eclsim.components.base import Component, Path, Storage
from eclsim.components.exchangers import GasExchanger, Points
from eclsim.spelling import spelling_hint
from eclsim.units import ML_S_PER_L_MIN

LARGEST_FLOW_L_MIN = 10.0
"""Largest flow in either direction at which a law is sampled."""
_FINE = np.geomspace(1e-4, LARGEST_FLOW_L_MIN, 120)
_FLOWS = np.unique(np.concatenate([-_FINE, [0.0], _FINE, np.linspace(-1.0, 1.0, 401) * LARGEST_FLOW_L_MIN]))
_ROUNDING = 1e-10
"""Fall between two samples, as a share of the drop, that is rounding."""
_GASES = ((40.0, 46.0), (90.0, 40.0), (400.0, 30.0))
"""Partial pressures of oxygen and carbon dioxide [mmHg] of venous, arterial and oxygenated blood."""
_VOLUMES_ML = np.linspace(0.0, 200.0, 41)
"""Volumes at which the law of a store is sampled."""
_COMPILED = "a law is compiled: write jnp.where in place of if, jnp in place of math and NumPy, no float()"
_RULE = "the drop, upstream minus downstream, must rise with the flow; see docs/add-a-component.md"


def is_own(law: Component) -> bool:
    """Whether a law comes from outside the package."""
    return not type(law).__module__.startswith("eclsim.")


def mistakes_of_own_laws(circuit: Circuit, values: Mapping[str, float]) -> list[str]:
    """One sentence for each law from outside the package that the solver cannot use at these values.

    Args:
        circuit: the circuit.
        values: parameter values; a law is left out if some of its own are missing or not allowed.
    """
    result = []
    for law, what in _own(circuit):
        names = dict.fromkeys(law.parameter_names())
        if all(name in values and math.isfinite(values[name]) for name in names) and _allowed(law, values):
            fault = _fault(law, tuple((name, float(values[name])) for name in names))
            result += [f"{what} ({type(law).__name__}): {fault}"] if fault else []
    return result


def cause(error: Exception, frame_of: str = "") -> str:
    """Text for an error in code of a user: the line of the file and what to do, where that is known."""
    places = traceback.extract_tb(error.__traceback__)
    own = [at for at in places if at.filename == frame_of]
    where = f" ({own[-1].filename}, line {own[-1].lineno})" if own else ""
    if type(error).__module__.startswith("jax"):
        return f"{type(error).__name__}{where}: {_COMPILED}"
    return f"{type(error).__name__}: {' '.join(str(error).split())}{where}"


@lru_cache(maxsize=256)
def _own(circuit: Circuit) -> tuple[tuple[Component, str], ...]:
    """Laws from outside the package that are checked, each with its place in words."""
    stores = ((c.component, f"compartment '{c.name}'") for c in circuit.compartments)
    paths = ((c.component, f"connection '{c.name}'") for c in circuit.connections)
    exchanges = ((e.component, f"exchange '{e.name}'") for e in circuit.exchanges)
    return tuple(
        (law, what)
        for law, what in (*stores, *paths, *exchanges)
        if is_own(law) and isinstance(law, tuple(_CHECKS)) and not (isinstance(law, Path) and law.given_flow)
    )


def _allowed(law: Component, values: Mapping[str, float]) -> bool:
    """Whether the values are those that the law accepts; others are refused by name elsewhere."""
    above = all(values[name] > 0.0 for name in law.names_of(law.above_zero))
    return above and all(values[name] >= 0.0 for name in law.names_of(law.not_negative))


@lru_cache(maxsize=4096)
def _fault(law: Component, given: tuple[tuple[str, float], ...]) -> str:
    """What is wrong with a law at its parameter values; empty if nothing is."""
    check = next(check for kind, check in _CHECKS.items() if isinstance(law, kind))
    values = dict(given)
    try:
        return check(law, values)
    except KeyError as error:
        name = str(error.args[0]) if error.args else ""
        return _unnamed(law, name, values) or cause(error, _file_of(law))
    except Exception as error:
        return cause(error, _file_of(law))


def _file_of(law: Component) -> str:
    """File that defines a law."""
    methods = (getattr(type(law), name, None) for name in ("pressure_drop", "pressure", "rates"))
    return next(method.__code__.co_filename for method in methods if method is not None)


def _unnamed(law: Component, name: str, values: Mapping[str, float]) -> str:
    """Text for a parameter that a law reads though no field names it."""
    holding = [f.name for f in fields(law) if name in np.atleast_1d(getattr(law, f.name))]  # pyright: ignore[reportArgumentType]
    if holding:
        field = holding[0]
        return f"it reads {name!r}, but the annotation of `{field}` is not Key: write `{field}: Key`"
    return f"it reads {name!r}, which no field annotated as Key names{spelling_hint(name, values)}"


def _fault_of_path(law: Any, values: Mapping[str, float]) -> str:
    constants = law.constants(values)
    # A valve whose own `flow` never runs backwards needs no drop of backward flow.
    forward = law.one_way and type(law).flow is not Path.flow
    flows = _FLOWS[_FLOWS >= 0.0] if forward else _FLOWS
    with np.errstate(all="ignore"):
        drops, slopes = _sampled(lambda flow: law.pressure_drop(flow, constants), flows * ML_S_PER_L_MIN)
    if drops.shape != flows.shape:
        return "`pressure_drop` must return one number for a flow"
    return _not_finite(flows, drops, slopes) or _falling(flows, drops)


def _sampled(drop: Callable[[Any], Any], flows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Drop and slope at flows [mL/s], traced as the solver does."""

    def both(flow: Any) -> Any:
        return jax.jvp(lambda q: drop(q) + 0.0 * q, (flow,), (jnp.ones_like(flow),))

    drops, slopes = jax.vmap(both)(jnp.asarray(flows))
    return np.asarray(drops), np.asarray(slopes)


def _not_finite(flows: np.ndarray, drops: np.ndarray, slopes: np.ndarray) -> str:
    """Text for drops that are no numbers; a drop that becomes infinite far from 0 is allowed."""
    bad = np.isnan(drops) | (np.isinf(drops) & (np.sign(drops) != np.sign(flows)))
    if bad.any():
        return f"its pressure drop is not finite {_range(flows[bad])}; {_RULE}"
    bad = ~np.isfinite(slopes) & np.isfinite(drops) & (np.abs(flows) < 1.0)
    if bad.any():
        way = "round it there, as by a linear part; inside jnp.where both branches must be finite"
        return f"the slope of its pressure drop is not finite {_range(flows[bad])}: {way}"
    return ""


def _falling(flows: np.ndarray, drops: np.ndarray) -> str:
    """Text for the widest range of flows in which the drop falls."""
    with np.errstate(invalid="ignore"):
        steps = np.diff(drops)
    size = np.maximum(np.abs(drops[1:]), np.abs(drops[:-1]))
    falls = steps < -_ROUNDING * np.maximum(size, 1.0)
    if not falls.any():
        return ""
    if falls.all():
        return f"its pressure drop falls at all flows: is its sign reversed? {_RULE}"
    edges = np.flatnonzero(np.diff(np.concatenate([[False], falls, [False]]).astype(int)))
    first, last = max(edges.reshape(-1, 2), key=lambda pair: flows[pair[1]] - flows[pair[0]])
    ends = flows[[first, last]]
    remedy = "write Q |Q| in place of Q^2, or continue a fitted curve by a rising line"
    return (
        f"its pressure drop falls by {drops[first] - drops[last]:.3g} mmHg {_range(ends)}, so that more than "
        f"one flow is possible; {_RULE}: {remedy}"
    )


def _range(flows: Iterable[float]) -> str:
    low, high = min(flows), max(flows)
    return f"at {low:.3g} L/min" if low == high else f"between {low:.3g} and {high:.3g} L/min"


class _NoPairError(Exception):
    """A law returned something else than pressure and stiffness."""


def _pair(found: Any) -> tuple[Any, Any]:
    """Return what a law of a store returned as pressure and stiffness."""
    try:
        pressure, stiffness = found
    except (TypeError, ValueError):
        raise _NoPairError from None
    if jnp.ndim(pressure) or jnp.ndim(stiffness):
        raise _NoPairError
    return pressure, stiffness


def _fault_of_storage(law: Any, values: Mapping[str, float]) -> str:
    constants = law.constants(values)

    def pressure(volume: Any) -> tuple[Any, Any]:
        moments = [_pair(law.pressure(volume, activation, constants)) for activation in (0.0, 0.5, 1.0)]
        pressures, stiffnesses = zip(*moments, strict=True)
        return jnp.stack(jnp.broadcast_arrays(*pressures)), jnp.stack(jnp.broadcast_arrays(*stiffnesses))

    try:
        found = jax.vmap(pressure)(jnp.asarray(_VOLUMES_ML))
    except _NoPairError:
        return "`pressure` must return two numbers, pressure [mmHg] and stiffness dP/dV [mmHg/mL]"
    for what, numbers in zip(("pressure", "stiffness"), map(np.asarray, found), strict=True):
        if not np.isfinite(numbers).any(axis=0).all():
            return f"its {what} is finite at no volume from 0 to {_VOLUMES_ML[-1]:g} mL"
    return ""


def _fault_of_exchanger(law: Any, values: Mapping[str, float]) -> str:
    for oxygen, carbon_dioxide in _GASES:
        pressure = jnp.repeat(jnp.array([[oxygen], [carbon_dioxide]]), law.points, axis=1)
        ones = jnp.ones(law.points)
        inside = Points(jnp.zeros_like(pressure), pressure, oxygen * ones, 7.4 * ones)
        rates = np.asarray(jax.jit(lambda flow, at: law.rates(flow, at, values))(jnp.asarray(4.0), inside))
        at = f"at a PO2 of {oxygen:g} and a PCO2 of {carbon_dioxide:g} mmHg"
        if rates.shape != pressure.shape:
            return f"`rates` has the shape {rates.shape}; allowed: (2, points), here {pressure.shape}"
        if not np.isfinite(rates).all():
            return f"`rates` is not finite {at}: correct the law, not the patient's ventilation"
    return ""


_CHECKS: dict[type, Callable[[Any, Mapping[str, float]], str]] = {
    Path: _fault_of_path,
    Storage: _fault_of_storage,
    GasExchanger: _fault_of_exchanger,
}
