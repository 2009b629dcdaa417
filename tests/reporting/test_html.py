import re
from html.parser import HTMLParser

import pytest

from eclsim.reporting.html import box, bullets, inline_svg, page, paragraph, table, text


def test_text_is_escaped_and_control_characters_replaced():
    assert text("<b>\"'&\x00\x1b") == "&lt;b&gt;&quot;&#x27;&amp;\ufffd\ufffd"


@pytest.mark.parametrize(
    "piece",
    [
        paragraph("<i>"),
        box(["<i>", "<i>"]),
        bullets(["<i>"]),
        table(["<i>"], [["<i>"]]),
        page("<i>", []),
    ],
)
def test_no_piece_lets_a_tag_through(piece):
    assert "<i>" not in piece
    assert "&lt;i&gt;" in piece


def test_a_table_refuses_rows_of_another_length():
    with pytest.raises(ValueError, match="zip"):
        table(["a", "b"], [["1"]])


def test_a_drawing_stands_inside_a_page_with_names_of_its_own():
    svg = (
        '<?xml version="1.0"?><!DOCTYPE svg PUBLIC "x" "http://www.w3.org/a.dtd">'
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">'
        '<metadata>http://purl.org/</metadata><defs><path id="m1"/></defs>'
        '<use xlink:href="#m1" clip-path="url(#p1)"/></svg>'
    )
    drawn = inline_svg(svg, "key")
    assert "http" not in drawn
    assert 'id="key-m1"' in drawn
    assert 'href="#key-m1"' in drawn
    assert "url(#key-p1)" in drawn


def test_a_page_forbids_requests_and_closes_its_tags():
    whole = page("title", [paragraph("words")])
    assert "default-src 'none'" in whole
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", whole)
    opened = []

    class Checker(HTMLParser):
        def handle_starttag(self, tag, attrs):
            if tag != "meta":
                opened.append(tag)

        def handle_endtag(self, tag):
            assert opened.pop() == tag

    Checker().feed(whole)
    assert opened == []
