"""The pages of the library, and the labels of the bibliography."""

from inspect import getsourcelines
from types import ModuleType

import pytest

from pypose_lite.control import riccati
from pypose_lite.infinity import Run
from pypose_lite.teaching.site import api, docstrings
from pypose_lite.teaching.site.citations import Labels
from pypose_lite.teaching.site.plain import _entries


def test_every_room_has_a_page_that_begins_with_its_names():
    page = api.page("api/systems")
    listed = page.index("- {py:obj}`System <pypose_lite.systems.System>`: ")
    assert page.startswith("# Systems\n\n## pypose_lite.systems\n\nDynamical systems")
    assert listed < page.index(".. autoclass:: pypose_lite.systems.System")


def test_what_a_module_offers_stands_in_the_order_of_its_source():
    names = api.public(riccati)
    lines = [getsourcelines(getattr(riccati, name))[1] for name in names]
    assert {"riccati_step", "riccati"} <= set(names)
    assert lines == sorted(lines)


def test_names_of_another_room_are_listed_and_not_shown_again():
    page = api.page("api/tools")
    assert "- `MPC`: Returns" in page
    assert "autoclass:: pypose_lite.module.MPC" not in page


@pytest.mark.parametrize(
    ("docstring", "markdown"),
    [
        ("builds :class:`System` of ``x``", "builds {py:class}`System` of ``x``"),
        ("write ``{claim}`name```, then", "write `` {claim}`name` ``, then"),
    ],
)
def test_docstrings_become_markdown(docstring, markdown):
    module = ModuleType("x", docstring)
    assert api.markdown(module) == markdown


def test_the_fields_of_a_tuple_are_explained_by_their_comments():
    fields = dict(docstrings.fields(Run))
    assert fields["u"] == "inputs, (..., N, 2)"
    lines = []
    docstrings.with_fields(None, "class", "Run", Run, None, lines)
    assert "- ``u``: inputs, (..., N, 2)" in lines


def test_types_are_named_without_their_modules():
    signature = "(problem: ~pypose_lite.control.problem.Problem, T: int)"
    shown = docstrings.short_types(None, "", "", None, None, signature, "~torch.Tensor")
    assert shown == ("(problem: Problem, T: int)", "Tensor")
    assert docstrings.short_types(None, "", "", None, None, "()", None) == ("()", None)


def test_python_says_nothing_of_a_field():
    assert docstrings.skipped(None, "class", "u", Run.u, False, None) is True
    assert docstrings.skipped(None, "class", "steps", Run.steps, False, None) is None


def test_labels_are_author_and_year_and_a_letter_where_two_would_be_the_same():
    keys = ["astrom2021", "kalman1960control", "kalman1960filter", "sola2018"]
    assert list(Labels().format_labels([_entries()[key] for key in keys])) == [
        "Åström and Murray, 2021",
        "Kalman, 1960a",
        "Kalman, 1960b",
        "Solà et al., 2018",
    ]
