"""Mutation testing: ``PYTHONPATH=tests python -m support.mutate daemon/safety [--sample 60]``.

The mutations are those of cosmic-ray, without the ones that no number or enum takes (shifts, bits, ``<`` to ``is``),
and rows and conditions of the supervisor's table.
Each is compiled in memory in a fork of a process that has imported everything but the daemon, so that one costs the
tests that notice it and little else. Prints the survivors, and the share of mutants noticed, by module.
"""

import argparse
import gc
import os
import random
import re
import resource
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path

import pytest
from cosmic_ray import ast, mutating, plugins
from hypothesis import Phase, settings

OF_THE_CONTROLLER = [
    f"tests/unit/control/test_{name}.py" for name in ("controller", "setpoint_limits", "learned_in_flight")
]
FURTHER_TESTS = {
    "daemon/safety": [
        f"tests/unit/safety/test_{name}.py"
        for name in ("conditions", "dead_man", "engage", "release", "requests", "silence", "supervisor")
    ],
    "daemon/control": OF_THE_CONTROLLER,
    "daemon/frames.py": OF_THE_CONTROLLER,
    "daemon/loops": ["tests/unit/loops"],
    "daemon/autopilot": ["tests/unit/autopilot"],
    "daemon/pipeline.py": [
        "tests/unit/test_flown_windows.py",
        "tests/replay",
        "tests/closed_loop/test_first_flight.py",
    ],
}
PRELOADED = ("numpy", "scipy.linalg", "scipy.optimize", "scipy.integrate", "scipy.spatial.transform", "scipy.stats")
PRELOADED += ("pydantic", "ruckig", "pymap3d", "yaml", "structlog", "mcap.reader", "hypothesis.strategies", "asyncio")
NUMERIC, ORDER = "Add|Sub|Mul|Div", "Lt|LtE|Gt|GtE|Eq|NotEq"
OPERATORS = re.compile(
    rf"ReplaceBinaryOperator_({NUMERIC}|Mod|Pow)_({NUMERIC})|ReplaceComparisonOperator_(({ORDER})_({ORDER})|Is_IsNot|IsNot_Is)"
    "|ReplaceUnaryOperator_Delete_(USub|Not)|ReplaceTrueWithFalse|ReplaceFalseWithTrue|ReplaceAndWithOr|ReplaceOrWithAnd"
    "|ReplaceBreakWithContinue|ReplaceContinueWithBreak|AddNot|NumberReplacer|ExceptionReplacer|ZeroIterationForLoop"
)
MEMORY_BYTES = 8 << 30
EXAMPLES = 20
PLUGINS = ("no:cacheprovider", "no:faulthandler", "pytest_asyncio.plugin", "_hypothesis_pytestplugin")
QUIET = ["-x", "-q", "--tb=no", *(f"-p{name}" for name in PLUGINS)]


class Mutated(SourceFileLoader):
    """Finds and loads one module with another source."""

    def __init__(self, path: Path, source: str) -> None:
        super().__init__(".".join(path.with_suffix("").parts), str(path))
        self._source = source

    def find_spec(self, fullname: str, _path: object = None, _target: object = None) -> ModuleSpec | None:
        return spec_from_file_location(fullname, self.path, loader=self) if fullname == self.name else None

    def get_code(self, _fullname: str) -> object:
        return compile(self._source, self.path, "exec")


class Quicker:
    """Property tests with few examples."""

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        for test in {getattr(item, "obj", None) for item in items}:
            own = getattr(test, "_hypothesis_internal_use_settings", None)
            if own is not None:
                test._hypothesis_internal_use_settings = settings(own, max_examples=min(own.max_examples, EXAMPLES))


def tests_of(module: Path) -> list[list[str]]:
    """The tests that are to notice a mutation: the module's own, then more. Raises ``StopIteration`` without any."""
    own = sorted(Path("tests/unit", *module.parent.parts[1:]).glob(f"test_{module.stem}.py"))
    further = next(tests for prefix, tests in FURTHER_TESTS.items() if str(module).startswith(prefix))
    return [[str(path)] for path in own] + [[test for test in further if Path(test) not in own]]


def mutants(source: str) -> list[str]:
    """The module's source with one change each, every text once, only what compiles."""
    found = dict.fromkeys((*_of_operators(source), *_of_table(source)))
    return [mutant for mutant in found if mutant != source and _counts(source, mutant)]


