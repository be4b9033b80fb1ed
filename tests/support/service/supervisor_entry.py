"""The whole service with a worker for the job kinds of the tests: ``python -m support.service.supervisor_entry``."""

from stridelab.errors import StridelabError
from stridelab.service import supervisor
from stridelab.service.settings import current_settings

if __name__ == "__main__":
    supervisor.API = "support.service.api_entry"  # type: ignore[misc]
    supervisor.WORKER = "support.service.worker_entry"  # type: ignore[misc]
    supervisor.VIEWER = "support.no_viewer"  # type: ignore[misc]
    try:
        supervisor.serve(current_settings())
    except StridelabError as error:
        raise SystemExit(f"{error.code}: {error.message}") from error
