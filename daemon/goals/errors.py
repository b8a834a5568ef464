"""The errors of the goal protocol: a code for programs, a field and a reason for people; and the longest line."""

from enum import IntEnum

MAX_LINE_BYTES = 65536


class ErrorCode(IntEnum):
    """The codes of a JSON-RPC error; the first five are JSON-RPC's own."""

    PARSE = -32700
    INVALID_REQUEST = -32600
    UNKNOWN_METHOD = -32601
    INVALID_PARAMS = -32602
    INTERNAL = -32603
    REFUSED = -32001
    WRONG_STATE = -32002
    NOT_PERMITTED = -32003
    AUTOPILOT_REFUSED = -32004
    TIMED_OUT = -32005
    UNKNOWN_GOAL = -32006


class ProtocolError(Exception):
    """A request that is not done: ``code``, ``field`` (a path such as ``waypoint.position[2]``, or None), ``reason``.

    The message of the reply is ``field: reason``, or the reason alone.
    """

    def __init__(self, code: ErrorCode, reason: str, field: str | None = None) -> None:
        self.code = code
        self.reason = reason
        self.field = field
        super().__init__(f"{field}: {reason}" if field else reason)
