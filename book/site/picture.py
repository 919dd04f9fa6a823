"""Takes the animation out of the opening page: ``python book/site/picture.py NOTEBOOK PICTURE``."""

import base64
import re
import sys
from pathlib import Path

import nbformat

notebook, picture = map(Path, sys.argv[1:])
outputs = [
    out for cell in nbformat.read(notebook, as_version=4).cells for out in cell.get("outputs", [])
]
shown = "".join("".join(out.get("data", {}).get("text/html", "")) for out in outputs)
[gif] = re.findall(r"data:image/gif;base64,([\w+/=]+)", shown)
picture.write_bytes(base64.b64decode(gif))
