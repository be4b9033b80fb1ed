"""One test over many files: it checks each and lists those that fail, so that numbers of tests mean behaviour."""

from collections.abc import Callable, Iterable
from pathlib import Path

from support.docs.floors import ROOT


def each_of(paths: Iterable[Path]) -> Callable[[Callable[[Path], None]], Callable[[], None]]:
    """Decorate a check of one file: the test runs it for all ``paths`` and names every file that fails."""
    known = list(paths)

    def decorate(check: Callable[[Path], None]) -> Callable[[], None]:
        def test() -> None:
            assert known, "no files to check"
            failures = {}
            for path in known:
                try:
                    check(path)
                except AssertionError as error:
                    failures[str(path.relative_to(ROOT))] = str(error)
            assert not failures, "\n".join(f"{path}: {why}" for path, why in failures.items())

        test.__name__, test.__qualname__, test.__doc__ = check.__name__, check.__qualname__, check.__doc__
        test.__module__ = check.__module__
        return test

    return decorate
