"""Rollouts that workers share: the same bits for any number of them, and whatever is killed on the way."""

import os
import pickle
import signal

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra 'learning' is not installed")
pytest.importorskip("stable_baselines3", reason="the extra 'learning' is not installed")

from sim_backend.training.ledger import LEARNER_ENDED, LEDGER, WORKER_LOST, Ledger, account  # noqa: E402
from sim_backend.training.recipe import Recipe  # noqa: E402
from sim_backend.training.rollouts import Order, RolloutWorker  # noqa: E402
from sim_backend.training.train import Run  # noqa: E402

pytestmark = pytest.mark.filterwarnings("default")  # torch's own
SAMPLES = 16 * 4  # of an iteration
BEHIND = {"ppo": {"robots": 16, "steps": 4, "slices": 4, "epochs": 1, "minibatch": 32, "lag": 1, "learning_rate": 0.05}}


def recipe(**changes) -> Recipe:
    settings = {
        "task": "push",
        "layout": "push",
        "physics": "real",
        "episode_s": 0.1,
        "samples": 4 * SAMPLES,
        "checkpoint_minutes": 1e-9,
        "networks": {"actor": (8,), "critic": (8,), "privileged": True},
        "ppo": {"robots": 16, "steps": 4, "slices": 4, "epochs": 1, "minibatch": 32},
        "evaluation": {"every_samples": 10_000, "trials": 2, "final_trials": 0},
    }
    return Recipe.model_validate(settings | changes)


def learned(folder, workers, **changes) -> Run:
    folder.mkdir(exist_ok=True)
    run = Run("mine", recipe(**changes), folder, threads=1, workers=workers, tell=lambda _: None)
    run.learn()
    return run


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> Run:
    """Without workers, one update after the rollouts of another."""
    return learned(tmp_path_factory.mktemp("undisturbed") / "run", 0)


@pytest.fixture(scope="module")
def behind(tmp_path_factory) -> Run:
    """Without workers, rollouts one update behind."""
    return learned(tmp_path_factory.mktemp("behind") / "run", 0, **BEHIND)


def weights(run: Run) -> np.ndarray:
    return np.concatenate([values.numpy().ravel() for values in run.policy.state_dict().values()])


def test_the_same_bits_for_any_number_of_workers_and_after_a_checkpoint(tmp_path, undisturbed):
    """Here with four; with two where they are killed, and with one where the learner is."""
    runs = {0: undisturbed} | {workers: learned(tmp_path / str(workers), workers) for workers in (4,)}
    for run in runs.values():
        np.testing.assert_array_equal(weights(run), weights(runs[0]))
        assert run.returns.mean == runs[0].returns.mean
        assert account(run.folder).adds_up and account(run.folder).used == 4 * SAMPLES
    learned(tmp_path / "half", 0, samples=2 * SAMPLES)
    other = Run("mine", recipe(), tmp_path / "half", threads=1, workers=2, tell=lambda _: None)
    other.go_on()
    other.learn()
    assert account(other.folder).adds_up and account(other.folder).used == 4 * SAMPLES
    document = runs[4].record()["workers"]
    assert document["used"] == 4 * SAMPLES and document["dropped"] == {} and document["lag_updates"] == 0
    assert 0 < document["learner_idle_share"] < 1 and document["moved_bytes_per_sample"] > 0
    without = Run("mine", recipe(), tmp_path / "half", threads=1, tell=lambda _: None)
    with pytest.raises(ValueError, match="was begun with --workers"):
        without.go_on()


def test_whoever_has_a_slice_goes_on_from_its_state_not_from_what_it_did_before():
    first, second = (RolloutWorker(recipe(), 4) for _ in range(2))
    weights = {name: values.numpy().copy() for name, values in first._policy.state_dict().items()}
    first(Order(1, 0), None)  # looks around; the other one has the slice in the next iterations
    state = pickle.loads(pickle.dumps(second(Order(1, 0), weights).state))
    for iteration in (1, 2):
        ours, theirs = (worker(Order(1, iteration, state), weights) for worker in (first, second))
        assert ours.columns is not None and theirs.columns is not None
        for name, values in theirs.columns.items():
            np.testing.assert_array_equal(ours.columns[name], values, err_msg=name)
        state = theirs.state


