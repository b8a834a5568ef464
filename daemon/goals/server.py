"""The goal socket's server: takes connections in and shares the loop's time among them."""

import asyncio
import socket
from collections import deque
from contextlib import suppress
from functools import partial

import structlog

from daemon.goals.dispatch import Dispatcher
from daemon.goals.hub import Hub
from daemon.goals.service import FlightService
from daemon.goals.session import Session
from daemon.goals.sockets import Listener, Operators, peer_of

MAX_CLIENTS = 1000
BUFFER_BYTES = 16384
ACCEPTS_PER_PASS = 4
VISITS_PER_TURN = 32
PAUSE_S = 0.001
CHECK_PERIOD_S = 1.0
GOODBYE_S = 0.2

log = structlog.get_logger(__name__)


class GoalServer:
    """Serves the goal protocol on a listening socket.

    One line is done every ``PAUSE_S``, of each client in turn: a flood waits in the sockets of those who send it, and
    the daemon's own tasks keep the processor and are never late by more than a request.
    """

    def __init__(self, service: FlightService, hub: Hub, operators: Operators) -> None:
        self.operators = operators
        self.buffer = memoryview(bytearray(BUFFER_BYTES))
        self._hub = hub
        self._dispatcher = Dispatcher(service, hub)
        self._sessions: set[Session] = set()
        self._ready: deque[Session] = deque()
        self._turn: asyncio.Handle | None = None
        self._check: asyncio.TimerHandle | None = None
        self._empty = asyncio.Event()
        self._count = 0
        self._accepting: set[asyncio.Task[object]] = set()
        self._listener: Listener | None = None

    async def start(self, listener: Listener) -> None:
        """Begin to serve."""
        loop = asyncio.get_running_loop()
        self._listener = listener
        loop.add_reader(listener.sock, self._accept)
        self._check = loop.call_later(CHECK_PERIOD_S, self._check_clients)
        log.info("socket_listens", path=str(listener.path))

    async def stop(self) -> None:
        """Stop taking connections, end what runs, say goodbye within ``GOODBYE_S``, remove the socket."""
        for handle in (self._check, self._turn):
            if handle is not None:
                handle.cancel()
        if self._listener is not None:
            asyncio.get_running_loop().remove_reader(self._listener.sock)
            self._listener.close()
        await self._dispatcher.stop()
        for session in list(self._sessions):
            session.close()
        if self._sessions:
            with suppress(TimeoutError):
                await asyncio.wait_for(self._empty.wait(), GOODBYE_S)
        for session in list(self._sessions):
            session.abort()

    def opened(self, session: Session) -> bool:
        """Take the connection in, or refuse it because there are too many."""
        self._sessions.add(session)
        self._empty.clear()
        return len(self._sessions) <= MAX_CLIENTS

    def closed(self, session: Session) -> None:
        """The connection is gone."""
        self._sessions.discard(session)
        self._hub.forget(session)
        if not self._sessions:
            self._empty.set()

    def ready(self, session: Session) -> None:
        """Let the connection work when its turn comes."""
        if session.queued:
            return
        session.queued = True
        self._ready.append(session)
        if self._turn is None:
            self._turn = asyncio.get_running_loop().call_soon(self._take_turns)

    def handle(self, session: Session, line: bytes) -> None:
        """Do what a line asks for."""
        self._dispatcher.handle(session, line)

    def idle(self, session: Session) -> bool:
        """Tell whether nothing more is to come for a client that sends no more."""
        return session.in_flight == 0 and not self._hub.topics_of(session) and not self._hub.owns_goal(session)

    def _accept(self) -> None:
        """Take a few connections in; asyncio's own server would take all that wait, in one pass of the loop."""
        loop = asyncio.get_running_loop()
        for _ in range(ACCEPTS_PER_PASS):
            sock = self._next_connection()
            if sock is None:
                return
            self._count += 1
            session = Session(self, self._count, peer_of(sock))
            task = loop.create_task(loop.connect_accepted_socket(partial(_same, session), sock))
            self._accepting.add(task)
            task.add_done_callback(self._accepting.discard)

    def _next_connection(self) -> socket.socket | None:
        assert self._listener is not None
        try:
            return self._listener.sock.accept()[0]
        except (BlockingIOError, InterruptedError, ConnectionAbortedError):
            return None
        except OSError as error:  # no descriptor left: try again when some may have been closed
            log.error("accept_failed", reason=str(error))
            loop = asyncio.get_running_loop()
            loop.remove_reader(self._listener.sock)
            loop.call_later(CHECK_PERIOD_S, self._accept_again)
            return None

    def _accept_again(self) -> None:
        if self._listener is not None and self._listener.sock.fileno() >= 0:
            asyncio.get_running_loop().add_reader(self._listener.sock, self._accept)

    def _take_turns(self) -> None:
        did = False
        for _ in range(VISITS_PER_TURN):
            if did or not self._ready:
                break
            session = self._ready.popleft()
            session.queued = False
            did = session.work()
            if did:
                self.ready(session)
        loop = asyncio.get_running_loop()
        if did:
            self._turn = loop.call_later(PAUSE_S, self._take_turns)
        else:
            self._turn = loop.call_soon(self._take_turns) if self._ready else None

    def _check_clients(self) -> None:
        for session in list(self._sessions):
            session.check()
        self._check = asyncio.get_running_loop().call_later(CHECK_PERIOD_S, self._check_clients)


def _same(session: Session) -> Session:
    return session
