"""A build says what it is doing: which chapter, which page, and how many are left."""

import os
import time

import pytest

from pypose_lite.teaching.site import build, execute


def test_left_are_the_notebooks_that_this_run_has_not_made_yet(tmp_path):
    made, old, missing = (tmp_path / f"{name}.ipynb" for name in ("made", "old", "missing"))
    todo = tmp_path / ".todo"
    for path in (old, todo, made):
        path.write_text("", encoding="utf-8")
    todo.write_text(f"{made}\n{old}\n{missing}\n", encoding="utf-8")
    now = time.time()
    for path, age in ((old, 60), (todo, 30), (made, 10)):
        os.utime(path, (now - age, now - age))
    assert execute.left(todo) == 2


def test_a_chapter_says_when_it_begins_and_ends_and_how_many_are_to_go(
    tmp_path, capsys, monkeypatch
):
    target, todo = tmp_path / "03_mpc.ipynb", tmp_path / ".todo"
    todo.write_text(f"{target}\n{tmp_path / 'other.ipynb'}\n", encoding="utf-8")

    def made(chapter, target):
        target.write_text("", encoding="utf-8")
        return "03_mpc: 5 claims hold (9 s)"

    monkeypatch.setattr(execute, "execute", made)
    execute.main(tmp_path / "03_mpc.py", target, todo)
    first, second = capsys.readouterr().out.splitlines()
    assert first == "03_mpc: begins (2 to go)"
    assert second == "03_mpc: 5 claims hold (9 s); 1 to go"


@pytest.mark.parametrize(
    ("line", "shown"),
    [
        ("reading sources... [ 50%] 03_mpc", "   50 % 03_mpc read"),
        ("\x1b[01mwriting output... \x1b[39;49;00m[ 8%] api/lie", "    8 % api/lie written"),
        ("x.md:3: WARNING: undefined label", "x.md:3: WARNING: undefined label"),
        ("loading intersphinx inventory...", ""),
    ],
)
def test_the_site_is_built_with_a_line_a_page_and_its_warnings(line, shown, capsys):
    build.show(line, time.monotonic())
    assert capsys.readouterr().out.startswith(shown)
    assert bool(shown) is bool(shown.strip())