def test_workers_that_are_killed_change_no_bit_and_their_samples_are_accounted_for(tmp_path, monkeypatch, undisturbed):
    folder = tmp_path / "killed"
    folder.mkdir()
    run = Run("mine", recipe(), folder, threads=1, workers=2, tell=lambda _: None)
    killed = 0
    collect = run.slices.collect

    def kill_then_collect(buffer):
        nonlocal killed
        if run.iterations in (1, 2):
            os.kill(run.slices.collector.workers.pids[run.iterations - 1], signal.SIGKILL)
            killed += 1
        collect(buffer)

    monkeypatch.setattr(run.slices, "collect", kill_then_collect)
    run.learn()
    np.testing.assert_array_equal(weights(run), weights(undisturbed))
    found = account(folder)
    assert killed == 2 and found.adds_up and found.used == 4 * SAMPLES
    assert found.dropped == {WORKER_LOST: 2 * SAMPLES // 4}
    assert run.record()["workers"]["workers_lost"] == 2


def test_a_learner_that_is_killed_goes_on_from_its_checkpoint_with_the_same_bits(tmp_path, undisturbed):
    folder = tmp_path / "killed"
    learned(folder, 0, samples=2 * SAMPLES)
    Ledger(folder, 1).write("asked", 2, SAMPLES)  # and then it was killed
    Ledger(folder, 1).write("used", 2, SAMPLES)
    Ledger(folder, 1).write("asked", 3, SAMPLES)
    again = Ledger.of_next_start(folder)  # and once more before its next checkpoint, while a line was written
    again.write("started", 2)
    again.write("asked", 2, SAMPLES)
    again.write("used", 2, SAMPLES)
    with (folder / LEDGER).open("a") as file:
        file.write('{"start": 2, "what": "ask')
    run = Run("mine", recipe(), folder, threads=1, workers=1, tell=lambda _: None)
    run.go_on()
    run.learn()
    np.testing.assert_array_equal(weights(run), weights(undisturbed))
    found = account(folder)
    assert found.adds_up and found.used == 4 * SAMPLES and found.dropped == {LEARNER_ENDED: 3 * SAMPLES}
    assert run.record()["starts"] == 3
    assert Ledger.of_next_start(tmp_path, least=3).start == 3, "the ledger is gone, and the checkpoint knows of two"


def test_rollouts_that_run_ahead_of_updates_are_the_same_bits_for_any_number_of_workers_and_after_a_checkpoint(tmp_path, behind):
    runs = {0: behind} | {workers: learned(tmp_path / str(workers), workers, **BEHIND) for workers in (2,)}
    for run in runs.values():
        np.testing.assert_array_equal(weights(run), weights(runs[0]))
        assert account(run.folder).adds_up and account(run.folder).dropped == {}
        document = run.record()["workers"]
        assert document["lag_updates"] == 0.75, "three iterations of four are one update behind"
        assert document["importance_weight"] != 1.0 and 0 < document["weights_limited_share"] < 1
    folder = tmp_path / "ended"
    folder.mkdir()
    ended = Run("mine", recipe(**BEHIND), folder, threads=1, workers=1, tell=lambda _: None)

    def keep():
        Run.keep(ended)
        if ended.iterations == 2:
            raise KeyboardInterrupt

    ended.keep = keep
    with pytest.raises(KeyboardInterrupt):
        ended.learn()
    other = Run("mine", recipe(**BEHIND), folder, threads=1, workers=2, tell=lambda _: None)
    other.go_on()
    other.learn()
    np.testing.assert_array_equal(weights(other), weights(runs[0]))
    assert account(folder).adds_up and account(folder).dropped == {LEARNER_ENDED: SAMPLES}, "what was under way"


def test_a_run_ahead_that_is_stopped_goes_on_one_update_behind_with_the_same_bits(tmp_path, monkeypatch, behind):
    """Stopped while it rolls out, so that nothing is under way; and again before it has gone on; and by its samples."""

    def went_on(workers: int) -> Run:
        run = Run("mine", recipe(**BEHIND), folder, threads=1, workers=workers, tell=lambda _: None)
        run.go_on()
        return run

    folder = tmp_path / "stopped"
    folder.mkdir()
    run = Run("mine", recipe(**BEHIND), folder, threads=1, workers=1, tell=lambda _: None)
    collect = run.slices.collect

    def collect_then_stop(buffer):
        collect(buffer)
        if run.iterations == 1:
            run.stop()

    monkeypatch.setattr(run.slices, "collect", collect_then_stop)
    run.learn()
    run.keep()
    assert run.samples == 2 * SAMPLES
    at_once = went_on(0)
    at_once.stop()
    at_once.learn()
    at_once.keep()
    last = went_on(2)
    last.learn()
    np.testing.assert_array_equal(weights(last), weights(behind))
    assert account(folder).adds_up and account(folder).dropped == {}, "nothing was under way"
    assert last.record()["workers"]["lag_updates"] == 0.75

    folder = tmp_path / "shorter"
    learned(folder, 0, samples=2 * SAMPLES, **BEHIND).keep()
    longer = went_on(0)
    longer.learn()
    np.testing.assert_array_equal(weights(longer), weights(behind))


def test_a_worker_that_is_killed_while_rollouts_run_ahead_changes_no_bit(tmp_path, monkeypatch, behind):
    folder = tmp_path / "killed"
    folder.mkdir()
    run = Run("mine", recipe(**BEHIND), folder, threads=1, workers=2, tell=lambda _: None)
    ahead = run.slices.ahead

    def ahead_then_kill():
        ahead()
        if run.iterations == 1:
            os.kill(run.slices.collector.workers.pids[0], signal.SIGKILL)

    monkeypatch.setattr(run.slices, "ahead", ahead_then_kill)
    run.learn()
    np.testing.assert_array_equal(weights(run), weights(behind))
    assert account(folder).adds_up and account(folder).used == 4 * SAMPLES


@pytest.mark.parametrize(
    ("changes", "why"),
    [({"networks": {"memory": 4}}, "networks.memory"), ({"ppo": {"robots": 18, "steps": 4, "minibatch": 36}}, "must divide")],
)
def test_what_does_not_go_with_workers_says_so(tmp_path, changes, why):
    with pytest.raises(ValueError, match=why):
        Run("mine", recipe(**changes), tmp_path, workers=1)


def test_without_workers_nothing_is_behind_and_a_recipe_that_wants_it_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"ppo\.lag is about rollouts of workers; give --workers"):
        Run("mine", recipe(**BEHIND), tmp_path)
