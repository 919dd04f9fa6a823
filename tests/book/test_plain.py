"""The book's Markdown without roles and directives, for readers without an extension."""

import pytest

from pypose_lite.teaching.site.pages import on_site
from pypose_lite.teaching.site.plain import Plain, RawText, equation_numbers

NUMBERS = {"error": "0.05 m", "04_ekf.error": "0.06 m"}
EQUATIONS = {"eq-3-cost": "3.1"}


def place(page):
    """Lessons, and one lab; no pages that are no notebooks."""
    return {
        "01_systems": "1_lessons/01_systems.ipynb",
        "03_mpc": "1_lessons/03_mpc.ipynb",
        "exercises/03_mpc": "2_exercises/03_mpc.ipynb",
    }.get(page, "")


@pytest.fixture
def plain():
    """Rewrites text of chapter 3."""
    return Plain("03_mpc", NUMBERS.__getitem__, place, EQUATIONS)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("It is {claim}`error`, not {claim}`04_ekf.error`.", "It is 0.05 m, not 0.06 m."),
        ("by {eq}`eq-3-cost`", "by (3.1)"),
        ("the {term}`state`, {term}`gains <gain>`", "the *state*, *gains*"),
        ("{py:func}`pypose_lite.dlqr`", "`pypose_lite.dlqr`"),
        ("a <!-- given: 3 m --> b", "a b"),
        ("a\n<!-- given: 3 m,\n4 m -->\nb", "a\nb"),
        (":::{note}\nThis. <!-- given: 3 m -->\n:::\nb", "> **Note.**\n>\n> This.\nb"),
        ("(a-target)=\n## Heading", "## Heading"),
        ("see [one](01_systems.py#the-clock)", "see [one](01_systems.ipynb#the-clock)"),
        ("[lab](../exercises/03_mpc.py)", "[lab](../2_exercises/03_mpc.ipynb)"),
        ("[speed](benchmarks.md) and [lab](../exercises/09_go1.py)", "speed and lab"),
        ("$$\nx = 1\n$$ (eq-3-cost)", "$$\nx = 1 \\tag{3.1}\n$$"),
        (":::{dropdown} Hint 1\nThink of $x$.\n:::", None),
        (":::{note}\nMind\nthis.\n:::", "> **Note.**\n>\n> Mind\n> this."),
        ("``{claim}`error` `` and\n```\n{claim}`error`\n```", None),
    ],
)
def test_what_stands_for_a_role_or_a_directive(plain, text, expected):
    if ":::{dropdown}" in text:
        expected = "<details><summary>Hint 1</summary>\n\nThink of $x$.\n\n</details>"
    assert plain(text) == (text if expected is None else expected)


def test_a_lab_links_to_its_lesson():
    plain = Plain("exercises/03_mpc", NUMBERS.__getitem__, place)
    assert plain("[chapter 3](../book/03_mpc.py)") == "[chapter 3](../1_lessons/03_mpc.ipynb)"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "{cite}`dubins1957`",
            "([Dubins, 1957](https://doi.org/10.2307/2372560))",
        ),
        ("{cite:t}`astrom2021`", "[Åström and Murray (2021)](https://fbswiki.org)"),
        ("{cite:p}`anderson1990`", "(Anderson and Moore, 1990)"),
        ("{cite:t}`sola2018`", "[Solà et al. (2018)](https://arxiv.org/abs/1812.01537)"),
        ("{cite:t}`pypose06`", "[Zhan et al. (2023)](https://arxiv.org/abs/2309.13035)"),
        ("{cite}`deboor2001,ljung1999`", "(de Boor, 2001; Ljung, 1999)"),
    ],
)
def test_citations_are_by_author_and_year_with_a_link(plain, text, expected):
    assert plain(text) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{unknown}`x`", "03_mpc: no plain text is known for {unknown}`x`"),
        (":::{figure} x.png\n:::", "03_mpc: no plain text is known for the directive {figure}"),
        ("{eq}`eq-9-none`", "03_mpc: no equation has the label 'eq-9-none'"),
        ("{cite}`nobody1900`", "references.bib has no entry 'nobody1900'"),
        ("[two](02_lqrr.py)", "03_mpc: links to 02_lqrr.py, which does not exist"),
    ],
)
def test_what_a_reader_would_see_raw_is_refused(plain, text, message):
    with pytest.raises(ValueError, match=message):
        plain(text)
    assert issubclass(RawText, ValueError)


def test_equations_are_numbered_as_on_the_page_by_chapter_and_in_order():
    text = "$$ a $$ (eq-3-a)\n\n$$ unnumbered $$\n\n```\n$$ c $$ (eq-no)\n```\n$$\nb\n$$ (eq-3-b)"
    assert equation_numbers("03_mpc", text) == {"eq-3-a": "3.1", "eq-3-b": "3.2"}


@pytest.mark.parametrize(
    ("page", "file"),
    [
        ("03_mpc", "03_mpc.ipynb"),
        ("solutions/02_lqr", "solutions/02_lqr.ipynb"),
        ("scoreboard", "scoreboard.md"),
        ("nowhere", ""),
    ],
)
def test_pages_lie_on_the_site_under_their_names(page, file):
    assert on_site(page) == file
