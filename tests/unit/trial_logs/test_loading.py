"""While a program is loaded nothing is looked for that nobody needs, and after it as before."""

import gc

import pytest

from trial_logs.loading import everything_stays


@pytest.fixture
def collected():
    """Garbage is looked for, as usual, and afterwards, too."""
    gc.enable()
    yield
    gc.enable()


def test_garbage_is_not_looked_for_until_all_is_there(collected):
    kept = gc.get_freeze_count()
    with everything_stays():
        assert not gc.isenabled()
        loaded = [[number] for number in range(1000)]
    assert gc.isenabled()
    assert gc.get_freeze_count() >= kept + len(loaded), "never looked at again"


@pytest.mark.parametrize("is_on", [True, False])
def test_what_was_so_before_is_so_again_also_where_something_is_not_there(collected, is_on):
    (gc.enable if is_on else gc.disable)()
    with pytest.raises(ImportError), everything_stays():
        raise ImportError
    assert gc.isenabled() == is_on
