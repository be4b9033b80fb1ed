"""``python -m stridelab.service.api``: runs the web server (``server``), without searching its imports for garbage.

Imports make some hundred thousand objects that live to the end; the collector would search them again and again.
"""

import gc

gc.set_threshold(200_000)  # more new objects than the imports leave behind

from stridelab.service.api.server import main  # noqa: E402

if __name__ == "__main__":
    main()
