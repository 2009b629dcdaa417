"""Base classes of components: `Storage` holds blood, `Path` carries it, `Exchanger` changes its contents.

A component defines its law and the parameters that the law needs, nothing else: no solver, no file, no plot.
The circuit says where the component is. Values reach a component as a mapping from parameter name to number
or array (one entry per patient of a batch), so one formula serves a single patient and a batch.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from types import ModuleType
from typing import ClassVar, Generic, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from eclsim import runtime as _runtime  # noqa: F401  (double precision before the first array)

Number = float | np.ndarray | jax.Array
"""Number, or array with one entry per patient of a batch."""
Values = Mapping[str, Number]
"""Value of each parameter."""
Renaming = Callable[[str], str]
Own = TypeVar("Own", bound="Component")
Source = TypeVar("Source", bound="Key | Component | None")
Constants = TypeVar("Constants")


def value_of(values: Values, key: Key) -> Number:
    """Value of a key."""
    if isinstance(key, tuple):
        return sum((values[name] for name in key[1:]), start=values[key[0]])
    if isinstance(key, Derived):
        return key.value(values)
    return values[key] if isinstance(key, str) else key


def names_in(source: Key | Component | None) -> tuple[str, ...]:
    """Names of the parameters that a key refers to or that a law reads."""
    if isinstance(source, Component):
        return source.parameter_names()
    if isinstance(source, tuple):
        return source
    return (source,) if isinstance(source, str) else ()


def renamed(source: Source, parameter: Renaming) -> Source:
    """The same key or law with its parameters renamed."""
    if isinstance(source, Component):
        return source.renamed(parameter)
    if isinstance(source, tuple):
        return tuple(map(parameter, source))  # pyright: ignore[reportReturnType]  # a tuple of names
    return parameter(source) if isinstance(source, str) else source  # pyright: ignore[reportReturnType]  # a number


class Component:
    """Base class of all laws. Its parameters are the fields of a frozen dataclass annotated as `Key`."""

    above_zero: ClassVar[tuple[str, ...]] = ()
    """Fields whose parameters must be above zero, such as a compliance."""
    not_negative: ClassVar[tuple[str, ...]] = ()
    """Fields whose parameters must not be negative, such as a resistance."""

    def _keys(self) -> tuple[str, ...]:
        return tuple(f.name for f in fields(self) if _is_key(f.type))  # pyright: ignore[reportArgumentType]  # laws are dataclasses

    def names_of(self, wanted: Iterable[str]) -> tuple[str, ...]:
        """Names of the parameters in the given fields."""
        return tuple(name for field in wanted for name in names_in(getattr(self, field)))

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters that the law reads."""
        return self.names_of(self._keys())

    def renamed(self: Own, parameter: Renaming) -> Own:
        """The same law with renamed parameters; override it if fields that are no `Key` hold names."""
        changes = {field: renamed(getattr(self, field), parameter) for field in self._keys()}
        other = replace(self, **changes)  # pyright: ignore[reportType, reportArgumentType]  # laws are dataclasses
        missed = set(other.parameter_names()) - set(map(parameter, self.parameter_names()))
        if missed:
            raise TypeError(
                f"{type(self).__name__}: cannot rename {', '.join(sorted(missed))}: annotate the fields that "
                "hold parameter names as Key, or override `renamed`"
            )
        return other


class Derived(Component, ABC):
    """A value computed from others, such as a share of a total; used in place of a parameter name."""

    @abstractmethod
    def value(self, values: Values) -> Number:
        """Return the value."""


Key = str | float | tuple[str, ...] | Derived
"""Source of a value: a parameter's name, a number, names whose values are summed, or a derived value."""


_KEY_WRITTEN = re.compile(r"(Optional\[)?(\w+\.)*Key( \| None)?\]?")


def _is_key(annotation: object) -> bool:
    """Whether a field's annotation is `Key`, with `None` or without; text where annotations are postponed."""
    if isinstance(annotation, str):
        return _KEY_WRITTEN.fullmatch(annotation.removeprefix("typing.")) is not None
    return annotation in (Key, Key | None)


@dataclass(frozen=True)
class Scaled(Derived):
    """A value multiplied by factors and divided by divisors, such as a branch's share of a total.

    Args:
        of: the total.
        by: factors.
        over: divisors.
    """

    of: Key
    by: tuple[Key, ...] = ()
    over: tuple[Key, ...] = ()

    def parameter_names(self) -> tuple[str, ...]:
        """Names in the total, the factors and the divisors."""
        return sum(map(names_in, (self.of, *self.by, *self.over)), ())

    def renamed(self, parameter: Renaming) -> Scaled:
        """The same quotient with its parameters renamed."""
        by, over = (tuple(renamed(key, parameter) for key in keys) for keys in (self.by, self.over))
        return Scaled(renamed(self.of, parameter), by, over)

    def value(self, values: Values) -> Number:
        """The total times the factors, divided by the divisors."""
        result = value_of(values, self.of)
        for key in self.by:
            result = result * value_of(values, key)
        for key in self.over:
            result = result / value_of(values, key)
        return result


