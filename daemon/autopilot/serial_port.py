"""The device of a serial connection: whether the one that was opened is still there."""

from pathlib import Path

Device = tuple[int, int, int]


class SerialPort:
    """Follows the device behind one of MAVSDK's URLs; an adapter on USB that is plugged in again is another one."""

    def __init__(self, url: str) -> None:
        scheme, _, rest = url.partition("://")
        self._path = Path(rest.rpartition(":")[0] or rest) if scheme.startswith("serial") else None
        self._opened: Device | None = None

    def opened(self) -> None:
        """The device that is there now is the one in use."""
        self._opened = self._device()

    def is_another(self) -> bool:
        """Tell whether a device is there that is not the one in use; one that was away in between is another."""
        found = self._device()
        if found is None:
            self._opened = None
        return found != self._opened

    def _device(self) -> Device | None:
        if self._path is None:
            return None
        try:
            found = self._path.stat()
        except OSError:
            return None
        return found.st_dev, found.st_ino, found.st_rdev
