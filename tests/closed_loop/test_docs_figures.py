"""The pictures of the documentation can be drawn anew, and the page shows all of them."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

DOCS = Path(__file__).parents[2] / "docs"
MOST_BYTES = 150_000


@pytest.fixture(scope="module")
def figures() -> ModuleType:
    spec = importlib.util.spec_from_file_location("guidance_figures", DOCS / "figures" / "guidance.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_picture_is_drawn_from_a_flight(figures: ModuleType, tmp_path: Path) -> None:
    drawn = figures.draw("guidance-headings", tmp_path).read_bytes()
    assert drawn.startswith(b"\x89PNG")
    assert 5_000 < len(drawn) < MOST_BYTES


def test_the_page_shows_each_picture_once_and_nothing_else(figures: ModuleType) -> None:
    page = (DOCS / "guidance.md").read_text()
    assert all(page.count(f"](images/{name}.png)") == 1 for name in figures.FIGURES)
    files = {path.stem: path for path in (DOCS / "images").glob("guidance-*.png")}
    assert files.keys() == figures.FIGURES.keys()
    assert all(path.stat().st_size < MOST_BYTES for path in files.values())
