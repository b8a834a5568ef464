"""Who hears what: goals' feedback and results to the connection that submitted them, telemetry to subscribers.

Nothing here waits for a client; telemetry goes out in pieces of at most ``SENDS_PER_PIECE`` sends, in the loop's slack.
"""

import asyncio
import secrets
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from daemon.goals.protocol import encode_notification
from daemon.goals.results import EventTelemetry, GoalFeedback, GoalRecord, ResetReport
from daemon.goals.slack import Slack

SENDS_PER_PIECE = 32
MAX_JOBS = 1000
NEVER_S = float("inf")
SLACK_S = 0.002
TOPICS = ("state", "reference", "setpoint", "goal", "plan", "health", "loops", "events")
UNTHINNED = ("events",)


class Subscriber(Protocol):
    """A connection as the hub sees it."""

    def send(self, line: bytes, *, essential: bool) -> None:
        """Send a line, or drop it if it is not essential and the client does not read."""


@dataclass(slots=True)
class _Gate:
    """Lets a topic through to one subscriber at its rate."""

    period_s: float
    due_s: float = -NEVER_S

    def opens(self, now_s: float) -> bool:
        if now_s < self.due_s - SLACK_S:
            return False
        self.due_s = max(self.due_s + self.period_s, now_s + self.period_s / 2)
        return True


@dataclass(slots=True)
class _Goal:
    """An accepted goal that has not ended, or whose submission has not been answered yet."""

    owner: Subscriber
    answered: bool = False
    result: bytes | None = None


@dataclass(slots=True)
class _Job:
    """One payload on its way to the subscribers of a topic."""

    topic: str
    line: bytes
    targets: Iterator[Subscriber]
    thinned: bool
    essential: bool
    skip: Subscriber | None


