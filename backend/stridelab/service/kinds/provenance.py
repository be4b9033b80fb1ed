"""Where a number comes from: versions of what computed it, and the literature of the methods used."""

import platform
import re
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from stridelab.resources import models_dir

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
"""Packages that numbers depend on."""

_ENTRY = re.compile(r"^@\w+\{([^,\s]+),.*?^\}", re.MULTILINE | re.DOTALL)


@cache
def versions() -> dict[str, str]:
    """Version of Python and of every installed package of ``PACKAGES``."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


@cache
def _entries() -> dict[str, str]:
    text = (models_dir() / "references.bib").read_text(encoding="utf-8")
    return {match.group(1): match.group(0) for match in _ENTRY.finditer(text)}


def known_references() -> frozenset[str]:
    """Citation keys of ``models/references.bib``."""
    return frozenset(_entries())


def bibliography(keys: Iterable[str]) -> str:
    """BibTeX of the given keys, in their order. Raises ``KeyError`` for a key that models/references.bib lacks."""
    return "\n\n".join(_entries()[key] for key in dict.fromkeys(keys)) + "\n"
