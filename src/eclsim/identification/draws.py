"""Draws of a posterior: labelled arrays in ArviZ's schema, a table that studies read, and where they lie."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from eclsim._version import __version__
from eclsim.cases.fit_mark import DOUBTS, POSTERIOR
from eclsim.cases.quantities import quantity
from eclsim.cases.table import read_text_table
from eclsim.devices.registry import parameters
from eclsim.files import ORIGIN, csv_text, write_text
from eclsim.identification.quantities import unit_of, unit_of_parameter
from eclsim.identification.verdict import SIDES, possible_limits
from eclsim.inputs.mistakes import CaseError
from eclsim.orbit.model import AS_PUBLISHED
from eclsim.spelling import spelling_hint

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.identification.density import Gaussian, Prior
    from eclsim.identification.posterior import PosteriorResult


ARVIZ_NAMES = {
    "diverging": "diverging", "num_steps": "n_steps", "accept_prob": "acceptance_rate",
    "potential_energy": "lp", "energy": "energy", "step_size": "step_size",
    "jumped": "jumped", "saturated": "reached_max_treedepth",
}  # fmt: skip
"""The sampler's statistics and their names in ArviZ; `lp` is minus the potential, without constants."""
_NO_SAMPLES = "no samples; needed: a header of parameter names and a row for each sample"


def draws_as_tree(result: PosteriorResult) -> xr.DataTree:
    """Draws, statistics of the sampler, predictions and measurements of a posterior, a group each."""
    density, first = result.density, result.predictions[0]
    chains, draws, _ = result.samples.shape
    of_chains = {"chain": np.arange(chains), "draw": np.arange(draws)}
    of_predictions = {"chain": np.arange(chains), "draw": result.predicted_draws}
    shape = chains, len(result.predicted_draws)
    pair, outputs = ("chain", "draw"), tuple(dict.fromkeys(n for p in result.predictions for n in p.outputs))
    attributes = {
        **ORIGIN,
        "inference_library": "eclsim", "inference_library_version": __version__,
        "sampler": result.settings.method, "prior": result.settings.prior, "trusted": int(result.trusted),
        "doubts": "; ".join(result.doubts), "notes": "; ".join(result.notes),
        "warnings": "; ".join(first.warnings),
        "id": result.name, "blood_volume_policy": density.policy,
        "set_points": json.dumps(density.set_points),
    }  # fmt: skip

    def of_outputs(dims: tuple[str, ...], values: Mapping[str, Any]) -> dict[str, xr.Variable]:
        return {n: xr.Variable(dims, v, {"units": unit_of(n)}) for n, v in values.items()}

    random = np.random.default_rng(result.settings.sampling.seed)
    replicated = {  # what would be measured again: outputs of draws, with measurement noise
        n: (first.column(n) + density.errors[n] * random.standard_normal(len(first.values))).reshape(shape)
        for n in density.outputs
    }
    predicted = {
        n: np.stack([p.column(n).reshape(shape) for p in result.predictions], axis=-1) for n in outputs
    }
    labels = {
        **of_predictions, "settings": [p.label for p in result.predictions],
        "doubts": ("settings", ["; ".join((*result.doubts, *p.doubts)) for p in result.predictions]),
        "warnings": ("settings", ["; ".join(p.warnings) for p in result.predictions]),
    }  # fmt: skip
    groups: dict[str, tuple[dict[str, xr.Variable], Mapping[str, Any]]] = {
        "posterior": (
            {
                n: xr.Variable(pair, result.samples[:, :, k], {"units": unit_of_parameter(n)})
                for k, n in enumerate(result.names)
            },
            of_chains,
        ),
        "sample_stats": ({}, of_chains),
        "posterior_predictive": (of_outputs(pair, replicated), of_predictions),
        "predictions": (of_outputs((*pair, "settings"), predicted), labels),
        "observed_data": (of_outputs((), density.measured), {}),
        "constant_data": (of_outputs((), density.errors), {}),
    }
    if result.chains is None:
        del groups["sample_stats"]
    else:
        for numpyro_name, name in ARVIZ_NAMES.items():
            values = result.chains.statistics[numpyro_name]
            groups["sample_stats"][0][name] = xr.Variable(pair, -values if name == "lp" else values)
    return xr.DataTree.from_dict(
        {"/": xr.Dataset(attrs=ORIGIN)}
        | {
            group: xr.Dataset(data, coords, {n: v for n, v in attributes.items() if n not in coords})
            for group, (data, coords) in groups.items()
        }
    )


