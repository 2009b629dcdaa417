"""Blood gases: contents from partial pressures, and partial pressures from contents or a saturation."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from types import ModuleType
from typing import NamedTuple, Unpack

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from eclsim.blood import dash2016, standard
from eclsim.blood.acid_base import base_excess_of, bicarbonate, ph_of
from eclsim.blood.checks import blood_of, refuse_arguments, refuse_excess, refuse_names, refuse_results
from eclsim.blood.types import Array, Blood, Given, Values
from eclsim.runtime import refuse_single_precision  # its import sets double precision, before the first array

LAWS: dict[str, ModuleType] = {"severinghaus1979": standard, "dash2016": dash2016}
"""Sets of equations by name: modules with the functions `saturation` and `held`."""
STEPS = 60
"""Largest number of damped Newton steps from contents to pressures; most need fewer than ten."""
STEP_TOLERANCE = 1e-9
"""Size of the last step, in the logarithm of a partial pressure, below which the iteration stops."""
LARGEST_STEP = 1.0
"""Largest Newton step in the logarithm of a partial pressure."""
TRACE = 1e-9
"""Content of oxygen [mL/dL] at which blood without any has, to rounding, its PCO2: 0 has no logarithm."""


class BloodGases(NamedTuple):
    """Gases of blood at equilibrium, arrays of a common shape.

    Attributes:
        po2: partial pressure of oxygen [mmHg].
        pco2: partial pressure of carbon dioxide [mmHg].
        ph: pH of plasma [-].
        saturation: oxygen saturation of haemoglobin [-].
        bicarbonate: bicarbonate in plasma [mmol/L].
        oxygen: content of oxygen [mL/dL STPD].
        carbon_dioxide: content of carbon dioxide [mL/dL STPD].
    """

    po2: jax.Array
    pco2: jax.Array
    ph: jax.Array
    saturation: jax.Array
    bicarbonate: jax.Array
    oxygen: jax.Array
    carbon_dioxide: jax.Array


_Pair = tuple[jax.Array, jax.Array]
"""Values of oxygen, then of carbon dioxide."""


class _Search(NamedTuple):
    """State of the iteration for pressures: their logarithms, number of steps, size of the last step."""

    at: _Pair
    steps: jax.Array
    error: jax.Array


def gases(
    *,
    po2: Values,
    pco2: Values = 40.0,
    ph: Values | None = None,
    law: str = "severinghaus1979",
    **of: Unpack[Given],
) -> BloodGases:
    """Saturation, pH and contents of blood at given partial pressures.

    Args:
        po2: partial pressure of oxygen [mmHg].
        pco2: partial pressure of carbon dioxide [mmHg].
        ph: measured pH of plasma, in place of `base_excess`.
        law: a name of `LAWS`.
        of: `haemoglobin` [g/dL], `base_excess` of fully oxygenated blood [mmol/L], `temperature` [C]; for
            "severinghaus1979" `oxygen_capacity` [mL/g], for "dash2016" `dpg`, 2,3-diphosphoglycerate in
            the red cells [mmol/L]; by default 15, 0, 37, 1.34 and 4.65.

    Returns:
        Arrays of the arguments' common shape.

    Raises:
        TypeError: there is no such argument, or a value is no number.
        ValueError: the law is unknown or does not use an argument, or values are impossible in these units
            or together; lists all mistakes. Values under `jax.jit` and `jax.grad` are not checked.
    """
    blood, (po2, pco2) = _checked("gases", {"po2": po2, "pco2": pco2}, ph, law, of)
    if ph is not None:
        blood = _with_ph(ph, lambda at: law_named(law).saturation(po2, pco2, at, blood), pco2, blood)
        po2, pco2 = _common(blood, po2, pco2)
    found = _at_pressures(po2, pco2, blood, law)
    refuse_results(found, {"po2": po2, "pco2": pco2}, blood)
    return found


def gases_with_contents(
    *, oxygen: Values, carbon_dioxide: Values, law: str = "severinghaus1979", **of: Unpack[Given]
) -> BloodGases:
    """Blood gases at given contents [mL/dL STPD].

    Contents that no blood of this haemoglobin holds at the pressures allowed in `gases` raise `ValueError`.
    Under `jax.jit` they are not checked: NaN if no pressures between 1e-9 and 1e6 mmHg give them.

    Other arguments and errors as in `gases`.
    """
    given = {"oxygen": oxygen, "carbon_dioxide": carbon_dioxide}
    blood, wanted = _checked("gases_with_contents", given, None, law, of)
    none = np.zeros(1, bool) if isinstance(wanted[0], Tracer) else np.asarray(wanted[0]) == 0.0
    some = np.where(none, TRACE, wanted[0]) if none.any() else wanted[0]
    start = np.full(some.shape, math.log(40.0)), np.full(some.shape, math.log(45.0))
    found = _at_contents(start, (some, wanted[1]), blood, law)
    if none.any():
        without = _at_pressures(np.zeros(some.shape), found.pco2, blood, law)
        found = BloodGases(*(jnp.where(none, a, b) for a, b in zip(without, found, strict=True)))
    refuse_results(found, {"oxygen": wanted[0], "carbon_dioxide": wanted[1]}, blood)
    return found


def gases_with_saturation(
    *,
    saturation: Values,
    pco2: Values = 40.0,
    ph: Values | None = None,
    law: str = "severinghaus1979",
    **of: Unpack[Given],
) -> BloodGases:
    """Blood gases at a given saturation [-] and PCO2 [mmHg]; NaN if the saturation is 0 or 1.

    Other arguments and errors as in `gases`. P50 is the PO2 at a saturation of 0.5 with `ph=7.4`: without it
    the pH is 7.42, since blood of base excess 0 when oxygenated is less acid when it has given off oxygen.
    """
    given = {"saturation": saturation, "pco2": pco2}
    blood, (wanted, pco2) = _checked("gases_with_saturation", given, ph, law, of)
    if ph is not None:
        blood = _with_ph(ph, lambda _: wanted, pco2, blood)
        wanted, pco2 = _common(blood, wanted, pco2)
    found = _at_saturation(wanted, pco2, blood, law)
    if not isinstance(wanted, Tracer):
        known = np.where((wanted > 0.0) & (wanted < 1.0), wanted, np.nan)
        refuse_results(found, {"saturation": known, "pco2": pco2}, blood)
    return found


def base_excess(
    *,
    ph: Values,
    pco2: Values = 40.0,
    saturation: Values = 1.0,
    haemoglobin: Values = 15.0,
    temperature: Values = 37.0,
) -> Array:
    """Base excess of fully oxygenated blood [mmol/L] from a measured pH, PCO2 [mmHg] and saturation [-].

    It is the same in arteries, veins and after an oxygenator, and is what the other functions take.

    Raises:
        TypeError: a value is no number.
        ValueError: values are impossible in these units or together.
    """
    given = {"pco2": pco2, "saturation": saturation}
    of: Given = {"haemoglobin": haemoglobin, "temperature": temperature}
    blood, (pco2, saturation) = _checked("base_excess", given, ph, "severinghaus1979", of)
    return _with_ph(ph, lambda _: saturation, pco2, blood).base_excess


def _checked(
    function: str, given: dict[str, Values], ph: Values | None, law: str, of: Given
) -> tuple[Blood, list[np.ndarray | jax.Array]]:
    """Blood, and the values of a function in the arguments' common shape, after checks of all."""
    refuse_single_precision()
    measured = {} if ph is None else {"ph": ph}
    refuse_names(function, of, (*given, *(() if function == "gases_with_contents" else ("ph",))))
    if measured and "base_excess" in of:
        raise ValueError("ph and base_excess: one follows from the other; allowed: one of them")
    law_named(law)
    refuse_arguments({**given, **measured, **of}, law)
    blood = blood_of(of)
    return blood, _common(blood, *given.values())


