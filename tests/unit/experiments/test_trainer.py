"""Trainings side by side: stopped in the middle and gone on with, they leave the same files, and none is done twice."""

import os
import signal
import subprocess
import sys
import threading
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from experiments import trainer
from experiments.design import Start
from experiments.plan import TrainingPiece, missing
from experiments.recipe_files import write_recipe
from experiments.result_files import StoreError
from experiments.trainer import TrainingFailedError, train_all
from sim_backend.folder_lock import taken
from tests.unit.experiments.small import SMALL, leave_training, store_of

BEGUN = {"task": "push", "layout": "push", "samples": 10}
SLEEPS = "import time; time.sleep(60)"


def leave_checkpoint(folder, weight=0.0, seconds=1.0):
    """As the training program leaves one, as far as it counts here."""
    torch = pytest.importorskip("torch", reason="the extra 'learning' is not installed")
    tensors = {"actor": torch.full((3, 2), weight), "critic": torch.ones(5)}
    folder.mkdir(parents=True, exist_ok=True)
    torch.save({"policy": tensors, "run": [7, seconds, 0, 1]}, folder / "checkpoint.pt")


class Trainings:
    """Processes in place of the training program, which do at once what they are told to."""

    def __init__(self, store, monkeypatch):
        self.store, self.begun, self.resumed, self.hang, self.fail = store, [], [], None, None
        monkeypatch.setattr(trainer, "_child", self.child)
        monkeypatch.setattr(trainer, "POLL_EVERY_S", 0.01)

    def child(self, module, arguments, log):
        folder, stem = log.parent, Path(arguments[0]).stem
        assert module == "sim_backend.training" and (folder / f"{stem}.toml").exists()
        self.begun.append(stem)
        self.resumed += [stem] if "--resume" in arguments else []
        leave_checkpoint(folder)
        log.write_text("what it said last\n")
        if stem == self.hang:
            return subprocess.Popen([sys.executable, "-c", SLEEPS])
        if stem == self.fail:
            return subprocess.Popen([sys.executable, "-c", "import sys; sys.exit(3)"])
        leave_training(folder, stem)
        return subprocess.Popen([sys.executable, "-c", ""])


@pytest.fixture
def trainings(tmp_path, monkeypatch):
    return Trainings(store_of(tmp_path), monkeypatch)


def train(made, goes_on=lambda: True, jobs=2):
    left = [piece for piece in missing(SMALL, made.store) if isinstance(piece, TrainingPiece)]
    return train_all(left, made.store, jobs=jobs, goes_on=goes_on, tell=lambda _: None)


def kept(made):
    return sorted(path.name for path in (made.store.folder / "runs").iterdir())


def test_killed_in_the_middle_and_gone_on_with_the_same_files_are_there(trainings, tmp_path, monkeypatch):
    def interrupted():
        if len(trainings.begun) == 3:
            raise KeyboardInterrupt
        return True

    trainings.hang = "other-seed1"
    with pytest.raises(KeyboardInterrupt):
        train(trainings, interrupted)
    first = {name: (trainings.store.folder / "runs" / name).read_bytes() for name in kept(trainings)}
    assert [name for name in first if name.endswith("1.json")] == ["first-seed1.json"]
    before, trainings.hang = list(trainings.begun), None
    assert train(trainings)
    assert "first-seed1" not in trainings.begun[len(before) :], "what is finished is not done again"
    assert "other-seed1" in trainings.resumed
    assert all((trainings.store.folder / "runs" / name).read_bytes() == content for name, content in first.items())
    undisturbed = Trainings(store_of(tmp_path / "another"), monkeypatch)
    assert train(undisturbed)
    assert kept(trainings) == kept(undisturbed)
    assert len([name for name in kept(trainings) if name.endswith("seed1.json") or name.endswith("seed2.json")]) == 4


def test_when_the_time_is_over_what_runs_is_finished_and_nothing_begun(trainings):
    assert not train(trainings, goes_on=lambda: len(trainings.begun) < 1, jobs=1)
    assert trainings.begun == ["first-seed1"]
    assert trainings.store.run(SMALL.cells[0], 1) is not None


def test_one_that_fails_is_told_with_its_last_words_and_ends_the_others(trainings):
    trainings.fail, trainings.hang = "first-seed1", "first-seed2"
    with pytest.raises(TrainingFailedError, match=r"first, seed 1 ended with code 3[\s\S]*said last"):
        train(trainings)
    assert trainings.store.run(SMALL.cells[0], 1) is None


def test_demonstrations_are_recorded_once_and_cut_to_the_count(tmp_path, monkeypatch):
    from experiments.catalogue import CATALOGUE
    from sim_backend.training.demonstrations.recording import read_demonstrations

    experiment = CATALOGUE["demonstrations"]
    store = store_of(tmp_path, experiment)
    shown = replace(experiment.cell("demonstrations-25").training.demonstrations, count=2)
    path = trainer._demonstrations(shown, store, lambda _: None)
    found = read_demonstrations(path)
    assert len(found.first) == 2 and len(found.observation) == 2 * 750
    monkeypatch.setattr(trainer, "_child", None)
    assert trainer._demonstrations(shown, store, lambda _: None) == path


