from pathlib import Path

from daemon.recording.files import flight_id, in_order, part_path


def test_parts_come_in_the_order_in_which_they_were_flown() -> None:
    names = [f"20261122T101500Z-part{part}.mcap" for part in (10, 2, 1)] + ["20261122T101500Z-2-part1.mcap"]
    ordered = [file.name.split("Z-")[1] for file in in_order([Path(name) for name in names])]
    assert ordered == ["part1.mcap", "part2.mcap", "part10.mcap", "2-part1.mcap"]


def test_a_name_of_ones_own_is_no_fault() -> None:
    assert in_order([Path("b.mcap"), Path("a-partner.mcap")]) == [Path("a-partner.mcap"), Path("b.mcap")]


def test_two_flights_in_one_second_have_two_names(tmp_path: Path) -> None:
    first = flight_id(1.8e9, tmp_path)
    part_path(tmp_path, first, 1).touch()
    second = flight_id(1.8e9, tmp_path)
    assert (first, second) == ("20270115T080000Z", "20270115T080000Z-2")
