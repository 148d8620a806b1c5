"""Evidence from normal equations against densities computed directly."""

import numpy as np
import pytest
from scipy import stats

from sim_backend.reality_gap.subjects.joints.torques.equations import Channel, Equation
from sim_backend.reality_gap.subjects.joints.torques.normal_equations import (
    FOLDS,
    STRETCH_S,
    WINDOW_ROWS,
    Reduced,
    Whitened,
    folds_of,
    in_windows,
    left_over,
    normal_equations,
    reduced,
    whitened,
)

ROWS, TERMS = 60, 5
BASE, BASE_SCALES = (1, 4), np.array([0.3, 2.0])


def equation(residual, images=None, terms=(), channel=Channel.CURRENT, **more):
    rows = len(residual)
    images = np.zeros((rows, 0)) if images is None else images
    return Equation(channel, 0, 0, 1e-2 * np.arange(rows), residual, images, terms, np.ones(rows, bool), **more)


@pytest.fixture(scope="module")
def problem():
    rng = np.random.default_rng(1)
    x = rng.standard_normal((ROWS, TERMS))
    y = x @ np.array([0.5, 0.2, 0.0, -0.3, 1.0]) + rng.standard_normal(ROWS)
    half = ROWS // 2
    parts = []  # two equations that know some terms each
    for rows, terms in ((slice(0, half), (4, 1, 0)), (slice(half, ROWS), (0, 1, 2, 3))):
        images = x[rows][:, list(terms)]
        parts.append(Whitened(equation(y[rows], images, terms), y[rows], images, np.arange(half) % 3, 1.0))
        others = [t for t in range(TERMS) if t not in terms]
        x[rows.start : rows.stop, others] = 0.0
    return x, y, parts


def log_likelihood(y, x, terms, scales):
    covariance = np.eye(len(y)) + (x[:, list(terms)] * np.square(scales)) @ x[:, list(terms)].T
    return float(stats.multivariate_normal(np.zeros(len(y)), covariance).logpdf(y))


@pytest.mark.parametrize(("terms", "scales"), [((0,), (0.7,)), ((2,), (0.1,)), ((0, 2, 3), (0.7, 0.1, 3.0))])
def test_a_gain_is_the_difference_of_log_marginal_likelihoods(problem, terms, scales):
    x, y, parts = problem
    sums = normal_equations(parts, TERMS, 3)
    found = reduced(sums.weighted(np.ones(3)), BASE, BASE_SCALES).gain(terms, scales)
    without = log_likelihood(y, x, BASE, BASE_SCALES)
    with_terms = log_likelihood(y, x, (*BASE, *terms), (*BASE_SCALES, *scales))
    assert found == pytest.approx(with_terms - without, abs=1e-9)


def test_evidence_and_estimates_are_those_of_a_gaussian(problem):
    x, y, parts = problem
    left = reduced(normal_equations(parts, TERMS, 3).weighted(np.ones(3)), BASE, BASE_SCALES)
    constant = -0.5 * len(y) * np.log(2 * np.pi)
    assert left.log_evidence == pytest.approx(log_likelihood(y, x, BASE, BASE_SCALES) - constant)
    mean, covariance = left.estimate((0, 3), (0.7, 3.0))
    order, prior = (*BASE, 0, 3), np.array([*BASE_SCALES, 0.7, 3.0])
    more = log_likelihood(y, x, order, prior) - log_likelihood(y, x, BASE, BASE_SCALES)
    assert left.gain((0, 3), (0.7, 3.0)) == pytest.approx(more)
    posterior = np.linalg.inv(x[:, order].T @ x[:, order] + np.diag(prior**-2.0))
    np.testing.assert_allclose(mean, (posterior @ x[:, order].T @ y)[2:], atol=1e-10)
    np.testing.assert_allclose(covariance, posterior[2:, 2:], atol=1e-10)


def test_folds_add_up_and_can_be_left_out(problem):
    x, y, parts = problem
    sums = normal_equations(parts, TERMS, 3)
    kept = np.concatenate([part.fold != 1 for part in parts])
    images, cross, square = sums.weighted(np.array([1.0, 0.0, 1.0]))
    np.testing.assert_allclose(images, x[kept].T @ x[kept])
    np.testing.assert_allclose(cross, x[kept].T @ y[kept])
    assert square == pytest.approx(y[kept] @ y[kept])
    assert sums.rows.sum() == ROWS


def test_windows_make_white_noise_of_positions_white():
    rows = 4 * WINDOW_ROWS
    second_differences = np.diff(np.eye(rows + 2), 2, axis=0)
    impulses = [equation(column, second_differences, in_windows=True) for column in second_differences.T]
    answers = [in_windows(impulse, np.zeros(rows, int)) for impulse in impulses]
    response = np.stack([a[0] for a in answers if a is not None], axis=1)
    assert response.shape == (4 * (WINDOW_ROWS - 2), rows + 2)
    np.testing.assert_allclose(response @ response.T, np.eye(len(response)), atol=1e-10)
    first = answers[0]
    assert first is not None
    np.testing.assert_allclose(first[1], response, atol=1e-12)  # images go the same way


