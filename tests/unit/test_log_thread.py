"""Standard error by a thread: writers never wait, order is kept, what is lost is counted, the end is written."""

import fcntl
import os
import sys
from collections.abc import Iterator

import pytest

from daemon.log_thread import Beside, stderr_beside

PAGE = 4096


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    """Read and write end of a pipe that holds one page."""
    ends = os.pipe()
    fcntl.fcntl(ends[1], fcntl.F_SETPIPE_SZ, PAGE)
    yield ends
    for end in ends:
        os.close(end)


def test_what_was_taken_is_written_in_order_before_the_end(pipe: tuple[int, int]) -> None:
    beside = Beside(pipe[1], lambda _lost: None)
    for i in range(100):
        beside.write(f"{i}\n")
    beside.finish()
    assert os.read(pipe[0], PAGE).decode().split() == [str(i) for i in range(100)]


@pytest.mark.parametrize("blocking", [True, False])
def test_a_reader_that_stops_costs_nobody_time_and_the_lines_that_found_no_room_are_counted(
    pipe: tuple[int, int], blocking: bool
) -> None:
    told: list[int] = []
    os.set_blocking(pipe[1], blocking)
    beside = Beside(pipe[1], told.append, backlog=10)
    for i in range(200):
        beside.write(f"{i:03d}" + "x" * 996 + "\n")
    assert beside.lost >= 200 - 10 - 5, "one page is in the pipe, one line in the thread, ten wait"
    lost = beside.lost
    assert told == []
    text = b""
    while text.count(b"\n") < 200 - lost:
        text += os.read(pipe[0], PAGE)
    beside.write("after\n")
    beside.finish()
    numbers = [int(line[:3]) for line in text.splitlines()]
    assert numbers == list(range(200 - lost))
    assert told == [lost]
    assert os.read(pipe[0], PAGE) == b"after\n"


def test_an_end_does_not_wait_for_a_reader_for_ever(pipe: tuple[int, int]) -> None:
    beside = Beside(pipe[1], lambda _lost: None)
    beside.write("x" * 3 * PAGE)
    beside.finish(timeout_s=0.05)
    assert len(os.read(pipe[0], 3 * PAGE)) == PAGE
    os.read(pipe[0], 3 * PAGE)
    os.read(pipe[0], 3 * PAGE)


def test_a_reader_that_went_away_raises_nothing(pipe: tuple[int, int]) -> None:
    gone = os.pipe()
    os.close(gone[0])
    beside = Beside(gone[1], lambda _lost: None)
    beside.write("nobody reads this\n")
    beside.write("nor this\n")
    beside.finish()
    os.close(gone[1])


def test_all_of_standard_error_goes_this_way_and_comes_back(pipe: tuple[int, int]) -> None:
    class Stream:
        def fileno(self) -> int:
            return pipe[1]

        def flush(self) -> None:
            pass

    before = sys.stderr
    sys.stderr = Stream()
    try:
        stream = sys.stderr
        with stderr_beside(lambda _lost: None):
            print("a complaint", file=sys.stderr)
            assert sys.stderr.isatty() is False
        assert sys.stderr is stream
    finally:
        sys.stderr = before
    assert os.read(pipe[0], PAGE) == b"a complaint\n"


def test_without_a_file_behind_it_standard_error_stays_as_it_is() -> None:
    before, sys.stderr = sys.stderr, None
    try:
        with stderr_beside(lambda _lost: None):
            assert sys.stderr is None
    finally:
        sys.stderr = before
