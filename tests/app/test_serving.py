"""The server as a whole: root path, password, sessions, what a stranger can do."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
import urllib.error
import urllib.parse
import urllib.request

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one server, one browser


def status(url: str, **options: object) -> int:
    try:
        with urllib.request.urlopen(urllib.request.Request(url, **options), timeout=20) as answer:  # type: ignore[arg-type]
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


@pytest.fixture(scope="module", autouse=True)
def slow_visitor(served):
    """One who begins to ask and says no more; it is let go while other tests run."""
    address = urllib.parse.urlsplit(served.url)
    with socket.create_connection((address.hostname, address.port)) as slow:
        slow.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ")
        yield slow


@pytest.fixture(scope="module")
def full(browser, serving_throughout):
    """The page that a server for one session refused; the page before it has just been closed."""
    served = serving_throughout("--max-sessions", "1")
    first, second = browser.new_page(), browser.new_page()
    first.goto(served.url)
    first.wait_for_function("window.eclsim?.bus.last('beat')", timeout=150_000)
    second.goto(served.url)
    second.get_by_text("already open 1 times").wait_for()
    first.close()
    yield second
    second.close()


def test_no_more_sessions_than_allowed(full):
    assert full.get_by_text("already open 1 times").is_visible()


def test_behind_a_proxy_with_a_root_path(browser, serving):
    served = serving("--root-path", "/bed/side")
    page = browser.new_page()
    for address in ("/bed/side/", "/"):
        page.goto(served.url + address)
        page.wait_for_function("window.eclsim?.bus.last('beat')", timeout=150_000)
        paths = page.evaluate("performance.getEntriesByType('resource').map((e) => new URL(e.name).pathname)")
        assert paths
        assert all(path.startswith("/bed/side/") for path in paths)
    page.close()


def test_another_address_needs_a_password(tmp_path):
    from typer.testing import CliRunner

    from eclsim.cli.application import app

    result = CliRunner().invoke(app, ["app", "--host", "0.0.0.0"])
    assert result.exit_code == 2
    assert "--password-file" in result.output


def test_what_a_stranger_tries(served):
    assert status(served.url + "/static/..%2f..%2fetc/passwd") == 404
    assert status(served.url, headers={"Host": "evil.example"}) == 400
    assert status(served.url + "/_nicegui/client/guessed/upload/1", data=b"x") == 404
    assert (
        status(
            served.url + "/_nicegui/client/x/upload/1", data=b"x", headers={"Origin": "http://evil.example"}
        )
        == 403
    )
    assert (
        status(
            served.url + "/_nicegui/client/x/upload/1", data=b"x" * 10, headers={"Content-Length": "99999999"}
        )
        == 413
    )
    assert status(served.url + "/favicon.ico") == 200


def test_messages_that_no_browser_sends_end_their_connection_and_leave_no_traceback(serving):
    """Each left some twenty lines of a library in the log."""
    client = pytest.importorskip("websockets.sync.client", reason="speaks to the server as no browser does")
    from websockets.exceptions import ConnectionClosedError

    served = serving()
    address = served.url.replace("http", "ws") + "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
    for message in ("42", "42[", '42["event",null]', "9zzz", '42["event",{"id":1,"args":[NaN]}]'):
        with client.connect(address) as socket_:
            socket_.recv(timeout=20)
            socket_.send(message)
            with pytest.raises(ConnectionClosedError) as closed:
                socket_.recv(timeout=20)
            assert "1008" in str(closed.value)
    served.process.terminate()
    logged = served.process.stderr.read().decode()
    assert logged.count("a message from a browser could not be read") == 5
    assert "Traceback" not in logged


def test_addresses_sent_by_a_client_do_not_loosen_the_brake_on_passwords(serving, tmp_path):
    """uvicorn trusts X-Forwarded-For of this machine unless told otherwise."""
    secret = tmp_path / "password.txt"
    secret.write_text("correct horse battery\n")
    secret.chmod(0o600)
    served = serving("--password-file", str(secret), "--proxy", "192.0.2.1")

    def attempt(k: int) -> int:
        forwarded = {"X-Forwarded-For": f"10.0.0.{k}"}
        return status(served.url + "/sign-in", data=b"password=wrong", headers=forwarded)

    assert [attempt(k) for k in range(11)] == [401] * 10 + [429]


def test_a_port_in_use_is_said_in_one_line_and_no_address_is_promised(served):
    port = str(urllib.parse.urlsplit(served.url).port)
    command = [sys.executable, "-m", "eclsim", "app", "--port", port]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"error: --port {port}: already in use at 127.0.0.1; ")
    assert done.stderr.count("\n") == 1


def test_a_slow_visitor_is_let_go(served, slow_visitor):
    slow_visitor.settimeout(120)  # a visitor who is kept has this raise
    assert slow_visitor.recv(100) == b""
    assert status(served.url + "/favicon.ico") == 200


def test_a_place_is_free_again_after_a_page_was_closed(full):
    for _ in range(60):
        full.reload()
        if full.evaluate("!!document.querySelector('.ecl-page')"):
            break
        time.sleep(1)
    full.wait_for_function("window.eclsim?.bus.last('beat')", timeout=150_000)


def test_the_page_as_users_start_it_shows_a_beat_while_it_prepares_presets_and_fits(browser, serving):
    """Other servers of these tests compile what is asked for, and nothing in advance."""
    served = serving(program=("-m", "eclsim"))
    page = browser.new_page()
    page.goto(served.url)
    page.wait_for_function("window.eclsim?.bus.last('beat')", timeout=150_000)
    page.close()
    assert served.process.poll() is None
