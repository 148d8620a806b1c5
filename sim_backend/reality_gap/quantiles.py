"""Quantiles of the normal distribution, each of them here and nowhere else."""

import numpy as np

Z_90 = 1.6448536269514722
"""Half of a 90 % interval, in standard deviations; Z_95 and Z_99 alike."""
Z_95 = 1.959963984540054
Z_99 = 2.5758293035489004
MEDIAN_SIZE = 0.6744897501960817
"""Median of the size of one number, in standard deviations: a median absolute deviation over this is a standard deviation."""
MEDIAN_SQUARE = MEDIAN_SIZE**2
"""Median of its square, in variances."""
MEDIAN_LENGTH_OF_TWO = float(np.sqrt(2.0 * np.log(2.0)))
"""Median length of two independent numbers, in standard deviations of one."""
