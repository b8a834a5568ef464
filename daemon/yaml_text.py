"""YAML as people write it: each key once, and what is wrong in one line with its place."""

from typing import Any

import yaml


class _EachKeyOnce(yaml.SafeLoader):
    """YAML's own rule, which pyyaml does not keep: it takes the last of two keys, and the first section is lost."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            if key.value in lines:
                problem = f"the key {key.value} is there already, in line {lines[key.value]}"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            lines[key.value] = key.start_mark.line + 1
        return super().construct_mapping(node, deep)


def parsed(text: str) -> Any:
    """What a text holds. Raises ``ValueError``: one line."""
    try:
        return yaml.load(text, _EachKeyOnce)
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # ValueError: no date, such as 2026-13-45
        raise ValueError(f"not YAML: {_in_words(error)}") from None


def _in_words(error: Exception) -> str:
    if not isinstance(error, yaml.MarkedYAMLError) or error.problem is None or error.problem_mark is None:
        return " ".join(str(error).split())
    place = f"line {error.problem_mark.line + 1}, column {error.problem_mark.column + 1}"
    beginning = f" ({error.context} in line {error.context_mark.line + 1})" if error.context_mark else ""
    return f"{place}: {error.problem}{beginning}"
