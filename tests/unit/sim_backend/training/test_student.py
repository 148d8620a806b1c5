"""What a student learns from and what it remembers."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra 'learning' is not installed")

from sim_backend.layouts import layout_of  # noqa: E402
from sim_backend.training.demonstrations.recipe import StudentTable  # noqa: E402
from sim_backend.training.demonstrations.samples import Samples  # noqa: E402
from sim_backend.training.demonstrations.student import Student  # noqa: E402


def test_windows_keep_what_was_seen_together():
    samples = Samples(windows=4, window=3, size=2, parts=1, cells=5)
    for value in range(3):
        seen, wanted = torch.full((3, 2, 2), float(value)), torch.full((3, 2, 9), 0.1 * value)
        samples.add(seen + torch.arange(3)[:, None, None] * 10, wanted, torch.full((1, 2, 5), float(value)))
    assert samples.windows == 4 and samples.count == 12  # the first two windows gave way
    seen, wanted, state = samples.draw(np.random.default_rng(0), 300)
    assert seen.shape == (3, 100, 2) and state.shape == (1, 100, 5)
    assert set(seen[0, :, 0].tolist()) == {1.0, 2.0}
    assert torch.equal(seen[2, :, 0], seen[0, :, 0] + 20)
    torch.testing.assert_close(wanted[0, :, 0], 0.1 * seen[0, :, 0])
    assert torch.equal(state[0, :, 0], seen[0, :, 0])


def test_a_student_without_cells_remembers_nothing():
    student = Student(layout_of("push"), StudentTable(hidden=(8,)))
    assert student.nothing(3).shape == (0, 3, 0)
    outputs, state = student.act(np.zeros((3, layout_of("push").observation_size), dtype=np.float32), student.nothing(3))
    assert outputs.shape == (3, 9) and state.shape == (0, 3, 0)
