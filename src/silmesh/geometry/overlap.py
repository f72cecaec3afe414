"""How much of two masks is common to both."""

import numpy as np


def iou(masks: np.ndarray, others: np.ndarray, known: np.ndarray | None = None) -> np.ndarray:
    """Intersection over union of [..., height, width] bool and as many others: [...]; 0 of none.

    Args:
        known: [..., height, width] bool, the pixels that count; all if not given
    """
    if known is not None:
        masks, others = masks & known, others & known
    both = (masks & others).sum(axis=(-2, -1))
    either = (masks | others).sum(axis=(-2, -1))
    return both / np.maximum(either, 1)


def mean_iou(masks: np.ndarray, others: np.ndarray, known: np.ndarray | None = None) -> float:
    """Their IoU, averaged over the views [views, height, width]."""
    return float(iou(masks, others, known).mean())