# --- remarks on where the draws lie ---------------------------------------------------------------

OUTERMOST_LATENT, PILED_UP_SHARE = 1.96, 0.2
"""|z| with 2.5 % of the prior beyond it, and share of draws there above which a bound limits a parameter."""
FURTHEST_FROM_FIT = 0.025
"""Largest distance of the nearest draw from a fitted value, as a share of the distance between the bounds."""


def piled_up(prior: Prior, z: np.ndarray) -> tuple[str, ...]:
    """Return a sentence for each parameter whose draws pile up at a bound, which then limits it.

    Args:
        prior: prior of the parameters.
        z: draws of the latent variables, shape (..., parameters).
    """
    ends = prior.scale.values(np.stack([prior.lower, prior.upper])).T.tolist()
    flat = z.reshape(-1, z.shape[-1])
    return tuple(
        f"{name}: {share:.0%} of the draws are in the last 2.5 % of its range, at the {side} "
        f"bound of {bound:.3g}: the bound limits it, not the measurements, and predictions depend on the "
        "bound; give wider --bounds if such a value is possible"
        for k, name in enumerate(prior.names)
        for side, sign, bound in zip(SIDES, (-1.0, 1.0), ends[k], strict=True)
        if (share := float(np.mean(sign * flat[:, k] > OUTERMOST_LATENT))) > PILED_UP_SHARE
        and bound not in possible_limits(name)
    )


def several_solutions(prior: Prior, z: np.ndarray, gaussian: Gaussian) -> tuple[str, ...]:
    """Return a sentence if the measurements have several solutions, with the share of the draws near each.

    Args:
        prior: prior of the parameters.
        z: draws of the latent variables, shape (..., parameters).
        gaussian: Gaussian approximations at all solutions.
    """
    if not gaussian.others:
        return ()
    centres = np.stack([each.centre for each in gaussian.solutions])
    spread = np.max([np.diag(each.covariance) for each in gaussian.solutions], axis=0)
    k = int(np.argmax(np.ptp(centres, axis=0) ** 2 / spread))
    nearest = gaussian.nearest(z.reshape(-1, z.shape[-1]))
    each = ", ".join(
        f"{prior.scale.value(k, x):.3g} ({np.mean(nearest == number):.0%} of the draws)"
        for number, x in enumerate(prior.x_of(centres)[:, k])
    )
    return (
        f"the measurements have {len(centres)} solutions, which differ most in {prior.names[k]}: {each}. "
        "Medians and intervals are those of all draws together, and values between the solutions may fit "
        "nothing: see the figure pairs; a further measurement, or narrower --bounds, may exclude one",
    )


def away_from_fit(prior: Prior, z: np.ndarray, fitted: np.ndarray) -> tuple[str, ...]:
    """Return a sentence for each parameter whose fitted value no draw is near.

    The measurements may then have a second solution, and the draws describe only one of the two.

    Args:
        prior: prior of the parameters.
        z: draws of the latent variables, shape (..., parameters).
        fitted: coordinates of the fitted values, shape (parameters,).
    """
    x = prior.x_of(z.reshape(-1, z.shape[-1]))
    nearest = x[np.abs(x - fitted).argmin(axis=0), np.arange(len(fitted))]
    far = np.abs(nearest - fitted) > FURTHEST_FROM_FIT * prior.width
    return tuple(
        f"{name}: no draw is near the fitted value of {prior.scale.value(k, fitted[k]):.3g} (the nearest has "
        f"{prior.scale.value(k, nearest[k]):.3g}): the draws describe other patients than the fit, as where "
        "the measurements have two solutions; see the profiles, and narrow --bounds to what is possible"
        for k, name in enumerate(prior.names)
        if far[k]
    )


