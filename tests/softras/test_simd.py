"""A block of numbers at a time, against numpy one at a time."""

import numpy as np
from numba import njit

from silmesh.softras.simd import (
    COLUMNS,
    LANES,
    ROWS,
    any_nonzero,
    columns,
    exp2,
    gather,
    load,
    minus_product,
    plus_product,
    rows,
    scatter,
    splat,
    store,
    totals,
    where_less,
)


@njit
def apply_exp2(values, out):
    for k in range(0, len(values), LANES):
        store(out, k, exp2(load(values, k)))


def test_exp2():
    z = np.linspace(-20, 126, 16 * 5_000, dtype=np.float32)
    out = np.empty_like(z)
    apply_exp2(z, out)
    truth = np.exp2(z.astype(np.float64))
    assert np.abs(out / truth - 1).max() < 2.5e-7


@njit
def write_blocks(image, stride):
    x = splat(np.float32(3)) + columns()
    y = splat(np.float32(5)) + rows()
    scatter(image, 2, stride, x * splat(np.float32(10)) + y)
    block = gather(image, 2, stride)
    zero = splat(np.float32(0))
    scatter(image, ROWS * stride, stride, where_less(x, splat(np.float32(5)), block, x / y))
    scatter(image, 2 * ROWS * stride, stride, plus_product(x, x, y) - minus_product(y, x, y))
    return (
        totals(block, zero, x, y, block + block, x + y),
        any_nonzero(block),
        any_nonzero(zero),
        any_nonzero(where_less(x, y, x, zero)),
    )


def test_blocks_of_an_image():
    image = np.zeros((3 * ROWS, 9), np.float32)
    sums = write_blocks(image.reshape(-1), 9)
    y, x = np.mgrid[5 : 5 + ROWS, 3 : 3 + COLUMNS].astype(np.float32)
    block = x * 10 + y
    expected = np.zeros((3 * ROWS, 9), np.float32)
    expected[:ROWS, 2:6] = block
    expected[ROWS : 2 * ROWS, :4] = np.where(x < 5, block, x / y)
    expected[2 * ROWS :, :4] = (x + x * y) - (y - x * y)
    np.testing.assert_allclose(image, expected, rtol=1e-6)
    six = [part.sum() for part in (block, 0 * block, x, y, 2 * block, x + y)]
    assert sums == (tuple(six), True, False, True)
