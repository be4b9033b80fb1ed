"""``python -m stridelab.service.page_server``: runs the second web server, which renders pages (``page_relay``)."""

import gc

gc.set_threshold(200_000)  # as the first one does

from stridelab.service.api.server import run_page_server  # noqa: E402

if __name__ == "__main__":
    run_page_server()