# --- samples as a table, written by a posterior and read by a CRRT study ---------------------------

FREE_IN_CASES = ("total_blood_volume_ml", "heart_rate_bpm")
"""Quantities of a patient, besides the tabulated parameters, that may be uncertain."""
MOST_SAMPLES = 1000
MOST_MISTAKES = 20


class SamplesError(ValueError):
    """Raised for a file without valid samples; the message names every mistake."""


def write_samples(names: tuple[str, ...], draws: np.ndarray, path: Path, doubts: Sequence[str] = ()) -> None:
    """Write draws (draws, parameters) as a table with one column each, for `crrt-study --posterior`.

    A last column gives the reason if the draws cannot be trusted.
    """
    rows, remark = draws[:: max(1, len(draws) // MOST_SAMPLES)].tolist(), "; ".join(doubts)
    head = (*names, DOUBTS) if remark else names
    write_text(csv_text(head, ([*row, remark] for row in rows) if remark else rows), path)


def read_samples(path: str | Path) -> dict[str, list[float]]:
    """Read values by parameter, one per sample; of more than 1000 samples every n-th is used.

    Args:
        path: table with a header of parameter names and one row per sample, in the units of the parameter
            tables and separated by commas, semicolons or tabs; or the NetCDF file of a posterior,
            `posterior.nc`.

    Raises:
        SamplesError: The file has mistakes; the message names all of them.
    """
    head, rows, mistakes = _of_posterior(path) if Path(path).suffix == ".nc" else _of_table(path)
    if DOUBTS in head:
        words = head.index(DOUBTS)
        head, *cells = ([*row[:words], *row[words + 1 :]] for row in (head, *(cells for _, cells in rows)))
        rows = [(line, row) for (line, _), row in zip(rows, cells, strict=True)]
    mistakes += [
        f"{path}: column '{name[:40]}' is not a "
        f"parameter{spelling_hint(name, (*parameters(), *FREE_IN_CASES))}"
        for name in head
        if name not in FREE_IN_CASES and quantity(name) is None
    ]
    repeated = sorted({n for n in head if head.count(n) > 1})
    mistakes += [f"{path}: column {name} is there twice" for name in repeated]
    values = []
    for line, cells in rows:
        if len(cells) != len(head):
            mistakes.append(f"{path}:{line}: {len(cells)} values, the header has {len(head)}")
        values.append([_value(cell) for cell in cells])
        result = zip(head, cells, values[-1], strict=False)
        mistakes += [f"{path}:{line}: {wrong}" for each in result if (wrong := _mistake(*each))]
    if mistakes:
        more = len(mistakes) - MOST_MISTAKES
        raise SamplesError("; ".join(mistakes[:MOST_MISTAKES]) + (f"; and {more} more" if more > 0 else ""))
    thinned = values[:: math.ceil(len(values) / MOST_SAMPLES)]
    return {name: [row[k] for row in thinned] for k, name in enumerate(head)}


def doubts_of(path: str | Path, case: Case) -> tuple[str, ...]:
    """Doubts about a study with samples: those of the posterior, and whether they belong to this case.

    A table has doubts in a column of its own; for `samples.csv`, the `posterior.json` beside it is read, too.

    Args:
        path: file with samples that `read_samples` reads.
        case: case that the samples are used with.
    """
    about = _about(Path(path))
    doubts = list(filter(None, about["doubts"]))
    if not doubts and not about["trusted"]:
        doubts = ["nothing shows that its draws can be trusted"]
    name, policy, own = about["id"], about["blood_volume_policy"], case.blood_volume_policy or AS_PUBLISHED
    if name and name != case.patient.id and name.partition("/")[0] != case.patient.id.partition("/")[0]:
        doubts.append(f"its draws are those of patient '{name}', the case is that of '{case.patient.id}'")
    if policy and policy != own:
        doubts.append(f"its draws were fitted with the blood volume policy {policy}, the case has {own}")
    doubts += _doubts_about_reflexes(about["set_points"], case)
    return tuple(f"{POSTERIOR}{doubt}" for doubt in doubts)


def _doubts_about_reflexes(fitted: Mapping[str, float], case: Case) -> list[str]:
    """Doubts where draws were fitted with reflexes whose set points the case does not have."""
    if fitted and case.regulation is None:
        return ["its draws were fitted with reflexes, and the case has no [regulation]"]
    return [
        f"its draws were fitted with {name} = {fitted[name]:g}, which the case leaves open, so that every "
        "draw would have one of its own: use the fitted case, or give it"
        for name in case.open_set_points
        if name in fitted
    ]


def _about(path: Path) -> dict[str, Any]:
    """Read the attributes of a posterior: id, volume policy, set points, doubts, whether it is trusted."""
    usual: dict[str, Any] = {
        "id": "", "blood_volume_policy": "", "set_points": {}, "doubts": (), "trusted": True,
    }  # fmt: skip
    if path.suffix == ".nc":
        with xr.open_dataset(path, group="posterior", engine="h5netcdf") as draws:
            attributes = draws.attrs
        points = json.loads(attributes.get("set_points", "{}"))
        doubts = (attributes.get("doubts", ""),)
        return {**usual, "trusted": False, **attributes, "doubts": doubts, "set_points": points}
    if DOUBTS in (table := read_text_table(path, missing=_NO_SAMPLES)).header:
        column = table.header.index(DOUBTS)
        usual["doubts"] = tuple(dict.fromkeys(cells[column] for _, cells in table.rows))
    summary = path.with_name("posterior.json")
    if path.name != "samples.csv" or not summary.exists():
        return usual
    try:
        return {**usual, **json.loads(summary.read_text(encoding="utf-8"))}
    except (OSError, ValueError, TypeError):
        return {**usual, "doubts": (f"{summary}, which says whether they can be trusted, cannot be read",)}


_Rows = Sequence[tuple[int, Sequence[str]]]


def _of_table(path: str | Path) -> tuple[Sequence[str], _Rows, list[str]]:
    """Return header, rows with their line numbers, and mistakes of a table."""
    try:
        table = read_text_table(path, missing=_NO_SAMPLES)
    except CaseError as error:
        raise SamplesError(str(error)) from None
    return table.header, table.rows, [str(mistake) for mistake in table.mistakes]


def _of_posterior(path: str | Path) -> tuple[Sequence[str], _Rows, list[str]]:
    """Return names and draws of the group `posterior` of a NetCDF file, and mistakes."""
    if not Path(path).exists():
        raise SamplesError(f"{path}: no such file")
    try:
        with xr.open_dataset(path, group="posterior", engine="h5netcdf") as draws:
            columns = {str(name): values.to_numpy().ravel().tolist() for name, values in draws.items()}
    except (OSError, ValueError, KeyError) as error:
        raise SamplesError(f"{path}: no posterior can be read: {str(error).splitlines()[0]}") from None
    rows = list(enumerate(zip(*(map(repr, column) for column in columns.values()), strict=True), start=1))
    if not rows:
        raise SamplesError(f"{path}: its group posterior holds no draws")
    return list(columns), rows, []


def _mistake(name: str, cell: str, value: float) -> str:
    """Describe what is wrong with a value; empty if nothing is."""
    known = quantity(name)
    if not (math.isfinite(value) and (value > 0.0 or (known is not None and known.is_linear))):
        comma = math.isfinite(_value(cell.replace(",", ".")))
        hint = f": '{cell}' has a decimal comma; write a decimal point" if "," in cell and comma else ""
        return f"{name} is not a number above 0{hint}"
    if known is not None and not known.accepts(value):
        return f"{name} = {value:g}: outside the allowed range; allowed: {known.allowed}"
    return ""


def _value(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan
