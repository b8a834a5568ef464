"""Settings read and changed while the daemon runs: what ``config.get`` and ``config.set`` ask for."""

from typing import Any

from pydantic import ValidationError

from daemon import config as configuration
from daemon.goals import methods, results
from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.protocol import explained
from daemon.loops.vehicle import Vehicle


class LiveSettings:
    """The vehicle's settings by their dotted paths. Raises `ProtocolError`, which names ``path`` or ``value``."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle

    def get(self, path: str) -> results.Setting:
        """A setting as it is now, and what is known of it."""
        try:
            described = configuration.describe(path)
            value = configuration.value_at(self._vehicle.config, path)
        except KeyError:
            keys = ", ".join(configuration.keys_of(path))
            reason = (
                f"{path} is a section; its keys are {keys}"
                if keys
                else f"there is no setting {path!r}{configuration.meant(path)}"
            )
            raise ProtocolError(ErrorCode.REFUSED, reason, "path") from None
        return {"path": path, "value": value, **described}  # type: ignore[typeddict-item]

    def set(self, params: methods.ConfigSet) -> results.Setting:
        """Change one until the daemon restarts; the setting as it is then. What is refused changes nothing."""
        if not self.get(params.path)["settable"]:
            raise ProtocolError(
                ErrorCode.REFUSED,
                f"{params.path} cannot be changed while the daemon runs: write it into its file and restart",
                "path",
            )
        try:
            self._vehicle.set_config(configuration.with_value(self._vehicle.config, params.path, params.value))
        except ValidationError as error:
            raise _refused_value(params, dict(error.errors()[0])) from None
        except ValueError as error:
            raise ProtocolError(ErrorCode.REFUSED, str(error), "value") from None
        return self.get(params.path)


def _refused_value(params: methods.ConfigSet, fault: dict[str, Any]) -> ProtocolError:
    """What pydantic found wrong with a setting, as of the request's ``value``."""
    reason = configuration.unacceptable(fault)
    if reason is not None:
        return ProtocolError(ErrorCode.REFUSED, reason, "value")
    inside = fault["loc"][len(params.path.split(".")) :]
    return explained({**fault, "loc": ("value", *inside)}, {"value": params.value})
