import pytest

from api_schemas.bus import Heartbeat
from api_schemas.robot import RobotState
from services.jobs.claim import Claim
from services.jobs.fleet import KNOWN_AFTER_LOSS_S, RETURN_AFTER_S, SILENT_AFTER_S, Fleet

CLAIM = Claim("j-000", 1, "robot-0")


def beat(state=RobotState.IDLE, claim=None, instance="one", robot="robot-0"):
    trial_id, fence = (claim.trial_id, claim.fence) if claim else (None, None)
    return Heartbeat(robot=robot, instance=instance, pid=1, host="h", state=state, trial_id=trial_id, fence=fence)


@pytest.fixture
def fleet():
    fleet = Fleet()
    fleet.token_changed("robot-0", present=True, now_s=100.0)
    fleet.heard(beat(), 100.0)
    return fleet


def state(fleet, now_s=100.0):
    return fleet.member("robot-0").state(now_s)


def test_a_robot_is_idle_once_it_said_so(fleet):
    assert state(fleet) == RobotState.IDLE
    assert fleet.seen(100.0).ready == ("robot-0",)


def test_a_heartbeat_is_news_only_when_it_says_something_new(fleet):
    assert not fleet.heard(beat(), 101.0)
    assert fleet.heard(beat(RobotState.OUT_OF_SERVICE), 102.0)


def test_a_leased_robot_is_not_ready_whatever_it_says(fleet):
    fleet.leased(CLAIM, 100.0)
    assert state(fleet) == RobotState.LEASED
    fleet.accepted(CLAIM)
    fleet.heard(beat(), 100.1)
    assert state(fleet) == RobotState.RUNNING
    assert fleet.seen(100.1).ready == ()


def test_a_robot_is_ready_at_once_after_its_outcome(fleet):
    fleet.leased(CLAIM, 100.0)
    fleet.heard(beat(RobotState.RUNNING, CLAIM), 100.1)
    fleet.freed(CLAIM, done=True)
    assert fleet.seen(100.2).ready == ("robot-0",)
    assert fleet.member("robot-0").trials_done == 1


def test_the_end_of_an_old_attempt_does_not_end_the_new_one(fleet):
    fleet.leased(Claim("j-001", 1, "robot-0"), 100.0)
    fleet.freed(CLAIM, done=False)
    assert fleet.member("robot-0").lease == Claim("j-001", 1, "robot-0")


def test_a_robot_without_token_is_lost_and_its_last_words_do_not_bring_it_back(fleet):
    fleet.token_changed("robot-0", present=False, now_s=101.0)
    assert state(fleet, 101.0) == RobotState.LOST
    fleet.heard(beat(), 101.0 + RETURN_AFTER_S / 2)
    assert state(fleet, 102.0) == RobotState.LOST
    fleet.heard(beat(), 101.1 + RETURN_AFTER_S)
    assert state(fleet, 104.0) == RobotState.IDLE


@pytest.mark.parametrize("instance", ["one", "two"])
def test_a_returning_token_brings_it_back_as_soon_as_it_says_which_process_it_is(fleet, instance):
    fleet.token_changed("robot-0", present=False, now_s=101.0)
    fleet.token_changed("robot-0", present=True, now_s=101.5)
    assert state(fleet, 101.5) == RobotState.LOST, "a lease given now might be ended as one of the process that went"
    fleet.heard(beat(instance=instance), 101.6)
    assert state(fleet, 101.6) == RobotState.IDLE


def test_a_silent_robot_is_lost_though_its_token_stands(fleet):
    assert state(fleet, 100.0 + SILENT_AFTER_S) == RobotState.IDLE
    assert state(fleet, 100.1 + SILENT_AFTER_S) == RobotState.LOST


def test_a_lost_robot_takes_part_in_draws_for_a_while(fleet):
    fleet.token_changed("robot-0", present=False, now_s=101.0)
    assert fleet.seen(102.0).known == ("robot-0",)
    assert fleet.healthy(102.0) == frozenset()
    assert fleet.seen(101.0 + KNOWN_AFTER_LOSS_S).known == ()


def test_a_draining_robot_is_not_healthy(fleet):
    fleet.member("robot-0").drain = True
    assert state(fleet) == RobotState.DRAINING
    assert fleet.healthy(100.0) == frozenset()


def test_a_paused_robot_is_not_ready_until_its_time(fleet):
    fleet.member("robot-0").paused_until_s = 101.0
    assert fleet.seen(100.9).ready == ()
    assert fleet.seen(101.0).ready == ("robot-0",)


def test_leases_that_the_database_does_not_know_are_dropped(fleet):
    fleet.leased(CLAIM, 100.0)
    fleet.hold_only([CLAIM])
    assert fleet.member("robot-0").lease == CLAIM
    fleet.hold_only([])
    assert fleet.member("robot-0").lease is None


