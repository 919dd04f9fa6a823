"""A Sphinx extension: equations in docstrings stay as they stand in the source, line by line."""

import re


def as_written(app, what, name, obj, options, lines):
    """Marks each indented block that holds a numbered equation, ``... (1)``, as literal."""
    for start in reversed(range(1, len(lines))):
        if lines[start - 1] or not lines[start].startswith(" "):
            continue  # a block begins after an empty line
        end = start
        while end < len(lines) and (not lines[end] or lines[end].startswith(" ")):
            end += 1
        if any(re.search(r"\(\d+\)$", line) for line in lines[start:end]):
            lines[start:start] = ["::", ""]


def setup(app):
    """Before napoleon, which reads the same lines."""
    app.connect("autodoc-process-docstring", as_written, priority=400)
    return {"parallel_read_safe": True}
