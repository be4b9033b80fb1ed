"""The web server without libraries imported ahead for parsing: tests start it often."""

from functools import partial

from stridelab.service.api import app
from stridelab.service.api.__main__ import main
from stridelab.service.jobs.isolated import IsolatedPool

if __name__ == "__main__":
    app.IsolatedPool = partial(IsolatedPool, preload=())  # type: ignore[assignment,misc]
    main()
