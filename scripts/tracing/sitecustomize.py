"""Note which files of the project run any function: imported at the start of every Python process of a traced run.

``STRIDELAB_TRACE`` is a folder; each process writes the functions that it calls first into a file of its own there, at
once, because processes may end without notice. Nothing is noted before a file named ``on`` is in the folder.
"""

import inspect
import os
import sys
import threading
import time
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

FOLDER = os.environ.get("STRIDELAB_TRACE", "")
PACKAGES = ("/backend/stridelab/", "/frontend/stridelab_web/")
LOOK_S = 0.05
_known: set[CodeType] = set()
_on = False
_next_look_s = 0.0


def _is_on() -> bool:
    global _on, _next_look_s
    if not _on and time.perf_counter() > _next_look_s:
        _next_look_s = time.perf_counter() + LOOK_S
        _on = Path(FOLDER, "on").exists()
    return _on


def _note(frame: FrameType, event: str, _argument: Any) -> None:
    code = frame.f_code
    if event != "call" or code in _known or not _is_on():
        return
    _known.add(code)
    name = code.co_filename
    if code.co_flags & inspect.CO_OPTIMIZED and any(package in name for package in PACKAGES):  # a function
        with Path(FOLDER, str(os.getpid())).open("a", encoding="utf-8") as file:
            file.write(f"{name}\t{code.co_qualname}\n")


if FOLDER:
    threading.setprofile(_note)
    sys.setprofile(_note)
