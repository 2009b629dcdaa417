"""Small circulations with given flows, for tests of transport and exchange."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from eclsim.components.base import Key, value_of
from eclsim.components.exchangers import GasExchanger, MembraneLung, NativeLung, Points, Tissue
from eclsim.devices.ecmo_parts import MEMBRANE
from eclsim.gas.steady import solve
from eclsim.gas.transport import Drainage, Flows, balanced, mixtures

PATIENT = {
    "gas.vo2_ml_min": 250.0, "gas.vo2_percent_per_c": 0.0, "gas.respiratory_quotient": 0.8,
    "gas.alveolar_ventilation_l_min": 4.0,
    "gas.fio2": 0.5, "gas.shunt_fraction": 1.0, "gas.haemoglobin_g_dl": 10.0, "gas.base_excess_mmol_l": 0.0,
    "gas.temperature_c": 37.0, "gas.oxygen_capacity_ml_g": 1.34, "ecmo.sweep_l_min": 5.0, "ecmo.fdo2": 1.0,
    "ecmo.oxygenator.oxygen_transfer": 0.09, "ecmo.oxygenator.oxygen_exponent": 0.84,
    "ecmo.oxygenator.carbon_dioxide_transfer": 4.66, "ecmo.oxygenator.clotted_fraction": 0.0,
}  # fmt: skip


@dataclass(frozen=True)
class GivenGases(GasExchanger):
    """Blood leaves with given partial pressures, but for a shunt: an oxygenator or a lung of the textbook.

    Numbers, or keys of values: what differs in values alone is compiled once.
    """

    po2: Key
    pco2: Key
    shunt: Key = 0.0

    def exchanging(self, values):
        return 1.0 - value_of(values, self.shunt)

    def rates(self, flow, inside: Points, values):
        given = jnp.array([value_of(values, self.po2), value_of(values, self.pco2)])[:, None]
        return inside.gained - 10.0 * flow * (jnp.log(inside.pressure) - jnp.log(given))


def flows_of(paths, forward, backward=None):
    """Flows of connections (name, source, target) between compartments in order of appearance."""
    names = list(dict.fromkeys(end for _, *ends in paths for end in ends))
    leaves, enters = np.zeros((2, len(names), len(paths)))
    for j, (_, source, target) in enumerate(paths):
        leaves[names.index(source), j] = enters[names.index(target), j] = 1.0
    forward = jnp.asarray(forward, dtype=float)
    return Flows(leaves, enters, forward, 0.0 * forward if backward is None else jnp.asarray(backward))


compiled_quickly = partial(
    jax.jit, compiler_options={"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 0}
)
"""`jax.jit` for programs of a test's own: compiled in a third of the time, the same but for rounding."""
VENO_VENOUS = (
    ("ra", "ra", "pa"), ("lung", "pa", "art"), ("tissue", "art", "sv"), ("svn", "sv", "ra"),
    ("drain", "ra", "pre"), ("oxy", "pre", "post"), ("return", "post", "ra"),
)  # fmt: skip
EXCHANGERS, PLACES = (Tissue(), NativeLung(), MembraneLung(*MEMBRANE)), ("tissue", "lung", "oxy")


def veno_venous(output, ecmo, mixing=1.0, exchangers=EXCHANGERS, law="severinghaus1979", **values: float):
    """Gas state of a patient on V-V ECMO with one right atrium, flows in L/min."""
    named = {key.replace("gas_", "gas.").replace("ecmo_", "ecmo."): value for key, value in values.items()}
    # All as arrays of floats: what is traced with whole numbers is compiled again.
    given = {key: jnp.asarray(value, dtype=float) for key, value in (PATIENT | named).items()}
    forward = jnp.stack([jnp.asarray(flow, dtype=float) for flow in [output] * 4 + [ecmo] * 3])
    return _solved(exchangers, law, forward, jnp.asarray(mixing, dtype=float), given)


@partial(compiled_quickly, static_argnums=(0, 1))
def _solved(exchangers, law, forward, mixing, values):
    flows = balanced(flows_of(VENO_VENOUS, forward))
    at = [[path[0] for path in VENO_VENOUS].index(place) for place in PLACES]
    mixed = mixtures(flows, at, [(Drainage(4, (6,), "mixing"), mixing)])
    return solve(exchangers, mixed, values, law), mixed
