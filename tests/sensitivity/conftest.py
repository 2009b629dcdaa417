"""An analytic function in place of the model, and stores for it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from eclsim.sensitivity.analysis import Analysis
from eclsim.sensitivity.design import Design
from eclsim.sensitivity.evaluation import Evaluated
from eclsim.sensitivity.store import Store
from eclsim.sensitivity.testfunctions import ISHIGAMI_INPUTS, ishigami


@dataclass(frozen=True)
class FunctionEvaluator:
    """A function of the inputs as a model with the outputs "y" and "square"."""

    function: Callable = ishigami
    outputs: tuple[str, ...] = ("y", "square")

    def __call__(self, settings: Mapping[str, np.ndarray], count: int) -> Evaluated:
        y = self.function(**settings)
        assert y.shape == (count,)
        return Evaluated.of(np.stack([y, y**2], axis=1))

    def description(self) -> dict:
        return {"function": self.function.__name__}


@pytest.fixture
def plan() -> Analysis:
    design = Design(ISHIGAMI_INPUTS, 4096)  # 16 blocks of 256 rows
    assert design.blocks == 16
    return Analysis(design, FunctionEvaluator())


@pytest.fixture
def open_store(plan: Analysis) -> Callable[..., Store]:
    def opened(folder: Path, resume: bool = False) -> Store:
        store = Store.of(folder, plan.design, plan.evaluator)
        store.open(resume)
        return store

    return opened
