"""One client's connection: bounded reading, bounded work, bounded writing; it never makes the loop wait."""

import asyncio
import fcntl
import os
import select
import socket
import sys
import termios
from typing import Protocol

from daemon import logs
from daemon.goals.errors import ProtocolError
from daemon.goals.lines import LineSplitter
from daemon.goals.protocol import encode_error
from daemon.goals.service import Caller
from daemon.goals.sockets import Operators, Peer

SOFT_LIMIT_BYTES = 64 * 1024
HARD_LIMIT_BYTES = 1024 * 1024
MAX_IN_FLIGHT = 32
PATIENCE_S = 5.0
LEFT_S = 2.0
GOODBYE_S = 0.1

log = logs.get("goals")


class Host(Protocol):
    """What a connection needs of the server."""

    operators: Operators
    buffer: memoryview

    def opened(self, session: "Session") -> ProtocolError | None:
        """Take the connection in, or say why not."""

    def closed(self, session: "Session") -> None:
        """The connection is gone."""

    def ready(self, session: "Session") -> None:
        """The connection has something to do: call its `work` soon."""

    def handle(self, session: "Session", line: bytes, *, past: bool) -> None:
        """Do what a line asks for; ``past``: it was sent before the daemon stood still."""

    def idle(self, session: "Session") -> bool:
        """Tell whether nothing more is to come for a client that sends no more."""


