"""Takes the animation out of the opening page: ``python book/site/picture.py NOTEBOOK PICTURE``."""

import base64
import sys
from pathlib import Path

import nbformat

notebook, picture = map(Path, sys.argv[1:])
outputs = [
    out for cell in nbformat.read(notebook, as_version=4).cells for out in cell.get("outputs", [])
]
[gif] = [out.data["image/gif"] for out in outputs if "image/gif" in out.get("data", {})]
picture.write_bytes(base64.b64decode(gif))
