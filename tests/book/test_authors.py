"""Authors elsewhere: from the wheel, in an empty folder, a tutorial is begun, checked and built."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from bs4 import BeautifulSoup

import pypose_lite
from pypose_lite.teaching.site import config

ROOT = Path(__file__).parents[2]
SITE = "pypose_lite.teaching.site"
ENTRY_POINTS = "pypose_lite-*.dist-info/entry_points.txt"
TOOLING = f"""
import importlib, pkgutil, sys
import {SITE}, pypose_lite.teaching.pytest_plugin
from pypose_lite.teaching import animate, claim, figures, proofread, table, widgets
for module in pkgutil.iter_modules({SITE}.__path__):
    if module.name != "__main__":
        importlib.import_module(f"{SITE}.{{module.name}}")
print("torch" in sys.modules)
"""


@pytest.fixture(scope="module")
def author(wheel, tmp_path_factory):
    """A folder, and a way to run Python in it as if the wheel had been installed without torch."""
    folder, place = tmp_path_factory.mktemp("elsewhere"), tmp_path_factory.mktemp("installed")
    options = ["--no-deps", "--no-index", "--no-compile", "--target", str(place)]
    pip = [sys.executable, "-m", "pip", "install", *options, str(wheel)]
    subprocess.run(pip, check=True, capture_output=True, timeout=120)
    (place / "torch.py").write_text('raise ImportError("torch is not installed")\n', "utf-8")
    env = {key: value for key, value in os.environ.items() if key != "PYTEST_ADDOPTS"}
    env["PYTHONPATH"] = str(place)
    (folder / "build").mkdir()
    if (ROOT / "build" / "npm").exists():
        (folder / "build" / "npm").symlink_to(ROOT / "build" / "npm")

    def python(*words, **more):
        command = [sys.executable, "-m", *words]
        return subprocess.run(
            command, cwd=folder, env=env | more, capture_output=True, text=True, timeout=240
        )

    python.folder, python.place = folder, place
    begun = python(SITE, "new", "cart")
    assert begun.returncode == 0, begun.stderr
    return python


@pytest.fixture(scope="module")
def built(author):
    """The site that the author's one command builds."""
    done = author(SITE, "build")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "cart: 10 claims hold" in done.stdout
    return author.folder / "build" / "site" / "_build" / "html"


def page(path):
    """The text of a page's article."""
    return BeautifulSoup(path.read_text("utf-8"), "html.parser").find("article")


def test_the_wheel_that_is_tried_is_not_the_checkout(author):
    where = author("pypose_lite.teaching.site", "--help", PYTHONVERBOSE="1").stderr
    assert str(author.place / "pypose_lite") in where
    assert str(Path(pypose_lite.__file__).parent) not in where


def test_the_tooling_loads_no_torch():
    done = subprocess.run([sys.executable, "-c", TOOLING], capture_output=True, text=True)
    assert done.stdout == "False\n", done.stderr


def test_what_the_tooling_needs_is_listed_for_pip_and_torch_is_not_in_it(author):
    listed = author(SITE, "requirements").stdout.split("\n")
    names = {re.split(r"[<>=]", line)[0] for line in listed}
    assert {"jupyter-book", "jupytext", "nbval", "pytest"} <= names
    assert "torch" not in names


def test_pytest_finds_the_tutorials_by_the_wheels_entry_point(author):
    [path] = author.place.glob(ENTRY_POINTS)
    assert "[pytest11]\npypose_lite.teaching.pytest_plugin = " in path.read_text("utf-8")
    done = author("pytest", "cart.py", "-q", "--color=no")
    assert re.search(r"^1[0-9] passed", done.stdout, re.MULTILINE), done.stdout
    assert (author.folder / "build" / "claims" / "cart.json").exists()


def test_pytest_says_what_is_wrong_with_a_tutorial(author):
    text = (author.folder / "cart.py").read_text("utf-8")
    (author.folder / "wrong.py").write_text(text.replace("of 1 m,", "of 1.5 m,"), "utf-8")
    done = author("pytest", "wrong.py", "-q", "--color=no")
    (author.folder / "wrong.py").unlink()
    assert re.search(r"wrong\.py:\d+: prose states '1\.5 m'", done.stdout)
    assert done.returncode == 1


def test_a_test_of_the_authors_stays_a_test(author):
    (author.folder / "test_own.py").write_text("def test_own():\n    pass\n", "utf-8")
    done = author("pytest", "test_own.py", "-q", "--color=no")
    (author.folder / "test_own.py").unlink()
    assert done.stdout.endswith("1 passed\n") or "1 passed in" in done.stdout


def test_one_command_builds_the_site_with_numbers_answers_and_citations(built):
    article = page(built / "cart.html")
    assert "It stops 0.1 m before the line." in article.get_text()
    assert article.find("details", class_="answer").find("table")
    assert "Åström and Murray (2021)" in article.get_text()
    assert page(built / "bibliography.html").find(id="id2") or "Feedback Systems" in str(
        page(built / "bibliography.html")
    )
    assert (built / "_sources" / "cart.ipynb").exists()


def test_a_page_built_alone_has_its_citations_too(author, built):
    done = author(SITE, "build", "cart")
    assert done.returncode == 0, done.stdout + done.stderr
    text = page(author.folder / "build" / "page" / "_build" / "html" / "cart.html").get_text()
    assert "Åström and Murray (2021)" in text and "[]" not in text


def test_a_tutorial_that_is_there_is_not_written_over(author):
    before = (author.folder / "cart.py").read_text("utf-8")
    done = author(SITE, "new", "cart")
    assert done.stderr.endswith("cart.py exists already; choose another name\n")
    assert len(done.stderr.splitlines()) == 1
    assert (author.folder / "cart.py").read_text("utf-8") == before


def test_a_second_tutorial_is_told_where_it_is_entered(author):
    done = author(SITE, "new", "other")
    (author.folder / "other.py").unlink()
    assert "Add it to _toc.yml, where it belongs:  - file: other" in done.stdout


@pytest.mark.parametrize("name", ["no such", "../up", "A-b"])
def test_a_name_that_no_page_can_have_is_refused(author, name):
    done = author(SITE, "new", name)
    assert done.returncode == 1 and "expected letters, digits, underscores" in done.stderr


def test_settings_of_an_author_are_laid_over_those_of_every_book():
    below = {"title": "Tutorials", "sphinx": {"config": {"a": 1, "b": 2}, "extra": ["x"]}}
    above = {"title": "Mine", "sphinx": {"config": {"b": 3}, "extra": ["y"]}, "logo": "l"}
    assert config.over(below, above) == {
        "title": "Mine",
        "sphinx": {"config": {"a": 1, "b": 3}, "extra": ["x", "y"]},
        "logo": "l",
    }
