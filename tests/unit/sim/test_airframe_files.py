"""Airframes from YAML."""

import pytest

from daemon.sim import airframe_files


def test_the_built_in_airframes_load_and_hover_below_full_thrust():
    assert airframe_files.names() == ["sih", "x500"]
    assert airframe_files.load("sih").hover_thrust == pytest.approx(0.4905)
    assert airframe_files.load("x500").hover_thrust == pytest.approx(2.0 * 9.81 / 34.0)


def test_an_airframe_of_ones_own_loads_by_path(tmp_path):
    text = (airframe_files.DIRECTORY / "sih.yaml").read_text().replace("mass_kg: 1.0", "mass_kg: 1.2")
    path = tmp_path / "heavy.yaml"
    path.write_text(text)
    assert airframe_files.load(path).mass_kg == 1.2


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("mass_kg: 1.0", "mass_kg: 9.0", "cannot carry"),
        ("mass_kg: 1.0", "mass_kg: -1.0", "positive"),
        ("mass_kg: 1.0", "weight_kg: 1.0", "weight_kg"),
        ("rate_gains:", "gains:", "rate_gains"),
    ],
)
def test_a_wrong_airframe_is_refused_with_what_is_wrong(tmp_path, old, new, words):
    path = tmp_path / "wrong.yaml"
    path.write_text((airframe_files.DIRECTORY / "sih.yaml").read_text().replace(old, new))
    with pytest.raises(ValueError, match=words):
        airframe_files.load(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mass_kg: [\n", "line 2, column 1: expected the node content"),
        ("", "keys such as"),
        ("- sih\n", "keys such as"),
        ("mass_kg: 1.0\nmass_kg: 2.0\n", "the key mass_kg is there already, in line 1"),
    ],
)
def test_a_file_that_holds_no_airframe_is_refused_in_words(tmp_path, text, words):
    path = tmp_path / "wrong.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=words):
        airframe_files.load(path)


def test_an_unknown_name_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match="known: sih, x500"):
        airframe_files.load("boeing")
