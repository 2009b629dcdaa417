"""What is known of a followed patient at each time: measurements beside their forecast, and the estimate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from eclsim.files import ORIGIN
from eclsim.identification.quantities import OUTPUTS, unit_of, unit_of_parameter
from eclsim.identification.verdict import FitVerdict

HOURS_PER_DAY = 24.0
SHARES = (0.05, 0.5, 0.95)
"""Quantiles of an `Interval`: lower end, median, upper end."""


@dataclass(frozen=True)
class Interval:
    """Median and central 90 % interval, in the unit of the quantity."""

    lower: float
    median: float
    upper: float


@dataclass(frozen=True)
class Innovation:
    """A measurement compared with its forecast.

    Args:
        measured: value [mmHg or L/min].
        deviation: (measured - forecast) / standard deviation of the difference; None without a forecast.
        unusual: whether the measurement does not fit.
        used: whether the parameters were updated with it.
        met: whether the estimate after the update agrees with it.
    """

    measured: float
    deviation: float | None = None
    unusual: bool = False
    used: bool = True
    met: bool = True


@dataclass(frozen=True)
class TrackedPoint:
    """The state of a patient at one time of a series.

    Args:
        name: name of the point.
        innovations: comparison of each measurement with its forecast.
        parameters: parameters after the update.
        outputs: outputs of the model after the update.
        drift: standard deviation of the change of a latent variable over a day, estimated so far.
        forecast: forecast outputs of the model; empty at the first point.
        expected: 90 % intervals of the expected measurements: the forecast with measurement noise.
        chi_square: chi-square of all innovations together; None at the first point.
        probability: probability of a larger chi-square.
        unusual: whether the measurements together do not fit the patient so far.
        verdict: whether the model can reproduce the first measurements; None at later points.
        message: remarks; empty if there are none.
        failed: whether the point could not be used.
        warnings: warnings about the beat, from draws of the estimate, with their probabilities.
        hours: time since the previous measurement, known or assumed [h]; None at the first point.
        seconds: wall time of forecast and update [s].
        doubts: unknown quantities that are held, so that the estimate compensates for them, open questions,
            and measurements that the estimate does not meet.
    """

    name: str
    innovations: Mapping[str, Innovation]
    parameters: Mapping[str, Interval]
    outputs: Mapping[str, Interval]
    drift: float
    forecast: Mapping[str, Interval] = field(default_factory=dict)
    expected: Mapping[str, Interval] = field(default_factory=dict)
    chi_square: float | None = None
    probability: float | None = None
    unusual: bool = False
    verdict: FitVerdict | None = None
    message: str = ""
    failed: bool = False
    warnings: tuple[str, ...] = ()
    hours: float | None = None
    seconds: float = 0.0
    doubts: tuple[str, ...] = ()

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Outputs whose intervals are not to be trusted; `doubts` gives the reason."""
        return tuple(n for n in self.outputs if any(doubt.startswith(f"{n}: ") for doubt in self.doubts))

    def as_object(self) -> dict[str, Any]:
        """Plain data for JSON; null for unknown values."""
        names = {"name": "id", "hours": "hours_since_last", "innovations": "measurements"}
        content = {names.get(name, name): value for name, value in asdict(self).items()}
        verdict = None if self.verdict is None else self.verdict.as_object()
        return {**content, "doubtful": self.doubtful, "verdict": verdict, "seconds": round(self.seconds, 3)}


@dataclass(frozen=True)
class TrackResult:
    """A patient followed through a series of measurements.

    Args:
        patient: id of the patient.
        points: points in order of time.
        assumed_interval_hours: assumed time between measurements [h]; None if their names are times.
        notes: assumptions for all times and on the time between them, and set points that the series gave
            because the cases leave them open.
    """

    patient: str
    points: tuple[TrackedPoint, ...] = field(repr=False)
    assumed_interval_hours: float | None
    notes: tuple[str, ...] = ()

    @property
    def dataset(self) -> xr.Dataset:
        """Parameters, forecasts and measurements over the points, with units; NaN for unknown values.

        `doubts` begins with the headline of the first estimate's verdict where that is not good.
        """
        points = self.points
        parameters = list(dict.fromkeys(n for p in points for n in p.parameters))
        outputs = [n for n in OUTPUTS if any(n in p.outputs or n in p.innovations for p in points)]

        def intervals(each: Sequence[Mapping[str, Interval]], names: Sequence[str]) -> np.ndarray:
            nothing = Interval(np.nan, np.nan, np.nan)
            result = [[by_name.get(n, nothing) for n in names] for by_name in each]
            return np.array([[(i.lower, i.median, i.upper) for i in row] for row in result])

        def of_measured(attribute: str) -> np.ndarray:
            rows = [[getattr(p.innovations.get(n), attribute, None) for n in outputs] for p in points]
            return np.array(rows, dtype=float)

        of_parameters = ("point", "parameter", "quantile")
        of_points, of_outputs = ("point", "output"), ("point", "output", "quantile")
        data = {
            "parameters": (of_parameters, intervals([p.parameters for p in points], parameters)),
            "forecast": (of_outputs, intervals([p.forecast for p in points], outputs)),
            "expected": (of_outputs, intervals([p.expected for p in points], outputs)),
            "outputs": (of_outputs, intervals([p.outputs for p in points], outputs)),
            **{name: (of_points, of_measured(name)) for name in ("measured", "deviation", "used", "met")},
        }  # fmt: skip
        for name, unit in (("chi_square", "1"), ("probability", "1"), ("drift", "1"), ("hours", "h")):
            values = np.array([getattr(p, name) for p in points], dtype=float)
            data[name] = ("point", values, {"units": unit})
        data |= {name: ("point", [getattr(p, name) for p in points]) for name in ("failed", "unusual")}
        data["message"] = ("point", [p.message for p in points])
        verdicts = ["" if p.verdict is None else str(p.verdict.level) for p in points]
        fits = [p.verdict.headline if p.verdict is not None and p.verdict.doubts else "" for p in points]
        data["verdict"] = ("point", verdicts)
        doubts = ["; ".join(filter(None, (of, *p.doubts))) for of, p in zip(fits, points, strict=True)]
        data["doubts"] = ("point", doubts)
        coordinates = {
            "point": [p.name for p in points], "parameter": parameters, "output": outputs,
            "quantile": list(SHARES),
            "parameter_units": ("parameter", list(map(unit_of_parameter, parameters))),
            "output_units": ("output", [unit_of(n) for n in outputs]),
        }  # fmt: skip
        about = {**ORIGIN, "patient": self.patient, "notes": list(self.notes)}
        if self.assumed_interval_hours is not None:
            about["assumed_interval_hours"] = self.assumed_interval_hours
        return xr.Dataset(data, coordinates, about)

    def as_object(self) -> dict[str, Any]:
        """Plain data for JSON; null for unknown values."""
        return {
            "id": self.patient,
            "assumed_interval_hours": self.assumed_interval_hours,
            "notes": list(self.notes),
            "points": [p.as_object() for p in self.points],
        }