def test_windows_do_not_hear_of_where_and_how_fast_a_motion_began():
    rows = 4 * WINDOW_ROWS
    jumps = np.zeros(rows)
    jumps[::WINDOW_ROWS] = 7.0
    found = in_windows(equation(jumps, in_windows=True), np.zeros(rows, int))
    assert found is not None
    np.testing.assert_allclose(found[0], 0.0, atol=1e-10)


def test_windows_with_a_row_that_does_not_count_are_left_out():
    whole = equation(np.ones(6 * WINDOW_ROWS + 3), in_windows=True)
    whole.valid[WINDOW_ROWS + 2] = False
    fold = np.arange(len(whole.valid)) // WINDOW_ROWS
    found = in_windows(whole, fold)
    assert found is not None
    assert np.unique(found[2]).tolist() == [0, 2, 3, 4, 5]
    whole.valid[: 3 * WINDOW_ROWS] = False
    assert in_windows(whole, fold) is None


def test_whitened_rows_are_of_unit_variance_and_without_memory():
    rng = np.random.default_rng(4)
    noise = rng.standard_normal(6000)
    for i in range(2, len(noise)):
        noise[i] += 1.2 * noise[i - 1] - 0.5 * noise[i - 2]
    images = np.sin(np.arange(6000) / 50.0)[:, None]
    coloured = equation(0.2 * noise + 0.5 * images[:, 0], images, (0,), channel=Channel.VELOCITY)
    white = whitened(coloured, np.array([1.0]), np.zeros(6000, int))
    assert white is not None
    series = white.residual - white.images @ np.linalg.lstsq(white.images, white.residual, rcond=None)[0]
    assert series.std() == pytest.approx(1.0, abs=0.15)
    memory = [series[lag:] @ series[:-lag] / (series @ series) for lag in range(1, 6)]
    # a fifth of the noise is taken to be white, so the first lag keeps about half of its 0.8
    assert 0.2 < memory[0] < 0.5
    assert np.abs(memory[1:]).max() < 0.1
    raw = [noise[lag:] @ noise[:-lag] / (noise @ noise) for lag in range(1, 6)]
    assert np.abs(memory).max() < 0.6 * np.abs(raw).max()


def test_outliers_count_little_but_in_least_squares():
    rng = np.random.default_rng(6)
    y = 0.01 * rng.standard_normal(2000)
    y[::100] += 0.5
    ordinary, plain = (whitened(equation(y), np.zeros(0), np.zeros(2000, int), plain=plain) for plain in (False, True))
    assert ordinary is not None
    assert plain is not None
    assert ordinary.noise == pytest.approx(0.01, rel=0.1)
    assert np.abs(ordinary.residual).max() < 4.0
    assert np.mean(plain.residual**2) == pytest.approx(1.0)
    assert np.ptp(plain.residual / y) < 1e-6


def test_what_is_left_is_free_of_images_within_their_priors():
    rng = np.random.default_rng(7)
    x = rng.standard_normal((500, 2))
    y = x @ [1.0, 1.0] + 0.01 * rng.standard_normal(500)
    left, noise = left_over(y, x, np.array([10.0, 10.0]), 1e-6)
    assert noise == pytest.approx(0.01, rel=0.15)
    held, _ = left_over(y, x, np.array([10.0, 1e-9]), 1e-6)
    assert np.std(left) == pytest.approx(0.01, rel=0.1)
    assert np.corrcoef(held, x[:, 1])[0, 1] > 0.99


def test_folds_are_stretches_of_few_episodes_and_whole_ones_of_many():
    long = equation(np.zeros(3000))
    fold = folds_of(long, 1)
    assert set(fold) == set(range(FOLDS))
    assert np.flatnonzero(np.diff(fold))[0] == round(STRETCH_S / 1e-2) - 1
    assert set(folds_of(long, 5)) == {0}


@pytest.mark.parametrize("count", [1, 2, 61, 62])
def test_noise_is_that_of_the_bulk(count):
    y = np.random.default_rng(count).standard_normal(count) ** 3
    _, noise = left_over(y, np.zeros((count, 0)), np.zeros(0), 0.0)
    assert noise == pytest.approx(stats.median_abs_deviation(y, scale="normal"))


def test_evidence_of_what_is_no_sum_of_squares_is_refused():
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        Reduced(np.array([[-5.0]]), np.zeros(1), 0.0).gain((0,), (1.0,))
