"""The progress line and the meter."""

import io
import re
import sys
import time

import numpy as np
import pytest

from pipeline.engine.progress import Heartbeat, Line, Meter, announce, resume_command, say


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def advance() -> None:
    with Line("add", "samples", 40) as line:
        line.advance(30, 2)
        line.advance(10, 1)


def test_elsewhere_than_on_a_terminal_a_stage_is_one_plain_line(capsys: pytest.CaptureFixture) -> None:
    announce("add")
    advance()
    say("draw", "up to date")
    assert capsys.readouterr().err == "add  40/40 samples  0 s  3 failed\ndraw  up to date\n"


def test_on_a_terminal_the_line_is_redrawn_and_ends_as_the_plain_one(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    announce("add")
    advance()
    *earlier_lines, last_line = terminal.getvalue().rstrip("\n").split("\r")
    assert "add ..." in earlier_lines[0]
    assert any(re.match(r"add  0/40 samples", text) for text in earlier_lines)
    assert last_line == "add  40/40 samples  0 s  3 failed"


def test_an_error_says_how_far_it_came(capsys: pytest.CaptureFixture) -> None:
    def interrupted() -> None:
        with Line("add", "samples", 40) as line:
            line.advance(30, 2)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert capsys.readouterr().err == "add  30/40 samples  0 s  2 failed  stopped; finished chunks are kept\n"


def appears(capsys: pytest.CaptureFixture, pattern: str) -> bool:
    """Whether a line of the error stream matches within 20 s; a machine that is busy may take a while."""
    deadline = time.perf_counter() + 20.0
    while time.perf_counter() < deadline:
        if any(re.fullmatch(pattern, line) for line in capsys.readouterr().err.splitlines()):
            return True
        time.sleep(0.05)
    return False


def test_a_command_that_prints_nothing_for_a_while_says_what_it_does_and_how_far_it_is(
    capsys: pytest.CaptureFixture,
) -> None:
    with Heartbeat("bounds", silence=0.2):
        assert appears(capsys, r"bounds  \d+ s so far")
        with Line("add", "samples", 40) as line:
            line.advance(10, 0)
            assert appears(capsys, r"add  10/40 samples  \d+ s so far  about \d+ s left")
        resume_command()
        assert appears(capsys, r"bounds  \d+ s so far")


def test_what_is_left_takes_as_long_an_item_as_what_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    seconds = [100.0]
    monkeypatch.setattr(time, "perf_counter", lambda: seconds[0])
    with Line("add", "samples", 40) as line:
        assert line.remaining() == []
        line.advance(10, 0)
        seconds[0] += 20.0
        assert line.remaining() == ["about 60 s left"]


def test_a_command_that_prints_often_has_no_further_line(capsys: pytest.CaptureFixture) -> None:
    with Heartbeat("bounds", silence=0.5):
        for _ in range(4):
            time.sleep(0.15)
            say("draw", "up to date")
    assert capsys.readouterr().err == "draw  up to date\n" * 4


def test_a_long_stage_announces_its_time(capsys: pytest.CaptureFixture) -> None:
    announce("draw", 9.0)
    announce("add", 90.0)
    assert capsys.readouterr().err == "add  expected to take 90 s\n"


@pytest.mark.long
def test_meter_sees_a_peak_that_is_gone_at_the_end() -> None:
    with Meter() as meter:
        peak_before = meter.peak_bytes
        block = np.ones(25_000_000)
        time.sleep(2.5 * Meter.INTERVAL)
        del block
    assert meter.peak_bytes - peak_before > 150e6
    assert meter.seconds > 2 * Meter.INTERVAL