def _of_operators(source: str) -> Iterator[str]:
    nodes = list(ast.ast_nodes(ast.get_ast(source)))
    for name in sorted(plugins.operator_names()):
        if OPERATORS.fullmatch(name.partition("/")[2]):
            operator = plugins.get_operator(name)()
            for occurrence in range(sum(len(list(operator.mutation_positions(node))) for node in nodes)):
                with suppress(AttributeError):  # a dotted name among several that are caught is beyond cosmic-ray
                    yield mutating.mutate_code(source, operator, occurrence) or source


def _of_table(source: str) -> Iterator[str]:
    """A row of the supervisor's table left out; a condition of a row turned round, or left out."""
    for row in re.finditer(r"^ +Row\(.*$", source, re.MULTILINE):
        yield source[: row.start()] + source[row.end() :]
        conditions = list(re.finditer(r'"(!?)(\w+)"(?=.*")', row[0]))  # the last string is the reason
        for condition, other in zip(conditions, conditions[1:] + conditions[:1], strict=True):
            begin, end = row.start() + condition.start(), row.start() + condition.end()
            for instead in (f'"{condition[2]}"' if condition[1] else f'"!{condition[2]}"', other[0]):
                yield source[:begin] + instead + source[end:]


def _counts(source: str, mutant: str) -> bool:
    """Whether it compiles, and is more than another way of storing a record or of calling with keywords."""
    try:
        compile(mutant, "mutant", "exec")
    except SyntaxError:
        return False
    _, old, new = change(source, mutant)
    return not old.startswith("@") and not re.search(r"(^|, )/,", new)


def noticed(module: Path, source: str, limit_s: float) -> bool:
    """Whether the module's tests fail with this source, or do not end within the limit of processor time."""
    pid = os.fork()
    if pid == 0:
        try:
            silence = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silence, 1)
            os.dup2(silence, 2)
            resource.setrlimit(resource.RLIMIT_CPU, (int(limit_s) + 1,) * 2)
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES,) * 2)
            signal.setitimer(signal.ITIMER_REAL, 5.0 * limit_s)  # for one that waits for ever
            sys.meta_path.insert(0, Mutated(module, source))
            codes = (pytest.main([*QUIET, *tests], [Quicker()]) for tests in tests_of(module) if tests)
            os._exit(int(any(code != pytest.ExitCode.OK for code in codes)))
        finally:
            os._exit(1)
    return os.waitpid(pid, 0)[1] != 0


def change(before: str, after: str) -> tuple[int, str, str]:
    """The line that a mutation changed: its number, before and after."""
    lines = enumerate(zip(before.splitlines(), after.splitlines(), strict=True), 1)
    return next((number, old.strip(), new.strip()) for number, (old, new) in lines if old != new)


def mutate(module: Path, sample: int) -> tuple[int, int, int]:
    """Try the mutations of a module, or a sample of them: how many were noticed, tried, and are possible."""
    source = module.read_text()
    everything = mutants(source)
    tried = everything
    if 0 < sample < len(everything):
        tried = random.Random(f"{module}").sample(everything, sample)
    begin_s = time.monotonic()
    if tried and noticed(module, source, 600.0):
        raise SystemExit(f"{module}: its tests fail without a mutation: {tests_of(module)}")
    limit_s = 5.0 * (time.monotonic() - begin_s) + 5.0
    killed = 0
    for mutant in tried:
        if noticed(module, mutant, limit_s):
            killed += 1
        else:
            number, old, new = change(source, mutant)
            print(f"{module}:{number}: {old}\n    {new}", flush=True)
    return killed, len(tried), len(everything)


def main() -> int:
    """Mutate modules (files or folders) one after the other."""
    parser = argparse.ArgumentParser(prog="support.mutate")
    parser.add_argument("modules", nargs="+", type=Path)
    parser.add_argument("--sample", type=int, default=0, help="so many mutants of each module; 0: all")
    arguments = parser.parse_args()
    os.environ |= {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "OPENBLAS_NUM_THREADS": "1"}
    for name in PRELOADED:
        import_module(name)
    settings.register_profile("mutate", deadline=None, derandomize=True, phases=(Phase.explicit, Phase.generate))
    settings.load_profile("mutate")
    gc.freeze()  # else each fork looks through all of it
    for path in arguments.modules:
        for module in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            begin_s = time.monotonic()
            killed, tried, possible = mutate(module, arguments.sample)
            if tried:
                share = f"{killed} of {tried} noticed ({100.0 * killed / tried:.1f} %)"
                print(f"{module}: {share}, {possible} possible, {time.monotonic() - begin_s:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
