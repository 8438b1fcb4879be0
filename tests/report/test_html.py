"""Tables of a page: every cell in its place, as text, in a box of its own."""

import re

import pytest

from gril_jax.report.html import Cell, Section, Table, render

HOSTILE = "<b>x</b>&"


def _page(*tables):
    return render("title", "summary", [], [Section("numbers", tables)], {}, {}, {})


def _cells(html, tag):
    return re.findall(rf"<{tag}[^>]*>(.*?)</{tag}>", html)


def test_a_table_has_its_headings_across_and_its_rows_down():
    rows = {
        "first": [Cell("1.5", "1 to 2"), Cell("never")],
        "second": [Cell("10.0"), Cell("")],
    }
    page = _page(Table("what it is", ["a", "b"], rows))
    head, *body = _cells(re.search("<thead>.*</tbody>", page, re.DOTALL)[0].replace("\n", ""), "tr")
    assert (_cells(head, "td"), _cells(head, "th")) == ([""], ["a", "b"])
    assert [_cells(row, "th") for row in body] == [["first"], ["second"]]
    assert [_cells(row, "td") for row in body] == [
        ["1.5<small>1 to 2</small>", "never"],
        ["10.0", ""],
    ]
    assert "<figcaption>what it is</figcaption>" in page


def test_a_table_is_scrolled_by_itself_and_from_the_keyboard_too():
    page = _page(Table("what it is", ["a"], {"row": [Cell("1")]}))
    assert '<div class="wide" tabindex="0" role="region" aria-label="what it is"><table>' in page
    assert ".wide { overflow-x: auto; }" in page


def test_what_stands_in_a_table_is_text():
    page = _page(Table(f'{HOSTILE}"', [HOSTILE], {HOSTILE: [Cell(HOSTILE, HOSTILE)]}))
    assert "<b>" not in page
    assert page.count("&lt;b&gt;x&lt;/b&gt;&amp;") == 6
    assert 'aria-label="&lt;b&gt;x&lt;/b&gt;&amp;&quot;"' in page


def test_a_row_of_another_length_than_the_headings_is_a_mistake():
    with pytest.raises(ValueError, match="shorter"):
        _page(Table("", ["a", "b"], {"row": [Cell("1")]}))
