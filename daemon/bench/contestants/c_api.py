"""A C program on the library that the wheel of mavsdk brings: compiles ``c_api.c`` and becomes it."""

import importlib.util
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import NoReturn

from daemon.bench.c_program import NotCompiledError, compile_c
from daemon.bench.contestants.common import PORT, SECONDS, WARM_UP_S

_SOURCE = Path(__file__).with_suffix(".c")


def main() -> NoReturn:
    """Run the program in this process, or say why there is none."""
    package = importlib.util.find_spec("mavsdk")
    if package is None or package.origin is None:
        _skipped("no mavsdk")
    library = Path(package.origin).parent / "lib" / "libcmavsdk.so"
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "c_api"
        try:
            compile_c(_SOURCE, program, str(library), "-lm", "-pthread")
        except NotCompiledError as error:
            _skipped(str(error))
        file = os.open(program, os.O_RDONLY)
    # Preloaded, because the file in the wheel does not have the name that it gives itself (libcmavsdk.so.3).
    environment = {**os.environ, "LD_PRELOAD": str(library)}
    os.execve(file, ["c_api", str(PORT), str(SECONDS), str(WARM_UP_S)], environment)


def _skipped(reason: str) -> NoReturn:
    sys.stdout.write(json.dumps({"error": f"skipped: {reason}"}) + "\n")
    sys.exit()


main()
