"""Uploads are read apart: what unfolds to gigabytes ends their own process and no page."""

import io

import h5py
import numpy as np
import pytest

from eclsim.app import files
from eclsim.app.files import parse_file
from eclsim.app.server import MOST_UNCONNECTED, OpenPages
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import case_text
from eclsim.inputs.mistakes import CaseError


def posterior(draws: int, values: np.ndarray | None = None) -> bytes:
    """A posterior of one parameter; without values its arrays are unfolded from nothing when read."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        group = file.create_group("posterior")
        for name, size in (("chain", 1), ("draw", draws)):
            scale = group.create_dataset(name, (size,), "f8", chunks=(min(size, 1000),), compression="gzip")
            scale.make_scale(name)
        data = group.create_dataset("Rmc", (1, draws), "f8", chunks=(1, min(draws, 1000)), compression="gzip")
        data.dims[0].attach_scale(group["chain"])
        data.dims[1].attach_scale(group["draw"])
        if values is not None:
            data[:] = values
    return buffer.getvalue()


@pytest.mark.slow
def test_a_small_posterior_that_unfolds_to_gigabytes_is_refused():
    content = posterior(450_000_000)
    assert len(content) < 20_000
    with pytest.raises(CaseError, match=r"posterior\.nc: "):
        files.read_posterior_file("posterior.nc", content)


@pytest.mark.slow
def test_a_posterior_comes_back_from_its_process():
    members = files.read_posterior_file("posterior.nc", posterior(50, np.linspace(0.5, 0.9, 50)[None]))
    assert members.names == ("Rmc",)
    assert members.draws.shape == (50, 1)
    assert set(members.base) == {"Rmc"}


@pytest.mark.slow
def test_a_case_comes_back_from_its_process():
    case = PRESETS["paper"].case()
    content = case_text(case).encode()
    assert files.read_file("paper.toml", content) == parse_file("paper.toml", content)


@pytest.mark.slow
def test_mistakes_come_back_with_file_and_line():
    with pytest.raises(CaseError, match=r"^broken\.toml:1: "):
        files.read_file("broken.toml", b"format = = 1")


def test_too_much_time_is_said(monkeypatch):
    monkeypatch.setattr(files, "SECONDS", 0.01)
    with pytest.raises(CaseError, match=r"mine\.toml: not read: it takes too much memory or time"):
        files.read_file("C:\\folder\\mine.toml", b"format = 1")


def test_a_reader_that_dies_takes_nothing_with_it(monkeypatch):
    monkeypatch.setattr(files.sys, "executable", "/bin/false")
    with pytest.raises(CaseError, match=r"mine\.toml: not read"):
        files.read_file("mine.toml", b"format = 1")


class Client:
    """Stands in for a browser tab as the server sees it."""

    def __init__(self):
        self.deleted = False
        self.closed = False

    def on_connect(self, handler):
        self.connect = handler

    def on_delete(self, handler):
        self.handler = handler

    def delete(self):
        self.deleted = True
        self.handler()

    def close(self):
        self.closed = True


def test_pages_that_never_connect_take_no_session():
    visitors = OpenPages(most=2)
    unseen = [Client() for _ in range(3 * MOST_UNCONNECTED)]
    for client in unseen:
        visitors.add(client, client)
    assert not visitors.full
    assert [client.deleted for client in unseen] == [True] * 2 * MOST_UNCONNECTED + [False] * MOST_UNCONNECTED
    assert all(client.closed == client.deleted for client in unseen)
    people = [Client() for _ in range(2)]
    for client in people:
        visitors.add(client, client)
        client.connect()
    assert visitors.full
    people[0].delete()
    assert not visitors.full
