"""The full posterior by the No-U-Turn sampler (Hoffman and Gelman 2014, JMLR 15, 1593-1623), of NumPyro.

The sampler moves in the coordinates of a `Transport`, in which the posterior is nearly standard normal: its
mass matrix is nearly right from the first step, and goes on learning. Each leapfrog step asks the host for
the potential and its exact gradient, which depend on the point alone. After each draw a chain may jump (see
`Jumps`). Chains run side by side, one thread each.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.identification.density import PosteriorDensity
from eclsim.identification.gradient import GradientEvaluator
from eclsim.identification.proposals import Jumps, Mixture
from eclsim.orbit.execution import in_threads

if TYPE_CHECKING:
    import jax
    from numpyro.infer.hmc import HMCState

    HostPotential = Callable[[jax.Array, jax.Array], tuple[np.ndarray, np.ndarray]]

STATISTICS = (
    "diverging", "num_steps", "accept_prob", "potential_energy", "energy", "step_size", "jumped", "saturated",
)  # fmt: skip
"""Of NumPyro; `jumped`: whether a jump followed, `saturated`: whether the trajectory had all steps it may."""
OVERDISPERSION = 1.5
"""Chains start from a standard normal distribution made so much wider."""
TRIES = 20
FIRST_STEP = 0.7


class MissingPackageError(ImportError):
    """A package of an extra is not installed."""


@dataclass(frozen=True)
class Sampling:
    """How long and how carefully to sample.

    Args:
        chains: independent chains.
        warmup: draws of each chain in which step size and mass matrix are learnt; thrown away.
        draws: draws of each chain that are kept.
        seed: the same seed, the same draws.
        target_accept: mean acceptance probability that the step size is tuned for.
        deepest: largest depth of a trajectory's tree: at most 2^deepest - 1 steps for a draw. Seven steps are
            about half way round a standard normal distribution, fifteen all the way.
        deepest_warmup: the same for the draws that are thrown away.
    """

    chains: int = 4
    warmup: int = 600
    draws: int = 1500
    seed: int = 0
    target_accept: float = 0.7
    deepest: int = 3
    deepest_warmup: int = 2


@dataclass(frozen=True)
class Chains:
    """Draws of all chains.

    Args:
        z: latent variables, shape (chains, draws, parameters).
        statistics: `STATISTICS` of the sampler, each of shape (chains, draws).
        evaluations: of the potential with its gradient, warm-up counted in.
        without_beat: of these, those at points without a steady beat, which are excluded.
    """

    z: np.ndarray
    statistics: dict[str, np.ndarray]
    evaluations: int
    without_beat: int = 0


def sample(
    posterior: PosteriorDensity,
    proposals: Mixture,
    settings: Sampling | None = None,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> Chains:
    """Draw from a posterior.

    Args:
        posterior: density.
        proposals: distributions close to it; the sampler moves in the coordinates of the last, and jumps to
            draws from all.
        settings: how long and how carefully.
        report: called with the number of draws done, of all chains, and of all there are.

    Raises:
        MissingPackageError: NumPyro is not installed.
    """
    return _Sampler(posterior, proposals, settings or Sampling(), report).run()


class _Sampler:
    def __init__(
        self,
        posterior: PosteriorDensity,
        proposals: Mixture,
        settings: Sampling,
        report: Callable[[int, int], None],
    ):
        self.transport, self.settings, self.report = proposals.transports[-1], settings, report
        centre, count = self.transport.centre, settings.chains
        self.evaluators = [GradientEvaluator(posterior, centre, by_point=True) for _ in range(count)]
        self.evaluations, self.without_beat = [0] * count, [0] * count
        self.done = 0
        self.lock = threading.Lock()
        self.init, self.advance, self.energy = self._compile()
        self.jumps = Jumps.draw(proposals, count, settings.warmup + settings.draws, settings.seed)

    def run(self) -> Chains:
        chains = in_threads(self._chain, list(range(self.settings.chains)))
        statistics = {n: np.stack([s[n] for _, s in chains]) for n in STATISTICS}
        draws = np.stack([z for z, _ in chains])
        return Chains(draws, statistics, sum(self.evaluations), sum(self.without_beat))

    def potential(self, chain: jax.Array | int, z: jax.Array | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """On the host: U and dU/dz."""
        number = int(chain)
        self.evaluations[number] += 1
        u, gradient = self.evaluators[number].potential(np.asarray(z))
        self.without_beat[number] += not np.isfinite(u)
        return np.asarray(u), gradient

    def _compile(self) -> tuple[Callable[..., Any], Callable[..., Any], Callable[..., Any]]:
        """NumPyro's functions that begin a chain and advance it, and the potential with its gradient."""
        import jax

        try:
            from numpyro.infer.hmc import hmc
        except ImportError:
            raise MissingPackageError("sampling needs NumPyro: pip install 'eclsim[bayes]'") from None
        init, advance = hmc(potential_fn_gen=lambda chain: lambda u: self._transported(chain, u), algo="NUTS")
        energy = jax.value_and_grad(lambda u, chain: self._transported(chain, u))
        return init, jax.jit(lambda state, chain: advance(state, (chain,), {})), jax.jit(energy)

    def _transported(self, chain: jax.Array, u: jax.Array) -> jax.Array:
        """Potential in the sampler's coordinates, for JAX to differentiate."""
        import jax.numpy as jnp

        z, log_slope = self.transport.z_of(u, jnp)
        return _host_potential(self.potential, chain, z) - log_slope

    def _start(self, chain: int) -> np.ndarray:
        """A start with a steady beat."""
        random = np.random.default_rng([self.settings.seed, chain])
        size = len(self.transport.centre)
        for k in range(TRIES):
            u = OVERDISPERSION * 0.8**k * random.standard_normal(size)
            if np.isfinite(self.potential(chain, self.transport.z_of(u)[0])[0]):
                return u
        return np.zeros(size)

    def _chain(self, chain: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        import jax

        settings = self.settings
        with self.lock:
            state = self.init(
                self._start(chain),
                settings.warmup,
                step_size=FIRST_STEP,
                dense_mass=True,
                target_accept_prob=settings.target_accept,
                max_tree_depth=(settings.deepest_warmup, settings.deepest),
                find_heuristic_step_size=False,
                model_args=(chain,),
                model_kwargs={},
                rng_key=jax.random.fold_in(jax.random.PRNGKey(settings.seed), chain),
            )
        draws, kept = [], {name: [] for name in STATISTICS}
        for k in range(settings.warmup + settings.draws):
            moved = self.advance(state, chain)
            state = self._jumped(moved, chain, k)
            if k >= settings.warmup:
                draws.append(self.transport.z_of(np.asarray(state.z))[0])
                own = {
                    "jumped": state is not moved, "saturated": moved.num_steps >= 2**settings.deepest - 1,
                    "step_size": state.adapt_state.step_size,
                }  # fmt: skip
                for name, values in kept.items():
                    values.append(np.asarray(own[name] if name in own else getattr(state, name)))
            self._count()
        return np.stack(draws), {name: np.array(values) for name, values in kept.items()}

    def _jumped(self, state: HMCState, chain: int, draw: int) -> HMCState:
        """The sampler's state after a proposed jump, taken or not."""
        import jax

        z, log_slope = self.transport.z_of(np.asarray(state.z))
        ratio = self.jumps.log_ratio(z, float(state.potential_energy + log_slope))
        u, log_slope = self.transport.u_of(self.jumps.z[chain, draw])
        potential, gradient = self.energy(u, chain)
        if self.jumps.refused(chain, draw, ratio, float(potential + log_slope)):
            return state
        return state._replace(z=jax.numpy.asarray(u), potential_energy=potential, z_grad=gradient)

    def _count(self) -> None:
        with self.lock:
            self.done += 1
            self.report(self.done, self.settings.chains * (self.settings.warmup + self.settings.draws))


def _host_potential(host: HostPotential, chain: jax.Array, z: jax.Array) -> jax.Array:
    """The host's potential as a function that JAX can differentiate: value and gradient in one call."""
    import jax
    import jax.numpy as jnp

    shapes = jax.ShapeDtypeStruct((), jnp.float64), jax.ShapeDtypeStruct(z.shape, jnp.float64)

    def both(z: jax.Array) -> tuple[jax.Array, jax.Array]:
        return jax.pure_callback(host, shapes, chain, z)

    @jax.custom_vjp
    def value(z: jax.Array) -> jax.Array:
        return both(z)[0]

    value.defvjp(both, lambda gradient, weight: (weight * gradient,))
    return value(z)
