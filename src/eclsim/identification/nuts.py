"""The full posterior by NumPyro's No-U-Turn sampler (Hoffman and Gelman 2014, JMLR 15, 1593-1623).

The sampler moves in the coordinates of a `Transport`, in which the posterior is nearly standard normal. Its
mass matrix is therefore nearly right from the first step; it is adapted further during warm-up. Each leapfrog
step asks the host for the potential and its exact gradient, which depend on the point alone. After each draw
a chain may jump (see `Jumps`). Chains run side by side, one thread each.

Diagnostics are the rank-normalised split R-hat and the bulk and tail effective sample sizes of Vehtari,
Gelman, Simpson, Carpenter and Bürkner 2021, Bayesian Analysis 16, 667-718, doi 10.1214/20-BA1221, with their
limits, and the energy fraction of missing information (E-BFMI) of Betancourt 2016, arXiv 1604.00695, with his
limit. A trajectory that is cut at its largest length costs effective draws but causes no bias. The number of
such draws therefore has no limit; it is counted, and named if effective draws are too few.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import ndtri
from scipy.stats import rankdata

from eclsim.arguments import FiniteNumber, WholeNumber, check_fields
from eclsim.identification.density import GradientEvaluator, PosteriorDensity
from eclsim.identification.importance import FEWEST_EFFECTIVE
from eclsim.identification.proposals import Jumps, Mixture
from eclsim.orbit.execution import in_threads

if TYPE_CHECKING:
    from numpyro.infer.hmc import HMCState

    HostPotential = Callable[[jax.Array, jax.Array], tuple[np.ndarray, np.ndarray]]

STATISTICS = (
    "diverging", "num_steps", "accept_prob", "potential_energy", "energy", "step_size", "jumped", "saturated",
)  # fmt: skip
"""Statistics of NumPyro; `jumped`: a jump followed, `saturated`: the trajectory had all steps it may."""
OVERDISPERSION = 1.5
"""Chains start from a standard normal distribution widened by this factor."""
TRIES = 20
DEEPEST_WARMUP, DEEPEST = 2, 3
"""Largest depth of the tree of a trajectory, with at most 2^depth - 1 steps for a draw, in and after warm-up.
Seven steps are about half way round a standard normal distribution, fifteen all the way."""
FIRST_STEP = 0.7


class MissingPackageError(ImportError):
    """Raised if a package of an optional extra is not installed."""


@dataclass(frozen=True)
class Sampling:
    """Settings of the No-U-Turn sampler.

    Args:
        chains: number of independent chains.
        warmup: draws of each chain in which step size and mass matrix are adapted; they are discarded.
        draws: draws of each chain that are kept.
        seed: seed of the random numbers; the same seed gives the same draws.
        target_accept: mean acceptance probability to which the step size is tuned. With 0.7 steps are so
            long that trajectories leave the posterior at a steep edge, such as that of PaO2 at high shunts.
    """

    chains: int = 4
    warmup: int = 600
    draws: int = 1500
    seed: int = 0
    target_accept: float = 0.9

    def __post_init__(self) -> None:
        check_fields(
            self,
            chains=WholeNumber(1),
            warmup=WholeNumber(),
            draws=WholeNumber(1),
            seed=WholeNumber(),
            target_accept=FiniteNumber(above=0.0, most=0.99),
        )


@dataclass(frozen=True)
class Chains:
    """Draws of all chains.

    Args:
        z: latent variables, shape (chains, draws, parameters).
        statistics: `STATISTICS` of the sampler, each of shape (chains, draws).
        evaluations: number of evaluations of the potential with its gradient, including warm-up.
        without_beat: number of these evaluations at points without a steady beat, which are excluded.
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
        posterior: density to sample.
        proposals: distributions close to the posterior; the sampler moves in the coordinates of the last one,
            and jumps to draws from their mixture.
        settings: settings of the sampler.
        report: called with the number of draws done by all chains, and with their total number.

    Raises:
        MissingPackageError: NumPyro is not installed.
    """
    return _Sampler(posterior, proposals, settings or Sampling(), report).run()


def numpyro_hmc() -> Callable[..., Any]:
    """NumPyro's Hamiltonian sampler.

    Raises:
        MissingPackageError: NumPyro is not installed.
    """
    try:
        from numpyro.infer.hmc import hmc
    except ImportError:
        message = (
            "chains need NumPyro: pip install 'eclsim[bayes]', or weighted draws: "
            'PosteriorSettings(method="importance")'
        )
        raise MissingPackageError(message) from None
    return hmc


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
        """U and dU/dz of a chain, evaluated on the host."""
        number = int(chain)
        self.evaluations[number] += 1
        u, gradient = self.evaluators[number].potential(np.asarray(z))
        self.without_beat[number] += not np.isfinite(u)
        return np.asarray(u), gradient

    def _compile(self) -> tuple[Callable[..., Any], Callable[..., Any], Callable[..., Any]]:
        """Return NumPyro's functions that begin and advance a chain, and the potential with its gradient."""
        hmc = numpyro_hmc()
        init, advance = hmc(potential_fn_gen=lambda chain: lambda u: self._transported(chain, u), algo="NUTS")
        energy = jax.value_and_grad(lambda u, chain: self._transported(chain, u))
        return init, jax.jit(lambda state, chain: advance(state, (chain,), {})), jax.jit(energy)

    def _transported(self, chain: jax.Array, u: jax.Array) -> jax.Array:
        """Potential in the sampler's coordinates, which JAX can differentiate."""
        z, log_slope = self.transport.z_of(u, jnp)
        return _host_potential(self.potential, chain, z) - log_slope

    def _start(self, chain: int) -> np.ndarray:
        """Find a start with a steady beat."""
        random = np.random.default_rng([self.settings.seed, chain])
        size = len(self.transport.centre)
        for k in range(TRIES):
            u = OVERDISPERSION * 0.8**k * random.standard_normal(size)
            if np.isfinite(self.potential(chain, self.transport.z_of(u)[0])[0]):
                return u
        return np.zeros(size)

    def _chain(self, chain: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        settings = self.settings
        with self.lock:
            state = self.init(
                self._start(chain),
                settings.warmup,
                step_size=FIRST_STEP,
                dense_mass=True,
                target_accept_prob=settings.target_accept,
                max_tree_depth=(DEEPEST_WARMUP, DEEPEST),
                find_heuristic_step_size=False,
                model_args=(chain,),
                model_kwargs={},
                rng_key=jax.random.fold_in(jax.random.PRNGKey(settings.seed), chain),
            )
        draws, statistics = [], {name: [] for name in STATISTICS}
        for k in range(settings.warmup + settings.draws):
            moved = self.advance(state, chain)
            state = self._jumped(moved, chain, k)
            if k >= settings.warmup:
                draws.append(self.transport.z_of(np.asarray(state.z))[0])
                of_draw = {
                    "jumped": state is not moved, "saturated": moved.num_steps >= 2**DEEPEST - 1,
                    "step_size": state.adapt_state.step_size,
                }  # fmt: skip
                for name, values in statistics.items():
                    values.append(np.asarray(of_draw[name] if name in of_draw else getattr(state, name)))
            with self.lock:
                self.done += 1
                self.report(self.done, settings.chains * (settings.warmup + settings.draws))
        return np.stack(draws), {name: np.array(values) for name, values in statistics.items()}

    def _jumped(self, state: HMCState, chain: int, draw: int) -> HMCState:
        """Return the sampler's state after a proposed jump, accepted or not."""
        z, log_slope = self.transport.z_of(np.asarray(state.z))
        ratio = self.jumps.log_ratio(z, float(state.potential_energy + log_slope))
        u, log_slope = self.transport.u_of(self.jumps.z[chain, draw])
        potential, gradient = self.energy(u, chain)
        if self.jumps.refused(chain, draw, ratio, float(potential + log_slope)):
            return state
        return state._replace(z=jax.numpy.asarray(u), potential_energy=potential, z_grad=gradient)


def _host_potential(host: HostPotential, chain: jax.Array, z: jax.Array) -> jax.Array:
    """Potential of the host as a function that JAX can differentiate: value and gradient in one call."""
    shapes = jax.ShapeDtypeStruct((), jnp.float64), jax.ShapeDtypeStruct(z.shape, jnp.float64)

    def potential_and_gradient(z: jax.Array) -> tuple[jax.Array, jax.Array]:
        return jax.pure_callback(host, shapes, chain, z)

    @jax.custom_vjp
    def value(z: jax.Array) -> jax.Array:
        return potential_and_gradient(z)[0]

    value.defvjp(potential_and_gradient, lambda gradient, weight: (weight * gradient,))
    return value(z)


# --- diagnostics of the draws -----------------------------------------------------------------------


LARGEST_R_HAT = 1.01
LARGEST_DIVERGENT_SHARE = 0.01
SMALLEST_ENERGY_FRACTION = 0.3


@dataclass(frozen=True)
class Diagnostics:
    """Agreement and mixing of the chains, by parameter.

    Args:
        names: names of the parameters.
        r_hat: split R-hat, shape (parameters,).
        effective_bulk: bulk effective sample size, shape (parameters,).
        effective_tail: tail effective sample size, of the 5 % and 95 % quantiles, shape (parameters,).
        divergent: number of draws with a divergent trajectory.
        draws: total number of draws.
        energy_fraction: E-BFMI of each chain, shape (chains,).
        saturated: number of draws whose trajectory was cut at its largest length.
    """

    names: tuple[str, ...]
    r_hat: np.ndarray
    effective_bulk: np.ndarray
    effective_tail: np.ndarray
    divergent: int
    draws: int
    energy_fraction: np.ndarray
    saturated: int

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons why the draws cannot be trusted; empty if they can."""
        doubts = []
        k = int(np.argmax(np.nan_to_num(self.r_hat, nan=np.inf)))
        if not self.r_hat[k] < LARGEST_R_HAT:
            doubts.append(
                f"R-hat of {self.names[k]} is {self.r_hat[k]:.3f} (below {LARGEST_R_HAT}): the chains "
                "disagree; sample longer"
            )
        fewest = np.minimum(self.effective_bulk, self.effective_tail)
        k = int(np.argmin(np.nan_to_num(fewest, nan=-1.0)))
        if not fewest[k] >= FEWEST_EFFECTIVE:
            cut = f"; {self.saturated} of {self.draws} trajectories were cut at their largest length"
            doubts.append(
                f"effective sample size of {self.names[k]} is {fewest[k]:.0f} (at least {FEWEST_EFFECTIVE}): "
                f"sample longer{cut if self.saturated else ''}"
            )
        if self.divergent > LARGEST_DIVERGENT_SHARE * self.draws:
            doubts.append(
                f"{self.divergent} of {self.draws} draws diverged (at most {LARGEST_DIVERGENT_SHARE:.0%}): "
                "doubt the intervals, and narrow --bounds to what is possible"
            )
        k = int(np.argmin(np.nan_to_num(self.energy_fraction, nan=-1.0)))
        if not self.energy_fraction[k] >= SMALLEST_ENERGY_FRACTION:
            doubts.append(
                f"E-BFMI of chain {k + 1} is {self.energy_fraction[k]:.2f} (at least "
                f"{SMALLEST_ENERGY_FRACTION}): the chain hardly reaches the tails; doubt the outer quantiles"
            )
        return tuple(doubts)


def remarks_on_divergence(diagnostics: Diagnostics) -> tuple[str, ...]:
    """Sentence on divergent draws that are few enough for the draws to be trusted; none without any."""
    number, total = diagnostics.divergent, diagnostics.draws
    if not 0 < number <= LARGEST_DIVERGENT_SHARE * total:
        return ()
    share = f"{100.0 * number / total:.2g} %, at most {100.0 * LARGEST_DIVERGENT_SHARE:.2g} % are allowed"
    return (f"{number} of {total} draws diverged ({share}): trajectories left the posterior at a steep edge",)


def diagnose(names: Sequence[str], draws: np.ndarray, statistics: Mapping[str, np.ndarray]) -> Diagnostics:
    """Compute the diagnostics of draws.

    Args:
        names: names of the parameters.
        draws: draws of the parameters, shape (chains, draws, parameters).
        statistics: statistics of the sampler, each of shape (chains, draws): whether each draw is
            "diverging", its "energy" (Hamiltonian), and whether its trajectory was cut at its largest length
            ("saturated").
    """
    each = [draws[:, :, k] for k in range(draws.shape[2])]
    return Diagnostics(
        tuple(names),
        np.array([r_hat(d) for d in each]),
        np.array([effective_bulk(d) for d in each]),
        np.array([effective_tail(d) for d in each]),
        int(statistics["diverging"].sum()),
        int(statistics["diverging"].size),
        np.array([energy_fraction(e) for e in statistics["energy"]]),
        int(statistics["saturated"].sum()),
    )


def energy_fraction(energy: np.ndarray) -> float:
    """E-BFMI of one chain: squared change of the energy from draw to draw, relative to its variance.

    Args:
        energy: Hamiltonian of the draws in order, shape (draws,).
    """
    finite = energy[np.isfinite(energy)]
    variation = np.sum((finite - finite.mean()) ** 2) if len(finite) > 1 else 0.0
    return float(np.sum(np.diff(finite) ** 2) / variation) if variation > 0.0 else np.nan


def r_hat(draws: np.ndarray) -> float:
    """Rank-normalised split R-hat, the larger one of location and scale; shape of draws (chains, draws)."""
    halves = _halves(draws)
    folded = np.abs(halves - np.median(halves))
    return max(_r_hat(_normal_ranks(halves)), _r_hat(_normal_ranks(folded)))


def effective_bulk(draws: np.ndarray) -> float:
    """Bulk effective sample size."""
    return _effective(_normal_ranks(_halves(draws)))


def effective_tail(draws: np.ndarray) -> float:
    """Tail effective sample size, the smaller one of the 5 % and 95 % quantiles."""
    limits = np.quantile(draws, (0.05, 0.95))
    return min(_effective(_halves((draws <= limit).astype(float))) for limit in limits)


def _halves(draws: np.ndarray) -> np.ndarray:
    half = draws.shape[1] // 2
    return np.concatenate([draws[:, :half], draws[:, draws.shape[1] - half :]])


def _normal_ranks(draws: np.ndarray) -> np.ndarray:
    ranks = rankdata(draws, method="average").reshape(draws.shape)
    return ndtri((ranks - 0.375) / (draws.size + 0.25))


def _r_hat(draws: np.ndarray) -> float:
    count = draws.shape[1]
    within = np.mean(np.var(draws, axis=1, ddof=1))
    between = count * np.var(np.mean(draws, axis=1), ddof=1)
    if not within > 0.0:
        return 1.0 if between == 0.0 else np.inf
    return float(np.sqrt((between / within + count - 1) / count))


def _effective(draws: np.ndarray) -> float:
    """Effective sample size over all chains by Geyer's initial monotone sequence."""
    chains, count = draws.shape
    if np.ptp(draws) == 0.0:
        return float(draws.size)
    spectrum = np.fft.rfft(draws - draws.mean(axis=1, keepdims=True), 2 * count, axis=1)
    covariance = np.fft.irfft(spectrum * np.conj(spectrum), axis=1)[:, :count] / count
    within = np.mean(covariance[:, 0]) * count / (count - 1)
    variance = within * (count - 1) / count
    if chains > 1:
        variance += np.var(np.mean(draws, axis=1), ddof=1)
    correlation = 1.0 - (within - np.mean(covariance, axis=0) * count / (count - 1)) / variance
    correlation[0] = 1.0
    pairs = correlation[: count // 2 * 2].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs < 0.0)
    pairs = np.minimum.accumulate(pairs[: negative[0] if len(negative) else len(pairs)])
    time = max(-1.0 + 2.0 * pairs.sum(), 1.0 / np.log10(draws.size))
    return float(draws.size / time)
