"""Work for ``in_order``: what a piece of work can do to its process. Run as a program, it never ends by itself."""

import os
import threading
import time
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_info

from stridelab.errors import Fault, NotEstimable
from stridelab.parallel import map_in_order


def square(piece: int) -> tuple[int, int]:
    return piece * piece, os.getpid()


def threads(_piece: int) -> list[int]:
    np.linalg.norm(np.eye(2))
    return [library["num_threads"] for library in threadpool_info()]


def refuse(piece: int) -> int:
    if piece == 2:
        raise NotEstimable("no-posture", "There is no posture.", [Fault("robot", "stiff")])
    return piece


def hog(_piece: int) -> int:
    raise MemoryError


def vanish(piece: int) -> int:
    if piece == 1:
        os._exit(3)
    return piece


def hang(piece: int) -> int:
    if piece > 1:
        time.sleep(600)
    return os.getpid()


def hang_noted(piece: int) -> int:
    Path(os.environ["NOTED"], str(os.getpid())).touch()
    time.sleep(600)
    return piece


if __name__ == "__main__":
    if os.environ["THREADS"] == "two threads":
        threading.Thread(target=time.sleep, args=(600,), daemon=True).start()
    list(map_in_order(hang_noted, 2, 2))
