"""Speed and accuracy of courses: a day with six events, 1-minute steps, beat by beat, a cohort.

Run as `python benchmarks/course.py [PATIENTS]`; every result is printed with its target.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import eclsim
from eclsim import CourseOptions, Execution

DAY = Path(__file__).parents[1] / "examples" / "course_of_a_day.toml"
HALF_HOUR = """
[[events]]
at_min = 2
set = { "crrt.net_ultrafiltration_ml_h" = 300 }
[[events]]
at_min = 5
give = { crystalloid_ml = 300 }
over_min = 10
[[events]]
at_min = 18
set = { "ecmo.speed_rpm" = 3300 }
ramp_min = 4
"""
TRANSIENTS = """
[[events]]
at_min = 20
set = { "ecmo.speed_rpm" = 1500 }
[[events]]
at_min = 40
give = { bleed_ml = 500 }
over_min = 5
[[events]]
at_min = 70
set = { "ecmo.speed_rpm" = 3000 }
ramp_min = 0.5
"""
OUTPUTS = ("MAP", "MPAP", "PCWP", "right_atrial_pressure", "CO", "PF", "drainage_pressure", "heart_rate")
PRESSURES = ("MAP", "MPAP", "PCWP", "right_atrial_pressure", "drainage_pressure")


def timed(function, *arguments, **options):
    """Result, elapsed seconds and processor seconds of a function, after a first call that compiles."""
    function(*arguments, **options)
    wall, processor = time.perf_counter(), time.process_time()
    result = function(*arguments, **options)
    return result, time.perf_counter() - wall, time.process_time() - processor


def day() -> None:
    one = Execution(threads=1)
    result, wall, processor = timed(eclsim.course, DAY, execution=one)
    about = result.attrs
    print(f"24 h, six events, all outputs and alarms: {processor:.2f} s of one core ({wall:.2f} s), bar 3 s")
    print(f"  {about['steps']} steps, {about['solves']} beats for rates, {result.sizes['time_min']} shown")
    for kind in ("secant", "derivative", "last"):
        own = eclsim.course(DAY, options=CourseOptions(predictor=kind), outputs=OUTPUTS).attrs
        print(f"  search begins at the {kind}: {own['beats'] / own['solves']:.2f} beats for each")
    fixed = eclsim.course(DAY, options=CourseOptions(step_s=60.0), outputs=OUTPUTS)
    own = eclsim.course(DAY, outputs=OUTPUTS)
    worst = max(float(np.abs(fixed[n] - own[n]).max()) for n in PRESSURES)
    print(f"  against 1-minute steps: pressures within {worst:.4f} mmHg, bar 0.1")


def half_hour() -> None:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "half_hour.toml"
        file.write_text(DAY.read_text().partition("[[events]]")[0] + HALF_HOUR)
        beats, wall, _ = timed(eclsim.course_beats, file, minutes=30.0)
        own = eclsim.course(file, minutes=30.0, every_min=0.25)
    print(f"30 min beat by beat: {wall:.1f} s")
    for name in PRESSURES:
        difference = np.interp(own["time_min"], beats["time_min"], beats[name]) - own[name].to_numpy()
        print(f"  {name}: steady beats within {np.abs(difference).max():.3f} mmHg, bar 0.1")


def transients() -> None:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "transients.toml"
        file.write_text(DAY.read_text().partition("[[events]]")[0] + TRANSIENTS)
        beats = eclsim.course_beats(file, minutes=120.0, outputs=PRESSURES)
        for words, hand_over in (("handed over", True), ("steady beats only", False)):
            options = CourseOptions(hand_over=hand_over)
            own, _, processor = timed(eclsim.course, file, minutes=120.0, options=options)
            there = beats["time_min"].to_numpy()
            worst = [np.abs(np.interp(there, own["time_min"], own[n]) - beats[n]).max() for n in PRESSURES]
            listed = ", ".join(f"{n} {float(value):.2f}" for n, value in zip(PRESSURES, worst, strict=True))
            print(f"2 h with sudden events, {words}: {processor:.1f} s; against every beat {listed} mmHg")


def cohort(count: int) -> None:
    draws = np.random.default_rng(1)
    spread = {n: draws.uniform(0.8, 1.2, count) for n in ("Rmc", "Emaxlv", "Csart", "Rpmc")}
    model = eclsim.model_of(eclsim.read_case(DAY).case)
    changes = {name: factor * model.values[name] for name, factor in spread.items()}
    options = {"outputs": OUTPUTS, "every_min": 30.0, "with_alarms": False}
    eclsim.course_many(DAY, {k: v[:40] for k, v in changes.items()}, **options)
    wall, processor = time.perf_counter(), time.process_time()
    results = eclsim.course_many(DAY, changes, **options)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    done = sum(r.attrs["converged"] for r in results)
    print(f"{count} patients of 24 h ({done} to the end): {wall:.1f} s, {processor:.1f} s of processors")
    both = processor / count * 1000 / 60 / 2
    print(f"  1,000 patients: {both:.1f} min if two cores share that evenly, bar 4 min on 2 cores")


if __name__ == "__main__":
    day()
    half_hour()
    transients()
    cohort(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
