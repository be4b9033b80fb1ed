"""The rooms of the backend and the floors that they stand on, for the tests of the house."""

from pathlib import Path

ROOT = Path(__file__).parents[3]
BACKEND = ROOT / "backend" / "stridelab"
FRONTEND = ROOT / "frontend" / "stridelab_web"

GROUND = {"conventions", "cores", "errors", "resources", "parallel"}
WINGS = ["dynamics", "recordings", "body", "estimation", "walking", "measures"]
ROBOT_WING = ["dynamics", "robots", "contacts", "reachability", "centroidal", "wholebody"]
SCIENCE = GROUND | set(WINGS) | set(ROBOT_WING)
STUDIES = ["simulation", "studies", "reproduction"]
NUMERIC = SCIENCE | set(STUDIES)
"""What computes: it knows no web and prints nothing, and a docstring says what each public part of it is."""


def room_of(path: Path) -> str:
    """Which room a module of the backend belongs to."""
    return path.relative_to(BACKEND).parts[0].removesuffix(".py")


def numeric_modules() -> list[Path]:
    """Every module of the rooms that compute."""
    return [path for path in sorted(BACKEND.rglob("*.py")) if room_of(path) in NUMERIC]