def test_other_demonstrations_are_another_file(tmp_path, monkeypatch):
    from experiments.catalogue import CATALOGUE

    store = store_of(tmp_path, CATALOGUE["demonstrations"])
    shown, recorded = CATALOGUE["demonstrations"].cell("demonstrations-25").training.demonstrations, []
    monkeypatch.setattr(trainer, "_await", lambda *_: None)
    monkeypatch.setattr(trainer, "cut", lambda _recorded, _count, wanted: (recorded.append(wanted), wanted.write_text("")))
    for each in (shown, shown, replace(shown, noise=0.1), replace(shown, physics="real"), replace(shown, count=7)):
        trainer._demonstrations(each, store, lambda _: None)
    assert len(set(recorded)) == len(recorded) == 4
    assert recorded[0].name == "push-scratch-25.demonstrations", "as the first results name it"


def test_a_checkpoint_of_another_recipe_is_refused_before_anything_is_trained(trainings, monkeypatch):
    trainings.fail = "other-seed2"
    with pytest.raises(TrainingFailedError):
        train(trainings)
    recipe = trainings.store.training_folder(SMALL.cells[1], 2) / "other-seed2.toml"
    recipe.write_text(recipe.read_text().replace("approach = 1000.0", "approach = 5.0"))
    trainings.begun.clear()
    with pytest.raises(
        StoreError, match=r"checkpoint of another recipe: reward\.approach was 5\.0 and is 1000\.0; move the folder"
    ):
        train(trainings)
    assert trainings.begun == []


def test_a_checkpoint_with_other_reduced_ranges_is_refused(trainings):
    piece = TrainingPiece(SMALL.cells[0], 1, 1.0)
    for without in (("cube_mass",), ("cube_size",)):
        training = replace(piece.cell.training, without=without)
        piece = replace(piece, cell=replace(piece.cell, training=training))
        folder = trainings.store.training_folder(piece.cell, 1)
        if without == ("cube_mass",):
            write_recipe(training, 1, folder, "first-seed1")
            (folder / "checkpoint.pt").write_text("")
            trainer._check_checkpoint(piece, trainings.store)
    with pytest.raises(StoreError, match=r"reduced-real\.toml has other ranges"):
        trainer._check_checkpoint(piece, trainings.store)


