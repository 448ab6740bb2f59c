"""One line a stage, redrawn on a terminal; a line for whoever waits; and the meter of time and memory."""

import sys
import threading
import time
from types import TracebackType

import psutil
from tqdm import tqdm

_BAR_FORMAT = "{desc}  {n_fmt}/{total_fmt} {unit} {bar:20} {elapsed_s:.0f} s, {remaining} left  {postfix}"


SILENCE = 5.0
"""Time without a line [s] after which a command prints that it is still running."""
ANNOUNCED = 10.0
"""Expected time [s] from which on a stage announces it."""


def say(stage: str, *parts: str) -> None:
    """Print a stage's line on the error stream, which leaves the output stream to answers."""
    print("  ".join([stage, *parts]), file=sys.stderr, flush=True)
    _current.last_line = time.perf_counter()


def announce(stage: str, expected_seconds: float | None = None) -> None:
    """Name the stage that begins: on a terminal until its line takes the place, elsewhere if it is expected to be long.

    Parameters
    ----------
    expected_seconds : by an earlier run or a calibrated cost; None if neither is known.
    """
    is_long = expected_seconds is not None and expected_seconds >= ANNOUNCED
    _current.begin(stage)
    if sys.stderr.isatty():
        print(f"{stage} ...", end="\r", file=sys.stderr, flush=True)
    elif is_long:
        say(stage, f"expected to take {expected_seconds:.0f} s")


class _Current:
    """What the command does at present, and since when."""

    def __init__(self) -> None:
        self.last_line = self.start = time.perf_counter()
        self.name = self.command = ""
        self.line: Line | None = None

    def begin(self, name: str, line: "Line | None" = None) -> None:
        """Note what begins; ``line`` counts its items."""
        self.name, self.line, self.start = name, line, time.perf_counter()


def resume_command() -> None:
    """Name the command again, whose stages have all run."""
    _current.begin(_current.command)


class Heartbeat:
    """While the context is open, a line whenever nothing was printed for `SILENCE`; a terminal redraws its line.

    Parameters
    ----------
    name : the command: what is done while no stage runs.
    silence : time without a line [s].
    """

    def __init__(self, name: str, silence: float = SILENCE) -> None:
        self.silence = silence
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        _current.command = name
        _current.begin(name)

    def __enter__(self) -> "Heartbeat":
        _current.last_line = time.perf_counter()
        self._thread.start()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._stop.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._stop.wait(max(0.1, _current.last_line + self.silence - time.perf_counter())):
            if time.perf_counter() - _current.last_line >= self.silence:
                _print_state()


def _print_state() -> None:
    """One line with what is running, how far it is, and for how long."""
    line, seconds = _current.line, time.perf_counter() - _current.start
    if line is not None and sys.stderr.isatty():
        line.redraw()
        return
    parts = [f"{seconds:.0f} s so far"]
    if line is not None:
        parts = [f"{line.done}/{line.total} {line.unit}", *parts, *line.remaining()]
    say(_current.name, *parts)


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
        _current.begin(stage, self)

    def redraw(self) -> None:
        """Draw the line of a terminal once more, with the time that has passed."""
        self._bar.refresh()
        _current.last_line = time.perf_counter()

    def remaining(self) -> list[str]:
        """Time that is left at the rate so far, as a text; none before the first items."""
        if not self.done:
            return []
        seconds = (time.perf_counter() - self._start_time) / self.done * (self.total - self.done)
        return [f"about {seconds:.0f} s left"]

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
        _current.begin(self.stage)
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


_current = _Current()
