"""Results of the checks of ``stridelab doctor``, and their printing."""

from dataclasses import dataclass
from pathlib import Path

from rich.markup import escape

from stridelab.cli.results import out


@dataclass(frozen=True)
class Check:
    """Result of one check; ``fix`` says what to do if ``ok`` is false."""

    name: str
    ok: bool
    detail: str
    fix: str = ""


def print_checks(checks: list[Check]) -> bool:
    """Print the results; returns whether all checks passed."""
    for check in checks:
        mark = "[green]ok  [/]" if check.ok else "[bold red]FAIL[/]"
        out.print(f"{mark} {check.name}: {escape(check.detail)}")
        if not check.ok and check.fix:
            out.print(f"     {escape(check.fix)}")
    return all(check.ok for check in checks)


def nearest_existing_folder(folder: Path) -> Path:
    """The folder itself, or the nearest one above it that exists."""
    return next(path for path in (folder, *folder.parents) if path.exists())
