from collections import Counter

import pytest

from services.api import rate_limits
from services.api.rate_limits import BURST_S, Buckets, drawn, network


def test_a_bucket_gives_its_burst_and_then_what_comes_in():
    buckets = Buckets(per_s=2.0)
    assert [buckets.draw("a", 100.0).passes for _ in range(21)] == [True] * 20 + [False]
    assert not buckets.draw("a", 100.4).passes
    assert buckets.draw("a", 100.5).passes
    assert not buckets.draw("a", 100.6).passes
    assert buckets.draw("b", 100.6).passes
    assert [buckets.draw("a", 500.0).left for _ in range(2)] == [19, 18]  # no more than the burst is gathered


def test_who_is_sent_away_passes_after_the_time_he_was_told():
    held, draw = drawn(0.25, 0.0, per_s=4.0)
    assert not draw.passes
    assert drawn(held, draw.wait_s, per_s=4.0)[1].passes
    assert not drawn(held, 0.99 * draw.wait_s, per_s=4.0)[1].passes


def test_what_was_drawn_for_nothing_is_given_back():
    buckets = Buckets(per_s=1.0)
    for _ in range(100):
        assert buckets.draw("a", 0.0).passes
        buckets.give_back("a")


def test_nothing_is_limited_at_zero():
    assert all(Buckets(per_s=0.0).draw("a", 0.0).passes for _ in range(1000))


def test_the_memory_of_strangers_is_bounded(monkeypatch):
    monkeypatch.setattr(rate_limits, "MOST_BUCKETS", 10)
    buckets = Buckets(per_s=1.0)
    for number in range(1000):
        buckets.draw(str(number), float(number))
        buckets.draw("faithful", float(number))
    assert len(buckets._held) <= 11
    assert "faithful" in buckets._held
    assert BURST_S == 10.0


@pytest.mark.parametrize(
    ("address", "counts_as"),
    [
        ("10.1.2.3", "10.1.2.3"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("2001:db8:1:2::9", "2001:db8:1:2::/64"),
        ("::ffff:10.1.2.3", "10.1.2.3"),
        ("unknown", "unknown"),
    ],
)
def test_an_owner_of_many_addresses_is_one(address, counts_as):
    assert network(address) == counts_as


def test_two_processes_let_pass_together_what_one_would():
    here, there, totals = Buckets(2.0, shared=True), Buckets(2.0, shared=True), Counter()
    passed = 0
    for half_seconds in range(40):
        now_s = half_seconds / 2
        passed += sum(each.draw("a", now_s).passes for each in (here, there) for _ in range(5))
        for each in (here, there):
            told = each.tell()
            totals.update(told)
            each.hear(told, {name: totals[name] for name in told}, now_s)
    alone = 2.0 * (BURST_S + 20.0)
    assert alone <= passed <= 1.4 * alone, "each of them would have let pass as many"


def test_who_asks_seldom_is_not_told_of_and_one_process_counts_nothing():
    shared, alone = Buckets(100.0, shared=True), Buckets(100.0)
    for buckets in (shared, alone):
        for name, times in (("often", 30), ("seldom", 2)):
            for _ in range(times):
                buckets.draw(name, 1.0)
    assert (shared.tell(), alone.tell()) == ({"often": 30}, {})
    assert shared.tell() == {}
