"""What a component is: a `Storage` keeps blood, a `Path` carries it, an `Exchanger` changes what is in it.

A component states its law and the parameters that the law needs, nothing else: no solver, no file, no plot.
The circuit says where it stands. Values reach a component as a mapping from parameter name to number or array
(one entry per patient of a batch), so every law is written once for one and for many.
"""

from __future__ import annotations

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
"""A number, or one for each patient of a batch."""
Values = Mapping[str, Number]
"""Value of each parameter."""
Renaming = Callable[[str], str]
Own = TypeVar("Own", bound="Component")
Source = TypeVar("Source", bound="Key | Component | None")
Constants = TypeVar("Constants")


def value_of(values: Values, key: Key) -> Number:
    """Value behind a key."""
    if isinstance(key, tuple):
        return sum((values[name] for name in key[1:]), start=values[key[0]])
    if isinstance(key, Derived):
        return key.value(values)
    return values[key] if isinstance(key, str) else key


def names_in(source: Key | Component | None) -> tuple[str, ...]:
    """Parameter names that a key refers to or that a law reads."""
    if isinstance(source, Component):
        return source.parameter_names()
    if isinstance(source, tuple):
        return source
    return (source,) if isinstance(source, str) else ()


def renamed(source: Source, parameter: Renaming) -> Source:
    """A key or law of other parameters."""
    if isinstance(source, Component):
        return source.renamed(parameter)
    if isinstance(source, tuple):
        return tuple(map(parameter, source))  # pyright: ignore[reportReturnType]  # a tuple of names
    return parameter(source) if isinstance(source, str) else source  # pyright: ignore[reportReturnType]  # a number


class Component:
    """What all laws share: parameters, the fields of a frozen dataclass that are annotated as `Key`."""

    above_zero: ClassVar[tuple[str, ...]] = ()
    """Fields whose parameters make no sense at zero or below, such as a compliance."""
    not_negative: ClassVar[tuple[str, ...]] = ()
    """Fields whose parameters make no sense below zero, such as a resistance."""

    def _keys(self) -> tuple[str, ...]:
        return tuple(f.name for f in fields(self) if f.type in ("Key", "Key | None", Key))  # pyright: ignore[reportArgumentType]  # laws are dataclasses

    def names_of(self, wanted: Iterable[str]) -> tuple[str, ...]:
        """Parameter names in some fields."""
        return tuple(name for field in wanted for name in names_in(getattr(self, field)))

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters that the law reads."""
        return self.names_of(self._keys())

    def renamed(self: Own, parameter: Renaming) -> Own:
        """The same law of other parameters; a law with names in fields that are no `Key` overrides it."""
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
    """A value that follows from others, such as a share of a total; stands where a name does."""

    @abstractmethod
    def value(self, values: Values) -> Number:
        """The value."""


Key = str | float | tuple[str, ...] | Derived
"""Where a value comes from: a parameter's name, a number, names to be summed, or a derived value."""


