"""Shapes are checked at run time in the tests; real recordings come from STRIDELAB_TEST_DATA."""

import os
from pathlib import Path

import pytest
from jaxtyping import install_import_hook

install_import_hook("stridelab", "beartype.beartype")


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder with the real recordings (gait/, robots/); tests that need it skip as a module where it is absent."""
    return Path(os.environ.get("STRIDELAB_TEST_DATA", Path(__file__).parents[2] / "shared")).resolve()
