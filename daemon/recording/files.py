"""Names of flight records, and how much of the disk they may have."""

import re
from datetime import UTC, datetime
from pathlib import Path

_NAME = re.compile(r"\d{8}T\d{6}Z(-\d+)?-part\d+\.mcap")


def flight_id(wall_s: float, directory: Path) -> str:
    """An id that no record in the directory has: UTC time of the beginning, counted up where it repeats."""
    base = datetime.fromtimestamp(wall_s, UTC).strftime("%Y%m%dT%H%M%SZ")
    name, count = base, 1
    while part_path(directory, name, 1).exists():
        count += 1
        name = f"{base}-{count}"
    return name


def part_path(directory: Path, flight: str, part: int) -> Path:
    """File of a part of a flight, counted from 1."""
    return directory / f"{flight}-part{part}.mcap"


def in_order(records: list[Path]) -> list[Path]:
    """Records by flight and part; a shell sorts part 10 before part 2."""

    def key(file: Path) -> tuple[str, int]:
        flight, _, part = file.stem.rpartition("-part")
        return (flight, int(part)) if part.isdecimal() else (file.stem, 0)

    return sorted(records, key=key)


def make_room(directory: Path, keep_bytes: int) -> list[Path]:
    """Remove the oldest records until all together fit, and return them; other files are left alone."""
    records = sorted((f.stat().st_mtime, f.name, f) for f in directory.iterdir() if _NAME.fullmatch(f.name))
    total = sum(f.stat().st_size for _, _, f in records)
    removed: list[Path] = []
    for _, _, file in records:
        if total <= keep_bytes:
            break
        total -= file.stat().st_size
        file.unlink()
        removed.append(file)
    return removed
