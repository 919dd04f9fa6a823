"""The pages of the library: one for each of its rooms, from the docstrings.

A page begins with a list of names, each with what it does in a line, and a link to its full text.
"""

import inspect
import re
from importlib import import_module
from types import ModuleType

ROOMS = {  # page: its title, and the modules that it shows
    "systems": ("Systems", ["systems"]),
    "control": ("Control", ["control", "control.riccati", "control.sweep", "control.ilqr"]),
    "filters": ("Filters", ["filters"]),
    "lie": ("Rotations and poses", ["lie"]),
    "splines": ("Splines", ["splines", "splines.planner"]),
    "infinity": ("The infinity", ["infinity"]),
    "go1": ("The Go1", ["go1"]),
    "compiled": ("The compiled engine", ["compiled"]),
    "tools": ("Small tools", ["linalg", "shapes", "module", "utils"]),
    "teaching": (
        "Teaching",
        ["teaching.claims", "teaching.checks", "teaching.proofread", "teaching.figures"]
        + ["teaching.plotting", "teaching.sketches", "teaching.pictures", "teaching.tables"]
        + ["teaching.widgets", "teaching.animation", "teaching.dog", "teaching.study"]
        + ["teaching.batches", "teaching.site"],
    ),
}
LIST = "<!-- modules -->"


def pages() -> list[str]:
    """The names of the pages, ``api/systems`` and the like."""
    return [f"api/{room}" for room in ROOMS]


def modules() -> str:
    """The list of these pages, with what each module says of itself in a line."""
    lines = []
    for room, (title, names) in ROOMS.items():
        module = import_module(f"pypose_lite.{names[0]}")
        lines.append(f"- [{title}](api/{room}.md): {first_line(module)}")
    return "\n".join(lines)


def page(name: str) -> str:
    """The page of a room: for each module its docstring, its names, and their full texts."""
    title, names = ROOMS[name.removeprefix("api/")]
    parts = [f"# {title}"]
    for name in names:
        module = import_module(f"pypose_lite.{name}")
        shown = public(module)
        parts += [f"## {module.__name__}", markdown(module)]
        parts.append(
            "\n".join(f"- {link(module, name)}: {summary(module, name)}" for name in shown)
        )
        parts += [entry(module, name) for name in shown if documented(module, name)]
    return "\n\n".join(parts) + "\n"


def public(module: ModuleType) -> list[str]:
    """The names that a module offers: its ``__all__``, or what it defines itself."""
    if hasattr(module, "__all__"):
        return list(module.__all__)
    own = inspect.getmembers(module, lambda x: getattr(x, "__module__", "") == module.__name__)
    line = {name: inspect.getsourcelines(value)[1] for name, value in own if name[0] != "_"}
    return sorted(line, key=line.__getitem__)


def documented(module: ModuleType, name: str) -> bool:
    """Whether a name is shown in full here: plain values are not, nor what another room shows."""
    value = getattr(module, name)
    room = ".".join(module.__name__.split(".")[:2])
    return (inspect.isclass(value) or inspect.isfunction(value)) and (
        value.__module__ == module.__name__ or value.__module__.startswith(f"{room}.")
    )


def link(module: ModuleType, name: str) -> str:
    """The name, leading to its full text where there is one."""
    shown = f"{{py:obj}}`{name} <{module.__name__}.{name}>`"
    return shown if documented(module, name) else f"`{name}`"


def entry(module: ModuleType, name: str) -> str:
    """The directive that shows a class or a function in full."""
    kind = "autoclass" if inspect.isclass(getattr(module, name)) else "autofunction"
    members = "\n   :members:" if kind == "autoclass" else ""
    return f"```{{eval-rst}}\n.. {kind}:: {module.__name__}.{name}{members}\n```"


def summary(module: ModuleType, name: str) -> str:
    """What a name is, in a line."""
    return first_line(getattr(module, name)) or "a constant"


def first_line(thing: object) -> str:
    """The first line of a docstring, as Markdown."""
    value = thing if isinstance(thing, ModuleType) or callable(thing) else type(thing)
    text = inspect.getdoc(value) or ""
    return as_markdown(text.split("\n\n")[0].replace("\n", " "))


def markdown(module: ModuleType) -> str:
    """A module's docstring as Markdown."""
    return as_markdown(inspect.getdoc(module) or "")


def as_markdown(text: str) -> str:
    """Roles and literals of docstrings, ``:class:`System```, in Markdown's way."""
    text = re.sub(r"``([^`\n]*`[^`\n]*`)``", r"`` \1 ``", text)
    return re.sub(r"(?<!`):(\w+):`", r"{py:\1}`", text)
