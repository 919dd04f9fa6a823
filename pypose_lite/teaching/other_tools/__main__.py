"""Solves the problem with every tool and records the answers: `make other-tools`.

Two environments are made in ``build/other-tools``: one beside the
project's own, and one for HILO-MPC, which needs numpy older than 2. What a tool answers is kept in
``results.json``; the page "The same infinity with other tools" is built from there, so that nobody
needs the tools in order to build the book.
"""

import json
import os
import platform
import subprocess
import sys
import sysconfig
from datetime import date
from pathlib import Path

from .both import RECORD, RECORDING

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
MADE = ROOT / "build" / "other-tools"
RESULTS = HERE / "results.json"
PROGRAMS = {  # each tool's program, with its argument, and the environment it runs in
    "ours.py": "tools",
    "ours.py compiled": "tools",
    "casadi_.py ipopt": "tools",
    "casadi_.py fatrop": "tools",
    "do_mpc_.py": "tools",
    "hilo_mpc_.py": "hilo",
    "pypose_.py": "tools",
    "neuromancer_.py": "tools",
}


def main() -> None:
    """Makes the environments, runs all programs, and writes what they answer."""
    answers = [answer(program, environment(name)) for program, name in PROGRAMS.items()]
    record = {"date": date.today().isoformat(), "machine": machine(), "answers": answers}
    RESULTS.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    print(f"wrote {RESULTS.relative_to(ROOT)}")
    record_pypose(environment("tools"))


def answer(program: str, python: Path) -> dict:
    """Returns what one program prints, as a dictionary; ends with its error where it fails."""
    file, *arguments = program.split()
    done = subprocess.run(
        [python, HERE / "programs" / file, *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        env=os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)},
    )
    if done.returncode:
        sys.exit(f"{program} failed: {done.stderr.strip().splitlines()[-1]}")
    found = json.loads(done.stdout.strip().splitlines()[-1])
    print(f"{found['tool']:20} u0 = {found['u0']}, {found['ms']:.2f} ms")
    return {"program": program, **found}


def record_pypose(python: Path) -> None:
    """Runs the page "From pypose_lite to PyPose", and so writes down what PyPose answers there."""
    RECORD.unlink(missing_ok=True)
    quiet = {"MPLBACKEND": "agg", "PYTHONPATH": str(ROOT), RECORDING: "1"}
    subprocess.run([python, ROOT / "book" / "to_pypose.py"], env=os.environ | quiet, check=True)
    print(f"wrote {RECORD.relative_to(ROOT)}")


def environment(name: str) -> Path:
    """Returns the interpreter of an environment with the tools, which is made if need be."""
    folder = MADE / name
    python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
    if (folder / "complete").exists():
        return python
    print(f"making {folder.relative_to(ROOT)}, a minute or two")
    subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
    install = [str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    if name == "tools":  # it sees the project's packages, and brings no second torch
        link = folder / Path(sysconfig.get_path("purelib")).relative_to(sys.prefix)
        (link / "project.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
        install.append("--no-deps")
    subprocess.run([*install, "-r", str(HERE / f"requirements-{name}.txt")], check=True)
    (folder / "complete").touch()
    return python


def machine() -> str:
    """Returns what the times were measured on, as far as it says."""
    return f"{platform.machine()}, one core, Python {platform.python_version()}"


if __name__ == "__main__":
    main()