class Hub:
    """Publishes to clients. Made by the composition root, used by one event loop; the server uses its ``slack`` too."""

    def __init__(self, prefix: str | None = None, slack: Slack | None = None) -> None:
        self.slack = slack or Slack()
        self._prefix = prefix or secrets.token_hex(3)
        self._count = 0
        self._goals: dict[str, _Goal] = {}
        self._gates: dict[str, dict[Subscriber, _Gate]] = {topic: {} for topic in TOPICS}
        self._due_s: dict[str, float] = dict.fromkeys(TOPICS, NEVER_S)
        self._jobs: deque[_Job] = deque()
        self.lost_jobs = 0

    # -- used by the daemon

    def wants(self, topic: str) -> bool:
        """Tell whether somebody is due to get ``topic`` now; if not, the payload need not be made."""
        due_s = self._due_s[topic]
        return due_s != NEVER_S and asyncio.get_running_loop().time() >= due_s - SLACK_S

    def publish(self, topic: str, payload: Mapping[str, Any]) -> None:
        """Send ``telemetry.<topic>`` to its subscribers, thinned to their rates (events go to all)."""
        if not self._gates[topic] or not (topic in UNTHINNED or self.wants(topic)):
            return
        thinned = topic not in UNTHINNED
        self._put(topic, encode_notification(f"telemetry.{topic}", payload), thinned=thinned, essential=not thinned)

    def event(
        self,
        code: str,
        text: str,
        goal_id: str | None = None,
        field: str | None = None,
        reset: ResetReport | None = None,
    ) -> None:
        """Publish something that happened."""
        if self._gates["events"]:
            self.publish("events", event_payload(code, text, goal_id, field, reset))

    def goal_feedback(self, feedback: GoalFeedback) -> None:
        """Send feedback to the connection that submitted the goal and to the subscribers of ``goal``."""
        goal = self._goals.get(feedback["goal_id"])
        owner = goal.owner if goal is not None else None
        if goal is None and not self.wants("goal"):
            return
        line = encode_notification("goal.feedback", feedback)
        if goal is not None and goal.answered:
            goal.owner.send(line, essential=False)
        if self.wants("goal"):
            self._put("goal", line, thinned=True, essential=False, skip=owner)

    def goal_result(self, record: GoalRecord) -> None:
        """Send the result, once for each accepted goal, to the connection that submitted it and to subscribers."""
        line = encode_notification("goal.result", record)
        goal = self._goals.get(record["goal_id"])
        if goal is not None and goal.answered:
            del self._goals[record["goal_id"]]
            goal.owner.send(line, essential=True)
        elif goal is not None:
            goal.result = line
        if self._gates["goal"]:
            self._put("goal", line, thinned=False, essential=True, skip=goal.owner if goal is not None else None)

    # -- used by the server

    def new_goal(self, owner: Subscriber) -> str:
        """Make an id for a goal that ``owner`` submits."""
        self._count += 1
        goal_id = f"{self._prefix}-{self._count}"
        self._goals[goal_id] = _Goal(owner)
        return goal_id

    def goal_refused(self, goal_id: str) -> None:
        """Forget a goal that was not accepted."""
        self._goals.pop(goal_id, None)

    def goal_answered(self, goal_id: str) -> None:
        """The reply that tells of the goal was sent: its notifications may follow."""
        goal = self._goals.get(goal_id)
        if goal is None:
            return
        goal.answered = True
        if goal.result is not None:
            del self._goals[goal_id]
            goal.owner.send(goal.result, essential=True)

    def owns_goal(self, subscriber: Subscriber) -> bool:
        """Tell whether a goal that this connection submitted is still to end."""
        return any(goal.owner is subscriber for goal in self._goals.values())

    def subscribe(self, subscriber: Subscriber, topics: list[str], rate_hz: float) -> list[str]:
        """Add topics at a rate; returns all that the connection gets."""
        for topic in topics:
            self._gates[topic][subscriber] = _Gate(1.0 / rate_hz)
            self._due_s[topic] = -NEVER_S
        return self.topics_of(subscriber)

    def unsubscribe(self, subscriber: Subscriber, topics: list[str]) -> list[str]:
        """Remove topics; returns all that the connection still gets."""
        for topic in topics:
            if self._gates[topic].pop(subscriber, None) is not None and not self._gates[topic]:
                self._due_s[topic] = NEVER_S
        return self.topics_of(subscriber)

    def topics_of(self, subscriber: Subscriber) -> list[str]:
        """Topics that the connection gets, in the order of ``TOPICS``."""
        return [topic for topic in TOPICS if subscriber in self._gates[topic]]

    def forget(self, subscriber: Subscriber) -> None:
        """The connection is gone; its goals go on."""
        self.unsubscribe(subscriber, list(TOPICS))
        for goal_id in [goal_id for goal_id, goal in self._goals.items() if goal.owner is subscriber]:
            del self._goals[goal_id]

    # -- the fan-out

    def _put(self, topic: str, line: bytes, *, thinned: bool, essential: bool, skip: Subscriber | None = None) -> None:
        if len(self._jobs) >= MAX_JOBS:
            self._due_s[self._jobs.popleft().topic] = -NEVER_S
            self.lost_jobs += 1
        if thinned:
            self._due_s[topic] = NEVER_S  # nothing more of this topic until this one went out to all
        self._jobs.append(_Job(topic, line, iter(list(self._gates[topic])), thinned, essential, skip))
        self.slack.want(self._fan_out)

    def flush(self) -> None:
        """Send all that still waits, at once: nothing comes after it."""
        while self._jobs:
            self._fan_out()

    def _fan_out(self) -> bool:
        now_s = asyncio.get_running_loop().time()
        for _ in range(SENDS_PER_PIECE):
            if not self._jobs:
                return True
            job = self._jobs[0]
            target = next(job.targets, None)
            if target is None:
                self._jobs.popleft()
                if job.thinned:
                    self._due_s[job.topic] = min((g.due_s for g in self._gates[job.topic].values()), default=NEVER_S)
                continue
            gate = self._gates[job.topic].get(target)
            if gate is not None and target is not job.skip and (not job.thinned or gate.opens(now_s)):
                target.send(job.line, essential=job.essential)
        if self._jobs:
            self.slack.want(self._fan_out)
        return True


def event_payload(
    code: str,
    text: str,
    goal_id: str | None = None,
    field: str | None = None,
    reset: ResetReport | None = None,
    error: int | None = None,
) -> EventTelemetry:
    """An event that happens now."""
    return {
        "time_s": asyncio.get_running_loop().time(),
        "code": code,
        "text": text,
        "goal_id": goal_id,
        "field": field,
        "error": error,
        "reset": reset,
    }
