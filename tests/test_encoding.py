"""Files are read and written as UTF-8, whatever the machine's locale is."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FOLDERS = "pypose_lite", "book", "exercises", "solutions", "tests"
NOT_TEXT = "os", "Image", "self._log"  # what has an open() of its own
SOURCES = sorted(path for name in FOLDERS for path in (ROOT / name).rglob("*.py"))


def calls_without(source):
    """Yields the lines of calls that open a text file and do not name its encoding."""
    for call in ast.walk(ast.parse(source)):
        if not isinstance(call, ast.Call) or any(word.arg == "encoding" for word in call.keywords):
            continue
        name = getattr(call.func, "attr", getattr(call.func, "id", ""))
        whose = ast.unparse(getattr(call.func, "value", ast.Constant(None)))
        words = [arg.value for arg in call.args if isinstance(arg, ast.Constant)]
        binary = any(isinstance(word, str) and "b" in word and len(word) < 4 for word in words)
        opens = name == "open" and whose not in NOT_TEXT and not binary
        reads = name == "read_text" and not call.args
        if opens or reads or (name == "write_text" and len(call.args) < 2):
            yield call.lineno


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_text_file_is_opened_with_a_named_encoding(path):
    assert list(calls_without(path.read_text("utf-8"))) == []


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        ("path.read_text()", [1]),
        ("path.read_text('utf-8')", []),
        ("x = 1\npath.write_text(text)", [2]),
        ("path.write_text(text, encoding='utf-8')", []),
        ("open(path, 'w')", [1]),
        ("open(path, 'rb')", []),
        ("path.open()", [1]),
        ("os.open(path)", []),
    ],
)
def test_a_call_that_does_not_name_it_is_found(source, lines):
    assert list(calls_without(source)) == lines


def test_a_chapter_is_executed_where_the_locale_is_not_utf_8(tmp_path):
    page = tmp_path / "page.py"
    page.write_text(
        "# ---\n# jupyter:\n#   kernelspec: {display_name: x, language: python, name: python3}\n"
        "# ---\n# %% [markdown]\n# # Ångström, 3 µm — Ω\n# %%\nprint('Ω')\n",
        "utf-8",
    )
    strict = ["-X", "warn_default_encoding", "-W", "error::EncodingWarning:pypose_lite"]
    command = [sys.executable, *strict, "-m", "pypose_lite.teaching.site.execute"]
    done = subprocess.run(
        [*command, str(page), str(tmp_path / "page.ipynb")],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert "Ångström" in (tmp_path / "page.ipynb").read_text("utf-8")


def test_make_has_python_write_utf_8_in_any_locale(tmp_path):
    print_it = "import sys; print(sys.flags.utf8_mode)"
    (tmp_path / "Makefile").write_text(
        f"include {ROOT / 'Makefile'}\nshow:\n\t@{sys.executable} -c '{print_it}'\n", "utf-8"
    )
    env = {"PATH": "/usr/bin:/bin", "LC_ALL": "C.UTF-8"}  # where Python's own choice is 0
    done = subprocess.run(
        ["make", "-s", "-C", str(tmp_path), "show"],
        env=env,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.stdout == "1\n", done.stderr