@dataclass(frozen=True)
class Scaled(Derived):
    """A value times factors, over divisors: a branch's share of a total.

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
        """The same of other parameters."""
        by, over = (tuple(renamed(key, parameter) for key in keys) for keys in (self.by, self.over))
        return Scaled(renamed(self.of, parameter), by, over)

    def value(self, values: Values) -> Number:
        """The product."""
        result = value_of(values, self.of)
        for key in self.by:
            result = result * value_of(values, key)
        for key in self.over:
            result = result / value_of(values, key)
        return result


@dataclass(frozen=True)
class Complement(Derived):
    """What shares leave of 1."""

    of: Key

    def value(self, values: Values) -> Number:
        """1 less the sum."""
        return 1.0 - value_of(values, self.of)


@dataclass(frozen=True)
class PartTimes(Derived):
    """A sum of which one part is multiplied by a factor; at a factor of 1 it is the sum to the last bit.

    Args:
        of: the sum, `part` among its names.
        part: parameter that is multiplied.
        factor: parameter, what by.
        settings: parameters that the factor follows from, which the circuit has with it.
    """

    of: Key
    part: Key
    factor: Key
    settings: Key = ()

    def value(self, values: Values) -> Number:
        """The sum with the part changed."""
        part = value_of(values, self.part)
        return value_of(values, self.of) + part * (value_of(values, self.factor) - 1.0)


class Activation(ABC):
    """When a chamber contracts: activation (0 at rest, 1 at peak) over the phase t / T of the beat."""

    @abstractmethod
    def at(self, phase: Number, xp: ModuleType) -> Number:
        """Activation at phases of 0 to 1; xp is the array module (numpy or jax.numpy)."""

    @property
    def break_points(self) -> tuple[float, ...]:
        """Phases of 0 to 1 where a derivative jumps: a stepper puts a step boundary there."""
        return ()


class Storage(Component, ABC, Generic[Constants]):
    """A compartment's law: pressure [mmHg] and stiffness dP/dV [mmHg/mL] of its stressed volume [mL]."""

    constant_stiffness: ClassVar[bool] = False
    """Whether dP/dV depends on neither volume nor phase, so that it can be computed once a beat."""

    narrows: ClassVar[bool] = False
    """Whether what leaves it meets a resistance that depends on its volume (`outlet`)."""

    @property
    def activation(self) -> Activation | None:
        """Timing of the contraction; None for a passive compartment."""
        return None

    def constants(self, values: Values) -> Constants:
        """What can be computed once from the parameters; handed back to `pressure`. Left out, the values."""
        return values  # pyright: ignore[reportReturnType]  # what a law without this method is written for

    @abstractmethod
    def pressure(self, volume: Number, activation: Number, constants: Constants) -> tuple[Number, Number]:
        """Pressure [mmHg] and stiffness [mmHg/mL] at a stressed volume [mL] and an activation of 0 to 1."""

    def driven(self, values: Values) -> tuple[Number, float] | None:
        """Phase at which it is moved from outside, and the share of the beat that this takes; None for most.

        Steps are fine there, as they are in systole.
        """
        return None

    def outlet(self, volume: Number, constants: Constants) -> Number:
        """Resistance [mmHg s/mL] in series with each connection that begins here; asked if it `narrows`."""
        raise NotImplementedError


class Enclosure(Component, ABC, Generic[Constants]):
    """The law of what surrounds several compartments and adds one pressure to all of them."""

    def constants(self, values: Values) -> Constants:
        """What can be computed once from the parameters; handed back to `pressure`. Left out, the values."""
        return values  # pyright: ignore[reportReturnType]  # what a law without this method is written for

    @abstractmethod
    def pressure(self, volume: Number, constants: Constants) -> tuple[Number, Number]:
        """Pressure [mmHg] on the compartments and its slope [mmHg/mL], from the sum of their volumes [mL]."""


