"""How well sets of images explain residuals: Gaussian evidence from normal equations that are kept fold by fold.

Residuals are whitened, so that each row of an equation is a number of unit variance. Everything that is asked later
(which hypothesis gains most on held-out stretches, by how much, how sure) follows from the normal equations alone.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg
from scipy.linalg import lapack

from sim_backend.reality_gap.knowledge.joint_effects import Channel
from sim_backend.reality_gap.quantiles import MEDIAN_SIZE
from sim_backend.reality_gap.subjects.joints.torques.equations import Equation

FOLDS = 10
WHOLE_EPISODES = 5
"""From so many episodes on each is a fold, or part of one, as a whole."""
STRETCH_S = 0.8
"""Folds within one episode are made of stretches of this length, far longer than the noise is correlated."""
WHITE_SHARE = 0.2
"""Of the noise is taken to be white: what slow motion tells is not trusted beyond that, however little noise it seems to have."""
STUDENT_NU = 4.0
WINDOW_ROWS = 16
WINDOW_FLOOR = 0.9
"""Least noise in a window, as a share of what the encoders' white noise makes there."""
ERROR_FLOOR = 0.5
"""Least noise of torque errors, as a share of what the sensors make of them: an autoregression leaves 0.5 to 0.85 of it."""
_FEWEST_ROWS = 20
"""Valid rows for each number that the noise has."""
_AR_ORDER = {Channel.MECHANICS: 4, Channel.VELOCITY: 8, Channel.CURRENT: 0, Channel.CONTROLLER: 0}
_SMALLEST_NOISE = {Channel.MECHANICS: 1e-5, Channel.VELOCITY: 2e-3, Channel.CURRENT: 1e-5, Channel.CONTROLLER: 2e-4}


@dataclass(frozen=True)
class Whitened:
    """An equation whose rows count alike: residual (r,), images (r, m) and fold (r,) of the valid rows; noise in its unit."""

    equation: Equation
    residual: np.ndarray
    images: np.ndarray
    fold: np.ndarray
    noise: float


