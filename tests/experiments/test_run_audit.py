import pytest
from quick_cli import content_of, rows_of, start, without_seconds

from tablesetting.irl.strategies import STRATEGIES

OPTIONS = ("--num-queries", "1", "--execute", "0", "--seed", "5")


def test_every_strategy_is_audited_in_every_round_and_nothing_else_changes(tmp_path):
    options = (*OPTIONS, "--strategy", "random")
    assert start(tmp_path / "plain", *options) == 0
    assert start(tmp_path / "audited", *options, "--audit") == 0
    plain, audited = rows_of(tmp_path / "plain"), rows_of(tmp_path / "audited")
    assert without_seconds(audited) == without_seconds(plain)
    assert not (tmp_path / "plain" / "audit.csv").exists()
    rows = rows_of(tmp_path / "audited", "audit.csv")
    assert [(row["num_demos"], row["strategy"]) for row in rows] == [
        (num_demos, strategy) for num_demos in ("1", "2") for strategy in STRATEGIES
    ]
    own = [row["is_chosen"] for row in rows if row["strategy"] == "random"]
    assert own == ["1", "1"]


def test_an_audit_says_what_is_asked_and_how_risky_that_is(tmp_path):
    assert start(tmp_path / "run", *OPTIONS, "--audit") == 0
    rounds = rows_of(tmp_path / "run")
    shown = content_of(tmp_path / "run", "demonstrations.json")["demonstrations"]
    rows = rows_of(tmp_path / "run", "audit.csv")
    for latest in rounds:
        own = [row for row in rows if row["num_demos"] == latest["num_demos"]]
        (asked,) = [row for row in own if row["strategy"] == "active-var"]
        assert asked["is_chosen"] == "1"
        assert asked["score"] == asked["var"]
        if latest["num_demos"] == "1":  # What is asked after it is shown next.
            for name, place in shown[1]["layout"].items():
                found = [float(asked[f"{name}_{axis}"]) for axis in "xy"]
                assert found == pytest.approx(place)
        bound = float(latest["var_bound"])
        assert float(asked["var"]) == pytest.approx(bound, abs=1e-8)
        assert asked["var_rank"] == "1"
        for row in own:
            assert 0 <= int(row["candidate"]) < 6
            is_same = row["candidate"] == asked["candidate"]
            assert row["is_chosen"] == str(int(is_same))
            assert float(row["var"]) <= float(asked["var"])
            assert (row["var_rank"] == "1") == (row["var"] == asked["var"])
            assert 1 <= int(row["var_rank"]) <= 6
