"""A Sphinx extension: docstrings of the library as they stand in the source.

Equations keep their lines, and the fields of a tuple say what their comments say.
"""

import inspect
import re

FIELD = re.compile(r"^    (\w+): [^#\n]+#\s+(.+)$", re.MULTILINE)


def as_written(app, what, name, obj, options, lines):
    """Marks each indented block that holds an equation, ``x = ...  (1)``, as literal."""
    for start in reversed(range(1, len(lines))):
        if lines[start - 1] or not lines[start].startswith(" "):
            continue  # a block begins after an empty line
        end = start
        while end < len(lines) and (not lines[end] or lines[end].startswith(" ")):
            end += 1
        if any(re.search(r"\(\d+\)$| = ", line) for line in lines[start:end]):
            lines[start:start] = ["::", ""]


def with_fields(app, what, name, obj, options, lines):
    """Adds a list of the fields of a tuple, with the comments beside them."""
    if what == "class" and hasattr(obj, "_fields"):
        lines += ["", *(f"- ``{field}``: {text}" for field, text in fields(obj)), ""]


def fields(kind: type) -> list[tuple[str, str]]:
    """The fields of a named tuple that have a comment, in their order."""
    try:
        return FIELD.findall(inspect.getsource(kind))
    except OSError:
        return []


def skipped(app, what, name, obj, skip, options):
    """Leaves out what Python says of a tuple's field: "Alias for field number 0"."""
    return True if (inspect.getdoc(obj) or "").startswith("Alias for field number") else None


def short_types(app, what, name, obj, options, signature, returns):
    """Names types without their modules: ``Problem`` for ``~pypose_lite.control.Problem``."""
    return tuple(text and re.sub(r"~[\w.]+\.(\w+)", r"\1", text) for text in (signature, returns))


def setup(app):
    """Before napoleon, which reads the same lines."""
    app.connect("autodoc-process-docstring", as_written, priority=400)
    app.connect("autodoc-process-docstring", with_fields, priority=600)
    app.connect("autodoc-process-signature", short_types)
    app.connect("autodoc-skip-member", skipped)
    return {"parallel_read_safe": True}
