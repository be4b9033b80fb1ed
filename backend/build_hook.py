"""Build hook of the wheel: compiles the C++ solver into it where a C++ compiler is.

Without a compiler, or with ``STRIDELAB_NATIVE=off``, the wheel is pure Python and CasADi solves in place of the C++
solver, slower. Editable installations never compile: ``scripts/native`` builds for a checkout.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PACKAGE = "stridelab_native"
_BUILD = "import sys; from scikit_build_core.build import build_wheel; print(build_wheel(sys.argv[1]))"


class NativeSolverHook(BuildHookInterface):
    """Adds ``stridelab_native`` to the wheel and tags the wheel with its platform."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the solver and include its files; leave the wheel pure where that is not possible."""
        if self.target_name != "wheel" or version == "editable":
            return
        if reason := self._reason_not_to_build():
            self.app.display_warning(f"The wheel has no C++ solver: {reason}")
            return
        self.folder = Path(tempfile.mkdtemp(prefix="stridelab-native-"))
        run = subprocess.run(
            [sys.executable, "-c", _BUILD, str(self.folder)],
            cwd=Path(self.root, "backend", "native"),
            capture_output=True,
            text=True,
            check=False,
        )
        if run.returncode != 0:
            last_lines = "\n".join((run.stdout + run.stderr).splitlines()[-20:])
            self.app.display_warning(f"The wheel has no C++ solver: its build failed.\n{last_lines}")
            return
        with zipfile.ZipFile(next(self.folder.glob("*.whl"))) as wheel:
            wheel.extractall(self.folder, [name for name in wheel.namelist() if name.startswith(f"{PACKAGE}/")])
        build_data["force_include"][str(self.folder / PACKAGE)] = PACKAGE
        build_data["pure_python"] = False
        build_data["infer_tag"] = True

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the compiled files."""
        if folder := getattr(self, "folder", None):
            shutil.rmtree(folder, ignore_errors=True)

    @staticmethod
    def _reason_not_to_build() -> str | None:
        if os.environ.get("STRIDELAB_NATIVE") == "off":
            return "STRIDELAB_NATIVE is off."
        if not any(shutil.which(name) for name in filter(None, (os.environ.get("CXX"), "c++", "g++", "clang++"))):
            return "no C++ compiler was found."
        return None
