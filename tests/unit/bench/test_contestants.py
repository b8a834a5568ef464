"""The clients that the benchmark compares with, where what they need is missing."""

import json
import subprocess
import sys
from pathlib import Path


def said_with(path: Path) -> object:
    command = [sys.executable, "-m", "daemon.bench.contestants.c_api", "1", "1", "1"]
    root = Path(__file__).resolve().parents[3]
    environment = {"PATH": str(path), "PYTHONPATH": str(root)}
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout)


def test_without_a_compiler_the_c_program_is_skipped_with_the_reason(tmp_path: Path) -> None:
    assert said_with(tmp_path) == {"error": "skipped: no C compiler (cc)"}


def test_a_program_that_does_not_compile_is_skipped_with_the_reason(tmp_path: Path) -> None:
    compiler = tmp_path / "cc"
    compiler.write_text("#!/bin/sh\necho no such header >&2\nexit 1\n")
    compiler.chmod(0o755)
    assert said_with(tmp_path) == {"error": f"skipped: {compiler} failed: no such header"}
