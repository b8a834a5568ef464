"""The record's topics as they happen, over the Foxglove WebSocket on loopback; fed by the recorder's thread."""

import foxglove
from foxglove.websocket import WebSocketServer

from daemon import logs
from daemon.recording import narrator
from daemon.recording.topics import Note, Step, Topics

HOST = "127.0.0.1"

log = logs.get("live")


class Live:
    """A server on loopback. A port that is taken costs the live view only."""

    def __init__(self, port: int, wall_s: float, path_poses: int, period_s: float) -> None:
        context = foxglove.Context()
        self._topics = Topics(context, wall_s, path_poses)
        self._period_s = period_s
        self._told = narrator.Told()
        self._server: WebSocketServer | None = None
        try:
            self._server = foxglove.start_server(name="flightd", host=HOST, port=port, context=context)
        except (OSError, RuntimeError) as error:
            log.error("live_view_unavailable", port=port, reason=str(error))
        else:
            log.info("live_view", url=f"ws://{HOST}:{self.port}")

    @property
    def port(self) -> int | None:
        """Where it listens; None when it does not."""
        return None if self._server is None else self._server.port

    def tick(self, step: Step) -> None:
        """Publish a tick to whoever looks."""
        if self._server is None:
            return
        self._told, events = narrator.tell(self._told, step, self._period_s)
        self._topics.tick(step)
        for event in events:
            self._topics.event(event)

    def note(self, note: Note) -> None:
        """Publish an event, a goal or a plan."""
        if self._server is not None:
            self._topics.note(note)

    def close(self) -> None:
        """Stop the server."""
        if self._server is not None:
            self._server.stop()
            self._server = None