class Path(Component, ABC, Generic[Constants]):
    """A connection's law: the pressure drop [mmHg] that goes with a flow [mL/s].

    `pressure_drop` is all that a new component must state. `flow` is its inverse under a series load,
    load * Q + drop(Q) = dp; the default solves it by Newton's method, a closed form is faster.
    """

    linear: ClassVar[bool] = False
    """Whether the drop is resistance * flow with a resistance that is constant over the beat."""
    one_way: ClassVar[bool] = False
    """Whether it opens and shuts: its mean flow then does not follow from the flow at the ends of steps."""
    leaks: ClassVar[bool] = False
    """Whether blood passes it backwards although it is one-way: what lies behind it is never shut in."""
    given_flow: ClassVar[bool] = False
    """Whether the flow is given whatever the pressures."""

    @property
    def inertial(self) -> bool:
        """Whether the flow has inertia and is a state of its own."""
        return False

    def constants(self, values: Values) -> Constants:
        """What can be computed once from the parameters; handed back to the methods below."""
        return values  # pyright: ignore[reportReturnType]  # what a law without this method is written for

    def inertance(self, constants: Constants) -> Number:
        """Inertance [mmHg s^2/mL] of an inertial path."""
        raise NotImplementedError

    def resistance(self, constants: Constants) -> Number:
        """Resistance [mmHg s/mL] of a linear path."""
        raise NotImplementedError

    @abstractmethod
    def pressure_drop(self, flow: Number, constants: Constants) -> Number:
        """Pressure upstream minus downstream [mmHg] that a steady flow [mL/s] takes."""

    def flow(self, pressure_difference: Number, load: Number, constants: Constants) -> Number:
        """Flow [mL/s] with load * flow + pressure_drop(flow) = pressure_difference; load in mmHg s/mL."""
        return _newton_flow(self, pressure_difference, load, constants)

    def sharpened(self: Own, smoothing: float) -> Own:
        """The law for an explicit solver; `smoothing` [mmHg] where it rounds a kink off, as a valve does."""
        return self


class Exchanger(Component):
    """The law of a place where what is dissolved in blood enters or leaves it.

    An oxygenator, the lungs, tissue or a dialyzer. The beat does not ask for it: it moves no blood.
    """


def _newton_flow(
    path: Path[Constants],
    pressure_difference: Number,
    load: Number,
    constants: Constants,
    iterations: int = 40,
) -> Number:
    """Newton's method on a monotone drop; slopes are kept positive, so a flat start cannot divide by 0.

    The last step alone is differentiated, which gives the exact derivative of the root.
    """

    def improved(flow: Number) -> Number:
        drop, slope = jax.jvp(lambda q: path.pressure_drop(q, constants), (flow,), (jnp.ones_like(flow),))
        return flow + (pressure_difference - drop - load * flow) / jnp.maximum(load + slope, 1e-9)

    start = jnp.zeros_like(pressure_difference + load)
    root = jax.lax.fori_loop(0, iterations, lambda _, flow: improved(flow), start)
    return improved(jax.lax.stop_gradient(root))


# --- slow regulation --------------------------------------------------------------------------------


class ControlState(NamedTuple):
    """One number that a controller keeps from beat to beat.

    `scale` is its typical change: a search moves it by no more than this and half of its size at once.
    """

    name: str
    scale: float = 1.0


class Controller(Component, ABC, Generic[Constants]):
    """A controller's law: a map from its states and what it reads off a beat to its states a beat later.

        readings of the beat --> [ states ] --> values in effect during the next beat

    The circuit's table says which readings it gets and which parameters it acts on, in which order. Every
    argument is a number, or one for each patient. The steady beat is the one after which the states are as
    before it; they are solved for together with volumes and flows, so that `next_states` must depend smoothly
    on readings and states, and `in_effect` should stay within what the circuit can be computed with.
    """

    relative: ClassVar[bool] = False
    """Whether it multiplies or shifts what it is given, so that several such may act on one parameter."""

    @property
    @abstractmethod
    def states(self) -> tuple[ControlState, ...]:
        """What it keeps from beat to beat; none where it acts the same whatever the beat."""

    def constants(self, values: Values) -> Constants:
        """What can be computed once from the parameters; handed back to the methods below."""
        return values  # pyright: ignore[reportReturnType]  # what a law without this method is written for

    @abstractmethod
    def start(self, constants: Constants) -> Sequence[Number]:
        """States at the start."""

    @abstractmethod
    def in_effect(
        self, states: Sequence[Number], values: Sequence[Number], constants: Constants
    ) -> Sequence[Number]:
        """Values in effect during a beat, from the given values of the parameters it acts on."""

    @abstractmethod
    def next_states(
        self, states: Sequence[Number], readings: Sequence[Number], period: Number, constants: Constants
    ) -> Sequence[Number]:
        """States a beat later; `period` is the length of the beat that was read [s]."""
