"""How much of two masks is common to both."""

import numpy as np


def iou(masks: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Intersection over union of [..., height, width] bool and as many others: [...]; 0 of none."""
    both = (masks & others).sum(axis=(-2, -1))
    either = (masks | others).sum(axis=(-2, -1))
    return both / np.maximum(either, 1)


def mean_iou(masks: np.ndarray, others: np.ndarray) -> float:
    """Their IoU, averaged over the views [views, height, width]."""
    return float(iou(masks, others).mean())
