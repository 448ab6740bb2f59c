"""Processes that end when the one that started them is gone, however it ended."""

import os
import threading
import time

WATCH = 0.2
"""Seconds between two looks at the parent: what is solved after that is gone is lost."""


def end_with_parent(parent: int) -> None:
    """End this process when its parent is no longer the process of that number.

    A worker calls it before anything else. Its number is given: a parent that is gone already would not be missed.
    """
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(WATCH)
    os._exit(1)
