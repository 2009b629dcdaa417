"""Gas exchange with given flows: an oxygenator on the bench, and a patient on V-V ECMO."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from eclsim.blood.gases import gases_with_contents, gases_with_saturation
from eclsim.components.base import Values
from eclsim.components.exchangers import GasExchanger, MembraneLung, NativeLung, Points, Tissue
from eclsim.devices.ecmo import ECMO, MEMBRANE, OXYGENATORS
from eclsim.devices.registry import parameters
from eclsim.gas.steady import GasState, solve
from eclsim.gas.transport import Drainage, Flows, balanced, mixtures

ADULT = "Quadrox-i Adult"
_VENO_VENOUS = (
    ("lung", "ra", "art"), ("tissue", "art", "sv"), ("svn", "sv", "ra"), ("drain", "ra", "pre"),
    ("oxy", "pre", "post"), ("return", "post", "ra"),
)  # fmt: skip
_CIRCUIT, _MEMBRANE = f"{ECMO.key}.", f"{ECMO.key}.oxygenator."
_SECTIONS = {"sweep_l_min": _CIRCUIT, "fdo2": _CIRCUIT, "carbon_dioxide_transfer": _MEMBRANE}


@dataclass(frozen=True)
class GivenBlood(GasExchanger):
    """A reservoir from which blood leaves with given partial pressures, whatever enters."""

    po2: str = "bench.po2"
    pco2: str = "bench.pco2"

    def rates(self, flow: Array, inside: Points, values: Values) -> Array:  # noqa: D102  (see the base class)
        reservoir = jnp.stack([jnp.asarray(values[self.po2]), jnp.asarray(values[self.pco2])])[:, None]
        return inside.gained - 10.0 * flow * jnp.log(inside.pressure / reservoir)


class Pass(NamedTuple):
    """Measurements of an oxygenator.

    Attributes:
        oxygen: oxygen transferred to the blood [mL/min STPD].
        carbon_dioxide: carbon dioxide removed from the blood [mL/min STPD].
        po2: PO2 at the outlet [mmHg].
        saturation: saturation at the outlet [%].
    """

    oxygen: float
    carbon_dioxide: float
    po2: float
    saturation: float


class VenoVenous(NamedTuple):
    """A patient on V-V ECMO: arterial, venous and drained blood.

    Attributes:
        sao2: arterial saturation [%].
        pao2: arterial PO2 [mmHg].
        paco2: arterial PCO2 [mmHg].
        svo2: saturation of the blood that leaves the tissues [%].
        spre: saturation of the drained blood [%].
        oxygen: oxygen transferred by the oxygenator [mL/min STPD].
        carbon_dioxide: carbon dioxide removed by the oxygenator [mL/min STPD].
    """

    sao2: float
    pao2: float
    paco2: float
    svo2: float
    spre: float
    oxygen: float
    carbon_dioxide: float


def values_with(values: Mapping[str, float]) -> dict[str, float]:
    """Default values of all parameters of gas exchange, with the given values replaced; all are floats.

    A program traced with a whole number is another one, and compiled anew.
    """
    known = {name: parameter.value for name, parameter in parameters().items()}
    known |= OXYGENATORS[ADULT].gas_values() | dict(values)
    return {name: float(value) for name, value in known.items()}


def single_pass(
    flow: float, sweep: float, saturation: float, pco2: float = 45.0, hb: float = 12.0, **oxygenator: float
) -> Pass:
    """Compute a single pass of blood with a given inlet saturation [-] through an oxygenator; flows in L/min.

    Other arguments are parameters of the oxygenator: `oxygen_transfer`, `carbon_dioxide_transfer`; `fdo2`.
    """
    inlet = gases_with_saturation(saturation=saturation, pco2=pco2, haemoglobin=hb)
    values = values_with(
        {
            "gas.haemoglobin_g_dl": hb,
            f"{_CIRCUIT}sweep_l_min": sweep,
            f"{_CIRCUIT}fdo2": oxygenator.pop("fdo2", 1.0),
        }
        | {_MEMBRANE + name: value for name, value in oxygenator.items()}
    ) | {"bench.po2": float(inlet.po2), "bench.pco2": float(pco2)}
    state = _bench()(float(flow), values)
    oxygen, carbon_dioxide = map(float, state.gained[:, 1])
    return Pass(
        oxygen, -carbon_dioxide, float(jnp.exp(state.pressure[0, -1])), 100.0 * float(state.saturation[-1])
    )


def veno_venous(output: float, ecmo: float, mixing: float = 0.0, **settings: float) -> VenoVenous:
    """Compute a patient on V-V ECMO with a cardiac output and a pump flow [L/min].

    Other arguments are keys of the section [gas], `sweep_l_min`, `fdo2`, or `carbon_dioxide_transfer`.
    """
    by_parameter = {_SECTIONS.get(key, "gas.") + key: value for key, value in settings.items()}
    values = values_with(by_parameter)
    state, inlets = _patient()(float(output), float(ecmo), float(mixing), values)
    hb = values["gas.haemoglobin_g_dl"]
    blood = jnp.stack([state.outlets[:, 1], state.outlets[:, 0], inlets])
    blood_gases = gases_with_contents(
        oxygen=blood[:, 0],
        carbon_dioxide=blood[:, 1],
        haemoglobin=hb,
        temperature=values["gas.temperature_c"],
    )
    oxygen, carbon_dioxide = map(float, state.gained[:, 2])
    art, ven, pre = (100.0 * blood_gases.saturation).tolist()
    return VenoVenous(
        art, float(blood_gases.po2[0]), float(blood_gases.pco2[0]), ven, pre, oxygen, -carbon_dioxide
    )


@cache
def _bench() -> Callable[..., GasState]:
    laws = (GivenBlood(), MembraneLung(*MEMBRANE))

    def compute(flow: Array, values: Mapping[str, Array]) -> GasState:
        flows = balanced(_flows((("source", "a", "b"), ("oxy", "b", "a")), jnp.stack([flow, flow])))
        return solve(laws, mixtures(flows, [0, 1]), values)

    return jax.jit(compute)


@cache
def _patient() -> Callable[..., tuple[GasState, Array]]:
    names = [path[0] for path in _VENO_VENOUS]
    at, drainage = [names.index(name) for name in ("tissue", "lung", "oxy")], Drainage(3, (5,), "mixing")

    def compute(
        output: Array, ecmo: Array, mixing: Array, values: Mapping[str, Array]
    ) -> tuple[GasState, Array]:
        flows = balanced(_flows(_VENO_VENOUS, jnp.stack([output] * 3 + [ecmo] * 3)))
        state = solve(
            (Tissue(), NativeLung(), MembraneLung(*MEMBRANE)),
            mixtures(flows, at, [(drainage, mixing)]),
            values,
        )
        return state, state.inlets[:, 2]

    return jax.jit(compute)


def _flows(paths: tuple[tuple[str, str, str], ...], forward: Array) -> Flows:
    names = list(dict.fromkeys(end for _, *ends in paths for end in ends))
    leaves, enters = np.zeros((2, len(names), len(paths)))
    for j, (_, source, target) in enumerate(paths):
        leaves[names.index(source), j] = enters[names.index(target), j] = 1.0
    return Flows(jnp.asarray(leaves), jnp.asarray(enters), forward, 0.0 * forward)
