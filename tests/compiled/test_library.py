"""Libraries that are kept on disk: used again where they are whole and nothing has changed."""

import os
import subprocess
import sys

import pytest
import torch

from pypose_lite.compiled import library

ANSWER = 'extern "C" int answer() { return 42; }'


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    """A folder of its own, and a process that has loaded nothing."""
    try:
        library.compiler()
    except RuntimeError as error:
        pytest.skip(str(error))
    monkeypatch.setenv("PYPOSE_LITE_CACHE", str(tmp_path / "kept"))
    monkeypatch.setattr(library, "_loaded", {})
    return tmp_path / "kept"


@pytest.fixture
def made(monkeypatch):
    """Counts what is compiled."""
    texts, make = [], library._make

    def count(text, *rest):
        texts.append(text)
        return make(text, *rest)

    monkeypatch.setattr(library, "_make", count)
    return texts


def again(monkeypatch, text=ANSWER):
    """What another process would get."""
    monkeypatch.setattr(library, "_loaded", {})
    library._compiler.cache_clear()
    return library.load(text, "an answer").answer()


def test_it_is_compiled_once_and_says_so(monkeypatch, made, capfd):
    assert library.load(ANSWER, "an answer").answer() == 42
    assert "compiling an answer" in capfd.readouterr().err
    assert again(monkeypatch) == 42
    assert len(made) == 1 and capfd.readouterr().err == ""


def test_another_text_is_another_library(monkeypatch, made):
    assert library.load(ANSWER, "an answer").answer() == 42
    assert again(monkeypatch, ANSWER.replace("42", "43")) == 43
    assert len(made) == 2


OTHERS = {
    "torch": (torch, "__version__", "2.99.0"),
    "Python": (sys, "version", "3.99"),
    "options": (library, "OPTIONS", [*library.OPTIONS, "-g"]),
    "processor": (library, "_processor", lambda: "another one"),
    "compiler": (library, "_compiler", lambda: "another one"),
}


@pytest.mark.parametrize("what", OTHERS)
def test_whatever_matters_makes_another_library(monkeypatch, made, what):
    library.load(ANSWER, "an answer")
    before = library._key(ANSWER)
    with monkeypatch.context() as patch:
        patch.setattr(*OTHERS[what])
        assert library._key(ANSWER) != before
    assert library._key(ANSWER) == before


def kept(folder, ending):
    (path,) = folder.glob(f"*{ending}")
    return path


def truncate(path):
    path.write_bytes(path.read_bytes()[:1000])


def replace(folder):
    """What is whole, and no library."""
    kept(folder, ".so").write_bytes(b"no library")
    kept(folder, ".sha256").write_text(
        library.hashlib.sha256(b"no library").hexdigest(), encoding="utf-8"
    )


DAMAGE = {
    "truncated": lambda folder: truncate(kept(folder, ".so")),
    "empty": lambda folder: kept(folder, ".so").write_bytes(b""),
    "other contents": lambda folder: kept(folder, ".so").write_bytes(b"no library"),
    "no library at all": replace,
    "no digest": lambda folder: kept(folder, ".sha256").unlink(),
    "gone": lambda folder: kept(folder, ".so").unlink(),
    "another digest": lambda folder: kept(folder, ".sha256").write_text("0" * 64, encoding="utf-8"),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_what_is_not_whole_is_made_anew(monkeypatch, made, folder, damage):
    code = f"from pypose_lite.compiled import library; library.load({ANSWER!r}, 'an answer')"
    subprocess.run([sys.executable, "-c", code], check=True)  # this process must not have it open
    DAMAGE[damage](folder)
    assert again(monkeypatch) == 42 and len(made) == 1
    assert again(monkeypatch) == 42 and len(made) == 1


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o722])
def test_a_folder_that_others_can_write_is_not_used(monkeypatch, made, folder, mode):
    library.load(ANSWER, "an answer")
    folder.chmod(mode)
    assert again(monkeypatch) == 42 and len(made) == 2


def test_a_folder_of_somebody_else_is_not_used(monkeypatch, made):
    library.load(ANSWER, "an answer")
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    assert again(monkeypatch) == 42 and len(made) == 2


def test_without_a_folder_it_lasts_as_long_as_the_process(monkeypatch, made, tmp_path):
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    monkeypatch.setenv("PYPOSE_LITE_CACHE", str(tmp_path / "file" / "kept"))
    for _ in range(2):
        assert library.load(ANSWER, "an answer").answer() == 42
    assert len(made) == 1
    assert again(monkeypatch) == 42 and len(made) == 2


def test_a_full_disk_is_no_obstacle(monkeypatch, made, folder):
    def full(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(library.os, "replace", full)
    assert library.load(ANSWER, "an answer").answer() == 42
    assert list(folder.glob("*.so")) == []


def test_the_folder_is_private_and_where_the_system_keeps_such_things(monkeypatch, folder):
    library.load(ANSWER, "an answer")
    assert folder.stat().st_mode & 0o777 == 0o700
    monkeypatch.delenv("PYPOSE_LITE_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    assert library._folder() == folder / "cache" / "pypose_lite"


def test_without_a_compiler_it_is_said(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CXX", raising=False)
    with pytest.raises(RuntimeError, match="expected a C\\+\\+ compiler, g\\+\\+ or clang\\+\\+"):
        library.compiler()


def test_what_the_compiler_says_is_passed_on():
    with pytest.raises(RuntimeError, match="nonsense.* does not name a type"):
        library.load("nonsense here;", "nothing")


def test_a_compiler_that_does_not_know_its_processor_compiles_all_the_same(monkeypatch):
    options = [o.replace("-march=native", "-march=nonsense") for o in library.OPTIONS]
    monkeypatch.setattr(library, "OPTIONS", options)
    monkeypatch.setattr(library, "NATIVE", "-march=nonsense")
    assert library.load(ANSWER, "an answer").answer() == 42
