"""What the pages name is there: links and their headings, commands and their options, settings, targets of make."""

import re
from functools import cache
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from daemon.cli.commands import COMMANDS, build
from daemon.config import default_path

ROOT = Path(__file__).parents[2]
PAGES = [
    *ROOT.glob("*.md"),
    *(ROOT / "docs").glob("*.md"),
    ROOT / "examples" / "README.md",
    ROOT / "systemd" / "README.md",
]
GROUPS = {"fly", "config", "bench", "sim"}


@pytest.fixture(params=PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def page(request: pytest.FixtureRequest) -> Path:
    found: Path = request.param
    return found


def headings(page: Path) -> set[str]:
    """As GitHub links to them."""
    titles = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if link.startswith("http"):
            continue
        path, _, heading = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        assert not heading or heading in headings(target), link


@cache
def help_page(*words: str) -> str:
    shown = CliRunner().invoke(build(words[0]), [*words, "--help"], prog_name="flightd", env={"COLUMNS": "200"})
    assert shown.exit_code == 0, words
    return shown.output


def test_commands_have_the_options_that_they_are_shown_with(page: Path) -> None:
    for line in re.findall(r"(?:^|[`/ ])flightd ([a-z][^`\n#|;]*)", page.read_text(), re.MULTILINE):
        words = line.split()
        if words[0] not in COMMANDS:
            continue
        inner = [word for word in words[1:2] if words[0] in GROUPS and re.fullmatch("[a-z]+", word)]
        for option in re.findall(r"(?<!\S)--[a-z0-9-]+", line):
            assert f" {option} " in help_page(words[0], *inner), line


def test_settings_are_called_so(page: Path) -> None:
    known = yaml.safe_load(default_path().read_text())
    for name in re.findall(r"`([a-z]+(?:\.[a-z0-9_]+)+)(?:: [^`]*)?`", page.read_text()):
        section, *keys = name.split(".")
        if (
            section not in known
            or name == "estimator.pose"
            or (ROOT / "daemon" / f"{name.replace('.', '/')}.py").exists()
        ):
            continue
        found = known[section]
        for key in keys:
            assert key in found, name
            found = found[key]


def test_targets_of_make_are_there(page: Path) -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    shown = re.findall(r"(?:^|`|&& )make ([\w-]+)", page.read_text(), re.MULTILINE)
    assert set(shown) - targets <= {"px4_sitl"}, shown  # PX4's own
