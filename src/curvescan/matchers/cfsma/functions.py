"""CF-SMA2 (a): curvature functions paired in the Fourier domain (section 2.2, eq. 6).

A person who moved or an object that left the view has no partner and takes no part in the pose: this is
where dynamic objects drop out.
"""

import numpy as np
from numpy.typing import NDArray

from curvescan._jit import kernel
from curvescan.matchers.cfsma.config import FunctionsConfig
from curvescan.types import Floats, Ints

MOST_FUNCTIONS = 2000
"""Functions of a scan that are compared, the longest; a scan of 361 beams has 72 at the most."""

_BLOCK = 1 << 20
"""Complex numbers of products of spectra held at once."""

_FLAT = 1e-9
"""Total turning, radians, under which a function is zero but for rounding: it has no shape to compare."""


def spectra(eta: Floats, starts: Ints, stops: Ints, length: int) -> NDArray[np.complex128]:
    """Return the spectrum of each curvature function, at a common length and of unit energy (eq. 6).

    The functions are brought to the common length by resampling their running sum: each of the `length` samples is
    the turning within its share of the segment, so that a corner one reading wide is neither missed nor doubled.

    Departure: each function is divided by its norm, so that the correlation of eq. 6 lies in [-1, 1] and U_c means
    the same for a long and a short, a strong and a weak function.

    eta (m,); starts, stops (s,); result (s, length // 2 + 1).
    """
    return np.fft.rfft(_resample(eta, starts, stops, length), axis=1)


def correlations(spectra_cur: NDArray[np.complex128], spectra_ref: NDArray[np.complex128], length: int) -> Floats:
    """Return the best circular correlation over all lags of every pair of functions (eq. 6).

    spectra_cur (s, length // 2 + 1); spectra_ref (t, length // 2 + 1); result (s, t): upsilon_ij in [-1, 1].
    """
    upsilon = np.zeros((len(spectra_cur), len(spectra_ref)))
    if upsilon.size == 0:
        return upsilon
    conjugate = np.conj(spectra_ref)[np.newaxis, :, :]
    n_rows = max(_BLOCK // spectra_ref.size, 1)
    for first in range(0, len(spectra_cur), n_rows):
        rows = slice(first, first + n_rows)
        products = spectra_cur[rows, np.newaxis, :] * conjugate
        upsilon[rows] = np.fft.irfft(products, n=length, axis=2).max(axis=2)
    return upsilon


def pair_longest(
    spectra_cur: NDArray[np.complex128],
    lengths_cur: Ints,
    spectra_ref: NDArray[np.complex128],
    lengths_ref: Ints,
    config: FunctionsConfig,
) -> tuple[tuple[Ints, Ints], Floats]:
    """Return the pairs of functions and their correlations, of the longest MOST_FUNCTIONS of each scan.

    The bound is for hostile or broken scans: 100,000 beams of noise fall into 20,000 functions, and a table of all
    pairs would take gigabytes.

    spectra_cur, spectra_ref (s, length // 2 + 1); lengths_cur, lengths_ref (s,); pairs ((p,) int64, (p,) int64);
    correlation (p,).
    """
    cur, ref = _longest(lengths_cur), _longest(lengths_ref)
    upsilon = correlations(spectra_cur[cur], spectra_ref[ref], config.length)
    rows, cols = pair_functions(upsilon, config)
    return (cur[rows], ref[cols]), upsilon[rows, cols]


def _longest(lengths: Ints) -> Ints:
    """Return the indices of the longest functions, ascending."""
    if lengths.size <= MOST_FUNCTIONS:
        return np.arange(lengths.size)
    return np.sort(np.argsort(-lengths, kind="stable")[:MOST_FUNCTIONS])


def pair_functions(upsilon: Floats, config: FunctionsConfig) -> tuple[Ints, Ints]:
    """Return the pairs of functions: the best pair, then the best of what is left, down to U_c.

    The best pair of all is the best of its row and of its column, so that no order of rows favours a function; each
    function is used once.

    upsilon (s, t); cur_idx, ref_idx (p,).
    """
    flat = upsilon.ravel()
    candidates = np.flatnonzero(flat >= config.min_correlation)
    candidates = candidates[np.argsort(-flat[candidates], kind="stable")]
    return _take_once(candidates, *upsilon.shape)


@kernel
def _resample(eta: Floats, starts: Ints, stops: Ints, length: int) -> Floats:
    """Return (s, length) functions of unit norm: differences of the running sum at equal shares."""
    functions = np.zeros((starts.size, length))
    for s in range(starts.size):
        n = stops[s] - starts[s]
        step = n / length
        total = 0.0  # running sum of eta over whole readings before `i`
        i = starts[s]
        before = 0.0
        energy = 0.0
        turning = 0.0
        for j in range(length):
            at = starts[s] + (j + 1) * step
            while i + 1 <= at and i < stops[s]:
                total += eta[i]
                i += 1
            partial = eta[i] * (at - i) if i < stops[s] else 0.0
            value = total + partial - before
            before = total + partial
            functions[s, j] = value
            energy += value * value
            turning += abs(value)
        scale = 1.0 / np.sqrt(energy) if turning > _FLAT else 0.0
        for j in range(length):
            functions[s, j] *= scale
    return functions


@kernel
def _take_once(candidates: Ints, n_rows: int, n_cols: int) -> tuple[Ints, Ints]:
    """Return rows and columns of the flat indices, in order, skipping a row or column already used."""
    rows = np.empty(min(n_rows, n_cols), dtype=np.int64)
    cols = np.empty(min(n_rows, n_cols), dtype=np.int64)
    row_used = np.zeros(n_rows, dtype=np.bool_)
    col_used = np.zeros(n_cols, dtype=np.bool_)
    n = 0
    for candidate in candidates:
        row = candidate // n_cols
        col = candidate - row * n_cols
        if row_used[row] or col_used[col]:
            continue
        row_used[row] = True
        col_used[col] = True
        rows[n] = row
        cols[n] = col
        n += 1
    return rows[:n], cols[:n]
