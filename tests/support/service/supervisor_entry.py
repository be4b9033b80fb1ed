"""The whole service with a web server and a worker for tests, and without viewer; a program that imports little."""

from stridelab.errors import StridelabError
from stridelab.service import supervisor
from stridelab.service.settings import current_settings

API, WORKER = "support.service.web_server", "support.service.job_kinds"
"""Web server and worker of the tests, as programs."""

if __name__ == "__main__":
    supervisor.API, supervisor.WORKER, supervisor.VIEWER = API, WORKER, "support.no_viewer"  # type: ignore[misc]
    try:
        supervisor.serve(current_settings())
    except StridelabError as error:
        raise SystemExit(f"{error.code}: {error.message}") from error
