"""Without the C++ solver everything works by CasADi, and says so."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from stridelab.centroidal.native import availability
from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.solver import solve
from stridelab.errors import NotEstimable
from support.robots.sequences import rest_to_rest, two_steps


@pytest.fixture(autouse=True)
def looked_for_anew() -> Iterator[None]:
    availability.native_availability.cache_clear()
    yield
    availability.native_availability.cache_clear()


def absent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(availability, "MODULE", "stridelab_native_missing")


def test_auto_uses_casadi_without_the_native_library(monkeypatch: pytest.MonkeyPatch) -> None:
    absent(monkeypatch)
    plan = solve(rest_to_rest(two_steps(), control=CircularCones()))
    assert plan.converged
    assert plan.solver == "ipopt"


def test_native_is_refused_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    absent(monkeypatch)
    with pytest.raises(NotEstimable) as refused:
        solve(replace(rest_to_rest(two_steps()), control=CircularCones()), "native")
    assert refused.value.code == "solver-unavailable"
    assert "has not been built" in refused.value.message


def test_a_library_of_another_build_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "stridelab_native_of_old.py").write_text("INTERFACE = 0\n")
    monkeypatch.setattr(availability, "MODULE", "stridelab_native_of_old")
    monkeypatch.setenv(availability.PATH_VARIABLE, str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path))
    missing = availability.native_availability()
    assert isinstance(missing, availability.NativeUnavailable)
    assert "another version" in missing.reason


def test_a_library_that_does_not_load_gives_the_reason(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "stridelab_native_broken.py").write_text("raise ImportError('wrong processor')\n")
    monkeypatch.setattr(availability, "MODULE", "stridelab_native_broken")
    monkeypatch.syspath_prepend(str(tmp_path))
    missing = availability.native_availability()
    assert isinstance(missing, availability.NativeUnavailable)
    assert "wrong processor" in missing.reason
