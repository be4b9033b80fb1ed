"""``stridelab``, and ``python -m stridelab.cli``: the command line.

Imports make some hundred thousand objects that live to the end; the collector would search them for cycles again and
again, 0.15 s of a start.
"""

import gc
from typing import Final

COLLECT_AFTER: Final = 200_000
"""New objects after which the collector searches for cycles: more than a command's imports leave behind."""


def main() -> None:
    """Run the command line with a collector that does not run during the imports."""
    gc.set_threshold(COLLECT_AFTER)
    from stridelab.cli.app import main as run

    run()


if __name__ == "__main__":
    main()
