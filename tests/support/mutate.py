"""Mutation testing with cosmic-ray, in a copy of the tree: ``PYTHONPATH=tests python -m support.mutate daemon/safety``.

Prints the survivors as differences, and the share of mutants that the tests noticed.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

TESTS = {
    "daemon/safety": "tests/unit/safety",
    "daemon/control": "tests/unit/control",
    "daemon/frames.py": "tests/unit/test_frames.py tests/unit/control tests/unit/estimation",
    "daemon/pipeline.py": "tests/replay tests/closed_loop/test_first_flight.py",
}
LIMIT_S = 60.0


def tests_of(module: str) -> str:
    """The tests that are to notice a mutation of a module. Raises ``StopIteration`` for one that is not listed."""
    return next(tests for prefix, tests in TESTS.items() if module.startswith(prefix))


def configuration(module: str) -> str:
    """cosmic-ray's configuration of one module."""
    tests = " ".join(path for path in tests_of(module).split() if Path(path).exists())
    command = f"{sys.executable} -m pytest -x -q -p no:cacheprovider {tests}"
    lines = (
        "[cosmic-ray]",
        f"module-path = {json.dumps(module)}",
        f"timeout = {LIMIT_S}",
        "excluded-modules = []",
        f"test-command = {json.dumps(command)}",
        "[cosmic-ray.distributor]",
        'name = "local"',
    )
    return "\n".join(lines) + "\n"


def mutate(module: str, copy: Path, environ: dict[str, str]) -> tuple[int, int]:
    """Try all mutations of a module; how many were noticed, and how many there are."""
    config, session = copy / "mutate.toml", copy / "mutate.sqlite"
    config.write_text(configuration(module))
    session.unlink(missing_ok=True)
    for verb in (("init", str(config), str(session)), ("exec", str(config), str(session))):
        subprocess.run(["cosmic-ray", *verb], cwd=copy, env=environ, check=True)
    dump = subprocess.run(["cosmic-ray", "dump", str(session)], capture_output=True, text=True, check=True).stdout
    results = [json.loads(line)[1] for line in dump.splitlines()]
    done = [result for result in results if result is not None]
    survivors = [result for result in done if result["test_outcome"] == "survived"]
    for survivor in survivors:
        print(survivor["diff"])
    return len(done) - len(survivors), len(done)


def main(modules: list[str]) -> int:
    """Mutate modules (files or folders) one after the other."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "tree"
        subprocess.run(["git", "clone", "--quiet", ".", str(copy)], check=True)
        environ = {"PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin", "PYTHONPATH": str(copy)}
        for name in modules:
            path = Path(name)
            for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
                killed, tried = mutate(str(file), copy, environ)
                if tried:
                    print(f"{file}: {killed} of {tried} mutants noticed ({100.0 * killed / tried:.0f} %)", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
