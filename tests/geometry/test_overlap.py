import numpy as np
import pytest

from silmesh.geometry.overlap import iou, mean_iou


def test_iou_of_each_pair():
    masks, others = np.zeros((2, 3, 4, 5), bool)
    masks[0, :2, :2] = others[0, 1:3, :2] = True  # 2 of 6 pixels
    masks[1] = others[1] = True
    assert iou(masks, others).tolist() == [pytest.approx(1 / 3), 1, 0]  # nothing in either: 0
    assert iou(masks[0], others[0]) == pytest.approx(1 / 3)
    assert mean_iou(masks, others) == pytest.approx(4 / 9)
