"""A worker process for the job kinds of the tests: ``python -m support.service.worker_entry``."""

import asyncio

from stridelab.service.jobs.worker import run_worker
from stridelab.service.logging import configure_logging
from stridelab.service.settings import current_settings
from support.service.job_kinds import KINDS

if __name__ == "__main__":
    configure_logging("info")
    asyncio.run(run_worker(current_settings(), KINDS))
