"""What made a result is told by content: of the ranges and of the code, not by names or words."""

import re

import pytest

from api_schemas.physics import NAMED_PHYSICS
from experiments.provenance import code_digest, made_by, ranges_digest
from sim_backend.effects.ranges import PRESET_NAMES

RANGES = """about = "{about}"
[[range]]
key = "cube_size.factor"
distribution = "uniform"
low = 0.9
high = {high}
per = "robot"
each = false
source = "{about}"
dated = 2025-01-01
"""


def test_every_physics_has_a_digest_of_its_own():
    digests = {ranges_digest(physics) for physics in PRESET_NAMES}
    assert len(digests) == len(PRESET_NAMES) and all(re.fullmatch("[0-9a-f]{16}", digest) for digest in digests)


def test_ranges_are_told_by_their_content_not_by_words(tmp_path):
    digests = []
    for number, (about, high) in enumerate([("one", 1.1), ("other words", 1.1), ("one", 1.2)]):
        path = tmp_path / f"{number}.toml"
        path.write_text(RANGES.format(about=about, high=high))
        digests.append(ranges_digest(str(path)))
    assert digests[0] == digests[1] != digests[2]


CODE = '''"""A docstring."""
# a comment
def step(x):
    """Another."""
    return f"{x + 1}"
'''


def digest_of(folder, text):
    folder.mkdir()
    (folder / "part").mkdir()
    (folder / "part" / "step.py").write_text(text)
    return code_digest((folder,))


def test_code_is_told_by_what_it_does_not_by_comments_and_docstrings(tmp_path):
    digest = digest_of(tmp_path / "a", CODE)
    assert digest == digest_of(tmp_path / "b", CODE.replace("a comment", "another").replace("Another.", "One.\\n\\n    More."))
    assert digest != digest_of(tmp_path / "c", CODE.replace("x + 1", "x + 2"))
    assert digest != digest_of(tmp_path / "d", CODE.replace("def step", "def stepped"))


def test_code_that_only_learns_or_diagnoses_is_not_of_a_trial(tmp_path):
    digest = digest_of(tmp_path / "a", CODE)
    (tmp_path / "a" / "training").mkdir()
    (tmp_path / "a" / "training" / "run.py").write_text("x = 1\n")
    assert code_digest((tmp_path / "a",)) == digest
    (tmp_path / "a" / "part" / "more.py").write_text("x = 1\n")
    assert code_digest((tmp_path / "a",)) != digest


@pytest.mark.parametrize("physics", NAMED_PHYSICS)
def test_all_that_is_kept_says_nothing_of_the_machine(physics):
    told = made_by(physics)
    assert list(told) == ["trifarm", "mujoco", "code", f"physics {physics}"]
    assert "/" not in "".join(told.values()) and told == made_by(physics)
