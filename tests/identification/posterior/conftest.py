import pytest

from known_posteriors import CurvedPosterior


@pytest.fixture
def curved():
    return CurvedPosterior(bend=0.8)
