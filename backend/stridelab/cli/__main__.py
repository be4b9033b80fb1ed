"""``stridelab``, and ``python -m stridelab.cli``: the command line.

Imports make some hundred thousand objects that live to the end; the collector would search them for cycles again and
again, 0.15 s of a start. So it does not run during the imports.
"""

import gc

gc.set_threshold(200_000)  # more new objects than a command's imports leave behind

from stridelab.cli.app import main  # noqa: E402

__all__ = ["main"]

if __name__ == "__main__":
    main()
