"""Finds calls that may wait for a disk, a peer or another thread, made on a thread that must never wait.

``sys.addaudithook`` sees what the interpreter itself tells of (files, modules among them, connections, names looked up,
processes); the ways to wait that it tells nothing of are replaced by ones that look first. Both stay for the
life of the process and do nothing while nobody watches.
"""

import concurrent.futures
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

AUDITED = frozenset(
    {
        "open", "os.listdir", "os.scandir", "os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.truncate",
        "os.system", "os.posix_spawn", "os.fork", "subprocess.Popen", "socket.connect", "socket.getaddrinfo",
        "socket.gethostbyname", "socket.bind", "time.sleep", "shutil.copyfile", "glob.glob",
    }
)  # fmt: skip
ALLOWED = (
    (
        "/daemon/notify.py",
        "socket.connect",
        "a datagram socket of this machine, and bounded",
    ),
    (" in _handing_over", "open", "the sources of a traceback, when the vehicle was given away"),
    ("/tests/", None, "what the test itself does in the daemon's thread"),
)
_OURS = ("/daemon/", "/tests/")

_thread: int | None = None
_found: list[str] = []
_installed = False


@contextmanager
def watched() -> Iterator[list[str]]:
    """Within, what this thread waits for is noted: the call, and where in the daemon it is made."""
    found = begin()
    try:
        yield found
    finally:
        end()


def begin() -> list[str]:
    """Watch this thread from now on; the list grows."""
    global _thread, _found
    _install()
    _found = []
    _thread = threading.get_ident()
    return _found


def end() -> None:
    """Watch no more."""
    global _thread
    _thread = None


def _note(call: str, detail: Any) -> None:
    global _thread
    watching, _thread = _thread, None  # what is done to describe it is not looked at
    frames = [f for f in traceback.extract_stack() if any(part in f.filename for part in _OURS)]
    frames = [f for f in frames if not f.filename.endswith("blocking_calls.py")]
    where = f"{frames[-1].filename}:{frames[-1].lineno} in {frames[-1].name}" if frames else "nowhere of ours"
    if not any(part in where and name in (None, call) for part, name, _ in ALLOWED):
        _found.append(f"{call} {detail!r:.80} at {where}")
    _thread = watching


def _audit(event: str, arguments: tuple[Any, ...]) -> None:
    if _thread is not None and event in AUDITED and threading.get_ident() == _thread:
        _note(event, arguments[0] if arguments else None)


def _looking_first(owner: Any, name: str, waits: Callable[..., bool]) -> None:
    """Replace ``owner.name`` by one that notes the call where ``waits`` says that it would wait."""
    original = getattr(owner, name)

    def call(*args: Any, **kwargs: Any) -> Any:
        if _thread is not None and threading.get_ident() == _thread and waits(*args, **kwargs):
            _note(f"{getattr(owner, '__name__', owner)}.{name}", args[-1:] or None)
        return original(*args, **kwargs)

    setattr(owner, name, call)


def _install() -> None:
    global _installed
    if _installed:
        return
    _installed = True
    sys.addaudithook(_audit)
    _looking_first(time, "sleep", lambda seconds: seconds > 0.0)
    _looking_first(threading.Event, "wait", lambda event, timeout=None: not event.is_set())
    _looking_first(threading.Thread, "join", lambda thread, timeout=None: thread.is_alive())
    _looking_first(concurrent.futures.Future, "result", lambda future, timeout=None: not future.done())
    _looking_first(concurrent.futures, "wait", lambda *_args, **_kwargs: True)
