"""Equation meets line: what a docstring numbers, a line of the same file computes."""

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

import pypose_lite

FOLDER = Path(pypose_lite.__file__).parent
FILES = {
    str(path.relative_to(FOLDER)): path.read_text(encoding="utf-8")
    for path in sorted(FOLDER.rglob("*.py"))
    if "teaching" not in path.parts
}
NUMBER = r"\((\d+'?)\)"


def numbered_equations(source):
    """Numbers at the ends of indented lines of docstrings, after two spaces or more."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    nodes = (node for node in ast.walk(ast.parse(source)) if isinstance(node, documented))
    texts = (ast.get_docstring(node) or "" for node in nodes)
    return {n for text in texts for n in re.findall(rf"^ +\S.*  +{NUMBER}$", text, re.MULTILINE)}


def numbered_lines(source):
    """Numbers in comments that say nothing else."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    comments = (token.string for token in tokens if token.type == tokenize.COMMENT)
    return {n for comment in comments for n in re.findall(NUMBER, comment)}


@pytest.mark.parametrize("name", FILES)
def test_every_numbered_equation_is_computed_by_a_line_with_its_number(name):
    assert numbered_equations(FILES[name]) - numbered_lines(FILES[name]) == set()


@pytest.mark.parametrize("name", FILES)
def test_every_numbered_line_has_an_equation(name):
    missing = {n for n in numbered_lines(FILES[name]) if f"({n})" not in docstrings(FILES[name])}
    assert missing == set()


def docstrings(source):
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    nodes = (node for node in ast.walk(ast.parse(source)) if isinstance(node, documented))
    return "\n".join(ast.get_docstring(node) or "" for node in nodes)


def test_the_search_for_numbers_finds_them():
    found = [name for name, source in FILES.items() if numbered_equations(source)]
    assert {"control/riccati.py", "systems/models.py", "infinity.py"} <= set(found)
