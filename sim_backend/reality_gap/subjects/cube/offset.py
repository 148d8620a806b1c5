"""Where a tracker sees the cube too far: three numbers, of which the two across the table are read off tables from replays."""

import numpy as np


def best_offset(
    vector: np.ndarray, fine: np.ndarray, ways_x: np.ndarray, ways_y: np.ndarray, height: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """The offset that brings a session nearest to healthy ones.

    What offsets along x and along y do to the numbers is taken as additive, the height as linear, so that the best height follows
    from the other two and all pairs on the grid are looked at.

    Args:
        vector: the session's numbers, of unit covariance where it is healthy, shape (k,).
        fine: offsets on the grid, m, shape (g,).
        ways_x: what each moves along x, shape (g, k).
        ways_y: along y, shape (g, k).
        height: what a metre of height moves, shape (k,); not zero.

    Returns:
        Offset, m, shape (3,), its standard errors, m, shape (3,), and the gain over no offset, nats.
    """
    unit = height / np.linalg.norm(height)
    rest, along_x, along_y = (row - (row @ unit)[..., None] * unit for row in (vector, ways_x, ways_y))
    squares = 2.0 * along_x @ along_y.T
    squares += ((along_x**2).sum(axis=1) - 2.0 * along_x @ rest)[:, None] + ((along_y**2).sum(axis=1) - 2.0 * along_y @ rest)
    i, j = np.unravel_index(int(squares.argmin()), squares.shape)
    z_m = float((vector - ways_x[i] - ways_y[j]) @ height / (height @ height))
    columns = np.stack([_slope(ways_x, fine, int(i)), _slope(ways_y, fine, int(j)), height], axis=1)
    information = columns.T @ columns + 1e-9 * np.diag(np.diag(columns.T @ columns)) + 1e-12 * np.eye(3)
    explained = float(vector @ vector - rest @ rest - squares[i, j])
    return np.array([fine[i], fine[j], z_m]), np.sqrt(np.diag(np.linalg.inv(information))), 0.5 * explained


def _slope(ways: np.ndarray, fine: np.ndarray, k: int) -> np.ndarray:
    left, right = max(k - 1, 0), min(k + 1, len(fine) - 1)
    return (ways[right] - ways[left]) / (fine[right] - fine[left])
