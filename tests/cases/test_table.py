"""Tables of text cells: delimiters, line endings and quotes, and what is refused."""

import hashlib
from pathlib import Path

import pytest

from eclsim.cases import CaseError, table
from eclsim.cases.table import digest_of, read_text_table

HEAD, ROW = "patient,name,value", "P01,Jürgen,5.8"
ENCODINGS = {"utf-16": "UTF-16", "utf-16-le": "UTF-16", "latin-1": "Latin-1"}


@pytest.fixture
def read(tmp_path: Path):
    """Write lines to a file and read it."""

    def written(*lines: str | bytes, end: bytes = b"\n") -> table.Table:
        path = tmp_path / "table.csv"
        path.write_bytes(end.join(x if isinstance(x, bytes) else x.encode() for x in lines))
        return read_text_table(path, missing="no rows of the test")

    return written


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
def test_byte_order_mark_line_endings_and_blank_rows(read, end):
    result = read(b"\xef\xbb\xbf" + HEAD.encode(), ROW, ROW, "", ",,,", "", end=end)
    assert result.header == HEAD.split(",")
    assert result.rows == [(2, ROW.split(",")), (3, ROW.split(","))]
    assert not result.mistakes


@pytest.mark.parametrize(("delimiter", "name"), [(";", "semicolons"), ("\t", "tabs")])
def test_another_delimiter_is_found_and_stated(read, delimiter, name):
    result = read(HEAD.replace(",", delimiter), ROW.replace(",", delimiter))
    assert result.rows == [(2, ROW.split(","))]
    assert any(name in str(note) for note in result.notes)


@pytest.mark.parametrize(("stated", "delimiter"), [("sep=;", ";"), ('"sep=,"', ","), ("sep=\t", "\t")])
def test_a_spreadsheets_line_that_says_the_delimiter_is_no_header(read, stated, delimiter):
    result = read(stated, HEAD.replace(",", delimiter), ROW.replace(",", delimiter))
    assert result.header == HEAD.split(",")
    assert result.rows == [(3, ROW.split(","))]


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (("",), "empty: no rows of the test"),
        (("", " ", ""), "empty: no rows of the test"),
        (("sep=;", ""), "nothing follows: no rows of the test"),
        ((HEAD,), "no rows follow: no rows of the test"),
    ],
)
def test_a_table_without_rows_is_refused_with_what_is_missing(read, lines, message):
    with pytest.raises(CaseError, match=message):
        read(*lines)


@pytest.mark.parametrize(("encoding", "name"), ENCODINGS.items())
def test_a_file_in_another_encoding_is_refused(read, encoding, name):
    with pytest.raises(CaseError, match=name):
        read(f"{HEAD}\n{ROW}".encode(encoding))


def test_files_too_large_are_refused_before_they_are_read_whole(read, monkeypatch):
    monkeypatch.setattr(table, "MAXIMUM_BYTES", 1_000_000)
    with pytest.raises(CaseError, match="at most 1 MB"):
        read(HEAD, *[ROW] * 80_000)


def test_limits_of_rows_and_columns(read, monkeypatch):
    monkeypatch.setattr(table, "MAXIMUM_ROWS", 10)
    with pytest.raises(CaseError, match="at most 10 rows"):
        read(HEAD, *[ROW] * 11)
    with pytest.raises(CaseError, match="at most 200 columns"):
        read(HEAD + ",x" * 300, ROW)


def test_quoted_commas_and_line_breaks(read):
    result = read(HEAD, 'P01,"a, b\nc",1', "P02,,2")
    assert [line for line, _ in result.rows] == [2, 4]
    assert [(cells[0], cells[-1]) for _, cells in result.rows] == [("P01", "1"), ("P02", "2")]
    assert "a, b" in result.rows[0][1][1]


def test_a_quote_that_is_never_closed_is_named_and_rows_before_it_stand(read):
    result = read(HEAD, ROW, ROW.replace("Jürgen", '"Jürgen'), ROW)
    assert [line for line, _ in result.rows] == [2]
    (mistake,) = result.mistakes
    assert mistake.line == 3
    assert "never closed" in str(mistake)


def test_a_quote_that_is_never_closed_in_the_header_refuses_the_file(read):
    with pytest.raises(CaseError, match="never closed"):
        read('"' + HEAD, ROW)


def test_no_such_file_and_a_folder(tmp_path):
    with pytest.raises(CaseError, match="no such file"):
        read_text_table(tmp_path / "none.csv", missing="rows")
    with pytest.raises(CaseError, match="a folder"):
        read_text_table(tmp_path, missing="rows")


def test_the_digest_is_that_of_the_file_as_read(read, tmp_path):
    digest = read(HEAD, ROW).digest
    assert digest == hashlib.sha256(f"{HEAD}\n{ROW}".encode()).hexdigest()
    assert digest_of(tmp_path / "table.csv") == digest
    assert digest_of(tmp_path / "none.csv") is None
