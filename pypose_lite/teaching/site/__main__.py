"""For authors: ``python -m pypose_lite.teaching.site new NAME | build [PAGE] | requirements``.

``new`` begins a tutorial, NAME.py, in this folder; ``build`` runs what has changed and builds the
site, or one page of it; ``requirements`` prints what the tooling needs, for pip, without torch.
"""

import argparse
import re
import shutil
import sys
from importlib import metadata
from pathlib import Path

BUILD = Path("build")


def main(words: list[str] | None = None) -> None:
    """Does what the command line says; what goes wrong is said in a line."""
    parser = argparse.ArgumentParser(
        prog="python -m pypose_lite.teaching.site", description=(__doc__ or "").split("\n\n")[1]
    )
    tasks = parser.add_subparsers(dest="task", required=True)
    tasks.add_parser("new", help="begins a tutorial").add_argument("name")
    build_task = tasks.add_parser("build", help="runs what has changed, and builds the site")
    build_task.add_argument("page", nargs="?", default="*")
    tasks.add_parser("requirements", help="what the tooling needs, for pip, without torch")
    said = parser.parse_args(words)
    try:
        if said.task == "new":
            from .begin import begin

            begin(said.name)
        elif said.task == "build":
            build(said.page)
        else:
            print(*requirements(), sep="\n")
    except ValueError as error:
        sys.exit(f"pypose_lite: {error}")


def requirements() -> list[str]:
    """What the extra ``book`` asks for, as pip takes it."""
    asked = metadata.requires("pypose_lite") or []
    return [re.split(r"\s*;", line)[0] for line in asked if re.search(r"extra == .book.", line)]


def build(page: str) -> None:
    """Builds the site into ``build/site``, or one page of it into ``build/page``."""
    from . import assets, scoreboard, stage
    from .build import build as build_site
    from .pages import ROOT, notebooks, texts

    if page not in {"*", *notebooks(), *texts()}:
        raise ValueError(f"there is no page {page}; there are {', '.join(notebooks() | texts())}")
    folder, target = ("book", "site") if page == "*" else ("page", "page")
    sources, html = ROOT / BUILD / folder, ROOT / BUILD / target / "_build" / "html"
    run(page)
    stage.stage(ROOT / BUILD / "executed", sources, page)
    for line in assets.fetch(ROOT / BUILD / "npm"):
        print(line, file=sys.stderr)
    for kind in ("static", "extra"):
        shutil.copytree(ROOT / BUILD / "npm" / kind, sources / kind, dirs_exist_ok=True)
    strict = ["-W", "-n", "--keep-going"] if page == "*" else []
    if failed := build_site(sources, ROOT / BUILD / target, strict):
        sys.exit(failed)
    notes = sources.with_name(f"{folder}-notebooks")
    shutil.copytree(notes, html / "_sources", dirs_exist_ok=True)
    print(scoreboard.table(scoreboard.gather(ROOT / BUILD / "executed")))
    first = html / f"{'index' if page == '*' else page}.html"
    print(f"\nThe site: {first.as_uri()}")


def run(only: str) -> None:
    """Runs the notebooks that have changed since they were run; the site shows no others."""
    from nbclient.exceptions import CellExecutionError, CellTimeoutError

    from .execute import execute
    from .pages import ROOT, notebooks

    executed = ROOT / BUILD / "executed"
    there = {page: source for page, source in notebooks().items() if page[:10] != "exercises/"}
    for path in executed.rglob("*.ipynb"):
        if str(path.relative_to(executed).with_suffix("")) not in there:
            path.unlink()
    for page, source in there.items():
        target = executed / f"{page}.ipynb"
        fresh = target.exists() and target.stat().st_mtime > source.stat().st_mtime
        if fresh or only not in ("*", page):
            continue
        try:
            print(execute(source, target), flush=True)
        except (CellExecutionError, CellTimeoutError, ValueError) as error:
            raise ValueError(f"{source}: {error}") from None


if __name__ == "__main__":
    main()
