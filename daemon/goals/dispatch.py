"""From a line to its reply: calls the service, counts what runs, turns errors into replies."""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from daemon import logs
from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.hub import TOPICS, Hub, event_payload
from daemon.goals.methods import (
    METHODS,
    PROTOCOL_VERSION,
    GoalCancel,
    GoalSubmit,
    GoalUpdate,
    Subscribe,
    Unsubscribe,
)
from daemon.goals.protocol import (
    Call,
    Refusal,
    encode_batch,
    encode_error,
    encode_notification,
    encode_result,
    interpret,
    parse,
)
from daemon.goals.results import Subscription, SystemInfo
from daemon.goals.service import Caller, FlightService
from daemon.goals.session import Session
from daemon.goals.turns import Turnstile

log = logs.get("goals")

MAX_BATCHES = 64
MAX_GOALS_WAITING = 64
LONG_S = 0.001
REST = 3.0
BUSY = "too many of these wait to be done; try again when some are"
RELEASED = "the vehicle was released while the {} waited"
STOOD_STILL = "the daemon stood still while the {} waited; ask again"
TAKING = frozenset({"vehicle.arm", "vehicle.takeoff", "vehicle.engage"})
RELEASING = frozenset({"vehicle.hold", "vehicle.land", "vehicle.return"})
INTERNAL = "something went wrong inside the daemon; its log says what"


@dataclass(slots=True)
class _Sent:
    """When a line was sent: after so many ``releases`` of the vehicle, those that it asks for itself included.

    What waits for its turn must not take back a vehicle that somebody gave away after that, nor move one after more
    ``standstills`` of the daemon: who sent it has given up by then, and may stand beside the vehicle.
    """

    releases: int
    standstills: int


