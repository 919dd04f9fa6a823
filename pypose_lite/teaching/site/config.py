"""The settings of the site: those of every book, and over them an author's ``_config.yml``."""

from pathlib import Path
from typing import Any

import yaml

from .pages import BOOK, ROOT

DEFAULTS = Path(__file__).parent / "_config.yml"


def merged() -> str:
    """Returns the settings as text: mappings are merged, lists go on, the rest is the author's."""
    settings = yaml.safe_load(DEFAULTS.read_text(encoding="utf-8"))
    path = ROOT / "_config.yml"
    if path.exists():
        settings = over(settings, yaml.safe_load(path.read_text(encoding="utf-8")) or {})
    if not (BOOK / "references.bib").exists():
        without_references(settings)
    return yaml.safe_dump(settings, sort_keys=False, allow_unicode=True)


def over(below: Any, above: Any) -> Any:
    """Returns ``above`` laid over ``below``."""
    if isinstance(below, dict) and isinstance(above, dict):
        both = {key: over(below[key], above[key]) for key in below if key in above}
        return below | above | both
    if isinstance(below, list) and isinstance(above, list):
        return below + [item for item in above if item not in below]
    return above


def without_references(settings: dict[str, Any]) -> None:
    """Takes out what reads a bibliography, which would warn where there is none."""
    del settings["bibtex_bibfiles"]
    sphinx = settings["sphinx"]
    sphinx["extra_extensions"] = [e for e in sphinx["extra_extensions"] if "citations" not in e]
    sphinx["config"] = {k: v for k, v in sphinx["config"].items() if not k.startswith("bibtex")}
