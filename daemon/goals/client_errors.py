"""What can go wrong for a client, as exceptions."""

from typing import Any

from daemon.goals.errors import ErrorCode


class FlightError(Exception):
    """Base of all errors of the client."""


class NoDaemonError(FlightError):
    """Nobody listens at the socket."""


class SocketNotPermittedError(NoDaemonError):
    """The socket does not let this user in."""


class ConnectionLostError(FlightError):
    """The daemon went away before it answered: the request may or may not have taken effect."""


class RequestError(FlightError):
    """The daemon did not do a request: ``code``, ``field`` (a path, or None) and ``reason`` in words."""

    def __init__(self, code: int, message: str, field: str | None = None, reason: str | None = None) -> None:
        self.code = code
        self.field = field
        self.reason = reason or message
        super().__init__(message)


class InvalidRequestError(RequestError):
    """The request is not one that the daemon understands: wrong type, unknown or missing key, unknown method."""


class RefusedError(RequestError):
    """The value is unacceptable: outside the fence, too far, tilted, beyond limits."""


class WrongStateError(RequestError):
    """Not possible in this state."""


class NotPermittedError(RequestError):
    """Only operators may do this."""


class AutopilotRefusedError(RequestError):
    """The autopilot refused."""


class RequestTimedOutError(RequestError):
    """It took too long; it may still take effect."""


class UnknownGoalError(RequestError):
    """The daemon does not know this goal."""


_CLASSES: dict[int, type[RequestError]] = {
    ErrorCode.PARSE: InvalidRequestError,
    ErrorCode.INVALID_REQUEST: InvalidRequestError,
    ErrorCode.UNKNOWN_METHOD: InvalidRequestError,
    ErrorCode.INVALID_PARAMS: InvalidRequestError,
    ErrorCode.REFUSED: RefusedError,
    ErrorCode.WRONG_STATE: WrongStateError,
    ErrorCode.NOT_PERMITTED: NotPermittedError,
    ErrorCode.AUTOPILOT_REFUSED: AutopilotRefusedError,
    ErrorCode.TIMED_OUT: RequestTimedOutError,
    ErrorCode.UNKNOWN_GOAL: UnknownGoalError,
}


def error_from(error: dict[str, Any]) -> RequestError:
    """Exception for the error object of a reply."""
    data = error.get("data") or {}
    kind = _CLASSES.get(error["code"], RequestError)
    return kind(error["code"], error["message"], data.get("field"), data.get("reason"))
