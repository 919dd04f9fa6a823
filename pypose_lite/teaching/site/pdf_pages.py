"""The pages of the built site as one page: for printing, with links that stay within it.

Every name within a page gets the page's name before it, so that two pages may have a section of the
same name. Films stand still at their end, sliders where they begin, and all folds are open.
"""

import base64
import io
import json
from pathlib import Path
from posixpath import dirname, join, normpath
from string import Template
from typing import Any
from urllib.parse import unquote, urlparse

import yaml
from bs4 import BeautifulSoup
from PIL import Image

from . import contents
from .config import merged
from .folds import STATE, VIEW

LAYOUT = Path(__file__).parent / "layout"
STYLES = "pygments", "mystnb", "sphinx-design"  # of the site; the others lay out its sidebars
MATHJAX = "tex-svg-full.js"
OUT = "script, .headerlink, .toctree-wrapper"  # what is for screens only
LABELS = {"Hide the code": "Code", "Open the answer": "Answer"}  # on a fold, open on paper
SLIDER = "On the site, a slider changes this figure."


def whole(html: Path) -> str:
    """Returns the book as one page, from the folder of its built site.

    Raises:
        ValueError: a page of the contents is not among those built.
    """
    html = html.resolve()
    names = contents.names()
    if missing := [name for name in names if not (html / f"{name}.html").exists()]:
        raise ValueError(f"{html} has no page {missing[0]}: build the site first (make site)")
    settings = yaml.safe_load(merged())
    articles = {name: article(html, name, names) for name in names}
    head = parsed(html, names[0]).head
    styles = [link["href"] for link in head.find_all("link", rel="stylesheet")]
    return Template((LAYOUT / "pdf.html").read_text(encoding="utf-8")).substitute(
        title=settings["title"],
        author=settings.get("author", ""),
        css=(LAYOUT / "pdf.css").as_uri(),
        styles="".join(
            f'<link rel="stylesheet" href="{address(html, style)}">'
            for style in styles
            if Path(style).name.startswith(STYLES)
        ),
        mathjax=(html / "_static" / MATHJAX).as_uri(),
        contents=table_of(articles),
        pages="\n".join(str(tree) for tree in articles.values()),
    )


def parsed(html: Path, name: str) -> Any:
    """A page of the site as a tree."""
    return BeautifulSoup((html / f"{name}.html").read_text(encoding="utf-8"), "html.parser")


def address(html: Path, path: str) -> str:
    """Where a file of the site lies, as a browser takes it."""
    return (html / unquote(urlparse(path).path)).resolve().as_uri()


def key(name: str, fragment: str = "") -> str:
    """What a page, or a place within it, is called in the one page."""
    page = name.replace("/", "-")
    return f"{page}--{fragment}" if fragment else page


def article(html: Path, name: str, names: list[str]) -> Any:
    """The text of one page, made ready to stand beside the others."""
    soup = parsed(html, name)
    tree = soup.find("article")
    still(soup, tree)
    for tag in tree.select(OUT):
        tag.decompose()
    opened(tree)
    for image in tree.find_all("img"):
        image["src"] = picture(html, name, image["src"])
    for tag in tree.find_all(id=True):
        tag["id"] = key(name, tag["id"])
    tree["id"] = key(name)
    follow(tree, name, names)
    return tree


def opened(tree: Any) -> None:
    """Opens all folds; what stands on them then says what is in them."""
    for fold in tree.find_all("details"):
        fold["open"] = ""
        for label in fold.summary.find_all(string=True):
            label.replace_with(LABELS.get(label.strip(), label))


def still(soup: Any, tree: Any) -> None:
    """Puts a picture in the place of each slider: the one that it shows at first."""
    states = [json.loads(tag.string)["state"] for tag in soup.find_all("script", type=STATE)]
    models = {name: model["state"] for state in states for name, model in state.items()}
    for view in tree.find_all("script", type=VIEW):
        first = shown(json.loads(view.string)["model_id"], models)
        note = f'<p class="slider">{SLIDER}</p>'
        view.replace_with(BeautifulSoup(first + note, "html.parser"))


def shown(name: str, models: dict[str, Any]) -> str:
    """What a widget shows: its own HTML, or that of the child that is selected, or of all."""
    model = models.get(name, {})
    children = [child.removeprefix("IPY_MODEL_") for child in model.get("children", [])]
    if (selected := model.get("selected_index")) is not None and children:
        children = [children[selected]]
    own = str(model.get("value", "")) if "<img" in str(model.get("value", "")) else ""
    return own + "".join(shown(child, models) for child in children)


def picture(html: Path, name: str, source: str) -> str:
    """The address of a picture; of a film, its last frame."""
    if source.startswith("data:image/gif"):
        film = Image.open(io.BytesIO(base64.b64decode(source.partition("base64,")[2])))
        film.seek(getattr(film, "n_frames", 1) - 1)
        buffer = io.BytesIO()
        film.convert("RGB").save(buffer, "png")
        return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"
    if urlparse(source).scheme:
        return source
    return address(html, join(dirname(name), source))


def follow(tree: Any, name: str, names: list[str]) -> None:
    """Makes links between pages links within the one page; those to other files become text."""
    for link in tree.find_all("a", href=True):
        url = urlparse(link["href"])
        if url.scheme or url.netloc:
            continue
        path = normpath(join(dirname(name), unquote(url.path))) if url.path else f"{name}.html"
        page = path.removesuffix(".html")
        if page in names:
            link["href"] = f"#{key(page, unquote(url.fragment))}"
        else:
            link.name = "span"
            del link["href"]


def table_of(articles: dict[str, Any]) -> str:
    """The contents, with a link and room for the page's number on each line."""
    toc = yaml.safe_load(contents.of())
    lines = [line(toc["root"], articles)]
    for part in toc.get("parts", [toc]):
        if caption := part.get("caption"):
            lines.append(f"<h3>{caption}</h3>")
        for chapter in part.get("chapters", []):
            lines.append(line(chapter["file"], articles))
            lines += [line(s["file"], articles, "sub") for s in chapter.get("sections", [])]
    return "\n".join(lines)


def line(name: str, articles: dict[str, Any], kind: str = "") -> str:
    """One line of the contents."""
    title = articles[name].find("h1")
    text = title.get_text().strip() if title else name
    words = f'<a href="#{key(name)}">{text}</a>'
    return f'<p class="{kind}">{words}<span data-page="{key(name)}"></span></p>'
