"""Compiles the C programs that benchmarks use, where there is a compiler."""

import shutil
import subprocess
from pathlib import Path


class NotCompiledError(Exception):
    """There is no compiler, or it failed; says which."""


def compile_c(source: Path, program: Path, *arguments: str) -> None:
    """Make a program. Raises `NotCompiledError`."""
    compiler = shutil.which("cc")
    if compiler is None:
        raise NotCompiledError("no C compiler (cc)")
    command = [compiler, "-std=gnu11", "-O2", "-o", str(program), str(source), *arguments]
    built = subprocess.run(command, capture_output=True, text=True)
    if built.returncode != 0:
        raise NotCompiledError(f"{compiler} failed: {built.stderr.strip()[-300:]}")