@dataclass(frozen=True)
class Complement(Derived):
    """1 minus a value or a sum of values: the share that remains."""

    of: Key

    def value(self, values: Values) -> Number:
        """1 minus the sum."""
        return 1.0 - value_of(values, self.of)


@dataclass(frozen=True)
class PartTimes(Derived):
    """A sum with one part multiplied by a factor; at a factor of 1 it equals the sum to the last bit.

    Args:
        of: the sum, which includes `part`.
        part: parameter that is multiplied.
        factor: parameter that holds the factor.
        settings: parameters from which the factor is computed; listed so that the circuit has them as well.
    """

    of: Key
    part: Key
    factor: Key
    settings: Key = ()

    def value(self, values: Values) -> Number:
        """The sum with the part multiplied."""
        part = value_of(values, self.part)
        return value_of(values, self.of) + part * (value_of(values, self.factor) - 1.0)


class Activation(ABC):
    """Timing of a chamber's contraction: activation (0 at rest, 1 at peak) over the phase t / T."""

    @abstractmethod
    def at(self, phase: Number, xp: ModuleType) -> Number:
        """Activation at phases of 0 to 1; xp is the array module (numpy or jax.numpy)."""

    @property
    def break_points(self) -> tuple[float, ...]:
        """Phases of 0 to 1 where a derivative jumps; a time stepper should place a step boundary there."""
        return ()


class Storage(Component, ABC, Generic[Constants]):
    """A compartment's law: pressure [mmHg] and stiffness dP/dV [mmHg/mL] of its stressed volume [mL]."""

    constant_stiffness: ClassVar[bool] = False
    """Whether dP/dV depends on neither volume nor phase, so that it is computed once per beat."""

    narrows: ClassVar[bool] = False
    """Whether the outflow meets a resistance that depends on the compartment's volume (`outlet`)."""

    @property
    def activation(self) -> Activation | None:
        """Timing of the contraction; None for a passive compartment."""
        return None

    def constants(self, values: Values) -> Constants:
        """Constants computed once from the parameters, for `pressure`; by default the values themselves."""
        return values  # pyright: ignore[reportReturnType]  # what a law without this method is written for

    @abstractmethod
    def pressure(self, volume: Number, activation: Number, constants: Constants) -> tuple[Number, Number]:
        """Pressure [mmHg] and stiffness [mmHg/mL] at a stressed volume [mL] and an activation of 0 to 1."""

    def driven(self, values: Values) -> tuple[Number, float] | None:
        """Phase at which an external drive begins and its duration as a share of the beat, or None.

        The grid uses small steps there, as in systole.
        """
        return None

    def softens(self, volume: float, values: Values) -> bool:
        """Whether contraction lowers its pressure at a stressed volume [mL]: outside what the law is for."""
        return False

    def switching_times(self) -> tuple[str, ...]:
        """Names of its parameters that are phases of the beat: derivatives by them need a finer grid."""
        return ()

    def outlet(self, volume: Number, constants: Constants) -> Number:
        """Resistance [mmHg s/mL] in series with each connection that begins here; used if `narrows`."""
        raise NotImplementedError


class Enclosure(Component, ABC, Generic[Constants]):
    """Law of an enclosure around several compartments that adds one pressure to all of them."""

    def constants(self, values: Values) -> Constants:
        """Constants computed once from the parameters, for `pressure`; by default the values themselves."""
        return values  # pyright: ignore[reportReturnType]  # what a law without this method is written for

    @abstractmethod
    def pressure(self, volume: Number, constants: Constants) -> tuple[Number, Number]:
        """Pressure [mmHg] on the compartments and its slope [mmHg/mL], from the sum of their volumes [mL]."""


NEWTON_STEPS = 60