class Dispatcher:
    """Does what lines ask for; each message of a batch waits for a turn of its caller's."""

    def __init__(self, service: FlightService, hub: Hub, turn: Callable[[Caller], Awaitable[None]]) -> None:
        self._service = service
        self._hub = hub
        self._turn = turn
        self._tasks: set[asyncio.Task[None]] = set()
        self._turnstile = Turnstile()
        self._batches = 0

    def handle(self, session: Session, line: bytes, *, past: bool = False) -> None:
        """Start what a line asks for; the reply follows when it is done. ``past``: sent before the last standstill."""
        standstills = self._service.standstills - past
        try:
            messages, batch = parse(line)
        except ProtocolError as error:
            session.send(encode_error(None, error), essential=True)
            return
        if batch and self._batches >= MAX_BATCHES:
            session.send(encode_error(None, ProtocolError(ErrorCode.WRONG_STATE, BUSY)), essential=True)
            return
        if batch:
            self._start(session, self._answer_batch(session, messages, standstills))
            return
        item = interpret(messages[0], operator=session.caller.operator)
        if isinstance(item, Call) and not item.method.notification:
            self._start(session, self._answer(session, item, standstills))
        elif (reply := self._answer_now(session, item, standstills)) is not None:
            session.send(reply, essential=True)

    async def stop(self) -> None:
        """Cancel what still runs."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _start(self, session: Session, work: Coroutine[Any, Any, None]) -> None:
        session.started()
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)

        def done(task: asyncio.Task[None]) -> None:
            self._tasks.discard(task)
            session.finished()

        task.add_done_callback(done)

    def _answer_now(self, session: Session, item: Call | Refusal, standstills: int) -> bytes | None:
        """Reply to what needs no task: a refusal, or a notification (None: reported as an event if it failed)."""
        if isinstance(item, Call):
            error, goal_id = self._notify(session, item, standstills), getattr(item.params, "goal_id", None)
        elif item.reply:
            return encode_error(item.id, item.error)
        else:
            error, goal_id = item.error, item.goal_id
        if error is not None:
            payload = event_payload("refused", str(error), goal_id, error.field, error=int(error.code))
            session.send(encode_notification("telemetry.events", payload), essential=False)
        return None

    def _notify(self, session: Session, call: Call, standstills: int) -> ProtocolError | None:
        try:
            self._require_no_standstill(standstills, "notification")
            getattr(self._service, call.method.name.replace(".", "_"))(call.params, session.caller)
        except ProtocolError as error:
            return error
        except Exception:
            log.exception("request_failed", method=call.method.name)
            return ProtocolError(ErrorCode.INTERNAL, INTERNAL)
        return None

    async def _answer(self, session: Session, call: Call, standstills: int) -> None:
        reply, goal_id = await self._call(session, call, _Sent(self._service.releases, standstills))
        session.send(reply, essential=True)
        if goal_id is not None:
            self._hub.goal_answered(goal_id)

    async def _answer_batch(self, session: Session, messages: list[Any], standstills: int) -> None:
        self._batches += 1
        try:
            replies, goal_ids = await self._replies(session, messages, _Sent(self._service.releases, standstills))
        finally:
            self._batches -= 1
        if replies:
            session.send(encode_batch(replies), essential=True)
        for goal_id in goal_ids:
            self._hub.goal_answered(goal_id)

    async def _replies(self, session: Session, messages: list[Any], sent: _Sent) -> tuple[list[bytes], list[str]]:
        """Replies to the messages of a batch, and the ids of the goals that it submitted."""
        replies: list[bytes] = []
        goal_ids: list[str] = []
        for message in messages:
            await self._turn(session.caller)
            item = interpret(message, operator=session.caller.operator)
            if isinstance(item, Call) and not item.method.notification:
                reply, goal_id = await self._call(session, item, sent)
                replies.append(reply)
                goal_ids += [goal_id] if goal_id is not None else []
            elif (refusal := self._answer_now(session, item, sent.standstills)) is not None:
                replies.append(refusal)
        return replies, goal_ids

    async def _call(self, session: Session, call: Call, sent: _Sent) -> tuple[bytes, str | None]:
        """Reply of one request, and the id of the goal that it submitted."""
        goal_id = self._hub.new_goal(session) if isinstance(call.params, GoalSubmit) else None
        try:
            return encode_result(call.id, await self._result(session, call, goal_id, sent)), goal_id
        except ProtocolError as error:  # not kept in a name that outlives it: that would be a cycle, garbage
            reply = encode_error(call.id, error)
        except Exception:
            log.exception("request_failed", method=call.method.name)
            reply = encode_error(call.id, ProtocolError(ErrorCode.INTERNAL, INTERNAL))
        if goal_id is not None:
            self._hub.goal_refused(goal_id)
        return reply, None

    async def _result(self, session: Session, call: Call, goal_id: str | None, sent: _Sent) -> Mapping[str, Any]:
        caller = session.caller
        if call.method.name == "system.info":
            return self._info()
        if isinstance(call.params, Subscribe):
            session.rate_hz = call.params.rate_hz
            topics = self._hub.subscribe(session, list(call.params.topics), call.params.rate_hz)
            return Subscription(topics=topics, rate_hz=session.rate_hz)
        if isinstance(call.params, Unsubscribe):
            topics = self._hub.unsubscribe(session, list(call.params.topics or TOPICS))
            return Subscription(topics=topics, rate_hz=session.rate_hz)
        if isinstance(call.params, GoalSubmit) and goal_id is not None:
            return await self._in_order(session, partial(self._submit, call.params, caller, goal_id, sent))
        do: Callable[..., Awaitable[Mapping[str, Any]]] = getattr(self._service, call.method.name.replace(".", "_"))
        # A cancel comes after what its own client asked for before it, but waits for nobody else's goals.
        if isinstance(call.params, GoalUpdate) or (isinstance(call.params, GoalCancel) and session.goals_waiting):
            return await self._in_order(session, partial(do, call.params, caller))
        return await self._do(partial(do, call.params, caller), call.method.name, sent)

    async def _do(
        self, work: Callable[[], Awaitable[Mapping[str, Any]]], method: str, sent: _Sent
    ) -> Mapping[str, Any]:
        if method in TAKING:
            self._require_sent_after(sent, "request")
        kept = self._service.releases == sent.releases
        result = await work()
        if kept and method in RELEASING:  # and nobody else's was newer, or it would not be done
            sent.releases = self._service.releases
        return result

    async def _submit(self, params: GoalSubmit, caller: Caller, goal_id: str, sent: _Sent) -> Mapping[str, Any]:
        self._require_sent_after(sent, "goal")
        return await self._service.goal_submit(params, caller, goal_id)

    def _require_sent_after(self, sent: _Sent, what: str) -> None:
        """Refuse what would take the vehicle and is older than its last release, or the last standstill."""
        self._require_no_standstill(sent.standstills, what)
        if self._service.releases != sent.releases:
            raise ProtocolError(ErrorCode.WRONG_STATE, RELEASED.format(what))

    def _require_no_standstill(self, standstills: int, what: str) -> None:
        if self._service.standstills != standstills:
            raise ProtocolError(ErrorCode.WRONG_STATE, STOOD_STILL.format(what))

    async def _in_order(self, session: Session, work: Callable[[], Awaitable[Mapping[str, Any]]]) -> Mapping[str, Any]:
        """One goal at a time: the last to come is the last to be flown, and few are checked in threads at once."""
        loop, caller = asyncio.get_running_loop(), session.caller
        if self._turnstile.count(caller.uid, caller.pid) >= MAX_GOALS_WAITING:
            raise ProtocolError(ErrorCode.WRONG_STATE, BUSY)
        session.goals_waiting += 1
        try:
            await self._turnstile.enter(caller.uid, caller.pid)
        except asyncio.CancelledError:
            session.goals_waiting -= 1
            raise
        begun_s = loop.time()
        try:
            return await work()
        finally:
            session.goals_waiting -= 1
            if (took_s := loop.time() - begun_s) > LONG_S:  # in a thread, which takes its time from the loop's
                loop.call_later(REST * took_s, self._turnstile.leave)
            else:
                self._turnstile.leave()

    def _info(self) -> SystemInfo:
        identity = self._service.identity()
        return {
            "name": "flightd",
            "version": product_version(),
            "protocol": PROTOCOL_VERSION,
            "config_hash": identity.config_hash,
            "uptime_s": identity.uptime_s,
            "methods": list(METHODS),
        }


def product_version() -> str:
    """Version of the installed distribution."""
    try:
        return version("flightd")
    except PackageNotFoundError:
        return "unknown"
