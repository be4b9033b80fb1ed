"""Provenance of results: versions of the software that computed them, and the literature of the used methods.

Web server and worker import this module, and no numerical library with it.
"""

import platform
import re
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from stridelab.machine.models_folder import models_dir

PACKAGES = (
    "stridelab",
    "numpy",
    "scipy",
    "ezc3d",
    "pin",
    "pyarrow",
    "casadi",
    "daqp",
    "mujoco",
    "scikit-learn",
    "example-robot-data",
)
"""Packages that affect numerical results."""

_ENTRY = re.compile(r"^@\w+\{([^,\s]+),.*?^\}", re.MULTILINE | re.DOTALL)


@cache
def software_versions() -> dict[str, str]:
    """Version of Python and of every installed package of ``PACKAGES``."""
    package_versions = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            package_versions[package] = version(package)
        except PackageNotFoundError:
            package_versions[package] = "not installed"
    return package_versions


@cache
def _bibtex_entries() -> dict[str, str]:
    text = (models_dir() / "references.bib").read_text(encoding="utf-8")
    return {match.group(1): match.group(0) for match in _ENTRY.finditer(text)}


def known_references() -> frozenset[str]:
    """Citation keys of ``models/references.bib``."""
    return frozenset(_bibtex_entries())


def bibtex_of(keys: Iterable[str]) -> str:
    """BibTeX entries of ``keys``, in their order. Raises ``KeyError`` for a key missing in models/references.bib."""
    return "\n\n".join(_bibtex_entries()[key] for key in dict.fromkeys(keys)) + "\n"
