"""The C++ solver is built where it can be, and nothing stops where it cannot."""

import importlib.util
import os
import shutil
import subprocess
import sysconfig
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "scripts" / "native"
COMPILERS = ("c++", "g++", "clang++")


def native(folder: Path, **settings: str) -> subprocess.CompletedProcess[str]:
    """The script with a cache of its own, whatever the tests were started with."""
    variables = {name: value for name, value in os.environ.items() if not name.startswith(("STRIDELAB_NATIVE", "CXX"))}
    environment = variables | {"XDG_CACHE_HOME": str(folder / "a cache")} | settings
    return subprocess.run([SCRIPT], env=environment, capture_output=True, text=True, check=False, timeout=120)


def says_one_line(run: subprocess.CompletedProcess[str], words: str) -> None:
    assert run.returncode == 0
    assert run.stdout == ""
    assert len(run.stderr.splitlines()) == 1
    assert words in run.stderr
    assert "CasADi solves in its place" in run.stderr


@pytest.mark.skipif(not (ROOT / ".venv" / "bin" / "python").exists(), reason="the script builds for .venv")
class TestScript:
    def test_without_a_compiler_the_build_prints_one_line(self, tmp_path: Path) -> None:
        tools = tmp_path / "bin"
        tools.mkdir()
        for name in ("sh", "dirname"):
            (tools / name).symlink_to(str(shutil.which(name)))
        says_one_line(native(tmp_path, PATH=str(tools)), "no C++ compiler")

    def test_a_broken_compiler_is_reported_in_one_line_and_remembered(self, tmp_path: Path) -> None:
        broken = tmp_path / "broken"
        broken.write_text(f'#!/bin/sh\necho called >>"{tmp_path}/calls"\nexit 3\n')
        broken.chmod(0o755)
        says_one_line(native(tmp_path, CXX=str(broken)), "does not build C++20")
        calls = (tmp_path / "calls").read_text().count("called")
        says_one_line(native(tmp_path, CXX=str(broken)), "does not build C++20")
        # The second start asks the compiler for its name only.
        assert (tmp_path / "calls").read_text().count("called") == calls + 1

    def test_a_disabled_build_is_reported_in_one_line(self, tmp_path: Path) -> None:
        says_one_line(native(tmp_path, STRIDELAB_NATIVE="off"), "switched off")

    def test_a_given_folder_is_used(self, tmp_path: Path) -> None:
        run = native(tmp_path, STRIDELAB_NATIVE_PATH="/opt/some folder")
        assert (run.returncode, run.stdout, run.stderr) == (0, "/opt/some folder\n", "")


class TestWheel:
    """The build hook alone: ``scripts/release`` builds, installs and runs whole wheels."""

    @staticmethod
    def built(root: Path, version: str = "standard") -> tuple[dict[str, Any], list[str]]:
        """The build data after the hook, and its warnings."""
        spec = importlib.util.spec_from_file_location("build_hook", ROOT / "backend" / "build_hook.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        warnings: list[str] = []
        app = SimpleNamespace(display_warning=warnings.append)
        hook = module.NativeSolverHook(str(root), {}, None, None, str(root), "wheel", app)
        data: dict[str, Any] = {"force_include": {}}
        hook.initialize(version, data)
        return data, warnings

    def test_the_wheel_is_pure_when_the_build_is_disabled(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("STRIDELAB_NATIVE", "off")
        data, warnings = self.built(ROOT)
        assert data == {"force_include": {}}
        assert warnings == ["The wheel has no C++ solver: STRIDELAB_NATIVE is off."]

    def test_the_wheel_is_pure_without_a_compiler(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.delenv("STRIDELAB_NATIVE", raising=False)
        monkeypatch.delenv("CXX", raising=False)
        monkeypatch.setenv("PATH", str(tmp_path))
        assert self.built(ROOT) == (
            {"force_include": {}},
            ["The wheel has no C++ solver: no C++ compiler was found."],
        )

    def test_the_wheel_is_pure_if_the_build_fails(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        """Sources that do not build: one warning with the compiler's last lines, no half-filled wheel."""
        monkeypatch.delenv("STRIDELAB_NATIVE", raising=False)
        monkeypatch.setenv("CXX", "true")
        (tmp_path / "backend" / "native").mkdir(parents=True)
        data, warnings = self.built(tmp_path)
        assert data == {"force_include": {}}
        assert [warning.splitlines()[0] for warning in warnings] == ["The wheel has no C++ solver: its build failed."]

    def test_editable_installations_are_not_changed(self) -> None:
        assert self.built(ROOT, "editable") == ({"force_include": {}}, [])


def test_the_native_library_is_built_if_there_is_a_compiler() -> None:
    """Under ``scripts/test``, and so in continuous integration, the native solver is never skipped by accident."""
    if "STRIDELAB_NATIVE_PATH" not in os.environ:
        pytest.skip("scripts/test, which builds the C++ solver, did not start these tests")
    if os.environ.get("STRIDELAB_NATIVE") == "off":
        pytest.skip("the C++ solver is switched off")
    compiler = any(shutil.which(name) for name in COMPILERS)
    headers = Path(sysconfig.get_path("include"), "Python.h").is_file()
    if not (compiler and headers):
        pytest.skip("no C++ compiler, or no headers of Python")
    folder = os.environ["STRIDELAB_NATIVE_PATH"]
    assert folder, "a compiler is here, and yet the C++ solver was not built: scripts/native says why"
    assert (Path(folder) / "stridelab_native" / "__init__.py").is_file()


def test_a_wheel_is_for_every_processor() -> None:
    """-march=native is for the cache alone."""
    project = ROOT / "backend" / "native"
    for file in (project / "pyproject.toml", ROOT / "backend" / "Dockerfile"):
        assert "march" not in file.read_text().lower()
    build = (project / "CMakeLists.txt").read_text()
    assert 'set(STRIDELAB_MARCH "" CACHE STRING' in build
    assert "-ffast-math" not in "".join(line for line in build.splitlines(keepends=True) if not line.startswith("#"))
