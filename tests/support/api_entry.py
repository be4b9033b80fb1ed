"""The web server without libraries imported ahead for parsing: tests start it often."""

from stridelab.service.api import app
from stridelab.service.api.__main__ import main
from stridelab.service.jobs.isolated import IsolatedPool

if __name__ == "__main__":
    app.IsolatedPool = lambda _: IsolatedPool()  # type: ignore[assignment,misc]
    main()
