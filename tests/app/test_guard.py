"""The guard: hosts, origins, sizes, times, paths, password. Plain ASGI, no server needed."""

import asyncio

import pytest

from eclsim.app import guard
from eclsim.app.guard import LARGEST_BODY, Guard, Rules
from eclsim.app.sign_in import MOST_FAILURES, MOST_FAILURES_TOGETHER, SignIns

HOSTS = frozenset({"127.0.0.1", "localhost", "[::1]"})


async def inner(scope, receive, send):
    """Reads everything and tells the path and the size."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        return
    size, more = 0, True
    while more:
        message = await receive()
        size += len(message.get("body", b""))
        more = message.get("more_body", False)
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send(
        {"type": "http.response.body", "body": f"{scope['root_path']} {scope['path']} {size}".encode()}
    )


class Answer:
    def __init__(self, messages):
        start = next((m for m in messages if m["type"] == "http.response.start"), {})
        self.kinds = [m["type"] for m in messages]
        self.status = start.get("status")
        self.headers = {k.decode(): v.decode() for k, v in start.get("headers", ())}
        self.text = b"".join(
            m.get("body", b"") for m in messages if m["type"] == "http.response.body"
        ).decode()


def ask(rules=None, method="GET", path="/", headers=(), body=(b"",), kind="http", wait=0.0, **more):
    """One request; `body` in pieces, `wait` seconds before each; `more` is put in the scope."""
    pieces = list(body)

    async def run():
        sent = []

        async def receive():
            await asyncio.sleep(wait)
            if kind == "websocket":
                return {"type": "websocket.connect"}
            piece = pieces.pop(0) if pieces else b""
            return {"type": "http.request", "body": piece, "more_body": bool(pieces)}

        async def send(message):
            sent.append(message)

        result = {"host": "127.0.0.1:8080", **dict(headers)}
        raw = [(k.encode(), v.encode()) for k, v in result.items()]
        scope = {"type": kind, "method": method, "path": path, "headers": raw, "scheme": "http"}
        scope |= {"client": ("127.0.0.1", 50000), **more}
        await Guard(inner, rules or Rules(HOSTS))(scope, receive, send)
        return Answer(sent)

    return asyncio.run(run())


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.1:8080", "LOCALHOST:1", "[::1]:8080"])
def test_own_names_are_let_in(host):
    assert ask(headers={"host": host}).status == 200


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example", "", "localhost@evil.example", "[::2]:8080"]
)
def test_other_names_are_refused(host):
    assert ask(headers={"host": host}).status == 400


def test_a_request_for_the_headers_alone_is_answered_as_one_for_the_page():
    assert ask(method="HEAD").status == 200
    assert ask(method="HEAD").headers["content-type"] == "text/html; charset=utf-8"
    assert ask(method="HEAD").text == ""  # and no page is built that nobody opens
    assert ask(method="HEAD", path="/favicon.ico").text == " /favicon.ico 0"  # dropped by the server
    locked = Rules(HOSTS, signed_in=SignIns("long enough"))
    assert ask(locked, method="HEAD").status == 303
    assert ask(method="HEAD", headers={"host": "evil.example"}).status == 400


def test_another_site_can_neither_post_nor_open_a_socket():
    foreign = {"origin": "https://evil.example"}
    assert ask(method="POST", path="/_nicegui/x", headers=foreign).status == 403
    assert ask(kind="websocket", path="/_nicegui_ws/", headers=foreign).kinds == ["websocket.close"]
    assert ask(method="POST", path="/_nicegui/x", headers={"sec-fetch-site": "cross-site"}).status == 403


def test_the_page_itself_can():
    own = {"origin": "http://127.0.0.1:8080", "sec-fetch-site": "same-origin"}
    assert ask(method="POST", path="/_nicegui/x", headers=own).status == 200
    assert ask(kind="websocket", path="/_nicegui_ws/", headers=own).kinds == ["websocket.accept"]


@pytest.mark.parametrize(
    "path",
    [
        "/static/../../etc/passwd",
        "/_nicegui/../../etc/passwd",
        "/docs",
        "/openapi.json",
        "/x",
        "//evil.example",
    ],
)
def test_other_paths_are_not_found(path):
    assert ask(path=path).status == 404


def test_unusual_methods_are_refused():
    assert ask(method="DELETE").status == 405


def test_a_body_that_says_it_is_too_large_is_refused_unread():
    answer = ask(method="POST", path="/_nicegui/x", headers={"content-length": str(LARGEST_BODY + 1)})
    assert answer.status == 413
    assert answer.headers["connection"] == "close"
    assert ask(method="POST", path="/_nicegui/x", headers={"content-length": "-1"}).status == 413


def test_a_body_that_grows_too_large_is_refused():
    pieces = [b"x" * 1_000_000] * 7
    assert ask(method="POST", path="/_nicegui/x", body=pieces).status == 413
    assert ask(method="POST", path="/_nicegui/x", body=pieces[:5]).text.endswith("5000000")


def test_a_body_that_does_not_come_is_given_up(monkeypatch):
    monkeypatch.setattr(guard, "SLOWEST_BODY_S", 0.05)
    assert ask(method="POST", path="/_nicegui/x", body=[b"a"] * 9, wait=0.02).status == 408


def test_answers_forbid_frames_and_other_sites():
    headers = ask().headers
    assert headers["x-frame-options"] == "DENY"
    assert "default-src 'self'" in headers["content-security-policy"]
    assert "http" not in headers["content-security-policy"]


@pytest.mark.parametrize("path", ["/", "/eclsim", "/eclsim/"])
def test_behind_a_proxy_the_root_path_may_be_there_or_not(path):
    answer = ask(Rules(HOSTS, "/eclsim"), path=path)
    assert answer.text == "/eclsim /eclsim/ 0"


def test_a_path_that_only_begins_like_the_root_path_is_not_it():
    assert ask(Rules(HOSTS, "/eclsim"), path="/eclsimulator").status == 404


# --- password ----------------------------------------------------------------------------------

PASSWORD = "correct horse battery"


def sign_in(rules, password, headers=(), peer="127.0.0.1"):
    body = ("password=" + password.replace(" ", "+")).encode()
    return ask(rules, "POST", "/sign-in", headers=headers, body=(body,), client=(peer, 50000))


@pytest.fixture
def locked():
    return Rules(HOSTS, "", SignIns(PASSWORD))


def test_without_the_password_nothing_is_shown(locked):
    assert ask(locked).headers["location"] == "/sign-in"
    assert ask(locked, path="/_nicegui/x").status == 401
    assert ask(locked, kind="websocket", path="/_nicegui_ws/").kinds == ["websocket.close"]
    assert ask(locked, headers={"cookie": "eclsim_session=guessed"}).status == 303
    assert "password" in ask(locked, path="/sign-in").text


def test_with_it_a_cookie_lets_in(locked):
    answer = sign_in(locked, PASSWORD)
    cookie = answer.headers["set-cookie"]
    assert answer.status == 303
    assert {"HttpOnly", "SameSite=Strict"} <= set(cookie.split("; "))
    pair = {"cookie": cookie.split(";")[0]}
    assert ask(locked, headers=pair).status == 200
    assert ask(locked, kind="websocket", path="/_nicegui_ws/", headers=pair).kinds == ["websocket.accept"]


@pytest.mark.parametrize(("proxies", "is_secure"), [(frozenset({"127.0.0.1"}), True), (frozenset(), False)])
def test_behind_a_named_proxy_with_https_the_cookie_is_for_https_alone(proxies, is_secure):
    rules = Rules(HOSTS, "", SignIns(PASSWORD), proxies)
    answer = sign_in(rules, PASSWORD, {"x-forwarded-proto": "https"})
    assert ("Secure" in answer.headers["set-cookie"]) == is_secure


def test_a_sender_that_says_to_be_another_is_braked_all_the_same():
    """Each attempt came with an address of its own, and none was refused."""
    rules = Rules(HOSTS, "", SignIns(PASSWORD, lambda: 0.0))
    for k in range(MOST_FAILURES):
        assert sign_in(rules, "wrong", {"x-forwarded-for": f"10.0.0.{k}"}).status == 401
    assert sign_in(rules, PASSWORD, {"x-forwarded-for": "10.0.0.99"}).status == 429


@pytest.mark.parametrize("sent_before", ["", "10.9.9.{k}, "])
def test_behind_a_named_proxy_the_address_that_it_wrote_itself_is_braked(sent_before):
    """A proxy that appends leaves what the client sent in front of the address it saw."""
    rules = Rules(HOSTS, "", SignIns(PASSWORD, lambda: 0.0), frozenset({"192.0.2.1"}))

    def attempt(password, address, k):
        forwarded = {"x-forwarded-for": sent_before.format(k=k) + address}
        return sign_in(rules, password, forwarded, peer="::ffff:192.0.2.1").status

    assert [attempt("wrong", "203.0.113.5", k) for k in range(MOST_FAILURES)] == [401] * MOST_FAILURES
    assert attempt(PASSWORD, "203.0.113.5", 99) == 429
    assert attempt(PASSWORD, "203.0.113.6", 99) == 303


def test_headers_of_a_proxy_reach_the_page_from_a_named_one_only(caplog):
    seen = []

    async def inner(scope, receive, send):
        seen.append((scope["client"][0], sorted(k for k, _ in scope["headers"])))

    def request(guard, peer):
        raw = [(b"host", b"localhost"), (b"x-forwarded-for", b"10.0.0.1"), (b"x-forwarded-prefix", b"/x")]
        scope = {"type": "http", "method": "GET", "path": "/", "headers": raw, "client": (peer, 1)}

        async def receive():
            return {"type": "http.request", "body": b"", "more_body": False}

        asyncio.run(guard(scope, receive, receive))

    guard = Guard(inner, Rules(HOSTS, proxies=frozenset({"::1"})))
    for peer in ("::1", "127.0.0.1", "127.0.0.1"):
        request(guard, peer)
    every = [b"host", b"x-forwarded-for", b"x-forwarded-prefix"]
    assert seen == [("10.0.0.1", every), ("127.0.0.1", [b"host"]), ("127.0.0.1", [b"host"])]
    assert [record.getMessage() for record in caplog.records] == [
        "X-Forwarded-For from 127.0.0.1 is ignored: if this is your reverse proxy, add --proxy 127.0.0.1"
    ]


def test_who_signs_out_must_sign_in_again():
    rules = Rules(HOSTS, "/bed", SignIns(PASSWORD))
    pair = {"cookie": sign_in(rules, PASSWORD).headers["set-cookie"].split(";")[0]}
    assert ask(rules, headers=pair).status == 200
    assert ask(rules, path="/sign-out", headers=pair).status == 404  # a link elsewhere signs nobody out
    answer = ask(rules, "POST", "/sign-out", headers=pair)
    assert (answer.status, answer.headers["location"]) == (303, "/bed/sign-in")
    assert answer.headers["set-cookie"].startswith("eclsim_session=; Path=/bed;")
    assert "Max-Age=0" in answer.headers["set-cookie"]
    assert ask(rules, headers=pair).status == 303
    assert ask(method="POST", path="/sign-out").status == 404  # without a password, nobody signed in


def test_after_many_failures_from_everywhere_attempts_take_turns(monkeypatch):
    waits = []

    async def slept(seconds):
        waits.append(seconds)

    signed_in = SignIns(PASSWORD, lambda: 0.0)
    rules = Rules(HOSTS, "", signed_in)
    for k in range(MOST_FAILURES_TOGETHER):
        signed_in.try_body(b"password=wrong", f"10.0.0.{k}")
    monkeypatch.setattr(guard.asyncio, "sleep", slept)
    statuses = [sign_in(rules, PASSWORD, peer=f"10.1.0.{k}").status for k in range(12)]
    assert statuses == [303] * 11 + [429]
    assert [wait for wait in waits if wait] == [*range(1, 11)]


def test_guessing_is_slowed_down():
    now = [0.0]
    rules = Rules(HOSTS, "", SignIns(PASSWORD, lambda: now[0]))
    for _ in range(MOST_FAILURES):
        assert sign_in(rules, "wrong").status == 401
    assert sign_in(rules, PASSWORD).status == 429
    now[0] = 61.0
    assert sign_in(rules, PASSWORD).status == 303


@pytest.mark.parametrize("body", [b"", b"\xff\xfe", b"password", b"a=b&" * 100, b"password=" + b"x" * 5000])
def test_nonsense_at_the_door_is_refused(locked, body):
    assert ask(locked, "POST", "/sign-in", body=(body,)).status in (401, 413)


OWN = "http://127.0.0.1:8080"


@pytest.mark.parametrize(
    ("origin", "more", "status"),
    [
        (OWN, {}, 200),
        ("http://127.0.0.1:3000", {}, 403),
        ("http://127.0.0.1", {}, 403),
        ("https://127.0.0.1:8080", {}, 403),
        ("http://localhost:8080", {}, 403),
        ("null", {}, 403),
        ("http://127.0.0.1:99999", {}, 403),
        ("https://localhost", {"host": "localhost"}, 200),
        ("https://localhost:8443", {"host": "localhost"}, 403),
        ("https://localhost", {"host": "localhost", "x-forwarded-proto": "https"}, 200),
        ("http://localhost", {"host": "localhost", "x-forwarded-proto": "https"}, 403),
        ("https://localhost:8443", {"host": "localhost:8443", "x-forwarded-proto": "https"}, 200),
    ],
)
def test_an_origin_is_the_pages_own_with_scheme_and_port_or_it_is_foreign(origin, more, status):
    headers, rules = {"origin": origin, **more}, Rules(HOSTS, proxies=frozenset({"127.0.0.1"}))
    assert ask(rules, method="POST", path="/_nicegui/x", headers=headers).status == status
    opened = ask(rules, kind="websocket", path="/_nicegui_ws/socket.io", headers=headers).kinds
    assert opened == ["websocket.accept" if status == 200 else "websocket.close"]


@pytest.mark.parametrize(
    ("origin", "host", "status"),
    [("https://localhost", "localhost", 200), ("https://localhost:8443", "localhost:8443", 403)],
)
def test_the_scheme_that_an_unnamed_proxy_says_does_not_count(origin, host, status):
    """At the usual ports, HTTPS works without it; at others the proxy must be named."""
    headers = {"origin": origin, "host": host, "x-forwarded-proto": "https"}
    assert ask(method="POST", path="/_nicegui/x", headers=headers).status == status


def test_requests_that_poll_and_sockets_are_read_before_the_libraries_read_them():
    polling = "/_nicegui_ws/socket.io/"
    assert ask(method="POST", path=polling, body=(b'42["ack"', b",{}]")).status == 400
    message = b'42["ack",{"client_id":"x","next_message_id":3}]'
    assert ask(method="POST", path=polling, body=(message[:9], message[9:])).text.endswith(f" {len(message)}")
    assert ask(path=polling, query_string=b"implicit_handshake=true&client_id=x").status == 400


def test_another_site_can_not_poll_the_socket_either():
    polling = "/_nicegui_ws/socket.io/"
    assert ask(path=polling, headers={"origin": "https://evil.example"}).status == 403
    assert ask(path=polling, headers={"sec-fetch-site": "cross-site"}).status == 403
    assert ask(path=polling, headers={"origin": OWN, "sec-fetch-site": "same-origin"}).status == 200


def test_another_site_can_link_to_the_page_but_not_load_it_unseen():
    foreign = {"sec-fetch-site": "cross-site"}
    assert ask(headers={**foreign, "sec-fetch-mode": "navigate"}).status == 200
    for mode in ("no-cors", "cors", "same-origin"):
        assert ask(headers={**foreign, "sec-fetch-mode": mode}).status == 403
