"""Eight numbers at a time, against numpy one at a time."""

import numpy as np
from numba import njit

from silmesh.softras.simd import (
    any_nonzero,
    columns,
    exp2,
    load,
    minus_product,
    plus_product,
    rows,
    splat,
    store,
    total,
    where_less,
)


@njit
def apply_exp2(values, out):
    for k in range(0, len(values), 8):
        store(out, k, 4, exp2(load(values, k, 4)))


def test_exp2():
    z = np.linspace(-20, 126, 8 * 10_000, dtype=np.float32)
    out = np.empty_like(z)
    apply_exp2(z, out)
    truth = np.exp2(z.astype(np.float64))
    assert np.abs(out / truth - 1).max() < 2.5e-7


@njit
def write_blocks(image, stride):
    x = splat(np.float32(3)) + columns()
    y = splat(np.float32(5)) + rows()
    store(image, 2, stride, x * splat(np.float32(10)) + y)
    block = load(image, 2, stride)
    store(image, 2 * stride, stride, where_less(x, splat(np.float32(5)), block, x / y))
    store(image, 4 * stride, stride, plus_product(x, x, y) - minus_product(y, x, y))
    zero = splat(np.float32(0))
    return (
        total(block),
        any_nonzero(block),
        any_nonzero(zero),
        any_nonzero(where_less(x, y, x, zero)),
    )


def test_blocks_of_an_image():
    image = np.zeros((6, 9), np.float32)
    sums = write_blocks(image.reshape(-1), 9)
    y, x = np.mgrid[5:7, 3:7].astype(np.float32)
    block = x * 10 + y
    expected = np.zeros((6, 9), np.float32)
    expected[:2, 2:6] = block
    expected[2:4, :4] = np.where(x < 5, block, x / y)
    expected[4:, :4] = (x + x * y) - (y - x * y)
    np.testing.assert_allclose(image, expected, rtol=1e-6)
    assert sums == (block.sum(), True, False, True)