class Path(Component, ABC, Generic[Constants]):
    """A connection's law: the pressure drop [mmHg] at a flow [mL/s].

    A new component must define only `pressure_drop`. `flow` is its inverse under a series load,
    load * Q + drop(Q) = dp; the default solves it by Newton's method, a closed form is faster.
    """

    linear: ClassVar[bool] = False
    """Whether the drop is resistance * flow with a resistance that is constant over the beat."""
    one_way: ClassVar[bool] = False
    """Whether it opens and closes; its mean flow then does not follow from the flow at the steps' ends."""
    leaks: ClassVar[bool] = False
    """Whether blood also flows back through a one-way path, so that blood is not trapped behind it."""
    given_flow: ClassVar[bool] = False
    """Whether the flow is prescribed, independent of the pressures."""

    def is_leaking(self, values: Mapping[str, float]) -> bool:
        """Whether it leaks with these parameter values, which may be incomplete."""
        return self.leaks

    @property
    def inertial(self) -> bool:
        """Whether the flow has inertia and is a state of its own."""
        return False

    def constants(self, values: Values) -> Constants:
        """Constants computed once from the parameters and passed to the methods below."""
        return values  # pyright: ignore[reportReturnType]  # what a law without this method is written for

    def inertance(self, constants: Constants) -> Number:
        """Inertance [mmHg s^2/mL] of an inertial path."""
        raise NotImplementedError

    def resistance(self, constants: Constants) -> Number:
        """Resistance [mmHg s/mL] of a linear path."""
        raise NotImplementedError

    @abstractmethod
    def pressure_drop(self, flow: Number, constants: Constants) -> Number:
        """Pressure upstream minus downstream [mmHg] at a steady flow [mL/s]."""

    def flow(self, pressure_difference: Number, load: Number, constants: Constants) -> Number:
        """Flow [mL/s] with load * flow + pressure_drop(flow) = pressure_difference; load in mmHg s/mL.

        By Newton's method on a drop that rises with the flow; the bracket is halved where a step leaves it or
        is more than half of the last one, as beside an exponential. Slopes are bounded above 0 to avoid
        dividing by 0. Only the last step is differentiated, which gives the exact derivative of the root.
        """

        def excess(flow: Number) -> tuple[Number, Number]:
            drop, slope = jax.jvp(lambda q: self.pressure_drop(q, constants), (flow,), (jnp.ones_like(flow),))
            return load * flow + drop - pressure_difference, jnp.maximum(load + slope, 1e-9)

        def improved(_: int, state: tuple[Number, ...]) -> tuple[Number, ...]:
            low, high, last, flow = state
            above, slope = excess(flow)
            low, high = jnp.where(above <= 0.0, flow, low), jnp.where(above >= 0.0, flow, high)
            step = -above / slope
            inside = (flow + step > low) & (flow + step < high) & (jnp.abs(step) <= 0.5 * last)
            middle = 0.5 * (low + high)
            step = jnp.where(inside | ~jnp.isfinite(middle), step, middle - flow)
            return low, high, jnp.abs(step), flow + step

        start = jnp.zeros_like(pressure_difference + load)
        endless = jnp.full_like(start, jnp.inf)
        root = jax.lax.fori_loop(0, NEWTON_STEPS, improved, (-endless, endless, endless, start))[-1]
        flow = jax.lax.stop_gradient(root)
        above, slope = excess(flow)
        return flow - above / slope

    def sharpened(self: Own, smoothing: float) -> Own:
        """The law for an explicit solver; kinks, as of a valve, are rounded over `smoothing` [mmHg]."""
        return self


class Exchanger(Component):
    """Law of a site where gases or solutes enter or leave the blood.

    Examples are an oxygenator, the lungs, tissue and a dialyzer. The heartbeat does not use it: it moves no
    blood.
    """


# --- slow regulation --------------------------------------------------------------------------------


class ControlState(NamedTuple):
    """A state variable that a controller carries from beat to beat.

    `scale` is its typical change: one solver step changes it by at most `scale` plus half of its magnitude.
    """

    name: str
    scale: float = 1.0


class Controller(Component, ABC, Generic[Constants]):
    """A controller's law: maps its states and readings of one beat to its states one beat later.

        readings of the beat --> [ states ] --> values in effect during the next beat

    The circuit's table lists, in order, the readings it receives and the parameters it acts on. Every
    argument is a number, or an array with one entry per patient. In the steady beat the states after the beat
    equal those before it; they are solved for together with volumes and flows. `next_states` must therefore
    depend smoothly on readings and states, and `in_effect` should return values with which the circuit can be
    computed.
    """

    relative: ClassVar[bool] = False
    """Whether it scales or shifts the given value; several such controllers may act on one parameter."""

    @property
    @abstractmethod
    def states(self) -> tuple[ControlState, ...]:
        """States carried from beat to beat; empty if its action does not depend on the beat."""

    def constants(self, values: Values) -> Constants:
        """Constants computed once from the parameters and passed to the methods below."""
        return values  # pyright: ignore[reportReturnType]  # what a law without this method is written for

    @abstractmethod
    def start(self, constants: Constants) -> Sequence[Number]:
        """States at the start."""

    @abstractmethod
    def in_effect(
        self, states: Sequence[Number], values: Sequence[Number], constants: Constants
    ) -> Sequence[Number]:
        """Values in effect during a beat, computed from the given values of the parameters it acts on."""

    @abstractmethod
    def next_states(
        self, states: Sequence[Number], readings: Sequence[Number], period: Number, constants: Constants
    ) -> Sequence[Number]:
        """States one beat later; `period` is the length of the beat that was read [s]."""