def test_a_process_that_takes_the_place_of_another_is_the_robot_from_then_on(fleet):
    assert fleet.came_anew(beat(instance="two"), 101.0)
    fleet.heard(beat(instance="two"), 101.0)
    fleet.heard(beat(instance="three"), 102.0)
    assert state(fleet, 102.0) == RobotState.IDLE
    assert not fleet.came_anew(beat(instance="three"), 103.0)


def both_heard(fleet, *at_s):
    for now_s in at_s:
        fleet.heard(beat(instance="two"), now_s)
        fleet.heard(beat(instance="one"), now_s + 0.5)


def test_two_living_processes_of_one_name_are_out_of_service_with_the_reason(fleet):
    fleet.leased(CLAIM, 100.0, accepted=True)
    both_heard(fleet, 101.0)
    assert state(fleet, 101.5) == RobotState.OUT_OF_SERVICE
    assert fleet.member("robot-0").reason(101.5) == "two processes call themselves robot-0; start one of them with --first"
    assert fleet.seen(101.5).ready == ()
    assert fleet.healthy(101.5) == frozenset()
    # Neither is taken for a new process each time that it speaks; a third one is.
    assert not fleet.came_anew(beat(instance="two"), 102.0)
    assert fleet.came_anew(beat(instance="three"), 102.0)


def test_a_name_is_in_service_again_when_one_process_alone_was_heard_for_a_while(fleet):
    both_heard(fleet, *range(101, 120))
    for now_s in range(120, 120 + int(SILENT_AFTER_S)):
        fleet.heard(beat(instance="two"), now_s)
        # "one" was heard for the last time at 119.5
        assert (state(fleet, now_s) == RobotState.OUT_OF_SERVICE) == (now_s <= 119.5 + SILENT_AFTER_S)
    assert state(fleet, 119.6 + SILENT_AFTER_S) == RobotState.IDLE
    fleet.heard(beat(instance="two"), 130.0)
    assert fleet.member("robot-0").reason(130.0) is None
    fleet.heard(beat(instance="three"), 131.0)
    assert state(fleet, 131.0) == RobotState.IDLE


def test_a_process_that_wakes_after_a_long_sleep_is_found_out_as_soon_as_the_other_speaks(fleet):
    for now_s in range(101, 150):
        fleet.heard(beat(instance="two"), now_s)
    fleet.heard(beat(instance="one"), 150.0)
    assert state(fleet, 150.0) == RobotState.IDLE
    fleet.heard(beat(instance="two"), 150.5)
    assert state(fleet, 150.5) == RobotState.OUT_OF_SERVICE


def leaving(state=RobotState.DRAINING, claim=None):
    return beat(state, claim).model_copy(update={"leaving": True})


@pytest.mark.parametrize(("said", "has_left"), [(leaving(), True), (beat(RobotState.DRAINING), False), (beat(), False)])
def test_a_robot_that_said_that_it_goes_is_not_missed_and_forgotten_after_a_minute(fleet, said, has_left):
    fleet.heard(said, 101.0)
    assert not fleet.member("robot-0").has_left
    fleet.token_changed("robot-0", present=False, now_s=102.0)
    assert (fleet.member("robot-0").has_left, state(fleet, 102.0)) == (has_left, RobotState.LOST)
    assert fleet.left_for_good(102.0 + KNOWN_AFTER_LOSS_S - 1.0) == []
    assert fleet.left_for_good(102.0 + KNOWN_AFTER_LOSS_S) == ["robot-0"] * has_left


def test_a_robot_that_goes_in_the_middle_of_a_trial_is_missed(fleet):
    fleet.leased(CLAIM, 100.0)
    fleet.heard(leaving(RobotState.RUNNING, CLAIM), 101.0)
    fleet.token_changed("robot-0", present=False, now_s=102.0)
    assert not fleet.member("robot-0").has_left


def test_a_withdrawn_robot_that_goes_is_remembered(fleet):
    fleet.member("robot-0").withdrawn = "five faults in a row"
    fleet.heard(leaving(), 101.0)
    fleet.token_changed("robot-0", present=False, now_s=102.0)
    assert fleet.left_for_good(1000.0) == []


def test_robots_without_cameras_are_blind_together_and_an_empty_farm_is_not():
    fleet = Fleet()
    assert not fleet.is_blind(100.0), "whoever comes may see"
    for robot, sees in (("robot-0", False), ("robot-1", True)):
        fleet.token_changed(robot, present=True, now_s=100.0)
        fleet.heard(beat(robot=robot).model_copy(update={"sees": sees}), 100.0)
        assert fleet.is_blind(100.0) is not sees


def test_who_hears_nobody_draws_nobody_until_robots_are_heard_again(fleet):
    fleet.hear_nobody()
    assert (state(fleet), fleet.seen(100.0).known) == (RobotState.LOST, ())
    fleet.token_changed("robot-0", present=True, now_s=500.0)
    fleet.heard(beat(), 500.0)
    assert (state(fleet, 500.0), fleet.seen(500.0).ready) == (RobotState.IDLE, ("robot-0",))
