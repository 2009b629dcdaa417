"""Gas exchange on the bench and with given flows on V-V ECMO, and recirculation in the whole circulation.

Recirculation is that of the whole circulation: pump flow, cannula tips, loss of blood, output. The mixing of
the drained blood is that of femoro-jugular cannulae in patients (Pooth 2025). With tips that lie close
together, and for the simulated vena cava, it is fitted to one number. The pigs' size, vessels and reflex are
not in the abstract: an adult with soft veins and a reflex stands for them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax import Array

from eclsim.blood.gases import gases_with_contents, gases_with_saturation
from eclsim.cases.reading import read_mapping
from eclsim.components.base import Values
from eclsim.components.exchangers import GasExchanger, MembraneLung, NativeLung, Points, Tissue
from eclsim.course.course import course
from eclsim.devices.ecmo import ECMO
from eclsim.devices.ecmo_parts import MEMBRANE, OXYGENATORS
from eclsim.devices.registry import parameters
from eclsim.gas.steady import GasState, solve
from eclsim.gas.transport import Drainage, Flows, balanced, mixtures
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate_many
from eclsim.paper.comparison import Explanation, Row
from eclsim.validation.reference_cases import PROTOCOLS, root

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
        oxygen: oxygen transferred by the oxygenator [mL/min STPD].
        carbon_dioxide: carbon dioxide removed by the oxygenator [mL/min STPD].
    """

    sao2: float
    pao2: float
    paco2: float
    svo2: float
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
    state = _patient()(float(output), float(ecmo), float(mixing), values)
    blood = jnp.stack([state.outlets[:, 1], state.outlets[:, 0]])
    blood_gases = gases_with_contents(
        oxygen=blood[:, 0], carbon_dioxide=blood[:, 1], haemoglobin=values["gas.haemoglobin_g_dl"],
        temperature=values["gas.temperature_c"],
    )  # fmt: skip
    oxygen, carbon_dioxide = map(float, state.gained[:, 2])
    art, ven = (100.0 * blood_gases.saturation).tolist()
    return VenoVenous(
        art, float(blood_gases.po2[0]), float(blood_gases.pco2[0]), ven, oxygen, -carbon_dioxide
    )


@cache
def _bench() -> Callable[..., GasState]:
    laws = (GivenBlood(), MembraneLung(*MEMBRANE))

    def compute(flow: Array, values: Mapping[str, Array]) -> GasState:
        flows = balanced(_flows((("source", "a", "b"), ("oxy", "b", "a")), jnp.stack([flow, flow])))
        return solve(laws, mixtures(flows, [0, 1]), values)

    return jax.jit(compute)


@cache
def _patient() -> Callable[..., GasState]:
    names = [path[0] for path in _VENO_VENOUS]
    at, drainage = [names.index(name) for name in ("tissue", "lung", "oxy")], Drainage(3, (5,), "mixing")

    def compute(output: Array, ecmo: Array, mixing: Array, values: Mapping[str, Array]) -> GasState:
        flows = balanced(_flows(_VENO_VENOUS, jnp.stack([output] * 3 + [ecmo] * 3)))
        laws = (Tissue(), NativeLung(), MembraneLung(*MEMBRANE))
        return solve(laws, mixtures(flows, at, [(drainage, mixing)]), values)

    return jax.jit(compute)


def _flows(paths: tuple[tuple[str, str, str], ...], forward: Array) -> Flows:
    names = list(dict.fromkeys(end for _, *ends in paths for end in ends))
    leaves, enters = np.zeros((2, len(names), len(paths)))
    for j, (_, source, target) in enumerate(paths):
        leaves[names.index(source), j] = enters[names.index(target), j] = 1.0
    return Flows(jnp.asarray(leaves), jnp.asarray(enters), forward, 0.0 * forward)


# --- recirculation in the whole circulation -------------------------------------------------------

CASE = PROTOCOLS["recirculation"]
FLOW, MIXING, SHARE = f"{ECMO.key}.roller_l_min", f"{ECMO.key}.drainage_mixing", "recirculation_fraction"
SLOW, FAST = 3.5, 5.0
"""Pump flows of the pigs [L/min]."""
VOLUME_ML, OVER_MIN, AFTER_MIN = 1000.0, 20.0, 30.0
"""Blood taken and given back, the time it takes, and the time until the measurement (both assumed)."""


def recirculation_numbers() -> dict[str, float]:
    """Numbers for the rows of `gas.csv` on recirculation, by key."""
    return _flows_and_tips() | _loss_of_blood() | _simulated_cava() | _output()