class Session(asyncio.BufferedProtocol):
    """A connection: lines in, replies and notifications out."""

    def __init__(self, host: Host, number: int, peer: Peer) -> None:
        self._host = host
        self._lines = LineSplitter()
        self._transport: asyncio.Transport | None = None
        self._loop = asyncio.get_running_loop()
        self._paused = False
        self._stuck_since_s: float | None = None
        self._ended = False
        self._hung_up = False
        self._closing = False
        self._gone_since_s: float | None = None
        self._rest: socket.socket | None = None
        self._past_bytes = 0
        self.caller = Caller(number, peer.pid, peer.uid, host.operators.include(peer))
        self.queued = False
        self.past_until_connected = False
        self.in_flight = 0
        self.goals_waiting = 0
        self.lost = 0
        self.rate_hz = 10.0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin, unless the host does not want to."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        transport.set_write_buffer_limits(high=SOFT_LIMIT_BYTES)
        if self.past_until_connected:
            self.stood_still()
        if (refusal := self._host.opened(self)) is not None:
            self.fail(refusal)

    def connection_lost(self, exc: Exception | None) -> None:
        """The client is gone; what it sent before, and a reply was too late for, is still to be done."""
        transport, self._transport = self._transport, None
        if self._closing or transport is None:
            self._host.closed(self)
            return
        self._rest = socket.socket(fileno=os.dup(transport.get_extra_info("socket").fileno()))
        self._ended = True
        self._stuck_since_s = None
        self._gone_since_s = self._gone_since_s or self._loop.time()
        self._host.ready(self)

    def get_buffer(self, sizehint: int) -> memoryview:
        """One buffer serves all connections: it is emptied in the same call."""
        return self._host.buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Keep what came, and read no more until it was this client's turn: the rest waits in its socket."""
        if self._closing or self._transport is None:
            return
        self._lines.feed(self._host.buffer[:nbytes])
        self._paused = True
        self._transport.pause_reading()
        self._host.ready(self)

    def eof_received(self) -> bool:
        """Do what is left to do; go on answering a client that only sends no more."""
        self._ended = True
        self._hung_up = self._peer_closed()
        self._lines.finish()
        self._host.ready(self)
        return True

    def pause_writing(self) -> None:
        """Take no more requests of a client that does not read."""
        self._stuck_since_s = self._loop.time()

    def resume_writing(self) -> None:
        """Go on."""
        self._stuck_since_s = None
        self._host.ready(self)

    def _peer_closed(self) -> bool:
        """Tell a client that closed from one that shut down its sending side only (POLLHUP, poll(2))."""
        if self._gone_since_s is None and self._transport is not None:
            poll = select.poll()
            poll.register(self._transport.get_extra_info("socket").fileno(), 0)
            if any(event & select.POLLHUP for _, event in poll.poll(0)):
                self._gone_since_s = self._loop.time()
        return self._transport is None or self._gone_since_s is not None

    def work(self) -> bool:
        """Do one line, or read on; tell whether anything was done."""
        if self._closing or self.in_flight >= MAX_IN_FLIGHT or self._stuck_since_s is not None:
            return False
        held = self._lines.held
        try:
            line = self._lines.take()
        except ProtocolError as error:
            self.fail(error)
            return True
        past = self._past_bytes > 0
        self._past_bytes = max(0, self._past_bytes - (held - self._lines.held))
        if line:
            self._host.handle(self, line, past=past)
        if self._lines.ready:
            self._host.ready(self)
            return True
        return self._read_on() or line is not None

    def _read_on(self) -> bool:
        if self._rest is not None:
            return self._read_rest(self._rest)
        if self._hung_up or (self._ended and self._host.idle(self)):
            self.close()
        elif self._paused and self._transport is not None:
            self._paused = False
            self._transport.resume_reading()
            return True
        return False

    def _read_rest(self, rest: socket.socket) -> bool:
        """Take the next piece of what a client that is gone has left in its socket."""
        try:
            left = rest.recv(len(self._host.buffer))
        except OSError:
            left = b""
        self._lines.feed(left)
        if not left:
            self._lines.finish()
            self._hung_up = True
            self._rest = None
            rest.close()
        self._host.ready(self)
        return True

    def stood_still(self) -> None:
        """All that has come and was not begun is of before a standstill of the daemon's."""
        self._past_bytes = self._lines.held + self._unread_bytes()

    def _unread_bytes(self) -> int:
        sock = self._rest if self._transport is None else self._transport.get_extra_info("socket")
        if sock is None or sock.fileno() < 0:
            return 0
        return int.from_bytes(fcntl.ioctl(sock.fileno(), termios.FIONREAD, bytes(4)), sys.byteorder)

    def started(self) -> None:
        """A request of this client runs."""
        self.in_flight += 1

    def finished(self) -> None:
        """A request of this client was answered."""
        self.in_flight -= 1
        if self._paused or self._ended:
            self._host.ready(self)

    def send(self, line: bytes, *, essential: bool) -> None:
        """Write a line; a client that does not read loses what is not essential, and then its connection."""
        transport = self._transport
        if transport is None or self._closing or self._hung_up or self._peer_closed():
            return  # a write would fail, and end the reading of what the client sent before it closed
        waiting = transport.get_write_buffer_size()
        if waiting > SOFT_LIMIT_BYTES and not essential:
            self.lost += 1
        elif waiting > HARD_LIMIT_BYTES:
            self._cut_off()
        else:
            transport.write(line)

    def fail(self, error: ProtocolError) -> None:
        """Answer with an error and close, a little later: a client that is about to write would not read it."""
        self.send(encode_error(None, error), essential=True)
        self._closing = True
        if self._transport is not None:
            self._transport.pause_reading()
            self._transport.write_eof()
        self._loop.call_later(GOODBYE_S, self.close)

    def close(self) -> None:
        """Close when what was written has gone out."""
        self._closing = True
        if self._transport is not None:
            self._stuck_since_s = self._stuck_since_s or self._loop.time()
            self._transport.close()
        else:
            self._leave()

    def check(self) -> None:
        """Cut the client off if it has not been reading, or has been gone, for too long: requests must not be stale."""
        now_s = self._loop.time()
        if self._stuck_since_s is not None and now_s - self._stuck_since_s > PATIENCE_S:
            self._cut_off()
        elif self._peer_closed() and self._gone_since_s is not None and now_s - self._gone_since_s > LEFT_S:
            log.warning("client_left_requests", pid=self.caller.pid, uid=self.caller.uid)
            self.abort()
        elif self._ended:
            self._hung_up = self._peer_closed()
            self._host.ready(self)

    def _cut_off(self) -> None:
        log.warning("client_cut_off", pid=self.caller.pid, uid=self.caller.uid, lost=self.lost)
        self.abort()

    def abort(self) -> None:
        """Close at once."""
        self._closing = True
        if self._transport is not None:
            self._transport.abort()
        else:
            self._leave()

    def _leave(self) -> None:
        if self._rest is not None:
            self._rest.close()
        self._host.closed(self)
