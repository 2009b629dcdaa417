"""Password files, sign-in sessions, and how guessing is slowed down."""

import pytest

from eclsim.app.sign_in import (
    FAILURES_WITHIN_S,
    LONGEST_WAIT_S,
    MOST_FAILURES,
    MOST_FAILURES_TOGETHER,
    SESSION_LASTS_S,
    TURN_S,
    PasswordFileError,
    SignIns,
    read_password,
)

PASSWORD = "correct horse battery"
RIGHT, WRONG = b"password=" + PASSWORD.replace(" ", "+").encode(), b"password=wrong"


def test_a_session_ends():
    now = [0.0]
    signed_in = SignIns(PASSWORD, lambda: now[0])
    token, _, _ = signed_in.try_body(b"password=" + PASSWORD.replace(" ", "+").encode())
    assert token is not None
    assert signed_in.is_signed_in(token)
    now[0] = SESSION_LASTS_S + 1
    assert not signed_in.is_signed_in(token)


def test_password_files(tmp_path):
    file = tmp_path / "password"
    file.write_text(PASSWORD + "\n")
    file.chmod(0o600)
    assert read_password(str(file)) == PASSWORD
    file.chmod(0o644)
    with pytest.raises(PasswordFileError, match="chmod 600"):
        read_password(str(file))
    file.chmod(0o600)
    file.write_text("short\n")
    with pytest.raises(PasswordFileError, match="10 characters"):
        read_password(str(file))
    with pytest.raises(PasswordFileError, match="cannot be read"):
        read_password(str(tmp_path / "none"))


def test_who_tries_passwords_keeps_nobody_else_out():
    signed_in = SignIns("a long password", clock=lambda: 0.0)
    for _ in range(MOST_FAILURES):
        assert signed_in.try_body(b"password=wrong", "10.0.0.1")[1] == 401
    assert signed_in.try_body(b"password=a+long+password", "10.0.0.1")[1] == 429
    assert signed_in.try_body(b"password=a+long+password", "10.0.0.2")[1] == 303


def test_failures_of_many_addresses_take_little_memory():
    signed_in = SignIns("a long password", clock=lambda: 0.0)
    for k in range(1100):
        signed_in._remember_failure(f"10.0.{k // 250}.{k % 250}", 0.0)
    assert len(signed_in._failures) == 1000


def test_the_addresses_of_one_user_are_one():
    """Whoever has an IPv6 address has 2**64 of them."""
    signed_in = SignIns(PASSWORD, clock=lambda: 0.0)
    for k in range(MOST_FAILURES):
        assert signed_in.try_body(WRONG, f"2001:db8:1:2::{k:x}")[1] == 401
    assert signed_in.try_body(RIGHT, "2001:db8:1:2:ffff::1")[1] == 429
    assert signed_in.try_body(RIGHT, "2001:db8:1:3::1")[1] == 303
    for k in range(MOST_FAILURES):
        signed_in.try_body(WRONG, "::ffff:192.0.2.7" if k % 2 else "192.0.2.7")
    assert signed_in.try_body(RIGHT, "192.0.2.7")[1] == 429
    assert signed_in.try_body(RIGHT, "::ffff:192.0.2.8")[1] == 303


def test_guessing_from_many_addresses_waits_and_keeps_the_right_password_out_for_a_while_only():
    now = [0.0]
    signed_in = SignIns(PASSWORD, lambda: now[0])
    assert signed_in.wait_s("10.0.0.1") == 0.0
    for k in range(MOST_FAILURES_TOGETHER):
        signed_in.try_body(WRONG, f"10.0.0.{k}")
    waits = [signed_in.wait_s("10.1.0.1") for _ in range(12)]
    assert waits == [*(k * TURN_S for k in range(11)), None]
    now[0] = LONGEST_WAIT_S / 2
    assert signed_in.wait_s("10.1.0.2") is not None
    assert signed_in.try_body(RIGHT, "10.1.0.2")[1] == 303
    now[0] = FAILURES_WITHIN_S + 1.0
    assert signed_in.wait_s("10.1.0.3") == 0.0


def test_an_address_that_is_refused_takes_no_turn_of_others():
    signed_in = SignIns(PASSWORD, clock=lambda: 0.0)
    for k in range(MOST_FAILURES_TOGETHER):
        signed_in.try_body(WRONG, f"10.0.0.{k // MOST_FAILURES}")
    assert [signed_in.wait_s("10.0.0.1") for _ in range(20)] == [None] * 20
    assert signed_in.wait_s("10.1.0.1") == 0.0


def test_who_signs_out_is_out_and_others_stay():
    signed_in = SignIns(PASSWORD)
    (mine, *_), (other, *_) = signed_in.try_body(RIGHT), signed_in.try_body(RIGHT)
    assert mine
    assert other
    signed_in.sign_out(mine)
    signed_in.sign_out("never heard of")
    assert not signed_in.is_signed_in(mine)
    assert signed_in.is_signed_in(other)
