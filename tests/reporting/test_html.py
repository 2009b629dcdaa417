import re
from html.parser import HTMLParser
from importlib.resources import files

import jinja2
import pytest

from eclsim.reporting import html
from eclsim.reporting.html import Table, inline_svg, render

PIECES = """{% extends "reporting/page.html" %}
{% from "reporting/blocks.html" import box, bullets, figure, table %}
{% block body %}
{{ text }}{{ box([text, text]) }}{{ bullets([text]) }}{{ table(rows) }}{{ figure(svg, text, "key") }}
{% endblock %}"""
SVG = '<svg xmlns="http://www.w3.org/2000/svg"><text>drawn</text></svg>'


@pytest.fixture
def page(monkeypatch):
    """The page of a template that is given as text."""
    environment = html._environment().overlay(
        loader=jinja2.ChoiceLoader([jinja2.DictLoader({"pieces": PIECES}), html._environment().loader])
    )
    monkeypatch.setattr(html, "_environment", lambda: environment)
    return lambda text: render(
        "pieces", title=text, text=text, svg=SVG, rows=Table([text], [[text], [text]], numeric=(0,), foot=1)
    )


def test_text_is_escaped_everywhere_and_control_characters_replaced(page):
    whole = page("<i>\"'&\x00\x1b")
    assert "<i>" not in whole
    assert whole.count("&lt;i&gt;&#34;&#39;&amp;\ufffd\ufffd") == 9
    assert "<text>drawn</text>" in whole


def test_a_table_sets_numbers_flush_right_and_the_last_rows_off(page):
    whole = page("x")
    assert whole.count('<td class="n">x</td>') == 2
    assert whole.count('<tr class="foot">') == 1


def test_a_table_refuses_rows_of_another_length():
    with pytest.raises(ValueError, match="a row has 1 cells, the head 2"):
        Table(["a", "b"], [["1"]])


def test_a_name_that_the_template_uses_and_nobody_gave_is_an_error(page):
    with pytest.raises(jinja2.UndefinedError, match="title"):
        render("pieces", text="x", svg=SVG, rows=Table([], []))


def test_every_template_of_the_package_can_be_read():
    names = html._environment().list_templates(extensions=["html"])
    assert {"reporting/page.html", "crrt_study/report.html", "app/sign_in.html"} <= set(names)
    for name in names:
        html._environment().get_template(name)
    assert (files("eclsim") / "reporting" / "page.css").is_file()


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


def test_a_page_forbids_requests_and_closes_its_tags(page):
    whole = page("words")
    assert "default-src 'none'" in whole
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", whole)
    opened = []

    class Checker(HTMLParser):
        def handle_starttag(self, tag, attrs):
            if tag not in ("meta", "br"):
                opened.append(tag)

        def handle_endtag(self, tag):
            assert opened.pop() == tag

    Checker().feed(whole)
    assert opened == []
