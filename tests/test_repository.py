"""What a stranger finds beside the code: metadata, licences, forms, and workflows that can run."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

import pypose_lite

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
GITHUB = ROOT / ".github"
WORKFLOWS = sorted((GITHUB / "workflows").glob("*.yml"))
FORMS = [
    path for path in sorted((GITHUB / "ISSUE_TEMPLATE").glob("*.yml")) if path.stem != "config"
]
SCHEMAS = [
    *((path, "github-workflows") for path in WORKFLOWS),
    *((path, "github-issue-forms") for path in FORMS),
    (GITHUB / "ISSUE_TEMPLATE" / "config.yml", "github-issue-config"),
    (GITHUB / "dependabot.yml", "dependabot"),
    (ROOT / "CITATION.cff", "citation-file-format"),
]
STEPS = [*WORKFLOWS, ROOT / ".ci" / "run", ROOT / ".devcontainer" / "devcontainer.json"]


def run(*command, **options):
    """What a command did, as if no make had called these tests."""
    env = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    options = {"env": env, "capture_output": True, "text": True, "timeout": 120, **options}
    return subprocess.run(command, **options)


@pytest.mark.parametrize(("path", "schema"), SCHEMAS, ids=lambda x: getattr(x, "name", ""))
def test_a_file_is_as_its_reader_expects_it(path, schema):
    pytest.importorskip("check_jsonschema")
    done = run(
        sys.executable, "-m", "check_jsonschema", "--builtin-schema", f"vendor.{schema}", path
    )
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("path", STEPS, ids=lambda path: path.name)
def test_every_step_is_a_target_of_make_or_a_script_that_is_here(path):
    text = path.read_text("utf-8")
    makefile = (ROOT / "Makefile").read_text("utf-8")
    for target in re.findall(r"\bmake ([a-z-]+)", text):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
    for script in re.findall(r"bash ([\w./]+\w)", text):
        assert (ROOT / script).exists()


def test_workflows_run_nothing_but_make_scripts_and_what_talks_to_github():
    for path in WORKFLOWS:
        for job in yaml.safe_load(path.read_text("utf-8"))["jobs"].values():
            for step in job["steps"]:
                command = step.get("run", "make")
                assert (
                    command.startswith(("make ", "bash .ci/")) or "gh " in command or "uses" in step
                )


def test_workflows_pass_their_linter():
    done = run("make", "-s", "-o", ".venv/.installed", "workflows", cwd=ROOT)
    if "cannot be fetched" in done.stderr:
        pytest.skip("the linter is not there, and cannot be fetched: no network")
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_linter_that_cannot_be_fetched_is_said_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setenv("npm_config_registry", "http://127.0.0.1:9")
    monkeypatch.setenv("npm_config_cache", str(tmp_path / "cache"))
    shutil.copytree(ROOT / ".ci", tmp_path / ".ci")
    (tmp_path / "pypose_lite").mkdir()
    make = ["make", "-s", "-f", str(ROOT / "Makefile"), "-o", ".venv/.installed", "workflows"]
    done = run(*make, cwd=tmp_path)
    said, makes_own = done.stderr.splitlines()
    assert said == "pypose_lite: the linter cannot be fetched, see build/workflows/npm.log"
    assert makes_own.startswith("make: ")


def test_the_linter_finds_a_fault(tmp_path):
    lint = ROOT / "build" / "workflows" / "lint.mjs"
    if not lint.exists() or not shutil.which("node"):
        pytest.skip("the linter is not there: make workflows")
    wrong = WORKFLOWS[0].read_text("utf-8").replace("github.token", "github.tokn")
    (tmp_path / "wrong.yml").write_text(wrong, "utf-8")
    done = run("node", lint, tmp_path / "wrong.yml")
    assert done.returncode == 1 and 'property "tokn" is not defined' in done.stdout


def test_every_address_of_the_repository_is_the_one_of_pyproject():
    repository = PROJECT["urls"]["Repository"]
    assert all(url.startswith(repository) for url in PROJECT["urls"].values())
    assert (
        yaml.safe_load((ROOT / "_config.yml").read_text("utf-8"))["repository"]["url"] == repository
    )
    assert (
        yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))["repository-code"] == repository
    )
    for name in ("README.md", "CITATION.cff", "_config.yml", ".github/CONTRIBUTING.md"):
        text = (ROOT / name).read_text("utf-8")
        assert set(re.findall(r"https://github\.com/pypose[\w-]*/[\w-]+", text)) <= {repository}


def test_the_citation_has_the_version():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert cited["version"] == pypose_lite.__version__
    assert (
        cited["title"]
        == f"pypose_lite: {PROJECT['description'][0].lower()}{PROJECT['description'][1:]}"
    )


def test_the_wheel_says_who_made_it_where_it_is_and_under_which_licences(wheel):
    archive = zipfile.ZipFile(wheel)
    [name] = [name for name in archive.namelist() if name.endswith("/METADATA")]
    metadata = archive.read(name).decode()
    assert "Author: the pypose_lite authors" in metadata
    assert f"Project-URL: Repository, {PROJECT['urls']['Repository']}" in metadata
    assert "License-Expression: MIT AND CC-BY-4.0" in metadata
    licences = {Path(name).name for name in archive.namelist() if "/licenses/" in name}
    assert licences == {"LICENSE", "LICENSE-prose"}


def test_a_release_is_made_only_of_the_version_that_its_tag_names():
    wrong = run("make", "-n", "wheel", "TAG=v9.9.9", cwd=ROOT)
    assert 'grep -q "^__version__ = \\"9.9.9\\"$" pypose_lite/__init__.py' in wrong.stdout
    shell = wrong.stdout.splitlines()[0]
    assert run("sh", "-c", shell, cwd=ROOT).returncode == 1
    right = shell.replace("9.9.9", pypose_lite.__version__)
    assert run("sh", "-c", right, cwd=ROOT).returncode == 0


def test_scripts_keep_their_line_ends_where_git_would_change_them(tmp_path):
    clone = ["git", "-c", "core.autocrlf=true", "clone", "--quiet", "--depth=1"]
    done = run(*clone, f"file://{ROOT}", str(tmp_path / "clone"))
    if done.returncode:
        pytest.skip("not a git checkout")
    for name in (".ci/install", ".ci/run", "Makefile", "book/03_mpc.py"):
        assert b"\r" not in (tmp_path / "clone" / name).read_bytes(), name
