"""The goal socket's server: takes connections in and shares the loop's time among them."""

import asyncio
import resource
import select
import socket
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from daemon import logs
from daemon.goals.dispatch import Dispatcher
from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.hub import Hub
from daemon.goals.service import Caller, FlightService
from daemon.goals.session import Session
from daemon.goals.sockets import BACKLOG, Listener, Operators, peer_of
from daemon.goals.turns import Turns

MAX_CLIENTS = 1000
KEPT_FOR_OPERATORS = 100
KEPT_DESCRIPTORS = 128
BUFFER_BYTES = 16384
VISITS = 32
CHECK_PERIOD_S = 1.0
GOODBYE_S = 0.2

log = logs.get("goals")


def most_clients() -> int:
    """How many connections there may be: the daemon itself needs some of the descriptors that it may have."""
    descriptors, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if descriptors == resource.RLIM_INFINITY:
        return MAX_CLIENTS
    return max(0, min(MAX_CLIENTS, descriptors - KEPT_DESCRIPTORS))


class GoalServer:
    """Serves the goal protocol on a listening socket.

    What clients ask for is done line by line in the hub's slack, users, their processes and connections in turn: a
    flood waits in the sockets of those who send it, and keeps neither the daemon's own tasks nor other clients from
    their work. ``look`` is called before anything is done: it calls ``stood_still`` when the daemon did.
    """

    def __init__(
        self, service: FlightService, hub: Hub, operators: Operators, look: Callable[[], None] = lambda: None
    ) -> None:
        self._look = look
        self.operators = operators
        self.buffer = memoryview(bytearray(BUFFER_BYTES))
        self._hub = hub
        self._dispatcher = Dispatcher(service, hub, self._turn)
        self._sessions: set[Session] = set()
        self._turns: Turns[Callable[[], bool]] = Turns(newcomers_first=True)
        self._most_clients = most_clients()
        self._check: asyncio.TimerHandle | None = None
        self._empty = asyncio.Event()
        self._count = 0
        self._accepting: set[asyncio.Task[object]] = set()
        self._past_connections = 0
        self._listener: Listener | None = None

    async def start(self, listener: Listener) -> None:
        """Begin to serve."""
        self._listener = listener
        self._await_connection()
        self._check = asyncio.get_running_loop().call_later(CHECK_PERIOD_S, self._check_clients)
        log.info("socket_listens", path=str(listener.path), most_clients=self._most_clients)

    async def stop(self) -> None:
        """Stop taking connections, end what runs, say goodbye within ``GOODBYE_S``, remove the socket."""
        if self._check is not None:
            self._check.cancel()
        if self._listener is not None:
            asyncio.get_running_loop().remove_reader(self._listener.sock)
            self._listener.close()
        await self._dispatcher.stop()
        self._hub.flush()
        for session in list(self._sessions):
            session.close()
        if self._sessions:
            with suppress(TimeoutError):
                await asyncio.wait_for(self._empty.wait(), GOODBYE_S)
        for session in list(self._sessions):
            session.abort()

    def stood_still(self) -> None:
        """What waits in the sockets now was sent before or while the daemon stood still."""
        for session in self._sessions:
            session.stood_still()
        self._past_connections = BACKLOG if self._somebody_knocks() else 0

    def _somebody_knocks(self) -> bool:
        if self._listener is None or self._listener.sock.fileno() < 0:
            return False
        poll = select.poll()
        poll.register(self._listener.sock.fileno(), select.POLLIN)
        return bool(poll.poll(0))

    def opened(self, session: Session) -> ProtocolError | None:
        """Take the connection in, or say why not; some are kept for those who act."""
        kept = 0 if session.caller.operator else KEPT_FOR_OPERATORS
        most = max(0, self._most_clients - kept)
        if len(self._sessions) < most:
            self._sessions.add(session)
            self._empty.clear()
            return None
        reason = f"too many connections: {most} are open already; close some and try again"
        return ProtocolError(ErrorCode.WRONG_STATE, reason)

    def closed(self, session: Session) -> None:
        """The connection is gone."""
        self._sessions.discard(session)
        self._hub.forget(session)
        if not self._sessions:
            self._empty.set()

    def ready(self, session: Session) -> None:
        """Let the connection work when its turn comes."""
        if not session.queued:
            session.queued = True
            self._put(session.caller, partial(_visit, session))

    def handle(self, session: Session, line: bytes, *, past: bool) -> None:
        """Do what a line asks for."""
        self._dispatcher.handle(session, line, past=past)

    def idle(self, session: Session) -> bool:
        """Tell whether nothing more is to come for a client that sends no more."""
        return session.in_flight == 0 and not self._hub.topics_of(session) and not self._hub.owns_goal(session)

    def _put(self, caller: Caller, piece: Callable[[], bool]) -> None:
        self._turns.put(caller.uid, caller.pid, piece)
        self._hub.slack.want(self._serve)

    def _serve(self) -> bool:
        """Do a piece of what clients asked for; after a standstill this may come before the control task's tick."""
        self._look()
        try:
            for _ in range(VISITS):
                if not self._turns:
                    return False
                if self._turns.take()():
                    break
        finally:  # what a piece raises strands nobody else's
            if self._turns:
                self._hub.slack.want(self._serve)
        return True

    async def _turn(self, caller: Caller) -> None:
        """Wait for a turn of this caller's."""
        come: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._put(caller, partial(_grant, come))
        await come

    def _await_connection(self) -> None:
        if self._listener is not None and self._listener.sock.fileno() >= 0:
            asyncio.get_running_loop().add_reader(self._listener.sock, self._knock)

    def _knock(self) -> None:
        """Somebody connects: asyncio's own server would take all that wait, in one pass of the loop."""
        assert self._listener is not None
        asyncio.get_running_loop().remove_reader(self._listener.sock)
        self._hub.slack.want(self._accept)

    def _accept(self) -> bool:
        """Take one connection in."""
        loop = asyncio.get_running_loop()
        try:
            sock = self._next_connection()
        except OSError as error:  # no descriptor left: try again when some may have been closed
            log.error("accept_failed", reason=str(error))
            loop.call_later(CHECK_PERIOD_S, self._await_connection)
            return True
        if sock is None:
            self._past_connections = 0
            self._await_connection()
            return False
        self._hub.slack.want(self._accept)
        self._count += 1
        try:
            session = Session(self, self._count, peer_of(sock))
        except OSError as error:
            log.error("accept_failed", reason=str(error))
            sock.close()
            return True
        if self._past_connections:
            self._past_connections -= 1
            session.past_until_connected = True
        task = loop.create_task(loop.connect_accepted_socket(partial(_same, session), sock))
        self._accepting.add(task)
        task.add_done_callback(self._accepting.discard)
        return True

    def _next_connection(self) -> socket.socket | None:
        if self._listener is None or self._listener.sock.fileno() < 0:
            return None
        try:
            return self._listener.sock.accept()[0]
        except (BlockingIOError, InterruptedError, ConnectionAbortedError):
            return None

    def _check_clients(self) -> None:
        for session in list(self._sessions):
            session.check()
        self._check = asyncio.get_running_loop().call_later(CHECK_PERIOD_S, self._check_clients)


def _same(session: Session) -> Session:
    return session


def _visit(session: Session) -> bool:
    session.queued = False
    return session.work()


def _grant(come: "asyncio.Future[None]") -> bool:
    if come.done():
        return False
    come.set_result(None)
    return True
