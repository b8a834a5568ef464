"""A C program on the library that the wheel of mavsdk brings: compiles ``c_api.c`` and becomes it."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NoReturn

from daemon.bench.contestants.common import PORT, SECONDS, WARM_UP_S

_SOURCE = Path(__file__).with_suffix(".c")


def main() -> NoReturn:
    """Run the program in this process, or say why there is none."""
    package, compiler = importlib.util.find_spec("mavsdk"), shutil.which("cc")
    if package is None or package.origin is None or compiler is None:
        _skipped("no C compiler (cc)" if compiler is None else "no mavsdk")
    library = Path(package.origin).parent / "lib" / "libcmavsdk.so"
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "c_api"
        command = [compiler, "-std=gnu11", "-O2", "-o", str(program), str(_SOURCE), str(library), "-lm", "-pthread"]
        built = subprocess.run(command, capture_output=True, text=True)
        if built.returncode != 0:
            _skipped(f"{compiler} failed: {built.stderr.strip()[-300:]}")
        file = os.open(program, os.O_RDONLY)
    # Preloaded, because the file in the wheel does not have the name that it gives itself (libcmavsdk.so.3).
    environment = {**os.environ, "LD_PRELOAD": str(library)}
    os.execve(file, ["c_api", str(PORT), str(SECONDS), str(WARM_UP_S)], environment)


def _skipped(reason: str) -> NoReturn:
    sys.stdout.write(json.dumps({"error": f"skipped: {reason}"}) + "\n")
    sys.exit()


main()
