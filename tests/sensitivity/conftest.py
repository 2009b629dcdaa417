"""An analytic function in place of the model."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pytest

from eclsim.sensitivity.design import Design
from eclsim.sensitivity.runs import Analysis, Runs
from known_indices import ISHIGAMI_INPUTS, ishigami, runs_of


@dataclass(frozen=True)
class FunctionEvaluator:
    """A function of the inputs as a model with the outputs "y" and "square"."""

    function: Callable = ishigami
    outputs: tuple[str, ...] = ("y", "square")

    def __call__(self, settings: Mapping[str, np.ndarray], count: int) -> Runs:
        y = self.function(**settings)
        assert y.shape == (count,)
        return runs_of(np.stack([y, y**2], axis=1))

    def description(self) -> dict:
        return {"function": self.function.__name__}


@pytest.fixture
def plan() -> Analysis:
    design = Design(ISHIGAMI_INPUTS, 4096)  # 16 blocks of 256 rows
    assert design.blocks == 16
    return Analysis(design, FunctionEvaluator())