def _with_ph(ph: Values, saturation_at: Callable[[Array], Array], pco2: Array, blood: Blood) -> Blood:
    """Blood with the base excess that gives a measured pH.

    Args:
        ph: pH of plasma.
        saturation_at: oxygen saturation [-] as a function of pH.
        pco2: partial pressure of carbon dioxide [mmHg].
        blood: the blood's other properties.
    """
    measured = ph if isinstance(ph, jax.Array) else np.asarray(ph, dtype=float)
    excess = base_excess_of(pco2, measured, saturation_at(measured), blood)
    refuse_excess(excess, {"ph": measured, "pco2": pco2})
    return blood._replace(base_excess=excess)


def equilibrium(po2: Array, pco2: Array, blood: Blood, law: str) -> BloodGases:
    """Saturation, pH and contents of `blood` at partial pressures [mmHg] of the same shape."""
    chosen = law_named(law)
    ph = ph_of(pco2, blood, lambda at: chosen.saturation(po2, pco2, at, blood))
    held = chosen.held(po2, pco2, ph, blood)
    return BloodGases(
        jnp.asarray(po2),
        jnp.asarray(pco2),
        jnp.asarray(ph),
        held.saturation,
        jnp.asarray(bicarbonate(pco2, ph, blood.temperature)),
        held.oxygen,
        held.carbon_dioxide,
    )