ENDS_TIDILY = """
import signal, sys, time
from pathlib import Path
def tidy(*_):
    Path(sys.argv[1]).write_text("tidy")
    sys.exit(130)
signal.signal(signal.SIGINT, tidy)
Path(sys.argv[1]).write_text("begun")
time.sleep(60)
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_while_a_start_is_trained_ends_the_start_too(trainings, tmp_path, monkeypatch, number):
    processes, mark = [], tmp_path / "mark"

    def child(*_):
        processes.append(subprocess.Popen([sys.executable, "-c", ENDS_TIDILY, str(mark)]))
        return processes[-1]

    def stop():
        while not mark.exists() or mark.read_text() != "begun":
            time.sleep(0.02)
        os.kill(os.getpid(), number)

    monkeypatch.setattr(trainer, "_child", child)
    before = signal.signal(number, signal.default_int_handler)
    try:
        threading.Thread(target=stop).start()
        with pytest.raises(KeyboardInterrupt):
            trainer._trained_start(Start("begun", BEGUN, 1.0), trainings.store, lambda _: None)
    finally:
        signal.signal(number, before)
        code = processes[0].poll()
        processes[0].kill()
        processes[0].wait()
    assert code == 130 and mark.read_text() == "tidy"


def test_a_start_that_another_experiment_trains_is_waited_for(trainings):
    start, told = Start("begun", BEGUN, 1.0), []
    folder = trainings.store.start_folder(start)
    with taken(folder, "training begun", ""):
        waiting = threading.Thread(target=lambda: trainer._trained_start(start, trainings.store, told.append))
        waiting.start()
        while not told:
            time.sleep(0.01)
        assert f"process {os.getpid()}" in told[0] and "waiting for its end" in told[0]
        (folder / "record.json").write_text("{}")
    waiting.join(120)
    assert not waiting.is_alive() and trainings.begun == [], "it was trained once"


def test_a_start_is_trained_once_and_given_to_every_run_that_goes_on_from_it(trainings, monkeypatch):
    start, training = Start("begun", BEGUN, 1.0), SMALL.cells[0].training
    made = [trainer._trained_start(start, trainings.store, lambda _: None) for _ in range(2)]
    assert made[0] == made[1] and trainings.begun == ["begun"]
    assert tomllib.loads((made[0] / "begun.toml").read_text()) == BEGUN | {"seed": 1}
    recipe = write_recipe(replace(training, start=start), 1, made[0], "mine", begun_with=made[0])
    assert tomllib.loads(recipe.read_text())["warm_start"] == {"run": str(made[0])}
    other = trainer._trained_start(replace(start, recipe=BEGUN | {"task": "lift"}), trainings.store, lambda _: None)
    assert other != made[0] and trainings.begun == ["begun", "begun"], "another recipe is another start"


def begun(start):
    """The small experiment, its first cell going on from a start."""
    first, other = SMALL.cells
    return replace(SMALL, cells=(replace(first, training=replace(first.training, start=start)), other))


def test_the_digest_of_weights_is_of_all_networks_and_not_of_the_time_that_they_took(tmp_path):
    digests = []
    for at, how in enumerate(({}, {"seconds": 9.0}, {"weight": 1e-7})):
        leave_checkpoint(tmp_path / str(at), **how)
        digests.append(trainer.weights_digest(tmp_path / str(at) / "checkpoint.pt"))
    assert digests[0] == digests[1] != digests[2]


def test_a_run_keeps_what_made_it_and_the_weights_that_it_began_with(tmp_path, monkeypatch):
    start = Start("begun", BEGUN, 1.0)
    made = Trainings(store_of(tmp_path, begun(start)), monkeypatch)
    monkeypatch.setattr(trainer, "trained_by", lambda: {"code": "a" * 16})
    made.hang = "first-seed2"
    pieces = [piece for piece in missing(made.store.experiment, made.store) if isinstance(piece, TrainingPiece)]

    def interrupted():
        if made.store.run(made.store.experiment.cells[0], 1) is not None:
            raise KeyboardInterrupt
        return True

    with pytest.raises(KeyboardInterrupt):
        train_all(pieces, made.store, jobs=2, goes_on=interrupted, tell=lambda _: None)
    monkeypatch.setattr(trainer, "trained_by", lambda: {"code": "b" * 16})
    made.hang = None
    assert train_all(pieces[1:], made.store, jobs=1, goes_on=lambda: True, tell=lambda _: None)
    first, other = made.store.experiment.cells
    digest = trainer.weights_digest(made.store.start_folder(start) / "checkpoint.pt")
    of_first, resumed, of_other = (made.store.run(cell, seed) for cell, seed in ((first, 1), (first, 2), (other, 1)))
    assert (of_first["made_by"], of_first["begun_with"]) == ([{"code": "a" * 16}], digest)
    assert (resumed["made_by"], resumed["begun_with"]) == ([{"code": "a" * 16}, {"code": "b" * 16}], digest)
    assert (of_other["made_by"], of_other["begun_with"]) == ([{"code": "b" * 16}], None)
    assert made.store.begun_with() == {"begun": digest}


def test_a_start_with_other_weights_than_the_kept_runs_began_with_is_refused_before_anything_is_trained(tmp_path, monkeypatch):
    start = Start("begun", BEGUN, 1.0)
    made = Trainings(store_of(tmp_path, begun(start)), monkeypatch)
    pieces = [piece for piece in missing(made.store.experiment, made.store) if isinstance(piece, TrainingPiece)]
    assert train_all(pieces[:1], made.store, jobs=1, goes_on=lambda: True, tell=lambda _: None)
    made.begun.clear()
    leave_checkpoint(made.store.start_folder(start), weight=1e-7)
    sentence = (
        r"has another training of begun \(digest \w+\) than that which the runs in .*small went on from \(\w+\); bring that"
    )
    with pytest.raises(StoreError, match=sentence):
        train_all([*pieces[2:], pieces[1]], made.store, jobs=1, goes_on=lambda: True, tell=lambda _: None)
    assert made.begun == [], "nor what has no start"


def test_a_checkpoint_that_began_with_other_weights_is_not_gone_on_with(tmp_path, monkeypatch):
    start = Start("begun", BEGUN, 1.0)
    made = Trainings(store_of(tmp_path, begun(start)), monkeypatch)
    pieces = [piece for piece in missing(made.store.experiment, made.store) if isinstance(piece, TrainingPiece)]
    made.fail = "first-seed1"
    with pytest.raises(TrainingFailedError):
        train_all(pieces[:1], made.store, jobs=1, goes_on=lambda: True, tell=lambda _: None)
    leave_checkpoint(made.store.start_folder(start), weight=1e-7)
    with pytest.raises(StoreError, match=r"checkpoint that began with weights of the digest \w+, while its start has \w+ now"):
        train_all(pieces[:1], made.store, jobs=1, goes_on=lambda: True, tell=lambda _: None)


def test_a_start_has_as_many_threads_on_every_machine(trainings, monkeypatch):
    asked = []
    monkeypatch.setattr(trainer, "cores", lambda: 64)
    monkeypatch.setattr(trainer, "_await", lambda _name, _module, arguments, _log: asked.append(arguments))
    trainer._trained_start(Start("begun", BEGUN, 1.0), trainings.store, lambda _: None)
    assert asked[0][asked[0].index("--threads") + 1] == "2"


def test_a_start_that_fails_is_told_with_its_last_words(trainings):
    trainings.fail = "begun"
    with pytest.raises(TrainingFailedError, match=r"begun ended with code 3[\s\S]*said last"):
        trainer._trained_start(Start("begun", BEGUN, 1.0), trainings.store, lambda _: None)
