"""A worker process for the job kinds of the tests: ``python -m support.service.worker_entry``."""

import asyncio

from stridelab.service.jobs.worker import work
from stridelab.service.logging import configure_logging
from stridelab.service.settings import settings
from support.service.job_kinds import KINDS

if __name__ == "__main__":
    configure_logging("info")
    asyncio.run(work(settings(), KINDS))