def beats(**changes: list[float]) -> xr.Dataset:
    """Steady beats with several pump flows (`flow`), mixings (`mixing`) or resistances (`Rmc`)."""
    names = {"flow": FLOW, "mixing": MIXING}
    table = {names.get(key, key): np.array(values) for key, values in changes.items()}
    return simulate_many(model_of(read_mapping(CASE).case), table, (SHARE, "SaO2", "CO"))


def _flows_and_tips() -> dict[str, float]:
    """Rise of the recirculated share [%] with flow, for tips apart and for tips that raise it by 16 %."""
    apart = CASE[ECMO.key]["drainage_mixing"]
    near = root(lambda m: _rise(mixing=[apart, m]) - 16.0, apart, 1.0, xtol=1e-4)
    faster = {"apart": _rise(flow=[SLOW, FAST]), "near": _rise(flow=[SLOW, FAST], mixing=[near, near])}
    shares = beats(flow=[2.0, 3.0, 4.0, 5.0, 6.0])[SHARE].values
    return {f"tips {name}": rise for name, rise in faster.items()} | {
        "tips": _rise(mixing=[apart, near]),
        "recirculation flow": float(np.all(np.diff(shares) > 0.0)),
    }


def _rise(**changes: list[float]) -> float:
    """Rise of the recirculated share from the first to the last beat [% of the first]."""
    shares = beats(**changes)[SHARE].values
    return float(100.0 * (shares[-1] / shares[0] - 1.0))


def _loss_of_blood() -> dict[str, float]:
    """A litre bled and given back: changes of the recirculated share [%] and of drainage pressure [mmHg]."""
    pause = OVER_MIN + AFTER_MIN
    events = [
        {"at_min": at, "over_min": OVER_MIN, "give": {kind: VOLUME_ML}}
        for at, kind in ((0.0, "bleed_ml"), (pause, "blood_ml"))
    ]
    followed = course(
        read_mapping(CASE | {"events": events}).case, minutes=2.0 * pause, every_min=5.0,
        outputs=(SHARE, "drainage_pressure"),
    )  # fmt: skip
    moments = followed.interp(time_min=[0.0, pause, 2.0 * pause])
    start, bled, given = moments[SHARE].values
    pressures = moments["drainage_pressure"].values
    return {
        "bled": 100.0 * float(bled / start - 1.0),
        "given back": 100.0 * float(given / bled - 1.0),
        "bled drainage": float(pressures[1] - pressures[0]),
    }


def _simulated_cava() -> dict[str, float]:
    """Recirculated share [%] at 3 and 5 L/min, with the mixing that gives the first."""
    mixing = root(lambda m: _percent(3.0, m) - 7.66, 0.01, 1.0, xtol=1e-5)
    return {f"cava {flow:g}": _percent(flow, mixing) for flow in (3.0, 5.0)}


def _percent(flow: float, mixing: float) -> float:
    return 100.0 * float(beats(flow=[flow], mixing=[mixing])[SHARE][0])


def _output() -> dict[str, float]:
    """Whether more output recirculates less, more flow oxygenates, and less output raises PaO2."""
    vessels = beats(Rmc=[0.6, 0.9, 1.2])
    falls = [
        float(np.all(np.diff(vessels[name].values) * sign > 0.0)) for name, sign in (("CO", -1), (SHARE, 1))
    ]
    saturation = beats(flow=[3.0, 4.0, 5.0])["SaO2"].values
    high, low = (
        veno_venous(q, 4.5, 0.1, shunt_fraction=1.0, vo2_ml_min=250.0, sweep_l_min=5.0).pao2
        for q in (9.0, 6.0)
    )
    return {
        "output": float(all(falls)),
        "flow saturation": float(np.all(np.diff(saturation) > 0.0)),
        "esmolol": float(low > high),
    }


def recirculation_reasons(numbers: Mapping[str, float]) -> dict[str, Explanation]:
    """The simulated vena cava contradicts pigs and patients, where the share rises about as the flow does."""
    least, most = 24.5, 73.5
    return {
        "cava 5": Explanation(
            "the simulated vena cava has more than four times the share at 5/3 of the flow, which needs "
            "mixing that rises with the flow; in patients the share rises linearly, in pigs from 3.5 to 5 "
            "L/min by 28 and 49 %, as here",
            (Row("pigs, tips apart", numbers["tips apart"], least, most, "%"),),
            undecided=True,
        )
    }
