import numpy as np
import pytest
from SALib.sample import sobol as salib_sampler

from eclsim.sensitivity import analysis
from eclsim.sensitivity.design import Design, DesignError
from eclsim.sensitivity.inputs import Categorical, Continuous

INPUTS = tuple(Continuous(name, low, high) for name, low, high in (("a", 0, 1), ("b", -2, 3), ("c", 5, 50)))


def salib_samples(design: Design) -> np.ndarray:
    problem = {
        "num_vars": len(design.inputs),
        "names": [i.name for i in design.inputs],
        "bounds": [[i.low, i.high] for i in design.inputs],
    }
    if design.groups:
        problem["groups"] = list(design.groups)
    options = {"calc_second_order": design.second_order, "seed": design.seed}
    return salib_sampler.sample(problem, design.samples, **options)


@pytest.mark.parametrize("groups", [(), ("R", "C", "R")])
@pytest.mark.parametrize("second_order", [True, False])
@pytest.mark.parametrize("seed", [0, 1, 77])
def test_samples_are_those_of_salib_bit_for_bit(groups, second_order, seed):
    design = Design(INPUTS, 16, seed, groups, second_order)
    ours = np.stack(list(design.settings(design.unit()).values()), axis=1)
    assert np.array_equal(ours, salib_samples(design))
    assert len(ours) == design.evaluations


def test_a_block_is_a_part_of_the_whole_design():
    design = Design(tuple(Continuous(f"x{k}", 0, 1) for k in range(24)), 256)
    whole = design.unit()
    parts = [design.unit(*design.block_rows(block)) for block in range(design.blocks)]
    assert design.blocks > 1
    assert np.array_equal(np.concatenate(parts), whole)


def test_a_smaller_design_is_the_beginning_of_a_larger_one():
    small, large = Design(INPUTS, 32), Design(INPUTS, 128)
    assert np.array_equal(small.unit(), large.unit(0, 32))


def test_a_choice_follows_its_own_coordinate():
    choice = Categorical("scheme", ("x", "y", "z"), (("access", (0, 1, 2)), ("back", (5, 5, 7))))
    design = Design((*INPUTS, choice), 64)
    points = design.settings(design.unit())["access"].reshape(64, design.runs_per_row)
    first, second = points[:, 0], points[:, -1]
    for k in range(3):  # exchanging another input leaves the choice of A
        assert np.array_equal(points[:, 1 + k], first)
    assert np.array_equal(points[:, 4], second)
    assert np.array_equal(points[:, 8], first)
    assert np.bincount(first.astype(int)).min() >= 20
    assert set(choice.table_column(np.array([0.0, 0.4, 0.999]))) == {"x", "y", "z"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"samples": 100}, "power of two"),
        ({"samples": 1}, "power of two"),
        ({"seed": -1}, "seed"),
        ({"groups": ("R",)}, "1 names for 3 inputs"),
        ({"inputs": (INPUTS[0], INPUTS[0])}, "given twice: a"),
        ({"inputs": ()}, "none given"),
    ],
)
def test_impossible_designs_say_what_is_allowed(change, message):
    with pytest.raises(DesignError, match=message):
        Design(**({"inputs": INPUTS, "samples": 8} | change))


def test_a_design_that_does_not_fit_into_memory_is_refused_with_what_does(monkeypatch):
    monkeypatch.setattr(analysis, "_memory_bytes", lambda: 1e9)
    inputs = tuple(Continuous(f"x{k}", 0.0, 1.0) for k in range(24))
    analysis.check_memory(Design(inputs, 8192), 7)
    with pytest.raises(DesignError, match=r"up to 8192 rows"):
        analysis.check_memory(Design(inputs, 4194304), 7)