@dataclass(frozen=True)
class NormalEquations:
    """Sums over rows for each fold: images by images (f, m, m), images by residual (f, m), residual squared (f,), rows (f,)."""

    images: np.ndarray
    cross: np.ndarray
    square: np.ndarray
    rows: np.ndarray

    @property
    def folds(self) -> int:
        """How many."""
        return len(self.square)

    def weighted(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Sums with a weight for each fold, shape (f,)."""
        return np.tensordot(weights, self.images, 1), weights @ self.cross, float(weights @ self.square)


def folds_of(equation: Equation, episodes: int) -> np.ndarray:
    """The fold of each row: whole episodes where there are enough of them, otherwise stretches of one."""
    if episodes >= WHOLE_EPISODES:
        return np.full(len(equation.time_s), equation.episode % FOLDS)
    return (np.floor((equation.time_s - equation.time_s[0]) / STRETCH_S).astype(int) + equation.episode) % FOLDS


def whitened(equation: Equation, scales: np.ndarray, fold: np.ndarray, *, plain: bool = False) -> Whitened | None:
    """Whiten an equation by what is left of it after all its images are fitted; None without enough valid rows.

    Mechanics: white noise of a position is a torque's that grows with the square of the frequency, so residual and images are
    integrated twice over short windows, from any start. Since what happens in a window comes from torques before it, noise that a
    controller feeds back does not look like an effect. Other channels: by an autoregression.

    Args:
        equation: with images of shape (r, m).
        scales: prior standard deviation of each image's coefficient, shape (m,).
        fold: of each row.
        plain: least squares, every row as it is: for values whose errors are then counted as root mean squares.
    """
    if equation.in_windows:
        windows = in_windows(equation, fold)
        if windows is None:
            return None
        y, x, fold = windows
        floor = WINDOW_FLOOR * equation.sensor_noise
    else:
        valid = equation.valid & np.isfinite(equation.residual)
        order = 0 if plain else _AR_ORDER[equation.channel]
        if valid.sum() < _fewest_rows(order):
            return None
        floor = max(_SMALLEST_NOISE[equation.channel], ERROR_FLOOR * equation.error_floor_nm)
        left, _ = left_over(equation.residual[valid], equation.images[valid], scales, floor)
        series = np.zeros(len(valid))
        series[valid] = left
        taps = _autoregression(series, valid, order)
        counted = np.array(valid)
        for lag in range(1, order + 1):
            counted[lag:] &= valid[:-lag]
            counted[:lag] = False
        y, x, fold = _filtered(equation.residual, taps)[counted], _filtered(equation.images, taps)[counted], fold[counted]
    left, noise = left_over(y, x, scales, floor)
    weight = np.sqrt((STUDENT_NU + 1.0) / (STUDENT_NU + (left / noise) ** 2)) / noise
    if plain:
        noise = max(float(np.sqrt(np.mean(left**2))), floor)
        weight = np.full(len(left), 1.0 / noise)
    return Whitened(equation, y * weight, x * weight[:, None], fold, noise)


def is_short(equation: Equation) -> bool:
    """Whether an equation has too few valid rows for a noise of its own."""
    if equation.in_windows:
        return False
    return int((equation.valid & np.isfinite(equation.residual)).sum()) < _fewest_rows(_AR_ORDER[equation.channel])


def least_s(equation: Equation) -> float:
    """How long the rows that count have to last, in all recordings together, for a joint to be judged by such an equation."""
    between_s = float(np.median(np.diff(equation.time_s))) if len(equation.time_s) > 1 else 0.0
    return _fewest_rows(_AR_ORDER[equation.channel]) * between_s


def _fewest_rows(order: int) -> int:
    return _FEWEST_ROWS * (order + 1)


def whitened_together(
    equations: Sequence[Equation], scales: np.ndarray, folds: Sequence[np.ndarray], *, plain: bool = False
) -> list[Whitened]:
    """Whiten equations of one channel and joint, each too short for it, by a noise that they have in common.

    Args:
        equations: one after the other, as if of one episode with pauses.
        scales: prior standard deviations of all terms, shape (m,).
        folds: of each one's rows.
        plain: as of :func:`whitened`.
    """
    terms = sorted({term for equation in equations for term in equation.terms})
    pause = max(_AR_ORDER.values())
    parts: list[list[np.ndarray]] = [[], [], [], []]
    for owner, (equation, fold) in enumerate(zip(equations, folds, strict=True)):
        images = np.zeros((len(equation.residual), len(terms)))
        images[:, [terms.index(term) for term in equation.terms]] = equation.images
        for part, values in zip(parts, (equation.residual, images, equation.valid, fold + FOLDS * owner), strict=True):
            part += [values, np.zeros((pause, *values.shape[1:]), values.dtype)]
    residual, images, valid, fold = (np.concatenate(part) for part in parts)
    one = replace(equations[0], residual=residual, images=images, valid=valid, terms=tuple(terms))
    white = whitened(one, scales[terms], fold, plain=plain)
    if white is None:
        return []
    found = []
    for owner, equation in enumerate(equations):
        own = white.fold // FOLDS == owner
        columns = [terms.index(term) for term in equation.terms]
        found.append(Whitened(equation, white.residual[own], white.images[own][:, columns], white.fold[own] % FOLDS, white.noise))
    return found


def in_windows(equation: Equation, fold: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Residual, images and fold of all whole windows, integrated twice and freed of where each began; None without any."""
    count = len(equation.residual) // WINDOW_ROWS
    used = slice(0, count * WINDOW_ROWS)
    whole = equation.valid[used].reshape(count, WINDOW_ROWS).mean(axis=1) > 1.0 - 1e-9
    if whole.sum() < 4:
        return None
    operator = _window_operator(WINDOW_ROWS)
    y = equation.residual[used].reshape(count, WINDOW_ROWS)[whole] @ operator.T
    x = np.einsum("pr,crm->cpm", operator, equation.images[used].reshape(count, WINDOW_ROWS, -1)[whole], optimize=True)
    folds = np.repeat(fold[used].reshape(count, WINDOW_ROWS)[whole, WINDOW_ROWS // 2], len(operator))
    return y.ravel(), x.reshape(y.size, x.shape[2]), folds


@functools.cache
def _window_operator(rows: int) -> np.ndarray:
    """Twice the sum, and no offset and no slope any more; shape (rows - 2, rows), noise of positions stays white."""
    twice = np.cumsum(np.cumsum(np.eye(rows), axis=0), axis=0)
    line = np.stack([np.ones(rows), np.arange(rows)], axis=1)
    basis = np.asarray(linalg.null_space(line.T))
    return basis.T @ twice


def left_over(y: np.ndarray, x: np.ndarray, scales: np.ndarray, floor: float) -> tuple[np.ndarray, float]:
    """Residual after a fit of all images that is held back by their priors, and its spread (not below ``floor``)."""
    x = x * scales
    noise = max(_spread(y), floor)
    left = y
    gram, cross = x.T @ x, x.T @ y
    for _ in range(4):
        if x.shape[1]:
            _, beta = _solved(gram / noise**2 + np.eye(x.shape[1]), cross / noise**2)
            left = y - x @ beta
        noise = max(_spread(left), floor)
    return left, noise


def _spread(values: np.ndarray) -> float:
    """Standard deviation of the bulk (median absolute deviation, scaled for a normal distribution)."""
    return _median(np.abs(values - _median(values))) / MEDIAN_SIZE


def _median(values: np.ndarray) -> float:
    """As NumPy's of finite numbers, which looks for three places instead of one; NaN of none."""
    half = len(values) // 2
    if not len(values):
        return float("nan")
    parted = np.partition(values, half)
    above = float(parted[half])
    return above if len(values) % 2 else 0.5 * (above + float(parted[:half].max()))


def _solved(square: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lower Cholesky factor of a positive definite matrix, and the solution; what SciPy's checks cost is more than the work.

    Raises:
        numpy.linalg.LinAlgError: the matrix is not positive definite.
    """
    chol, found, info = lapack.dposv(square, right, lower=1)  # pyrefly: ignore[missing-attribute] - its stub names few
    if info != 0:
        raise np.linalg.LinAlgError(f"a matrix of {len(square)} rows is not positive definite")
    return chol, found


def _autoregression(left: np.ndarray, valid: np.ndarray, order: int) -> np.ndarray:
    """Coefficients that predict a series from its past, shape (order,)."""
    if order == 0:
        return np.zeros(0)
    x = np.where(valid, left, 0.0)
    count = np.array([np.sum(valid[lag:] & valid[: len(valid) - lag]) for lag in range(order + 1)])
    r = np.array([x[lag:] @ x[: len(x) - lag] for lag in range(order + 1)]) / np.maximum(count, 1)
    r[0] *= 1.0 + WHITE_SHARE
    return np.asarray(linalg.solve_toeplitz(r[:-1], r[1:]))


def _filtered(series: np.ndarray, taps: np.ndarray) -> np.ndarray:
    out = series.copy()
    for lag, tap in enumerate(taps, start=1):
        out[lag:] -= tap * series[:-lag]
    return out


def of_one_noise(equations: Sequence[Whitened]) -> list[Whitened]:
    """The same with one noise for each joint over all episodes: least squares over all rows, whichever episode they are of."""
    pooled: dict[tuple[Channel, int], list[Whitened]] = {}
    for w in equations:
        pooled.setdefault((w.equation.channel, w.equation.joint), []).append(w)
    found = []
    for of_joint in pooled.values():
        rows = np.array([len(w.residual) for w in of_joint])
        noise = float(np.sqrt(rows @ np.array([w.noise**2 for w in of_joint]) / rows.sum()))
        for w in of_joint:
            by = w.noise / noise
            found.append(replace(w, residual=w.residual * by, images=w.images * by, noise=noise))
    return found


def normal_equations(equations: Sequence[Whitened], terms: int, folds: int) -> NormalEquations:
    """Add up all equations."""
    images, cross = np.zeros((folds, terms, terms)), np.zeros((folds, terms))
    square, rows = np.zeros(folds), np.zeros(folds)
    for w in equations:
        index = np.array(w.equation.terms, dtype=int)
        for fold in range(folds):
            mine = w.fold == fold
            x, y = w.images[mine], w.residual[mine]
            images[fold][np.ix_(index, index)] += x.T @ x
            cross[fold][index] += x.T @ y
            square[fold] += y @ y
            rows[fold] += len(y)
    return NormalEquations(images, cross, square, rows)


@dataclass(frozen=True)
class Reduced:
    """Normal equations from which a base model has been taken out: what is left for other terms to explain."""

    images: np.ndarray
    cross: np.ndarray
    log_evidence: float

    def gain(self, terms: Sequence[int], scales: Sequence[float] | np.ndarray) -> float:
        """Log evidence that some terms add, with priors of the given standard deviations; nats."""
        index, scale = np.array(terms), np.array(scales)
        precision = np.eye(len(index)) + scale[:, None] * self.images[index[:, None], index] * scale
        b = scale * self.cross[index]
        chol, found = _solved(precision, b)
        return float(0.5 * b @ found - np.log(chol.diagonal()).sum())

    def estimate(self, terms: Sequence[int], scales: Sequence[float] | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Posterior mean (d,) and covariance (d, d) of some terms' coefficients."""
        index, scale = np.array(terms), np.array(scales)
        covariance = linalg.inv(self.images[np.ix_(index, index)] + np.diag(1.0 / scale**2))
        return covariance @ self.cross[index], covariance


def reduced(
    sums: tuple[np.ndarray, np.ndarray, float], base: Sequence[int] | np.ndarray, scales: Sequence[float] | np.ndarray
) -> Reduced:
    """Take a base model (terms with the standard deviations of their priors) out of normal equations."""
    images, cross, square = sums
    index, scale = np.array(base, dtype=int), np.array(scales)
    if not len(index):
        return Reduced(images, cross, -0.5 * square)
    precision = np.eye(len(index)) + scale[:, None] * images[np.ix_(index, index)] * scale
    chol = linalg.cholesky(precision, lower=True)
    half = np.asarray(linalg.solve_triangular(chol, scale[:, None] * images[index], lower=True))
    seen = np.asarray(linalg.solve_triangular(chol, scale * cross[index], lower=True))
    evidence = -0.5 * square + 0.5 * seen @ seen - np.log(np.diag(chol)).sum()
    return Reduced(images - half.T @ half, cross - half.T @ seen, float(evidence))
