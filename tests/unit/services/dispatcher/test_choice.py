from hypothesis import given
from hypothesis import strategies as st

from services.dispatcher.choice import choose

ORDER = ("a", "b", "c")
ROBOTS = st.sampled_from("abcdef")


def why(robot):
    return "is lost"


def test_the_first_of_the_order_when_it_is_healthy():
    assert choose(ORDER, {"a", "b"}, (), why).first_choice == "a"
    assert choose(ORDER, {"a", "b"}, (), why).departure is None


def test_the_next_with_the_reason_when_it_is_not():
    choice = choose(ORDER, {"c"}, (), why)
    assert (choice.first_choice, choice.departure) == ("c", "a is lost; b is lost")


def test_a_robot_that_failed_the_trial_comes_after_those_that_did_not():
    choice = choose(ORDER, {"a", "b", "c"}, {"a"}, why)
    assert (choice.first_choice, choice.departure) == ("b", "a refused or failed an earlier attempt")


def test_when_all_have_failed_it_the_first_tries_again():
    assert choose(ORDER, {"a", "b"}, {"a", "b"}, why).first_choice == "a"


def test_robots_that_joined_later_come_last_and_enter_the_order_only_when_chosen():
    assert choose(ORDER, {"c", "d"}, (), why).order == ORDER
    choice = choose(ORDER, {"d"}, (), why)
    assert (choice.first_choice, choice.order) == ("d", (*ORDER, "d"))


def test_nobody_is_chosen_when_nobody_is_healthy():
    choice = choose(ORDER, (), (), why)
    assert (choice.first_choice, choice.order, choice.departure) == (None, ORDER, None)


@given(st.permutations("abcd"), st.frozensets(ROBOTS), st.frozensets(ROBOTS))
def test_a_healthy_robot_is_always_found_if_there_is_one(order, healthy, faulted):
    choice = choose(order, healthy, faulted, why)
    assert (choice.first_choice is None) == (not healthy)
    if choice.first_choice is not None:
        assert choice.first_choice in healthy
        assert choice.first_choice in choice.order
        assert (choice.first_choice == choice.order[0]) == (choice.departure is None)
