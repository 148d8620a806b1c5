"""Only refusals that pass by themselves are waited for, and not for ever."""

from types import SimpleNamespace

import pytest

from api_schemas.error import Problem
from client_cli.connection import patience
from client_cli.connection.patience import patiently
from client_cli.terminal.errors import Refused


def refusing(*answers):
    """A request that is refused with each of these, and then answered with how often it was asked."""
    asked = []

    def ask():
        asked.append(None)
        if len(asked) <= len(answers):
            slug, after_s = answers[len(asked) - 1]
            raise Refused(Problem(type=f"/problems/{slug}", title="t", status=429, detail=slug), after_s)
        return len(asked)

    return ask, asked


def test_it_is_asked_again_as_long_as_the_farm_says():
    ask, _ = refusing(("too-many-uploads", 0.0), ("too-many-verifications", 0.0), ("too-many-event-readers", 0.0))
    assert patiently(ask) == 4


@pytest.mark.parametrize("refusal", [("queued-jobs-quota", 0.0), ("too-many-uploads", None)])
def test_what_does_not_pass_soon_is_not_waited_for(refusal):
    ask, asked = refusing(refusal)
    with pytest.raises(Refused, match=refusal[0]):
        patiently(ask)
    assert len(asked) == 1


def test_patience_ends(monkeypatch):
    waited_s = []
    clock = SimpleNamespace(monotonic=lambda: sum(waited_s), sleep=waited_s.append)
    monkeypatch.setattr(patience, "time", clock)
    ask, asked = refusing(*[("too-many-uploads", patience.PATIENCE_S / 4)] * 100)
    with pytest.raises(Refused, match="too-many-uploads"):
        patiently(ask)
    assert (len(asked), sum(waited_s)) == (5, patience.PATIENCE_S)
