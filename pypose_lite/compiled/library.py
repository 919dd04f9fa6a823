"""Compiles C++ with the machine's own compiler, once, and keeps what came out on disk.

:func:`load` returns a library that holds the code of a text. What is kept lies under a name made
of all that matters: the text, torch's and Python's version, the compiler and its options, and the
processor. It is used only where its contents have the digest that was noted when it was made, and
where nobody else can have written it; anything else is made anew, silently. Where the folder
cannot be written, what is made lasts as long as the process.

The folder is ``~/.cache/pypose_lite`` (``$XDG_CACHE_HOME/pypose_lite``), or what the environment's
``PYPOSE_LITE_CACHE`` names.
"""

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import torch

NATIVE = "-march=native"  # not every compiler knows it for every processor
OPTIONS = f"-std=gnu++17 -O3 {NATIVE} -fno-math-errno -fno-trapping-math".split()
OPTIONS += ["-shared", "-fPIC", "-pthread"]
LIBRARIES = ["-lmvec"] if platform.machine() == "x86_64" and sys.platform == "linux" else []
_loaded: dict[str, ctypes.CDLL] = {}


def load(text: str, what: str) -> ctypes.CDLL:
    """Returns a library with the code of a C++ text, compiled now or earlier.

    Args:
        text: the whole program.
        what: what it is for, for the line that is shown while it compiles.

    Raises:
        RuntimeError: where there is no compiler, or it fails.
    """
    key = _key(text)
    if key not in _loaded:
        folder = _folder()
        library = _kept(folder, key) if folder else None
        _loaded[key] = library or _make(text, key, what, folder)
    return _loaded[key]


def compiler() -> str:
    """Returns the path of a C++ compiler: the environment's ``CXX``, g++ or clang++."""
    for name in (os.environ.get("CXX"), "g++", "clang++"):
        path = shutil.which(name) if name else None
        if path:
            return path
    raise RuntimeError("compile: expected a C++ compiler, g++ or clang++, and there is none")


def _key(text: str) -> str:
    """Returns the name that a text's library is kept under."""
    machine = platform.platform(), platform.machine(), _processor()
    parts = (text, *OPTIONS, *LIBRARIES, _compiler(), torch.__version__, sys.version, *machine)
    return hashlib.sha256("\0".join(map(str, parts)).encode()).hexdigest()[:32]


@cache
def _compiler() -> str:
    """Returns which compiler there is, with its version."""
    path = compiler()
    return path + subprocess.run([path, "--version"], capture_output=True, text=True).stdout


@cache
def _processor() -> str:
    """Returns what the processor can do; code for another one may not run on it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    wanted = ("model name", "flags", "Features", "CPU part")
    return "\n".join(sorted({line for line in lines if line.startswith(wanted)}))


def _folder() -> Path | None:
    """Returns the folder of what is kept, or None where it is not this user's alone."""
    home = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    folder = Path(os.environ.get("PYPOSE_LITE_CACHE") or Path(home) / "pypose_lite").expanduser()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = folder.stat()
    except OSError:
        return None
    mine = not hasattr(os, "getuid") or (state.st_uid == os.getuid() and not state.st_mode & 0o022)
    return folder if mine else None


def _kept(folder: Path, key: str) -> ctypes.CDLL | None:
    """Returns a library that was kept, where it is whole."""
    path = folder / f"{key}.so"
    try:
        digest = (folder / f"{key}.sha256").read_text(encoding="utf-8")
        if digest != hashlib.sha256(path.read_bytes()).hexdigest():
            return None
        return ctypes.CDLL(str(path))
    except OSError:
        return None


def _make(text: str, key: str, what: str, folder: Path | None) -> ctypes.CDLL:
    """Compiles a library, keeps it in the folder where that can be, and returns it."""
    sys.stderr.write(f"pypose_lite: compiling {what}, which takes a few seconds, once\n")
    with tempfile.TemporaryDirectory() as place:
        made = Path(place) / f"{key}.so"
        code = made.with_suffix(".cpp")
        code.write_text(text, encoding="utf-8")
        for options in (OPTIONS, [option for option in OPTIONS if option != NATIVE]):
            command = [compiler(), *options, str(code), "-o", str(made), *LIBRARIES]
            run = subprocess.run(command, capture_output=True, text=True)
            if not run.returncode:
                break
        else:
            raise RuntimeError(f"compile: the C++ compiler failed:\n{run.stderr[-2000:]}")
        if folder:
            try:
                _keep(made, folder)
                return ctypes.CDLL(str(folder / made.name))
            except OSError:
                pass
        return ctypes.CDLL(str(made))


def _keep(made: Path, folder: Path) -> None:
    """Puts a library into the folder, whole or not at all, and then its digest."""
    digest = made.with_suffix(".sha256")
    digest.write_text(hashlib.sha256(made.read_bytes()).hexdigest(), encoding="utf-8")
    for path in (made, digest):
        handle, name = tempfile.mkstemp(dir=folder)
        os.close(handle)
        shutil.copyfile(path, name)
        os.replace(name, folder / path.name)
