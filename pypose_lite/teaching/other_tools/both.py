"""The same example with this library and with PyPose, which differ in one import.

An example is a function of the library, ``def lqr(pp): ...``. Where PyPose is installed, both are
run; where it is not, its answer is the recorded one, as long as the example is still the same.
`make other-tools` records the answers anew.
"""

import hashlib
import importlib.util
import inspect
import json
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import torch

import pypose_lite

RECORD = Path(__file__).with_name("pypose.json")
RECORDING = "PYPOSE_LITE_RECORD"  # the environment variable under which answers are written down
NEWEST_SEEN = "0.9.5"  # of PyPose


class Both(NamedTuple):
    """What an example answers: numbers, lists of them, or the text of an error."""

    ours: Any
    theirs: Any


def installed() -> bool:
    """Returns whether PyPose can be imported here."""
    return importlib.util.find_spec("pypose") is not None


def both(example: Callable) -> Both:
    """Returns what an example answers with this library and with PyPose.

    Args:
        example: a function of the library; it returns numbers, tensors, or lists of them.

    Raises:
        RuntimeError: PyPose is not installed, and its answer was recorded for another text of the
            example, or not at all.
    """
    ours = _answer(example, pypose_lite)
    if not installed():
        return Both(ours, _recorded(example))
    import pypose

    theirs = _answer(example, pypose)
    if os.environ.get(RECORDING):
        _write(example, theirs)
    return Both(ours, theirs)


def provenance() -> str:
    """Returns a sentence that says where PyPose's answers come from."""
    if installed():
        return "PyPose is installed here, and its answers were computed just now."
    version = _read()["version"]
    return f"PyPose is not installed here: its answers are those recorded with version {version}."


def _answer(example: Callable, library: Any) -> Any:
    """What an example returns, or the error that it ends in, as JSON would keep it."""
    torch.manual_seed(0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return _plain(example(library))
        except Exception as error:  # whatever it is, it is the answer
            return f"{type(error).__name__}: {str(error).splitlines()[0]}"


def _plain(value: Any) -> Any:
    if isinstance(value, torch.Tensor):
        return value.detach().tolist()
    if isinstance(value, dict):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    return value


def _text(example: Callable) -> str:
    """A fingerprint of the example's text, and of the functions of the page that it calls."""
    called = [example.__globals__.get(name) for name in example.__code__.co_names]
    parts: list[Any] = [example, *filter(inspect.isfunction, called)]
    text = "\n".join(inspect.getsource(part).strip() for part in parts)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _recorded(example: Callable) -> Any:
    name = example.__name__
    entry = _read()["answers"].get(name)
    if entry is None or entry["text"] != _text(example):
        why = "not recorded" if entry is None else "recorded for another text of the example"
        raise RuntimeError(f"{name}: PyPose's answer is {why}; `make other-tools` records it")
    return entry["answer"]


def _read() -> dict:
    if not RECORD.exists():
        return {"version": NEWEST_SEEN, "answers": {}}
    return json.loads(RECORD.read_text(encoding="utf-8"))


def _write(example: Callable, answer: Any) -> None:
    import pypose

    record = _read()
    record["version"] = pypose.__version__
    record["answers"][example.__name__] = {"text": _text(example), "answer": answer}
    RECORD.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
