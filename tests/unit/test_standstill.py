"""What fails on a machine that stood still is tried again; what fails on one that runs, or must always hold, is not."""

import ctypes
from math import inf
from pathlib import Path

import pytest
from support import standstill
from support.standstill import ATTEMPTS, StoodStillError, Witness, where_it_runs


def stand_still(seconds: float) -> None:
    """Nothing of this process runs meanwhile: the interpreter is held."""
    ctypes.PyDLL(None).usleep(int(1e6 * seconds))


def test_a_witness_notes_a_standstill() -> None:
    with Witness() as witness:
        stand_still(0.3)
    assert witness.longest_s >= 0.3


async def test_what_failed_while_the_machine_stood_still_is_tried_again_in_a_folder_of_its_own(tmp_path: Path) -> None:
    folders: list[Path] = []

    async def fly(folder: Path) -> str:
        folders.append(folder)
        if len(folders) == 1:
            stand_still(0.3)
            raise TimeoutError
        if len(folders) == 2:
            stand_still(0.3)
            return "wrong"
        if len(folders) == 3:
            raise StoodStillError
        return "right"

    assert await where_it_runs(fly, tmp_path, lambda result: result == "wrong") == "right"
    assert len(set(folders)) == 4 and all(folder.is_dir() for folder in folders)


async def test_what_fails_on_a_machine_that_runs_fails_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(standstill, "STILL_S", inf)

    async def fly(folder: Path) -> str:
        raise AssertionError(folder.name)

    with pytest.raises(AssertionError, match=r"^0$"):
        await where_it_runs(fly, tmp_path)


async def test_what_is_wrong_on_a_machine_that_runs_is_returned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(standstill, "STILL_S", inf)

    async def fly(_folder: Path) -> str:
        return "wrong"

    assert await where_it_runs(fly, tmp_path, lambda _result: True) == "wrong"


async def test_what_must_always_hold_is_not_excused(tmp_path: Path) -> None:
    async def fly(_folder: Path) -> str:
        stand_still(0.3)
        pytest.fail("it did not hold")

    with pytest.raises(pytest.fail.Exception, match="it did not hold"):
        await where_it_runs(fly, tmp_path)


async def test_a_machine_that_never_runs_shows_nothing(tmp_path: Path) -> None:
    async def fly(_folder: Path) -> str:
        raise StoodStillError

    with pytest.raises(pytest.skip.Exception, match=f"each of {ATTEMPTS} flights"):
        await where_it_runs(fly, tmp_path)
