"""One plan of the infinity by other tools: their programs, and what they answered.

Each program is whole, in the idiom of its tool. `make other-tools` installs the tools, runs all
programs and records their answers; the book's page shows both.
"""

import json
from pathlib import Path

from IPython.display import Markdown

_HERE = Path(__file__).parent


def record() -> dict:
    """Returns the record of the last run.

    It holds the ``date``, the ``machine``, and the ``answers``: for each the ``tool``, its
    ``version``, the first input ``u0`` (m/s, rad/s), the ``cost`` of the plan, and the median time
    of a plan in ``ms``.
    """
    return json.loads((_HERE / "results.json").read_text(encoding="utf-8"))


def program(file: str) -> Markdown:
    """Returns the text of a program, ``"casadi_.py"``, as a notebook displays it."""
    text = (_HERE / "programs" / file).read_text(encoding="utf-8")
    return Markdown(f"```python\n{text}```")
