"""One line a stage: redrawn on a terminal, printed once elsewhere; and the meter of time and memory."""

import sys
import threading
import time
from types import TracebackType

import psutil
from tqdm import tqdm

_BAR_FORMAT = "{desc}  {n_fmt}/{total_fmt} {unit} {bar:20} {elapsed_s:.0f} s, {remaining} left  {postfix}"


def say(stage: str, *parts: str) -> None:
    """Print a stage's line on the error stream, which leaves the output stream to answers."""
    print("  ".join([stage, *parts]), file=sys.stderr, flush=True)


def announce(stage: str) -> None:
    """On a terminal, name the stage that is running until its line takes the place."""
    if sys.stderr.isatty():
        print(f"{stage} ...", end="\r", file=sys.stderr, flush=True)


class Line:
    """The line of a chunked stage; the context's end clears the redrawn line and prints the last one.

    Parameters
    ----------
    stage, unit : str
        Name of the stage; what is counted.
    total : int
        Items of the stage.
    """

    def __init__(self, stage: str, unit: str, total: int) -> None:
        self.stage, self.unit, self.total = stage, unit, total
        self.done = self.failed_items = 0
        self._start_time = time.perf_counter()
        bar = {"desc": stage, "unit": unit, "total": total, "bar_format": _BAR_FORMAT, "leave": False}
        self._bar = tqdm(**bar, disable=not sys.stderr.isatty())

    def advance(self, items: int, failed_items: int) -> None:
        """Count items as done, some of them without a result."""
        self.done += items
        self.failed_items += failed_items
        self._bar.set_postfix_str(f"{self.failed_items} failed", refresh=False)
        self._bar.update(items)

    def __enter__(self) -> "Line":
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._bar.close()
        seconds = time.perf_counter() - self._start_time
        end = ["stopped; finished chunks are kept"] if error else []
        say(
            self.stage, f"{self.done}/{self.total} {self.unit}", f"{seconds:.0f} s", f"{self.failed_items} failed", *end
        )


class Meter:
    """Seconds and peak resident memory of this process and its workers together, while the context is open."""

    INTERVAL = 0.5  # s; a look takes 1 ms, more where many processes run

    def __init__(self) -> None:
        self.peak_bytes = 0
        self._process = psutil.Process()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    @property
    def seconds(self) -> float:
        """Time since the context was entered."""
        return time.perf_counter() - self._start_time

    def __enter__(self) -> "Meter":
        self._start_time = time.perf_counter()
        self._look()
        self._thread.start()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._stop.set()
        self._thread.join()
        self._look()

    def _watch(self) -> None:
        while not self._stop.wait(self.INTERVAL):
            self._look()

    def _look(self) -> None:
        total = 0
        for process in [self._process, *self._process.children(recursive=True)]:
            try:
                total += process.memory_info().rss
            except psutil.Error:  # it ended while we looked
                continue
        self.peak_bytes = max(self.peak_bytes, total)
