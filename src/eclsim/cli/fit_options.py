"""Options that `eclsim identify` and `eclsim track` share: what is free, bounds, uncertainties."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from eclsim.cli.messages import fail

if TYPE_CHECKING:
    from eclsim.identification.settings import FitSettings


def fit_settings(
    parameters: str | None,
    bounds: str | None,
    uncertainty: str | None,
    *,
    weights: Literal["relative", "uncertainty"] = "relative",
    policy: str | None = None,
    seed: int = 0,
) -> FitSettings:
    """Settings from options as they were written; with any mistake say all and leave with exit status 2."""
    from eclsim.identification.multi_start import MultiStart
    from eclsim.identification.settings import FitSettings, parameter_names, read_bounds
    from eclsim.parameters.identification import BOUNDS
    from eclsim.sensitivity.inputs import InputError
    from eclsim.sensitivity.uncertainties import DEFAULTS, read_uncertainties

    wrong: list[str] = []
    uncertainties, limits = {}, {}
    try:
        uncertainties = read_uncertainties(uncertainty or "")
    except InputError as error:
        wrong += error.mistakes
    allowed = ", ".join(DEFAULTS)
    wrong += [
        f"--uncertainty {n}: no measurement; allowed: {allowed}" for n in uncertainties if n not in DEFAULTS
    ]
    try:
        limits = read_bounds(bounds or "")
    except ValueError as error:
        wrong += str(error).splitlines()
    names = tuple(BOUNDS) if parameters is None else tuple(parameter_names(parameters))
    if not names:
        wrong.append("--parameters: no names")
    if wrong:
        fail(*wrong)
    return FitSettings(names, limits, weights, uncertainties, MultiStart(seed=seed), policy)
