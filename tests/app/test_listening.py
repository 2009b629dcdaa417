"""Addresses: listening on them, what is said of them at the start, and how they are written."""

import socket

import pytest

from eclsim.app.listening import (
    ListenError,
    host_in_url,
    is_this_machine,
    listen,
    plain_address,
    served_names,
    start_lines,
)


def test_a_port_in_use_is_named_with_what_to_do():
    (first,) = listen("127.0.0.1", 0)
    with first:
        port = first.getsockname()[1]
        with pytest.raises(
            ListenError, match=rf"--port {port}: already in use at 127.0.0.1; .* another --port"
        ):
            listen("127.0.0.1", port)


@pytest.mark.parametrize("host", ["192.0.2.77", "no-such-host.invalid"])
def test_an_address_of_another_machine_is_named(host):
    with pytest.raises(ListenError, match=rf"--host {host}: not an address of this machine"):
        listen(host, 0)


def test_a_name_is_listened_to_at_each_of_its_addresses(monkeypatch):
    found = [
        (socket.AF_INET, socket.SOCK_STREAM, 6, "", ("127.0.0.1", 0)),
        (socket.AF_INET, socket.SOCK_STREAM, 6, "", ("192.0.2.77", 0)),
        (socket.AF_INET, socket.SOCK_STREAM, 6, "", ("127.0.0.1", 0)),
    ]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: found)
    sockets = listen("name", 0)
    assert [one.getsockname()[0] for one in sockets] == ["127.0.0.1"]
    for one in sockets:
        one.close()
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: found[1:2] * 2)
    with pytest.raises(ListenError, match="not an address of this machine"):
        listen("name", 0)


@pytest.mark.parametrize(
    ("host", "written"),
    [
        ("::1", "[::1]"),
        ("[::1]", "[::1]"),
        ("127.0.0.1", "127.0.0.1"),
        ("FE80::1", "[fe80::1]"),
        ("Ward", "ward"),
    ],
)
def test_hosts_are_written_as_browsers_do(host, written):
    assert host_in_url(host) == written


def test_addresses_have_one_form():
    assert plain_address("::ffff:192.0.2.1") == "192.0.2.1"
    assert plain_address("[::1]") == "::1"
    assert plain_address("ward.example") == plain_address("1.2.3.4:80") == plain_address("") == ""
    assert is_this_machine("::1")
    assert is_this_machine("localhost")
    assert not is_this_machine("0.0.0.0")


def test_all_addresses_are_no_name_but_a_single_one_is():
    assert "0.0.0.0" not in served_names("0.0.0.0", ["Ward.example"])
    assert {"ward.example", "127.0.0.1", "localhost", "[::1]"} == served_names("::", ["Ward.example"])
    assert {"[fe80::1]", "192.0.2.1"} <= served_names("fe80::1", ["192.0.2.1"])


def test_on_this_machine_the_address_alone_is_said():
    assert start_lines("127.0.0.1", 8080, "/bed", (), ()) == ["http://127.0.0.1:8080/bed/  (Ctrl-C stops it)"]
    assert start_lines("::1", 80, "", (), ())[0].startswith("http://[::1]:80/ ")


def test_for_others_the_names_and_the_lack_of_https_are_said():
    address, names, warning = start_lines("0.0.0.0", 8080, "", (), ())
    assert address.startswith("http://127.0.0.1:8080/")
    assert "under the names 127.0.0.1, [::1], localhost; add --allow-host NAME" in names
    assert "without HTTPS, passwords and patients are sent unencrypted" in warning
    behind = start_lines("0.0.0.0", 8080, "", ["ward.example"], ["10.0.0.1"])
    assert [line.split()[0] for line in behind] == ["http://ward.example:8080/", "served"]
    assert "ward.example" in behind[1]
