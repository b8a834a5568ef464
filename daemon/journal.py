"""What happens, told once: to the subscribers of events and to the flight record."""

from collections.abc import Mapping
from typing import Any

from daemon.goals.hub import Hub
from daemon.goals.results import ResetReport
from daemon.recording.recorder import Recorder


class Journal:
    """Fans out; ``recorder`` None: there is no flight record."""

    def __init__(self, hub: Hub, recorder: Recorder | None) -> None:
        self._hub = hub
        self._recorder = recorder

    def event(
        self,
        code: str,
        text: str,
        goal_id: str | None = None,
        field: str | None = None,
        reset: ResetReport | None = None,
    ) -> None:
        """Something happened now; ``reset`` when it was one of the estimate."""
        self._hub.event(code, text, goal_id, field, reset)
        if self._recorder is not None:
            self._recorder.event(code, text, goal_id, field, reset)

    def goal(self, what: str, goal_id: str | None, details: Mapping[str, Any]) -> None:
        """A goal was submitted, updated, refused or ended."""
        if self._recorder is not None:
            self._recorder.goal(what, goal_id, details)

    def plan(self, payload: Mapping[str, Any]) -> None:
        """A planned path as ``telemetry.plan`` has it."""
        self._hub.publish("plan", payload)
        if self._recorder is not None:
            self._recorder.plan(payload)
