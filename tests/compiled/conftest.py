"""Compiled code that tests make stays with the repository, in ``build``."""

import os
from pathlib import Path

KEPT = Path(__file__).parents[2] / "build" / "compiled"
os.environ.setdefault("PYPOSE_LITE_CACHE", str(KEPT))