def law_named(name: str) -> ModuleType:
    """Module with the set of equations of a name; raises `ValueError`, with all names, if unknown."""
    if name not in LAWS:
        raise ValueError(f"blood law '{name}'; allowed: {', '.join(LAWS)}")
    return LAWS[name]


_at_pressures = jax.jit(equilibrium, static_argnames="law")


@partial(jax.jit, static_argnames="law")
def _at_contents(start: _Pair, wanted: _Pair, blood: Blood, law: str) -> BloodGases:
    """Newton's method on the logarithms of both pressures, elementwise."""
    fixed = jax.lax.stop_gradient((wanted, blood))

    def residual(at: _Pair, to: _Pair, blood: Blood) -> _Pair:
        solution = equilibrium(jnp.exp(at[0]), jnp.exp(at[1]), blood, law)
        return solution.oxygen - to[0], solution.carbon_dioxide - to[1]

    def newton(at: _Pair, to: _Pair, blood: Blood) -> _Pair:
        one, none = jnp.ones_like(at[0]), jnp.zeros_like(at[0])
        value, (a, c) = jax.jvp(lambda x: residual(x, to, blood), (at,), ((one, none),))
        _, (b, d) = jax.jvp(lambda x: residual(x, to, blood), (at,), ((none, one),))
        determinant = a * d - b * c
        return (d * value[0] - b * value[1]) / determinant, (a * value[1] - c * value[0]) / determinant

    def improved(search: _Search) -> _Search:
        move = newton(search.at, *fixed)
        at = tuple(
            jnp.clip(x - jnp.clip(step, -LARGEST_STEP, LARGEST_STEP), jnp.log(1e-9), jnp.log(1e6))
            for x, step in zip(search.at, move, strict=True)
        )
        size = jnp.maximum(jnp.abs(move[0]), jnp.abs(move[1])).max(initial=0.0)
        return _Search((at[0], at[1]), search.steps + 1, size)

    def unfinished(search: _Search) -> jax.Array:
        return (search.steps < STEPS) & ~(search.error < STEP_TOLERANCE)  # NaN has not converged

    begun = _Search(start, jnp.array(0), jnp.array(jnp.inf))
    at = jax.lax.stop_gradient(jax.lax.while_loop(unfinished, improved, begun).at)
    move = newton(at, wanted, blood)
    left = [jnp.abs(jax.lax.stop_gradient(step)) for step in move]
    solved = jnp.maximum(*left) < 1e-6
    po2, pco2 = (jnp.where(solved, jnp.exp(x - step), jnp.nan) for x, step in zip(at, move, strict=True))
    return equilibrium(po2, pco2, blood, law)


@partial(jax.jit, static_argnames="law")
def _at_saturation(wanted: jax.Array, pco2: jax.Array, blood: Blood, law: str) -> BloodGases:
    """Newton's method on the logarithm of PO2, elementwise."""
    chosen = law_named(law)

    def residual(log_po2: Array) -> Array:
        po2 = jnp.exp(log_po2)
        ph = ph_of(pco2, blood, lambda _: wanted)
        reached = chosen.saturation(po2, pco2, ph, blood)
        return jnp.log(reached / (1.0 - reached)) - jnp.log(wanted / (1.0 - wanted))

    log_po2 = jnp.log(standard.severinghaus_pressure(wanted))

    def improved(_: int, at: jax.Array) -> jax.Array:
        value, slope = jax.jvp(residual, (at,), (jnp.ones_like(at),))
        return at - jnp.clip(value / slope, -LARGEST_STEP, LARGEST_STEP)

    solution = jax.lax.stop_gradient(jax.lax.fori_loop(0, 20, improved, jax.lax.stop_gradient(log_po2)))
    slope = jax.jvp(residual, (solution,), (jnp.ones_like(solution),))[1]
    return equilibrium(
        jnp.exp(solution - residual(solution) / jax.lax.stop_gradient(slope)), pco2, blood, law
    )


def _common(blood: Blood, *values: Values) -> list[np.ndarray | jax.Array]:
    """Broadcast values to the common shape of all, and of the properties of `blood`.

    Numbers stay in NumPy: one JAX operation outside a compiled program takes as long as the whole program.
    """
    shape = np.broadcast_shapes(*map(np.shape, (*values, *blood)))
    return [
        jnp.broadcast_to(jnp.asarray(value, dtype=float), shape)
        if isinstance(value, jax.Array)
        else np.broadcast_to(np.asarray(value, dtype=float), shape)
        for value in values
    ]
