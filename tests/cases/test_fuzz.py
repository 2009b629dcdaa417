"""Whatever a case file holds, reading it gives a case or a CaseError."""

import os
import tempfile

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eclsim.cases import CaseError, apply_settings, check_case, read_case, resolve_parameters

GOOD = """format = 1
[patient]
id = "P01"
sex = "female"
age_years = 70
height_cm = 165
weight_kg = 60
heart_rate_bpm = 120
[measurements]
SP = 83
DP = 76
CO = 1.4
[ecmo]
pump = "Rotaflow"
speed_rpm = 3425
oxygenator = "Quadrox-i Adult"
mode = "VA"
[crrt]
flow_ml_min = 200
access_site = "post_oxy"
return_site = "pre_oxy"
[lvad]
pump = "HVAD"
speed_rpm = 2600
inlet_site = "lv"
outlet_site = "ao"
[parameters]
Csart = 3.1852
"""
SCRAPS = st.sampled_from(
    [
        *(
            "nan",
            "-inf",
            "1e400",
            "1e-400",
            "true",
            '"NA"',
            '"17Fr"',
            '"3,5"',
            "{}",
            "[]",
            "[[lvad]]",
            "[ecmo]",
        ),
        *(
            "=",
            '"""',
            "0x10",
            "1_000",
            "2024-01-01",
            "\x00",
            "é",
            '"\\u0000"',
            "{ roller_l_min = 4.0 }",
            "-0.0",
        ),
        "9" * 5000,
        "[" * 2000,
    ]
)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20) | st.dates(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=10), inner, max_size=3),
    max_leaves=5,
)
NAMES = st.sampled_from(
    [
        *(
            "format",
            "patient",
            "measurements",
            "ecmo",
            "crrt",
            "lvad",
            "parameters",
            "id",
            "sex",
            "age_years",
        ),
        *(
            "SP",
            "DP",
            "pump",
            "speed_rpm",
            "mode",
            "drainage_fr",
            "return_site",
            "access_site",
            "Rmc",
            "ηB",
            "x",
        ),
    ]
)
CASES = st.dictionaries(NAMES, VALUES | st.dictionaries(NAMES, VALUES, max_size=6), max_size=7)


def check_refusal(error: CaseError) -> None:
    assert error.mistakes
    assert all("\n" not in str(mistake) for mistake in error.mistakes)


def read_or_refuse(data: bytes) -> None:
    handle, path = tempfile.mkstemp(suffix=".toml")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        try:
            reading = read_case(path)
        except CaseError as error:
            check_refusal(error)
        else:
            assert all(isinstance(value, float) for value in resolve_parameters(reading.case).values())
    finally:
        os.unlink(path)


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=300))
def test_random_bytes(data):
    read_or_refuse(data)


@st.composite
def mutated(draw):
    text = GOOD
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        length = draw(st.integers(0, 25))
        text = text[:start] + draw(SCRAPS | st.text(max_size=8)) + text[start + length :]
    return text.encode("utf-8", "surrogatepass")


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(mutated())
def test_mutated_files(data):
    read_or_refuse(data)


@st.composite
def with_one_value_changed(draw):
    lines = GOOD.splitlines()
    chosen = draw(st.sampled_from([index for index, line in enumerate(lines) if "=" in line]))
    lines[chosen] = (
        lines[chosen].partition("=")[0] + "= " + draw(SCRAPS | st.floats().map(repr) | st.integers().map(str))
    )
    return "\n".join(lines).encode("utf-8", "surrogatepass")


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(with_one_value_changed())
def test_files_with_one_value_changed(data):
    read_or_refuse(data)


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(CASES)
def test_mappings_never_raise(raw):
    checked = check_case(raw)
    assert checked.mistakes or "patient" in raw


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(st.lists(st.text(max_size=30) | st.builds("{}={}".format, NAMES, st.text(max_size=15)), max_size=3))
def test_settings_give_a_case_or_a_case_error(written):
    handle, path = tempfile.mkstemp(suffix=".toml")
    os.close(handle)
    try:
        with open(path, "w", encoding="utf-8") as file:
            file.write(GOOD)
        case = read_case(path).case
    finally:
        os.unlink(path)
    try:
        assert resolve_parameters(apply_settings(case, written))
    except CaseError as error:
        check_refusal(error)
