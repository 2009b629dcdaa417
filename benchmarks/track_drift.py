"""Errors and coverage of `eclsim track` on simulated patients whose parameters drift in a known way.

    python benchmarks/track_drift.py --series 50 --points 10 --out track_drift.jsonl --seconds 280

Every series is a line of the output file; a run that was stopped, or that ran out of its seconds, goes on
where it ended. The summary is printed over all lines.
"""

import argparse

import numpy as np
from resumable import run
from simulated_patients import NAMES, simulated_series

from eclsim.identification.density import PosteriorDensity, Prior, gaussian_approximation
from eclsim.identification.least_squares import refine
from eclsim.identification.objective import Box, Objective, Target
from eclsim.identification.quantities import BEAT_OUTPUTS
from eclsim.identification.tracking import Tracker
from eclsim.orbit.model import model_of
from eclsim.outputs.uncertainty import measurement_errors
from eclsim.parameters.thiel2025 import BOUNDS


def refitted(points):
    """Fits of each point on its own: least squares as in the paper, and maximum of its posterior."""
    box = Box.of(BOUNDS)
    models = [model_of(p.case) for p in points]
    measured = [{n: getattr(p.case.measurements, n) for n in BEAT_OUTPUTS} for p in points]
    objective = Objective([Target(m, v, v) for m, v in zip(models, measured, strict=True)], NAMES)
    truth = np.log([[p.truth[n] for n in NAMES] for p in points])
    squares = refine(objective, np.arange(len(points)), truth, box)
    highest = []
    for model, values, x in zip(models, measured, truth, strict=True):
        prior = Prior.within(box)
        found = gaussian_approximation(
            PosteriorDensity(model, values, measurement_errors(values), prior), x[None]
        )
        highest.append((prior.x_of(found.centre), found.outputs))
    return (squares.x, squares.outputs), tuple(np.array(v) for v in zip(*highest, strict=True))


def one_series(seed: int, count: int) -> dict:
    points = simulated_series(seed, count)
    tracker = Tracker()
    tracked = [tracker.update(str(k), p.case) for k, p in enumerate(points)]
    truth = np.log([[p.truth[n] for n in NAMES] for p in points])
    outputs = np.array([[p.outputs[n] for n in BEAT_OUTPUTS] for p in points])
    measured = np.array([[getattr(p.case.measurements, n) for n in BEAT_OUTPUTS] for p in points])
    errors = np.array([list(measurement_errors(p.outputs).values()) for p in points])
    middle = np.log([[t.parameters[n].median for n in NAMES] for t in tracked])
    after = np.array([[t.outputs[n].median for n in BEAT_OUTPUTS] for t in tracked])
    (square_x, square_y), (high_x, high_y) = refitted(points)

    def inside(intervals, values):
        return [
            [bool(i[n].lower <= v <= i[n].upper) for n, v in zip(i, row, strict=True)]
            for i, row in zip(intervals, values, strict=True)
        ]

    return {
        "seed": seed,
        "seconds": [t.seconds for t in tracked],
        "parameter_error": {
            "track": (middle - truth).tolist(),
            "least_squares": (square_x - truth).tolist(),
            "posterior_alone": (high_x - truth).tolist(),
        },
        "output_error": {
            "track": ((after - outputs) / errors).tolist(),
            "least_squares": ((square_y - outputs) / errors).tolist(),
            "posterior_alone": ((high_y - outputs) / errors).tolist(),
            "measured": ((measured - outputs) / errors).tolist(),
        },
        "parameters_inside": inside([t.parameters for t in tracked], np.exp(truth)),
        "outputs_inside": inside([t.outputs for t in tracked], outputs),
        "forecast_inside": inside([t.forecast for t in tracked[1:]], outputs[1:]),
        "measured_inside": inside([t.expected for t in tracked[1:]], measured[1:]),
        "unusual": [t.unusual for t in tracked],
        "probability": [t.probability for t in tracked],
        "drift": [t.drift for t in tracked],
    }


def root_mean_square(lines, key, name):
    return float(np.sqrt(np.nanmean(np.concatenate([np.array(o[key][name])[1:] for o in lines]) ** 2)))


def summary(lines: list[dict]) -> dict:
    first = {
        key: {name: round(root_mean_square(lines, key, name), 4) for name in lines[0][key]}
        for key in ("parameter_error", "output_error")
    }
    inside = {
        key: round(
            float(np.mean(np.concatenate([np.array(o[key])[-len(o["forecast_inside"]) :] for o in lines]))), 4
        )
        for key in ("parameters_inside", "outputs_inside", "forecast_inside", "measured_inside")
    }
    each = np.mean(np.concatenate([np.array(o["parameters_inside"])[1:] for o in lines]), axis=0)
    of_forecast = np.mean(np.concatenate([np.array(o["forecast_inside"]) for o in lines]), axis=0)
    seconds = np.concatenate([o["seconds"][1:] for o in lines])
    better = {
        key: int(sum(
            np.mean(np.square(o[key]["track"][1:])) < np.mean(np.square(o[key]["least_squares"][1:]))
            for o in lines
        ))
        for key in ("parameter_error", "output_error")
    }  # fmt: skip
    return {
        "series": len(lines),
        "root_mean_square": first,
        "series_better_than_least_squares": better,
        "inside_90": inside,
        "by_parameter": dict(zip(NAMES, each.round(3).tolist(), strict=True)),
        "by_forecast_output": dict(zip(BEAT_OUTPUTS, of_forecast.round(3).tolist(), strict=True)),
        "unusual_share": round(float(np.mean(np.concatenate([o["unusual"][1:] for o in lines]))), 4),
        "update_seconds": {
            "median": round(float(np.median(seconds)), 3),
            "95 %": round(float(np.quantile(seconds, 0.95)), 3),
        },
        "first_seconds": round(float(np.median([o["seconds"][0] for o in lines])), 2),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--series", type=int, default=50)
    parser.add_argument("--points", type=int, default=10)
    run(
        parser,
        lambda chosen: range(chosen.series),
        lambda seed, chosen: one_series(seed, chosen.points),
        summary,
    )


if __name__ == "__main__":
    main()
