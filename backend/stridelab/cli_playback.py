"""A recording as one page that a browser opens from the disk: viser's own player with the recording inside."""

import base64
from pathlib import Path
from typing import Final

PAGE_FILE: Final = "motion.html"
RECORDING_FILE: Final = "motion.viser"


def write_page(folder: Path) -> Path | None:
    """Write ``motion.html`` beside ``motion.viser``; None where there is no recording.

    This is what viser's ``StateSerializer.as_html`` makes, from a recording that has been written already.
    """
    recording = folder / RECORDING_FILE
    if not recording.is_file():
        return None
    import viser

    client = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text(encoding="utf-8")
    data = base64.b64encode(recording.read_bytes()).decode("ascii")
    script = f'<script>window.__VISER_EMBED_DATA__="{data}";window.__VISER_EMBED_CONFIG__={{darkMode:false}};</script>'
    head, end, rest = client.partition("</head>")
    page = folder / PAGE_FILE
    page.write_text(head + script + end + rest, encoding="utf-8")
    return page
