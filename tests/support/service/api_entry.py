"""The web server, which imports what reads uploads with the first one: tests start it often."""

from stridelab.service.api import app
from stridelab.service.api.__main__ import main
from support.service.web_server import LatePool

if __name__ == "__main__":
    app.IsolatedPool = LatePool  # type: ignore[misc]
    main()
