"""The page about the settings is what the settings say. After a change: `python -m support.settings_page`."""

from support.settings_page import PAGE, meanings, page

from daemon.config import describe
from daemon.settings import Control


def test_the_page_is_current() -> None:
    assert PAGE.read_text() == page(), "PYTHONPATH=tests python -m support.settings_page"


def test_each_key_is_told_with_its_range_and_meaning() -> None:
    told = page()
    assert "| `lost_s` | `1.5` | 1.4 to 5 s |  | silence after which the autopilot counts as disconnected; " in told
    assert "| `rate_feed_forward` | `true` | true, false |  |" in told
    assert f"| `tilt_max_deg` | `35.0` | {describe('control.tilt_max_deg')['min']:g} to 80 deg | yes |" in told
    assert {path for path in meanings() if path.startswith("control.")} == {
        f"control.{k}" for k in Control.model_fields
    }


def test_each_rule_that_binds_keys_is_told() -> None:
    rules = page().partition("## Keys that bind each other\n\n")[2].partition("\n\n")[0].splitlines()
    assert len(rules) >= 7
    assert all(len(rule) > 20 for rule in rules)
